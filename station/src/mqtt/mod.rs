//! MQTT 5: the station at a broker.
//!
//! | topic | document | |
//! |---|---|---|
//! | `baliza/status` | `online`, `offline` | retained, last will |
//! | `baliza/SITE/tags/TAG/position` | a [`TagPosition`](crate::model::TagPosition), at most one a second | retained |
//! | `baliza/SITE/tags/TAG/room` | `site`, `tag`, `name`, `room`, `zones`, `silent`, `reason`, `supply_v` | retained |
//! | `baliza/SITE/tags/TAG/events` | an [`StationEvent`](crate::model::StationEvent) | QoS 1 |
//! | `baliza/SITE/nodes/NODE/health` | a [`NodeStatus`](crate::model::NodeStatus), each half minute and when it is moved | retained |
//! | `baliza/SITE/nodes/NODE/events` | an [`StationEvent`](crate::model::StationEvent) | QoS 1 |
//! | `homeassistant/device/ID/config` | a device for Home Assistant | retained |
//!
//! `publisher` listens to the hub and fills the `outbox`; `connection` empties it into the broker and gives what comes
//! to the `inbox`, which sends what ESPresense's receivers say to the hub. A broker that is slow or away holds up
//! neither the hub nor the publisher.

mod broker;
mod connection;
pub mod espresense;
mod home_assistant;
mod inbox;
mod outbox;
mod publisher;
mod topics;

use std::collections::HashSet;
use std::sync::Arc;
use std::time::Duration;

use serde::Serialize;
use tokio::sync::watch;
use tokio::task::JoinHandle;

pub use self::broker::{Broker, NoBroker};
use self::connection::Connection;
use self::espresense::{Espresense, House};
use self::home_assistant::Discovery;
use self::inbox::Inbox;
use self::outbox::Outbox;
use self::publisher::Publisher;
pub use self::topics::{NoPrefix, Topics};
use crate::model::{TagStatus, Zone};
use crate::{Hub, SourceReport, Utc};

/// What the station does at its broker.
#[derive(Debug)]
pub struct MqttSettings {
    /// Where it is.
    pub broker: Broker,
    /// The topics.
    pub topics: Topics,
    /// The least time between two positions of a tag.
    pub every: Duration,
    /// Where Home Assistant looks for devices; none: they are not described.
    pub discovery: Option<Topics>,
    /// The house whose ESPresense receivers are at this broker, and its site.
    pub espresense: Option<(House, String)>,
}

impl MqttSettings {
    /// The rooms of the house.
    pub fn zones(&self) -> Vec<Zone> {
        self.espresense.iter().flat_map(|(house, site)| house.zones(site)).collect()
    }

    /// The receivers of the house, as reports.
    pub fn receivers(&self, t: Utc) -> Vec<SourceReport> {
        self.espresense.iter().flat_map(|(house, site)| house.nodes(site, t)).collect()
    }
}

/// A station at its broker.
#[derive(Debug)]
pub struct Mqtt {
    stop: watch::Sender<bool>,
    /// In the order in which they end.
    tasks: [JoinHandle<()>; 2],
}

impl Mqtt {
    /// Starts its tasks. `earlier` are the tags that the store had, `sites` the sites.
    pub fn start(
        hub: &Hub,
        settings: MqttSettings,
        earlier: Vec<TagStatus>,
        sites: impl IntoIterator<Item = String>,
    ) -> Self {
        let MqttSettings { broker, topics, every, discovery, espresense } = settings;
        let outbox = Arc::new(Outbox::default());
        let discovery = discovery.map(|prefix| Discovery::new(&prefix, &topics));
        let (stop, stopped) = watch::channel(false);
        let updates = hub.listen();
        let mut publisher =
            Publisher::new(hub.clone(), outbox.clone(), topics.clone(), discovery.clone(), every, earlier);
        // The inbox forgets what is not here.
        publisher.refresh();
        let inbox = Inbox {
            topics: topics.clone(),
            outbox: outbox.clone(),
            discovery,
            sites: sites.into_iter().collect::<HashSet<_>>(),
            espresense: espresense.map(|(house, site)| Espresense::new(house, site, hub.reports())),
        };
        let connection = Connection { broker, topics, outbox, inbox };
        let (published, is_published) = watch::channel(false);
        let publishing = async move {
            publisher.run(updates, stopped).await;
            published.send_replace(true);
        };
        Self { stop, tasks: [tokio::spawn(publishing), tokio::spawn(connection.run(is_published))] }
    }

    /// Sends what waits, says that the station is offline, and ends.
    pub async fn stop(self) {
        self.stop.send_replace(true);
        for task in self.tasks {
            if let Err(error) = task.await {
                log::error!("mqtt: a task ended: {error}");
            }
        }
    }
}

/// A document. Its types have text keys and finite numbers, which JSON has.
fn json(document: &impl Serialize) -> String {
    serde_json::to_string(document).unwrap_or_else(|error| {
        log::error!("mqtt: {error}");
        String::new()
    })
}
