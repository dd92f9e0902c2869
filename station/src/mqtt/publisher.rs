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

/// The pace of a tag's positions.
#[derive(Debug)]
struct Pace {
    /// When its last position went out.
    sent: Instant,
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
    paces: HashMap<(String, String), Pace>,
    /// Tags with documents.
    announced: HashSet<(String, String)>,
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
        let (paces, announced, nodes) = (HashMap::new(), HashSet::new(), HashSet::new());
        Self { hub, outbox, topics, discovery, every, earlier, paces, announced, nodes }
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
                    | EventKind::Uncertain => true,
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
            Update::Changed => self.refresh(),
        }
    }

    fn take_position(&mut self, position: TagPosition, now: Instant) {
        let key = (position.site.clone(), position.tag.clone());
        if let Some(pace) = self.paces.get_mut(&key) {
            if now.duration_since(pace.sent) < self.every {
                pace.waiting = Some(position);
                return;
            }
            *pace = Pace { sent: now, waiting: None };
        } else {
            self.paces.insert(key, Pace { sent: now, waiting: None });
        }
        self.outbox.retain(self.topics.position(&position.site, &position.tag), json(&position));
    }

    fn send_waiting(&mut self, now: Instant) {
        for pace in self.paces.values_mut() {
            if now.duration_since(pace.sent) >= self.every
                && let Some(position) = pace.waiting.take()
            {
                pace.sent = now;
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
            let key = (tag.site.clone(), tag.tag.clone());
            // Of before the start; later ones come as updates.
            let is_paced = self.paces.contains_key(&key);
            let is_first = self.announced.insert(key) && !is_paced;
            if let Some(position) = tag.last_position.as_ref().filter(|_| is_first) {
                self.outbox.retain(self.topics.position(&tag.site, &tag.tag), json(position));
            }
        }
        for (site, tag) in self.announced.extract_if(|key| !now.contains(key)) {
            self.paces.remove(&(site.clone(), tag.clone()));
            forget(&self.outbox, &self.topics, self.discovery.as_ref(), &site, &tag);
        }
        self.send_health();
    }

    fn send_tag(&self, tag: &TagStatus) {
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
