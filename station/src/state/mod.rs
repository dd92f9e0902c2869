//! The current state.
//!
//! The input is a [`Report`], the output its [`Update`]s. Time comes from the reports and from [`Live::tick`]; there is
//! no clock here.
//!
//! | module | what is in it |
//! |---|---|
//! | `tags` | a tag's position, room and zones |
//! | `nodes` | anchors and beacons, and their health |
//! | `outline` | the probability that a position is in a room |
//! | `rate` | events a second, means that forget |
//! | `supply` | a supply voltage, and whether it is low |
//!
//! **Times.** The state's clock is the time of the last tick, and of later reports since. A report from more than a
//! minute after the clock is taken as one of the clock's time; an earlier one keeps its time, whatever it is. Silence
//! is measured by the state's clock, from the arrival of a report. Wherever a time is before the one that it is
//! compared with, no time has passed. So a clock that jumps makes events at worst (all tags are silent, and back with
//! their next report), and nothing stays wrong after it.
//!
//! **Bounds.** Tags and nodes are limited in number ([`Limits`]), names in length. What exceeds a limit, and numbers
//! that cannot be measurements, are refused and counted ([`Live::refused`]).

mod nodes;
mod outline;
mod rate;
mod supply;
mod tags;

use std::collections::{BTreeMap, HashMap};
use std::time::Duration;

use serde::Serialize;
use utoipa::ToSchema;

use self::nodes::Nodes;
pub use self::outline::Gaussian;
use self::outline::Outline;
use self::tags::{Area, Inside, ROUND, RoundRange, TagState};
use crate::Utc;
use crate::bounds::{EXPONENTS, FARTHEST_M, is_name};
use crate::input::{Report, ReportKind, SolvedFrom};
use crate::model::{
    self, Event, EventKind, GeographicOrigin, Node, NodeHealth, Role, Tag, TagPosition, Zone, ZoneKind,
};
use crate::rssi::KnownNode;

/// Reports may be this much after the state's clock.
const AHEAD: Duration = Duration::from_secs(60);
/// The most bytes of a reason.
const LONGEST_REASON: usize = 200;
/// The greatest standard deviation, metres.
const VAGUEST_M: f64 = 1e5;
/// The longest range, metres.
const LONGEST_M: f64 = 10_000.0;
/// Received powers, dBm.
const POWERS_DBM: std::ops::RangeInclusive<f64> = -200.0..=100.0;
/// The greatest offset of a clock, ppm: more than telemetry can carry.
const FASTEST_PPM: f64 = 1000.0;
/// Supply voltages of radios, V.
const SUPPLIES_V: std::ops::RangeInclusive<f64> = 0.5..=10.0;

/// What has changed, as listeners get it.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
#[serde(tag = "type", rename_all = "kebab-case")]
pub enum Update {
    /// A tag has a new position.
    Position(TagPosition),
    /// Something happened.
    Event(Event),
    /// Tags, nodes or zones changed in another way: they are to be read again. At most one a tick.
    Changed,
}

/// When something counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// A tag that does not report for this time is silent.
    pub silent_after: Duration,
    /// A position by ranges with a greater standard deviation is uncertain, metres.
    pub uncertain_m: f64,
    /// The same of positions by RSSI alone, metres.
    pub uncertain_rssi_m: f64,
    /// A tag enters a zone at this probability …
    pub enter: f64,
    /// … and leaves it at this one.
    pub leave: f64,
    /// An anchor whose mean residual is greater than this was probably moved, metres.
    pub moved_m: f64,
    /// A supply is low below this voltage, V.
    pub low_supply_v: f64,
    /// Which events are alarms.
    pub alarms: Alarms,
    /// The most tags of all sites.
    pub tags: usize,
    /// The most anchors and beacons of all sites, and the most tags with a name in a site's file.
    pub nodes: usize,
}

/// Which events are alarms, besides those of zones, which say so themselves ([`Zone::alarm`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Alarms {
    /// [`EventKind::Silent`].
    pub silent: bool,
    /// [`EventKind::Moved`].
    pub moved: bool,
    /// [`EventKind::Uncertain`].
    pub uncertain: bool,
    /// [`EventKind::LowSupply`].
    pub low_supply: bool,
}

impl Default for Alarms {
    fn default() -> Self {
        Self { silent: true, moved: true, uncertain: true, low_supply: true }
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            silent_after: Duration::from_secs(30),
            uncertain_m: 3.0,
            // Three times the deviation that 95 % of the positions of the recording `kolakowski` stay below (2.7 m).
            uncertain_rssi_m: 8.0,
            enter: 0.8,
            leave: 0.2,
            moved_m: 0.5,
            // The DW1000 works from 2.8 V on (data sheet, operating conditions).
            low_supply_v: 2.9,
            alarms: Alarms::default(),
            tags: 10_000,
            nodes: 10_000,
        }
    }
}

/// What happened to a tag or an anchor, before it has a number.
#[derive(Debug)]
struct NewEvent {
    kind: EventKind,
    zone: Option<String>,
    dwell_s: Option<f64>,
    alarm: bool,
}

impl NewEvent {
    /// What has no zone.
    fn of(kind: EventKind, alarms: &Alarms) -> Self {
        let alarm = match kind {
            EventKind::Silent => alarms.silent,
            EventKind::Moved => alarms.moved,
            EventKind::Uncertain => alarms.uncertain,
            EventKind::LowSupply => alarms.low_supply,
            EventKind::Back | EventKind::Entered | EventKind::Left => false,
        };
        Self { kind, zone: None, dwell_s: None, alarm }
    }
}

/// The state of a site.
#[derive(Debug, Default)]
struct Site {
    tags: HashMap<String, TagState>,
    /// By address: the names in the site's file.
    tag_names: HashMap<String, String>,
    nodes: Nodes,
    areas: Vec<Area>,
}

/// The current state of all sites.
#[derive(Debug)]
pub struct Live {
    limits: Limits,
    sites: HashMap<String, Site>,
    geographic_origins: HashMap<String, GeographicOrigin>,
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
    /// Kept for its memory.
    happened: Vec<NewEvent>,
}

impl Live {
    /// The state without tags and nodes.
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            sites: HashMap::new(),
            geographic_origins: HashMap::new(),
            clock: None,
            last_event: 0,
            tags: 0,
            nodes: 0,
            names: 0,
            refused: 0,
            surveys: 0,
            waiting: Vec::new(),
            is_changed: false,
            happened: Vec::new(),
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
    pub fn set_geographic_origins(&mut self, sites: &[model::Site]) {
        let origins = sites.iter().filter_map(|site| Some((site.name.clone(), site.geographic_origin?)));
        self.geographic_origins = origins.collect();
        self.is_changed = true;
    }

    /// Where a site's frame is on the earth, where that is known.
    pub fn geographic_origin(&self, site: &str) -> Option<GeographicOrigin> {
        self.geographic_origins.get(site).copied()
    }

    /// The time as which that of a report is taken.
    pub(crate) fn time_of(&self, report: &Report) -> Utc {
        let now = self.clock.unwrap_or(report.t);
        if report.t > now + AHEAD { now } else { report.t }
    }

    /// Applies a report.
    pub fn apply(&mut self, report: &Report) -> Vec<Update> {
        let t = self.time_of(report);
        self.clock = Some(self.clock.unwrap_or(t).max(t));
        let mut updates = Vec::new();
        if self.take(t, &report.site, &report.what, &mut updates).is_none() {
            self.refused = self.refused.saturating_add(1);
        }
        updates
    }

    /// What changes because time passes: tags become silent, and an update says what has changed since the last tick.
    pub fn tick(&mut self, now: Utc) -> Vec<Update> {
        self.clock = Some(now);
        let mut updates = std::mem::take(&mut self.waiting);
        for (name, site) in &mut self.sites {
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
    pub fn tags(&self) -> Vec<Tag> {
        let now = self.clock.unwrap_or_default();
        let mut tags: Vec<Tag> = Vec::with_capacity(self.tags);
        for (name, site) in &self.sites {
            let name_of = |tag: &str| site.tag_names.get(tag).map(String::as_str);
            tags.extend(site.tags.iter().map(|(tag, state)| state.show(name, tag, name_of(tag), &site.areas, now)));
        }
        tags.sort_unstable_by(|a, b| (&a.site, &a.tag).cmp(&(&b.site, &b.tag)));
        tags
    }

    /// A tag.
    pub fn tag(&self, site: &str, tag: &str) -> Option<Tag> {
        let (now, name, site) = (self.clock.unwrap_or_default(), site, self.sites.get(site)?);
        let state = site.tags.get(tag)?;
        Some(state.show(name, tag, site.tag_names.get(tag).map(String::as_str), &site.areas, now))
    }

    /// The anchors and beacons, by site and address.
    pub fn nodes(&self) -> Vec<Node> {
        let now = self.clock.unwrap_or_default();
        let mut nodes: Vec<Node> = self.sites.iter().flat_map(|(name, site)| site.nodes.show(name, now)).collect();
        nodes.sort_unstable_by(|a, b| (&a.site, &a.node).cmp(&(&b.site, &b.node)));
        nodes
    }

    /// The health, at the state's time, of the nodes that were seen since the last call.
    pub fn take_health(&mut self) -> Vec<NodeHealth> {
        let now = self.clock.unwrap_or_default();
        self.sites.iter_mut().flat_map(|(name, site)| site.nodes.take_health(name, now)).collect()
    }

    /// The nodes of a role in a site whose places are known.
    pub fn known(&self, site: &str, role: Role) -> BTreeMap<String, KnownNode> {
        self.sites.get(site).map(|site| site.nodes.known(role)).unwrap_or_default()
    }

    /// A number that grows when a node is described anew: until then, what [`known`](Self::known) returned is true.
    pub fn surveys(&self) -> u64 {
        self.surveys
    }

    /// Forgets a node, until a source reports it again.
    pub fn forget_node(&mut self, site: &str, node: &str) {
        let Some(of) = self.sites.get_mut(site) else { return };
        if of.nodes.remove(node) {
            // They hold indices of nodes.
            of.tags.values_mut().for_each(|tag| tag.round.clear());
            self.nodes -= 1;
            self.surveys += 1;
            self.is_changed = true;
        }
    }

    /// Forgets a tag, which leaves its room and its zones.
    pub fn forget(&mut self, site: &str, tag: &str) -> Vec<Update> {
        let now = self.clock.unwrap_or_default();
        let Some(of) = self.sites.get_mut(site) else { return Vec::new() };
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

    /// None where the report is refused.
    fn take(&mut self, t: Utc, site: &str, what: &ReportKind, updates: &mut Vec<Update>) -> Option<()> {
        match what {
            ReportKind::Node { node, name, role, position_m } => {
                self.describe(site, node, name.as_deref(), *role, *position_m)
            }
            ReportKind::Position {
                tag,
                position_m: [x_m, y_m],
                z_m,
                sigma_m: [sx, sy],
                sigma_z_m,
                cov_xy_m2,
                used,
                solved_from,
            } => {
                let is_place = [Some(*x_m), Some(*y_m), *z_m].into_iter().flatten().all(|at| at.abs() <= FARTHEST_M);
                let sigmas = [Some(*sx), Some(*sy), *sigma_z_m];
                let is_sigma = sigmas.into_iter().flatten().all(|sigma| (0.0..=VAGUEST_M).contains(&sigma));
                if !(is_place && is_sigma && cov_xy_m2.is_finite()) {
                    return None;
                }
                // Rounding may make the covariance greater than the deviations allow.
                let most = sx * sy;
                self.position(
                    updates,
                    TagPosition {
                        site: site.to_owned(),
                        tag: tag.clone(),
                        t,
                        x_m: *x_m,
                        y_m: *y_m,
                        z_m: *z_m,
                        sigma_x_m: *sx,
                        sigma_y_m: *sy,
                        sigma_z_m: *sigma_z_m,
                        cov_xy_m2: cov_xy_m2.clamp(-most, most),
                        room: None,
                        used: *used,
                    },
                    *solved_from,
                )
            }
            ReportKind::NoPosition { tag, reason } => {
                let reason = shortened(reason);
                let state = self.reporting_tag(t, site, tag, updates)?;
                let is_new = state.lose(reason);
                self.is_changed |= is_new;
                Some(())
            }
            ReportKind::Range { tag, anchor, range_m, rx_power_dbm, first_path_power_dbm, clock_offset_ppm } => {
                let powers_dbm = [rx_power_dbm, first_path_power_dbm];
                let is_power = powers_dbm.into_iter().flatten().all(|power_dbm| POWERS_DBM.contains(power_dbm));
                let is_offset = clock_offset_ppm.is_none_or(|offset_ppm| offset_ppm.abs() <= FASTEST_PPM);
                if !((0.0..=LONGEST_M).contains(range_m) && is_power && is_offset && is_name(anchor)) {
                    return None;
                }
                self.reporting_tag(t, site, tag, updates)?;
                let node = self.node(site, anchor, Role::Anchor)?;
                let site = self.sites.get_mut(site)?;
                let power_db =
                    first_path_power_dbm.zip(*rx_power_dbm).map(|(first_path, received)| first_path - received);
                site.nodes.range(node, t, *range_m, power_db, *clock_offset_ppm);
                let round = &mut site.tags.get_mut(tag)?.round;
                // A source that ends no rounds: only the last ranges can be of this one.
                if round.len() >= ROUND {
                    round.clear();
                }
                round.push(RoundRange { node, range_m: *range_m });
                Some(())
            }
            ReportKind::Supply { node, supply_v } => {
                if !SUPPLIES_V.contains(supply_v) {
                    return None;
                }
                let low_v = self.limits.low_supply_v;
                let known = self.sites.get(site).and_then(|site| site.nodes.index(node));
                let supply = match known {
                    Some(index) => self.sites.get_mut(site)?.nodes.supply_mut(index)?,
                    None => &mut self.reporting_tag(t, site, node, updates)?.supply,
                };
                let is_new = supply.volts != Some(*supply_v);
                if supply.take(*supply_v, low_v) {
                    let happened = NewEvent::of(EventKind::LowSupply, &self.limits.alarms);
                    updates.push(Update::Event(event(&mut self.last_event, t, site, node, happened)));
                }
                self.is_changed |= is_new;
                Some(())
            }
            ReportKind::Sighting { tag, beacon, rssi_dbm } => {
                positioning_core::ble::signal::rssi(*rssi_dbm).ok()?;
                if !is_name(beacon) {
                    return None;
                }
                self.reporting_tag(t, site, tag, updates)?;
                let node = self.node(site, beacon, Role::Beacon)?;
                self.sites.get_mut(site)?.nodes.sight(node, t);
                Some(())
            }
            ReportKind::PathLoss { node, rssi_1m_dbm, path_loss_exponent } => {
                if let Some(rssi_1m_dbm) = *rssi_1m_dbm {
                    positioning_core::ble::signal::rssi(rssi_1m_dbm).ok()?;
                }
                if !path_loss_exponent.is_none_or(|exponent| EXPONENTS.contains(&exponent)) {
                    return None;
                }
                let nodes = &mut self.sites.get_mut(site)?.nodes;
                let is_new = nodes.set_path_loss(nodes.index(node)?, *rssi_1m_dbm, *path_loss_exponent);
                self.is_changed |= is_new;
                self.surveys += u64::from(is_new);
                Some(())
            }
            // The device is a tag from its first position on: most devices are of people who walk by.
            ReportKind::ReceiverSighting { receiver, device, rssi_dbm, rssi_1m_dbm } => {
                for rssi_dbm in [Some(*rssi_dbm), *rssi_1m_dbm].into_iter().flatten() {
                    positioning_core::ble::signal::rssi(rssi_dbm).ok()?;
                }
                if !(is_name(site) && is_name(receiver) && is_name(device)) {
                    return None;
                }
                let node = self.node(site, receiver, Role::Receiver)?;
                self.sites.get_mut(site)?.nodes.sight(node, t);
                Some(())
            }
        }
    }

    fn describe(
        &mut self,
        site: &str,
        node: &str,
        name: Option<&str>,
        role: Role,
        position_m: Option<[f64; 3]>,
    ) -> Option<()> {
        let is_place = position_m.is_none_or(|position_m| position_m.iter().all(|at| at.abs() <= FARTHEST_M));
        if !(is_place && is_name(site) && is_name(node) && name.is_none_or(is_name)) {
            return None;
        }
        match role {
            Role::Tag => {
                // A tag is listed when it reports.
                let Some(name) = name else { return Some(()) };
                if !self.sites.get(site).is_some_and(|site| site.tag_names.contains_key(node)) {
                    if self.names >= self.limits.nodes {
                        return None;
                    }
                    self.names += 1;
                }
                let names = &mut self.sites.entry(site.to_owned()).or_default().tag_names;
                self.is_changed |= names.insert(node.to_owned(), name.to_owned()).as_deref() != Some(name);
            }
            Role::Anchor | Role::Beacon | Role::Receiver => {
                let index = self.node(site, node, role)?;
                let is_new = self.sites.get_mut(site)?.nodes.describe(index, name, role, position_m);
                self.is_changed |= is_new;
                self.surveys += u64::from(is_new);
            }
        }
        Some(())
    }

    fn position(
        &mut self,
        updates: &mut Vec<Update>,
        mut position: TagPosition,
        solved_from: SolvedFrom,
    ) -> Option<()> {
        let t = position.t;
        self.reporting_tag(t, &position.site, &position.tag, updates)?;
        let Site { tags, nodes, areas, .. } = self.sites.get_mut(&position.site)?;
        let state = tags.get_mut(&position.tag)?;
        state.find(&mut position, solved_from, areas, &self.limits, &mut self.happened);
        let last_event = &mut self.last_event;
        let events = self.happened.drain(..);
        let events: Vec<Event> =
            events.map(|happened| event(last_event, t, &position.site, &position.tag, happened)).collect();
        let mut moved = Vec::new();
        if let Some(z_m) = position.z_m.filter(|_| !state.round.is_empty()) {
            let at_m = [position.x_m, position.y_m, z_m];
            let is_back = nodes.end_round(t, at_m, &state.round, &self.limits, |anchor| {
                let happened = NewEvent::of(EventKind::Moved, &self.limits.alarms);
                moved.push(event(last_event, t, &position.site, anchor, happened));
            });
            self.is_changed |= is_back || !moved.is_empty();
        }
        state.round.clear();
        updates.push(Update::Position(position));
        updates.extend(events.into_iter().chain(moved).map(Update::Event));
        Some(())
    }

    /// The tag, which has reported. None where there are too many.
    fn reporting_tag(&mut self, t: Utc, site: &str, tag: &str, updates: &mut Vec<Update>) -> Option<&mut TagState> {
        let now = self.clock.unwrap_or(t);
        if !self.sites.get(site).is_some_and(|site| site.tags.contains_key(tag)) {
            if self.tags >= self.limits.tags || !(is_name(site) && is_name(tag)) {
                return None;
            }
            self.sites.entry(site.to_owned()).or_default().tags.insert(tag.to_owned(), TagState::new(t));
            self.tags += 1;
            self.is_changed = true;
        }
        let state = self.sites.get_mut(site)?.tags.get_mut(tag)?;
        if state.note(t, now) {
            let happened = NewEvent::of(EventKind::Back, &self.limits.alarms);
            updates.push(Update::Event(event(&mut self.last_event, t, site, tag, happened)));
        }
        Some(state)
    }

    /// The index of a node in its site. None where there are too many.
    fn node(&mut self, site: &str, node: &str, role: Role) -> Option<usize> {
        if let Some(index) = self.sites.get(site).and_then(|site| site.nodes.index(node)) {
            return Some(index);
        }
        if self.nodes >= self.limits.nodes {
            return None;
        }
        self.nodes += 1;
        self.is_changed = true;
        Some(self.sites.entry(site.to_owned()).or_default().nodes.add(node, role))
    }
}

/// The next event.
fn event(last: &mut i64, t: Utc, site: &str, node: &str, happened: NewEvent) -> Event {
    let NewEvent { kind, zone, dwell_s, alarm } = happened;
    *last = last.saturating_add(1);
    Event { id: *last, t, site: site.to_owned(), kind, node: node.to_owned(), zone, dwell_s, alarm }
}

fn shortened(text: &str) -> &str {
    let end = (0..=LONGEST_REASON.min(text.len())).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
    text.get(..end).unwrap_or_default()
}

#[cfg(test)]
mod tests;
