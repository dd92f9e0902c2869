//! The current state.
//!
//! The input is a [`SourceReport`](crate::SourceReport), the output its [`Update`]s. Time comes from the reports and
//! from [`LiveState::tick`]; there is no clock here.
//!
//! | module | what is in it |
//! |---|---|
//! | `apply` | a report to what it changes |
//! | `blinks` | the positions of tags that blink |
//! | `limits` | when something counts, and what is an alarm |
//! | `rounds` | the measurements of a tag until its round ends |
//! | `recent` | a sample of the rounds of the last minutes |
//! | `tags` | a tag's position, room and zones |
//! | `nodes` | anchors and beacons, and their health |
//! | `containment` | the probability that a position is in a room |
//! | `rate` | events a second, means that forget |
//! | `supply` | a supply voltage, and whether it is low |
//!
//! **Times.** The state's clock is the time of the last tick, and of later reports since. A report from more than a
//! minute after the clock is taken as one of the clock's time; an earlier one keeps its time, whatever it is. Silence
//! is measured by the state's clock, from the arrival of a report. Wherever a time is before the one that it is
//! compared with, no time has passed. So a clock that jumps makes events at worst (all tags are silent, and back with
//! their next report), and nothing stays wrong after it.
//!
//! **Bounds.** Tags and nodes are limited in number ([`StateLimits`]), names in length. What exceeds a limit, and numbers
//! that cannot be measurements, are refused and counted ([`LiveState::refused`]).

mod apply;
mod blinks;
mod containment;
mod limits;
mod nodes;
mod rate;
mod recent;
mod refusals;
mod rooms;
mod rounds;
mod supply;
mod tags;
mod user_data;

use std::collections::{BTreeMap, HashMap, HashSet};

use ::blinks::Multilateration;
use serde::Serialize;
use utoipa::ToSchema;

pub use self::containment::Gaussian;
use self::containment::Outline;
pub use self::limits::{Alarms, StateLimits};
use self::nodes::Nodes;
pub use self::recent::RecentRound;
use self::recent::RecentRounds;
use self::rounds::{EndedRound, Rounds};
use self::tags::{Area, Inside, TagState};
use crate::Utc;
use crate::model::{
    self, EventKind, GeographicOrigin, NodeHealth, NodeMeasurement, NodeRole, NodeStatus, SiteFinding, StationEvent,
    TagData, TagPosition, TagStatus, Zone, ZoneKind,
};
use crate::rssi::KnownNode;

/// What has changed, as listeners get it.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
#[serde(tag = "type", rename_all = "kebab-case")]
pub enum Update {
    /// A tag has a new position.
    Position(TagPosition),
    /// Something happened.
    Event(StationEvent),
    /// A tag's user has sent data. The store does not keep them.
    Data(TagData),
    /// Tags, nodes or zones changed in another way: they are to be read again. At most one a tick.
    Changed,
}

/// An event of a tag or an anchor, before it has a number.
#[derive(Debug)]
struct NewEvent {
    kind: EventKind,
    zone: Option<String>,
    dwell_s: Option<f64>,
    alarm: bool,
}

impl NewEvent {
    /// An event without a zone.
    fn of(kind: EventKind, alarms: &Alarms) -> Self {
        let alarm = match kind {
            EventKind::Silent => alarms.silent,
            EventKind::Moved => alarms.moved,
            EventKind::Uncertain => alarms.uncertain,
            EventKind::LowSupply => alarms.low_supply,
            EventKind::Refusals => alarms.refusals,
            EventKind::Back | EventKind::Entered | EventKind::Left => false,
        };
        Self { kind, zone: None, dwell_s: None, alarm }
    }
}

/// The state of a site.
#[derive(Debug, Default)]
struct SiteState {
    tags: HashMap<String, TagState>,
    /// By address: the names in the site's file.
    tag_names: HashMap<String, String>,
    nodes: Nodes,
    areas: Vec<Area>,
    rounds: Rounds,
    recent: RecentRounds,
    blinks: Multilateration,
}

/// The current state of all sites.
#[derive(Debug)]
pub struct LiveState {
    limits: StateLimits,
    sites: HashMap<String, SiteState>,
    geographic_origins: HashMap<String, GeographicOrigin>,
    findings: Vec<SiteFinding>,
    /// None before the first report and the first tick.
    clock: Option<Utc>,
    last_event: i64,
    tags: usize,
    nodes: usize,
    names: usize,
    refused: u64,
    /// How often a node was described anew.
    surveys: u64,
    /// Updates that come with the next tick.
    waiting: Vec<Update>,
    is_changed: bool,
    /// Measurements of rounds that have ended, in the order of their ends. None: they are not kept.
    measurements: Option<Vec<NodeMeasurement>>,
    /// Positions that came late, for the store.
    late: Vec<TagPosition>,
    /// Tags that are known by those only, with their site.
    late_tags: HashSet<(String, String)>,
    /// Kept for its memory.
    happened: Vec<NewEvent>,
}

impl LiveState {
    /// The state without tags and nodes.
    pub fn new(limits: StateLimits) -> Self {
        Self {
            limits,
            sites: HashMap::new(),
            geographic_origins: HashMap::new(),
            findings: Vec::new(),
            clock: None,
            last_event: 0,
            tags: 0,
            nodes: 0,
            names: 0,
            refused: 0,
            surveys: 0,
            waiting: Vec::new(),
            is_changed: false,
            measurements: None,
            late: Vec::new(),
            late_tags: HashSet::new(),
            happened: Vec::new(),
        }
    }

    /// Keeps the measurements of rounds from now on, for [`LiveState::take_measurements`].
    pub fn keep_measurements(&mut self) {
        self.measurements.get_or_insert_default();
    }

    /// The measurements of the rounds that have ended since the last call, where they are kept.
    pub fn take_measurements(&mut self) -> Vec<NodeMeasurement> {
        self.measurements.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// The positions that came late since the last call: for the store, and for nobody who looks at the present.
    pub fn take_late(&mut self) -> Vec<TagPosition> {
        std::mem::take(&mut self.late)
    }

    /// Ends all rounds: there are no more reports.
    pub fn end_rounds(&mut self) {
        for (name, site) in &mut self.sites {
            let SiteState { nodes, rounds, .. } = site;
            rounds.end_all(|tag, ended| keep(&mut self.measurements, name, tag, nodes, Some(ended)));
        }
    }

    /// Numbers of events go on after this one.
    pub fn continue_events(&mut self, last: i64) {
        self.last_event = self.last_event.max(last);
    }

    /// Replaces the rooms and zones of all sites. Tags stay in those that keep their name and kind; the others are
    /// left, with an event of the next tick.
    pub fn set_zones(&mut self, zones: Vec<Zone>) {
        let now = self.clock.unwrap_or_default();
        let mut before: HashMap<String, Vec<Area>> =
            self.sites.iter_mut().map(|(name, site)| (name.clone(), std::mem::take(&mut site.areas))).collect();
        for zone in zones {
            let outline = Outline::new(zone.corners_m.clone());
            let site = self.sites.entry(zone.site.clone()).or_default();
            site.areas.push(Area { zone, outline });
        }
        for (name, site) in &mut self.sites {
            let before = before.remove(name).unwrap_or_default();
            let places: BTreeMap<(&str, bool), usize> =
                site.areas.iter().enumerate().map(|(index, area)| (area.key(), index)).collect();
            let mut gone = Vec::new();
            for (tag, state) in &mut site.tags {
                let mut stay = |inside: Inside| {
                    let area = before.get(inside.area)?;
                    if let Some(&index) = places.get(&area.key()) {
                        return Some(Inside { area: index, ..inside });
                    }
                    gone.push((tag.clone(), tags::left(area, &inside, now)));
                    None
                };
                state.rooms.clear();
                state.room = state.room.and_then(&mut stay);
                state.zones = std::mem::take(&mut state.zones).into_iter().filter_map(stay).collect();
            }
            for (tag, happened) in gone {
                self.waiting.push(Update::Event(event(&mut self.last_event, now, name, &tag, happened)));
            }
        }
        self.is_changed = true;
    }

    /// Replaces the geographic origins of all sites.
    pub fn set_geographic_origins(&mut self, sites: &[model::SiteMap]) {
        let origins = sites.iter().filter_map(|site| Some((site.name.clone(), site.geographic_origin?)));
        self.geographic_origins = origins.collect();
        self.is_changed = true;
    }

    /// Where a site's frame is on the earth, where that is known.
    pub fn geographic_origin(&self, site: &str) -> Option<GeographicOrigin> {
        self.geographic_origins.get(site).copied()
    }

    /// What changes because time passes: tags become silent, and an update says what has changed since the last tick.
    pub fn tick(&mut self, now: Utc) -> Vec<Update> {
        self.clock = Some(now);
        let mut updates = std::mem::take(&mut self.waiting);
        let sites: Vec<String> = self.sites.keys().cloned().collect();
        sites.iter().for_each(|site| self.solve_blinks(site, now, &mut updates));
        for (name, site) in &mut self.sites {
            let SiteState { nodes, rounds, .. } = site;
            rounds.tick(|tag, ended| keep(&mut self.measurements, name, tag, nodes, Some(ended)));
            site.recent.tick();
            for (tag, state) in &mut site.tags {
                // The clock may have been set back.
                state.reported = state.reported.min(now);
                if !state.is_silent && now.since(state.reported) > self.limits.silent_after {
                    state.is_silent = true;
                    let happened = NewEvent::of(EventKind::Silent, &self.limits.alarms);
                    updates.push(Update::Event(event(&mut self.last_event, now, name, tag, happened)));
                }
            }
        }
        if std::mem::take(&mut self.is_changed) {
            updates.push(Update::Changed);
        }
        updates
    }

    /// The tags, by site and address.
    pub fn tags(&self) -> Vec<TagStatus> {
        let now = self.clock.unwrap_or_default();
        let mut tags: Vec<TagStatus> = Vec::with_capacity(self.tags);
        for (name, site) in &self.sites {
            let name_of = |tag: &str| site.tag_names.get(tag).map(String::as_str);
            tags.extend(site.tags.iter().map(|(tag, state)| state.show(name, tag, name_of(tag), &site.areas, now)));
        }
        tags.sort_unstable_by(|a, b| (&a.site, &a.tag).cmp(&(&b.site, &b.tag)));
        tags
    }

    /// A tag.
    pub fn tag(&self, site: &str, tag: &str) -> Option<TagStatus> {
        let (now, name, site) = (self.clock.unwrap_or_default(), site, self.sites.get(site)?);
        let state = site.tags.get(tag)?;
        Some(state.show(name, tag, site.tag_names.get(tag).map(String::as_str), &site.areas, now))
    }

    /// The anchors and beacons, by site and address.
    pub fn nodes(&self) -> Vec<NodeStatus> {
        let now = self.clock.unwrap_or_default();
        let mut nodes: Vec<NodeStatus> =
            self.sites.iter().flat_map(|(name, site)| site.nodes.show(name, now)).collect();
        nodes.sort_unstable_by(|a, b| (&a.site, &a.node).cmp(&(&b.site, &b.node)));
        nodes
    }

    /// A sample of the rounds of the last five minutes, at most 300 of each site, the oldest first.
    pub fn recent_rounds(&self) -> BTreeMap<String, Vec<RecentRound>> {
        self.sites.iter().map(|(name, site)| (name.clone(), site.recent.rounds().cloned().collect())).collect()
    }

    /// Replaces what the check of the last minutes has found. What it had found before keeps its time.
    pub fn set_findings(&mut self, mut findings: Vec<SiteFinding>) {
        for finding in &mut findings {
            let before = self.findings.iter().find(|before| before.is_same(finding));
            finding.since = before.map_or_else(|| self.clock.unwrap_or_default(), |before| before.since);
        }
        self.is_changed |= findings != self.findings;
        self.findings = findings;
    }

    /// What the check of the last minutes has found.
    pub fn findings(&self) -> &[SiteFinding] {
        &self.findings
    }

    /// The health, at the state's time, of the nodes that were seen since the last call.
    pub fn take_health(&mut self) -> Vec<NodeHealth> {
        let now = self.clock.unwrap_or_default();
        self.sites.iter_mut().flat_map(|(name, site)| site.nodes.take_health(name, now)).collect()
    }

    /// The nodes of a role in a site whose places are known.
    pub fn known(&self, site: &str, role: NodeRole) -> BTreeMap<String, KnownNode> {
        self.sites.get(site).map(|site| site.nodes.known(role)).unwrap_or_default()
    }

    /// A number that grows when a node is described anew: until then, what [`known`](Self::known) returned is true.
    pub fn surveys(&self) -> u64 {
        self.surveys
    }

    /// Forgets a node, until a source reports it again.
    pub fn forget_node(&mut self, site: &str, node: &str) {
        let Some(of) = self.sites.get_mut(site) else { return };
        if of.nodes.index(node).is_some() {
            let SiteState { nodes, rounds, .. } = of;
            // They hold indices of nodes.
            rounds.end_all(|tag, ended| keep(&mut self.measurements, site, tag, nodes, Some(ended)));
            nodes.remove(node);
            self.nodes -= 1;
            self.surveys += 1;
            self.is_changed = true;
        }
    }

    /// Forgets a tag, which leaves its room and its zones.
    pub fn forget(&mut self, site: &str, tag: &str) -> Vec<Update> {
        let now = self.clock.unwrap_or_default();
        let Some(of) = self.sites.get_mut(site) else { return Vec::new() };
        let SiteState { nodes, rounds, .. } = of;
        rounds.forget(tag, |ended| keep(&mut self.measurements, site, tag, nodes, Some(ended)));
        let Some(state) = of.tags.remove(tag) else { return Vec::new() };
        self.tags -= 1;
        self.is_changed = true;
        let inside = state.room.into_iter().chain(state.zones);
        let left = inside.filter_map(|inside| Some(tags::left(of.areas.get(inside.area)?, &inside, now)));
        left.map(|left| Update::Event(event(&mut self.last_event, now, site, tag, left))).collect()
    }

    /// The rooms and zones, by site, in the order in which they were set.
    pub fn zones(&self) -> Vec<Zone> {
        let mut zones: Vec<Zone> =
            self.sites.values().flat_map(|site| site.areas.iter().map(|area| area.zone.clone())).collect();
        zones.sort_by(|a, b| a.site.cmp(&b.site));
        zones
    }

    /// The most probable room of a position of which nothing else is known, if it is more probable than not.
    pub fn room_of(&self, site: &str, position: &Gaussian) -> Option<String> {
        let rooms = self.sites.get(site)?.areas.iter().filter(|area| area.zone.kind == ZoneKind::Room);
        let (probability, room) = rooms
            .map(|area| (area.outline.probability(position), area))
            .max_by(|(one, _), (other, _)| one.total_cmp(other))?;
        (probability > 0.5).then(|| room.zone.name.clone())
    }

    /// The number of reports that were refused.
    pub fn refused(&self) -> u64 {
        self.refused
    }
}

/// Adds the measurements of a round that has ended, where they are kept.
fn keep(
    measurements: &mut Option<Vec<NodeMeasurement>>,
    site: &str,
    tag: &str,
    nodes: &Nodes,
    ended: Option<EndedRound<'_>>,
) {
    if let (Some(measurements), Some(ended)) = (measurements, ended) {
        measurements.extend(ended.kept(site, tag, nodes));
    }
}

/// The next event.
fn event(last: &mut i64, t: Utc, site: &str, node: &str, happened: NewEvent) -> StationEvent {
    let NewEvent { kind, zone, dwell_s, alarm } = happened;
    *last = last.saturating_add(1);
    StationEvent { id: *last, t, site: site.to_owned(), kind, node: node.to_owned(), zone, dwell_s, alarm }
}

#[cfg(test)]
mod tests;
