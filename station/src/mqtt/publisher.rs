//! From the hub to the outbox: what listeners of the hub get becomes documents of topics.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::time::Duration;

use serde::Serialize;
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{broadcast, watch};
use tokio::time::{Instant, MissedTickBehavior, interval};

use super::home_assistant::Discovery;
use super::json;
use super::outbox::Outbox;
use super::topics::Topics;
use crate::model::{EventKind, TagPosition, TagStatus};
use crate::{Hub, Update};

/// How often positions that wait for their time are looked at.
const LOOK: Duration = Duration::from_millis(100);
/// How often the health of nodes is sent.
const HEALTH_EVERY: Duration = Duration::from_secs(30);

/// A tag's room, as its topic has it.
#[derive(Debug, Serialize)]
struct TagRoom<'a> {
    site: &'a str,
    tag: &'a str,
    name: Option<&'a str>,
    room: Option<&'a str>,
    zones: &'a [String],
    silent: bool,
    reason: Option<&'a str>,
    supply_v: Option<f64>,
}

/// What the broker has of a tag.
#[derive(Debug, Default)]
struct Sent {
    /// When the last position went out.
    position: Option<Instant>,
    /// A later one, which waits.
    waiting: Option<TagPosition>,
}

/// Turns updates of the hub into MQTT messages.
pub(super) struct Publisher {
    pub(super) hub: Hub,
    pub(super) outbox: Arc<Outbox>,
    pub(super) topics: Topics,
    pub(super) discovery: Option<Discovery>,
    /// The least time between two positions of a tag.
    pub(super) every: Duration,
    /// The tags that the store had at the start.
    pub(super) earlier: Vec<TagStatus>,
    /// Tags with documents.
    tags: HashMap<(String, String), Sent>,
    /// Nodes with documents.
    nodes: HashSet<(String, String)>,
}

impl Publisher {
    pub(super) fn new(
        hub: Hub,
        outbox: Arc<Outbox>,
        topics: Topics,
        discovery: Option<Discovery>,
        every: Duration,
        earlier: Vec<TagStatus>,
    ) -> Self {
        let (tags, nodes) = (HashMap::new(), HashSet::new());
        Self { hub, outbox, topics, discovery, every, earlier, tags, nodes }
    }

    /// Follows the hub until the station stops.
    pub(super) async fn run(mut self, mut updates: broadcast::Receiver<Update>, mut stop: watch::Receiver<bool>) {
        let mut looks = interval(LOOK);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut health = interval(HEALTH_EVERY);
        health.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                _ = stop.wait_for(|stop| *stop) => break,
                update = updates.recv() => match update {
                    Ok(update) => self.take(update),
                    Err(RecvError::Lagged(missed)) => {
                        self.hub.note_missed(missed);
                        self.refresh();
                    }
                    Err(RecvError::Closed) => break,
                },
                _ = looks.tick() => self.send_waiting(Instant::now()),
                _ = health.tick() => self.send_health(),
            }
        }
        // What has come until now, and what waits for its time, is sent now.
        while let Ok(update) = updates.try_recv() {
            self.take(update);
        }
        self.every = Duration::ZERO;
        self.send_waiting(Instant::now());
    }

    fn take(&mut self, update: Update) {
        match update {
            Update::Position(position) => self.take_position(position, Instant::now()),
            Update::Event(event) => {
                let tag = self.hub.read(|live| live.tag(&event.site, &event.node));
                let of_tag = match event.kind {
                    EventKind::Moved => false,
                    EventKind::LowSupply => tag.is_some(),
                    EventKind::Entered
                    | EventKind::Left
                    | EventKind::Silent
                    | EventKind::Back
                    | EventKind::Uncertain
                    | EventKind::Refusals => true,
                };
                if of_tag {
                    self.outbox.push(self.topics.tag_events(&event.site, &event.node), json(&event));
                    if let Some(tag) = tag {
                        self.send_tag(&tag);
                    }
                } else {
                    self.outbox.push(self.topics.node_events(&event.site, &event.node), json(&event));
                    self.send_health();
                }
            }
            Update::Data(data) => self.outbox.push(self.topics.data(&data.site, &data.tag), json(&data)),
            Update::Changed => self.refresh(),
        }
    }

    fn take_position(&mut self, position: TagPosition, now: Instant) {
        let sent = self.tags.entry((position.site.clone(), position.tag.clone())).or_default();
        if sent.position.is_some_and(|last| now.duration_since(last) < self.every) {
            sent.waiting = Some(position);
            return;
        }
        *sent = Sent { position: Some(now), waiting: None };
        self.outbox.retain(self.topics.position(&position.site, &position.tag), json(&position));
    }

    fn send_waiting(&mut self, now: Instant) {
        for sent in self.tags.values_mut() {
            if sent.position.is_none_or(|last| now.duration_since(last) >= self.every)
                && let Some(position) = sent.waiting.take()
            {
                sent.position = Some(now);
                self.outbox.retain(self.topics.position(&position.site, &position.tag), json(&position));
            }
        }
    }

    /// Brings the documents of all tags and nodes up to date.
    pub(super) fn refresh(&mut self) {
        let mut tags = self.hub.read(crate::LiveState::tags);
        let live: HashSet<_> = tags.iter().map(|tag| (tag.site.clone(), tag.tag.clone())).collect();
        self.earlier.retain(|tag| !live.contains(&(tag.site.clone(), tag.tag.clone())));
        tags.extend(self.earlier.iter().map(|tag| TagStatus { silent: true, ..tag.clone() }));
        let now: HashSet<_> = tags.iter().map(|tag| (tag.site.clone(), tag.tag.clone())).collect();
        for tag in &tags {
            self.send_tag(tag);
            // Of before the start; later ones come as updates.
            let sent = self.tags.entry((tag.site.clone(), tag.tag.clone())).or_default();
            if let Some(position) = tag.last_position.as_ref().filter(|_| sent.position.is_none()) {
                sent.position = Some(Instant::now());
                self.outbox.retain(self.topics.position(&tag.site, &tag.tag), json(position));
            }
        }
        for ((site, tag), _) in self.tags.extract_if(|key, _| !now.contains(key)) {
            forget(&self.outbox, &self.topics, self.discovery.as_ref(), &site, &tag);
        }
        self.send_health();
    }

    fn send_tag(&mut self, tag: &TagStatus) {
        self.tags.entry((tag.site.clone(), tag.tag.clone())).or_default();
        let room = TagRoom {
            site: &tag.site,
            tag: &tag.tag,
            name: tag.name.as_deref(),
            room: tag.last_position.as_ref().and_then(|position| position.room.as_deref()),
            zones: &tag.zones,
            silent: tag.silent,
            reason: tag.reason.as_deref(),
            supply_v: tag.supply_v,
        };
        self.outbox.retain(self.topics.room(&tag.site, &tag.tag), json(&room));
        if let Some(discovery) = &self.discovery {
            self.outbox.retain(discovery.topic(&tag.site, &tag.tag), discovery.tag(tag));
        }
    }

    fn send_health(&mut self) {
        let nodes = self.hub.read(crate::LiveState::nodes);
        let now: HashSet<_> = nodes.iter().map(|node| (node.site.clone(), node.node.clone())).collect();
        for (site, node) in self.nodes.difference(&now) {
            self.outbox.clear(self.topics.health(site, node));
            if let Some(discovery) = &self.discovery {
                self.outbox.clear(discovery.topic(site, node));
            }
        }
        self.nodes = now;
        for node in nodes {
            self.outbox.retain(self.topics.health(&node.site, &node.node), json(&node));
            if let Some(discovery) = &self.discovery
                && let Some(document) = discovery.node(&node)
            {
                self.outbox.retain(discovery.topic(&node.site, &node.node), document);
            }
        }
    }
}

/// Makes the broker, and so Home Assistant, forget a tag.
pub(super) fn forget(outbox: &Outbox, topics: &Topics, discovery: Option<&Discovery>, site: &str, tag: &str) {
    outbox.clear(topics.position(site, tag));
    outbox.clear(topics.room(site, tag));
    if let Some(discovery) = discovery {
        outbox.clear(discovery.topic(site, tag));
    }
}

#[cfg(test)]
mod tests {
    use super::super::outbox::Message;
    use super::*;
    use crate::model::StationEvent;
    use crate::state::StateLimits;
    use crate::store::Retention;
    use crate::{LiveState, ReportKind, SolvedFrom, SourceReport, Store, Utc};

    const SITE: &str = "hall";
    const TAG: &str = "0x1001";
    const POSITION: &str = "baliza/hall/tags/0x1001/position";
    const ROOM: &str = "baliza/hall/tags/0x1001/room";
    const DEVICE: &str = "homeassistant/device/baliza__hall__0x1001/config";

    fn retained(messages: &[Message], is_right: impl Fn(&str) -> bool) -> Vec<&str> {
        let right = messages.iter().filter(|message| message.is_retained && is_right(&message.payload));
        let mut topics: Vec<_> = right.map(|message| &*message.topic).collect();
        topics.sort_unstable();
        topics
    }

    /// A tag is forgotten after one update, before its documents were brought up to date in another way.
    async fn assert_that_a_tag_of_one_update_can_be_forgotten(
        update: impl Fn(TagPosition) -> Update,
        documents: &[&str],
    ) {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Store::open(folder.path().join("baliza.db").to_str().expect("UTF-8")).await.expect("a store");
        let live = LiveState::new(StateLimits::default());
        let (hub, _task) = Hub::start(live, store, Retention::default()).await.expect("a hub");
        let mut updates = hub.listen();
        let what = ReportKind::Position {
            tag: TAG.to_owned(),
            round: None,
            position_m: [1.0, 1.0],
            z_m: None,
            sigma_m: [0.1; 2],
            sigma_z_m: None,
            cov_xy_m2: 0.0,
            used: 4,
            solved_from: SolvedFrom::Ranges,
            doubt: None,
        };
        let report = SourceReport { t: Utc::now(), site: SITE.to_owned(), what };
        hub.reports().send(report).await.expect("taken");
        let position = loop {
            if let Update::Position(position) = updates.recv().await.expect("the hub runs") {
                break position;
            }
        };
        let outbox = Arc::new(Outbox::default());
        let topics = Topics::new("baliza").expect("a prefix");
        let discovery = Discovery::new(&Topics::new("homeassistant").expect("a prefix"), &topics);
        let every = Duration::from_secs(1);
        let mut publisher = Publisher::new(hub.clone(), outbox.clone(), topics, Some(discovery), every, Vec::new());

        publisher.take(update(position));
        assert_eq!(retained(&outbox.next(10).await, |payload| !payload.is_empty()), documents);
        outbox.sent();
        hub.change(|live| live.forget(SITE, TAG));
        publisher.refresh();
        assert!(!outbox.is_empty(), "nothing is cleared");
        assert_eq!(retained(&outbox.next(10).await, str::is_empty), [POSITION, ROOM, DEVICE]);
    }

    #[tokio::test]
    async fn a_tag_whose_position_alone_was_sent_is_cleared() {
        assert_that_a_tag_of_one_update_can_be_forgotten(Update::Position, &[POSITION]).await;
    }

    #[tokio::test]
    async fn a_tag_of_whom_an_event_came_first_is_cleared() {
        let back = |position: TagPosition| {
            Update::Event(StationEvent {
                id: 1,
                t: position.t,
                site: position.site,
                kind: EventKind::Back,
                node: position.tag,
                zone: None,
                dwell_s: None,
                alarm: false,
            })
        };
        assert_that_a_tag_of_one_update_can_be_forgotten(back, &[ROOM, DEVICE]).await;
    }
}
