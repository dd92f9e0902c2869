//! What comes from the broker: Home Assistant that starts, what ESPresense's receivers say, and documents of tags that
//! are no more.

use std::collections::HashSet;
use std::sync::Arc;

use rumqttc::{QoS, SubscribeFilterInput};

use super::espresense::Espresense;
use super::home_assistant::{Discovery, ONLINE};
use super::outbox::Outbox;
use super::publisher::forget;
use super::topics::Topics;

/// Takes messages of the broker.
pub(super) struct Inbox {
    pub(super) topics: Topics,
    pub(super) outbox: Arc<Outbox>,
    pub(super) discovery: Option<Discovery>,
    /// The sites of this station.
    pub(super) sites: HashSet<String>,
    pub(super) espresense: Option<Espresense>,
}

impl Inbox {
    /// What to subscribe to.
    pub(super) fn filters(&self) -> Vec<SubscribeFilterInput> {
        let mut filters = vec![SubscribeFilterInput::new(self.topics.all_rooms(), QoS::AtMostOnce).no_local(true)];
        if let Some(discovery) = &self.discovery {
            filters.push(SubscribeFilterInput::new(discovery.status(), QoS::AtLeastOnce));
        }
        if self.espresense.is_some() {
            filters.extend(Espresense::FILTERS.map(|filter| SubscribeFilterInput::new(filter, QoS::AtMostOnce)));
        }
        filters
    }

    /// Takes a message.
    pub(super) async fn take(&mut self, topic: &[u8], payload: &[u8], is_retained: bool) {
        // MQTT's topics are UTF-8; others match none of ours.
        let Ok(topic) = std::str::from_utf8(topic) else { return };
        if let Some(discovery) = &self.discovery
            && topic == discovery.status()
        {
            if payload == ONLINE {
                self.outbox.again_below(discovery.prefix());
            }
        } else if let Some((site, tag)) = self.topics.tag_of_room(topic) {
            // Of an earlier run of this station: the tag was deleted since.
            if is_retained && !payload.is_empty() && self.sites.contains(&site) && !self.outbox.has(topic) {
                forget(&self.outbox, &self.topics, self.discovery.as_ref(), &site, &tag);
            }
        } else if let Some(espresense) = &mut self.espresense {
            espresense.take(topic, payload, is_retained).await;
        }
    }
}
