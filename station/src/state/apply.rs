//! A report to what it changes: one method for each kind of report. A method returns None where the report is refused;
//! then nothing has changed but the time of the tag's last report.

use std::time::Duration;

use wire::telemetry::Address;

use super::rounds::RoundMeasurement;
use super::tags::TagState;
use super::user_data::UserData;
use super::{LiveState, NewEvent, SiteState, Update, event, keep};
use crate::Utc;
use crate::bounds::{EXPONENTS, FARTHEST_M, is_name};
use crate::input::{ReportKind, SolvedFrom, SourceReport};
use crate::model::{EventKind, MeasuredValue, NodeRole, RangeMeasurement, StationEvent, TagData, TagPosition};

/// Reports may be this much after the state's clock.
const AHEAD: Duration = Duration::from_secs(60);
/// The most bytes of a reason.
const LONGEST_REASON: usize = 200;
/// The greatest standard deviation, metres.
const VAGUEST_M: f64 = 1e5;
/// Supply voltages of radios, V.
const SUPPLIES_V: std::ops::RangeInclusive<f64> = 0.5..=10.0;

impl LiveState {
    /// The time as which that of a report is taken.
    fn time_of(&self, report: &SourceReport) -> Utc {
        let now = self.clock.unwrap_or(report.t);
        if report.t > now + AHEAD { now } else { report.t }
    }

    /// Applies a report.
    pub fn apply(&mut self, report: &SourceReport) -> Vec<Update> {
        let t = self.time_of(report);
        self.clock = Some(self.clock.unwrap_or(t).max(t));
        let mut updates = Vec::new();
        if self.take(t, &report.site, &report.what, &mut updates).is_none() {
            self.refused = self.refused.saturating_add(1);
        }
        updates
    }

    /// None where the report is refused.
    pub(super) fn take(&mut self, t: Utc, site: &str, kind: &ReportKind, updates: &mut Vec<Update>) -> Option<()> {
        match kind {
            ReportKind::Node { node, name, role, position_m } => {
                self.describe(site, node, name.as_deref(), *role, *position_m)
            }
            ReportKind::Position { .. } => self.position(t, site, kind, updates),
            ReportKind::NoPosition { tag, round, reason } => self.no_position(t, site, tag, *round, reason, updates),
            ReportKind::Range { tag, round, anchor, range } => {
                self.range(t, site, tag, *round, anchor, *range, updates)
            }
            ReportKind::Supply { node, supply_v } => self.supply(t, site, node, *supply_v, updates),
            ReportKind::Data { tag, number, data } => {
                self.reporting_tag(t, site, tag, updates)?;
                self.data(t, site, tag, *number, data, updates)
            }
            // The hub has taken it.
            ReportKind::Answer { .. } => Some(()),
            ReportKind::Refusals { tag, frames } => self.refusals(t, site, tag, *frames, updates),
            ReportKind::Height { tag, height_m } => self.height(site, tag, *height_m),
            ReportKind::Arrival { anchor, arrival } => self.arrival(t, site, *anchor, arrival, updates),
            ReportKind::Sighting { tag, beacon, rssi_dbm } => self.sighting(t, site, tag, beacon, *rssi_dbm, updates),
            ReportKind::ReceiverSighting { receiver, device, rssi_dbm, rssi_1m_dbm } => {
                self.receiver_sighting(t, site, receiver, device, *rssi_dbm, *rssi_1m_dbm)
            }
            ReportKind::Late(kind) => match &**kind {
                ReportKind::Data { tag, number, data } => self.data(t, site, tag, *number, data, updates),
                kind => self.late(t, site, kind),
            },
            ReportKind::PathLoss { node, rssi_1m_dbm, path_loss_exponent } => {
                self.path_loss(site, node, *rssi_1m_dbm, *path_loss_exponent)
            }
        }
    }

    fn describe(
        &mut self,
        site: &str,
        node: &str,
        name: Option<&str>,
        role: NodeRole,
        position_m: Option<[f64; 3]>,
    ) -> Option<()> {
        let is_place = position_m.is_none_or(|position_m| position_m.iter().all(|at| at.abs() <= FARTHEST_M));
        if !(is_place && is_name(site) && is_name(node) && name.is_none_or(is_name)) {
            return None;
        }
        match role {
            NodeRole::Tag => {
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
            NodeRole::Anchor | NodeRole::Beacon | NodeRole::Receiver => {
                let index = self.node(site, node, role)?;
                let state = self.sites.get_mut(site)?;
                let is_new = state.nodes.describe(index, name, role, position_m);
                if let (NodeRole::Anchor, Some(position_m), Ok(Address(anchor))) = (role, position_m, node.parse()) {
                    state.blinks.set_anchor(anchor, position_m);
                }
                self.is_changed |= is_new;
                self.surveys += u64::from(is_new);
            }
        }
        Some(())
    }

    /// A tag is carried at this height.
    fn height(&mut self, site: &str, tag: &str, height_m: f64) -> Option<()> {
        let Address(tag) = tag.parse().ok()?;
        if !(is_name(site) && height_m.abs() <= FARTHEST_M) {
            return None;
        }
        self.sites.entry(site.to_owned()).or_default().blinks.set_height(tag, Some(height_m as f32));
        Some(())
    }

    /// The end of a round with a position.
    fn position(&mut self, t: Utc, site: &str, kind: &ReportKind, updates: &mut Vec<Update>) -> Option<()> {
        let (mut position, round, solved_from) = tag_position(t, site, kind)?;
        if self.reporting_tag(t, site, &position.tag, updates)?.is_repeated(t, round) {
            return Some(());
        }
        let SiteState { tags, nodes, areas, rounds, recent, .. } = self.sites.get_mut(site)?;
        let state = tags.get_mut(&position.tag)?;
        position.t = state.time_of_position(t);
        state.find(&mut position, solved_from, areas, &self.limits, &mut self.happened);
        let last_event = &mut self.last_event;
        let events = self.happened.drain(..);
        let events: Vec<StationEvent> = events.map(|new| event(last_event, t, site, &position.tag, new)).collect();
        let mut moved = Vec::new();
        if let Some(open) = rounds.known(&position.tag) {
            keep(&mut self.measurements, site, &position.tag, nodes, open.end_other(round));
            let ended = open.end(position.t);
            if let Some(ended) = ended {
                recent.add(&position.tag, state.height_m(), ended, nodes);
            }
            if let (Some(z_m), Some(ended)) = (position.z_m, ended) {
                let at_m = [position.x_m, position.y_m, z_m];
                let is_back = nodes.end_round(t, at_m, ended.measurements, &self.limits, |anchor| {
                    let new = NewEvent::of(EventKind::Moved, &self.limits.alarms);
                    moved.push(event(last_event, t, site, anchor, new));
                });
                self.is_changed |= is_back || !moved.is_empty();
            }
            keep(&mut self.measurements, site, &position.tag, nodes, ended);
        }
        updates.push(Update::Position(position));
        updates.extend(events.into_iter().chain(moved).map(Update::Event));
        Some(())
    }

    /// What comes late.
    fn late(&mut self, t: Utc, site: &str, kind: &ReportKind) -> Option<()> {
        let ReportKind::Position { tag, .. } = kind else { return Some(()) };
        let (position, ..) = tag_position(t, site, kind)?;
        if !self.sites.get(site).is_some_and(|site| site.tags.contains_key(tag)) {
            let key = (site.to_owned(), tag.clone());
            let has_room = self.late_tags.len() < self.limits.tags || self.late_tags.contains(&key);
            if !(has_room && is_name(site) && is_name(tag)) {
                return None;
            }
            self.late_tags.insert(key);
        }
        self.late.push(position);
        Some(())
    }

    /// The end of a round without a position.
    fn no_position(
        &mut self,
        t: Utc,
        site: &str,
        tag: &str,
        round: Option<u16>,
        reason: &str,
        updates: &mut Vec<Update>,
    ) -> Option<()> {
        let is_new = self.reporting_tag(t, site, tag, updates)?.lose(shortened(reason));
        self.is_changed |= is_new;
        let SiteState { tags, nodes, rounds, recent, .. } = self.sites.get_mut(site)?;
        if let Some(open) = rounds.known(tag) {
            keep(&mut self.measurements, site, tag, nodes, open.end_other(round));
            let ended = open.end(t);
            if let Some(ended) = ended {
                recent.add(tag, tags.get(tag).and_then(TagState::height_m), ended, nodes);
            }
            keep(&mut self.measurements, site, tag, nodes, ended);
        }
        Some(())
    }

    /// A range between a tag and an anchor.
    #[expect(clippy::too_many_arguments, reason = "the fields of the report")]
    fn range(
        &mut self,
        t: Utc,
        site: &str,
        tag: &str,
        round: Option<u16>,
        anchor: &str,
        range: RangeMeasurement,
        updates: &mut Vec<Update>,
    ) -> Option<()> {
        if !(range.is_sane() && is_name(anchor)) {
            return None;
        }
        self.reporting_tag(t, site, tag, updates)?;
        let node = self.node(site, anchor, NodeRole::Anchor)?;
        self.sites.get_mut(site)?.nodes.range(node, t, &range);
        self.gather(site, tag, round, RoundMeasurement { node, t, measured: MeasuredValue::Range(range) })
    }

    /// The voltage of a node's supply.
    fn supply(&mut self, t: Utc, site: &str, node: &str, supply_v: f64, updates: &mut Vec<Update>) -> Option<()> {
        if !SUPPLIES_V.contains(&supply_v) {
            return None;
        }
        let low_v = self.limits.low_supply_v;
        let known = self.sites.get(site).and_then(|site| site.nodes.index(node));
        let supply = match known {
            Some(index) => self.sites.get_mut(site)?.nodes.supply_mut(index)?,
            None => &mut self.reporting_tag(t, site, node, updates)?.supply,
        };
        let is_new = supply.volts != Some(supply_v);
        if supply.take(supply_v, low_v) {
            self.happened_to(t, site, node, EventKind::LowSupply, updates);
        }
        self.is_changed |= is_new;
        Some(())
    }

    /// Data of the user of a known tag.
    fn data(
        &mut self,
        t: Utc,
        site: &str,
        tag: &str,
        number: u8,
        data: &[u8],
        updates: &mut Vec<Update>,
    ) -> Option<()> {
        let state = self.sites.get_mut(site)?.tags.get_mut(tag)?;
        if !UserData::is_possible(data) {
            return None;
        }
        if state.data.take(t, number, data) {
            let data = data.iter().map(|byte| format!("{byte:02X}")).collect();
            updates.push(Update::Data(TagData { site: site.to_owned(), tag: tag.to_owned(), t, number, data }));
        }
        Some(())
    }

    /// A tag has refused frames.
    fn refusals(&mut self, t: Utc, site: &str, tag: &str, frames: u32, updates: &mut Vec<Update>) -> Option<()> {
        if self.reporting_tag(t, site, tag, updates)?.refusals.take(t, frames) {
            self.happened_to(t, site, tag, EventKind::Refusals, updates);
        }
        Some(())
    }

    /// An event of a tag or an anchor, without a zone.
    fn happened_to(&mut self, t: Utc, site: &str, node: &str, kind: EventKind, updates: &mut Vec<Update>) {
        let new = NewEvent::of(kind, &self.limits.alarms);
        updates.push(Update::Event(event(&mut self.last_event, t, site, node, new)));
    }

    /// A tag received a beacon.
    fn sighting(
        &mut self,
        t: Utc,
        site: &str,
        tag: &str,
        beacon: &str,
        rssi_dbm: f64,
        updates: &mut Vec<Update>,
    ) -> Option<()> {
        positioning_core::ble::signal::rssi(rssi_dbm).ok()?;
        if !is_name(beacon) {
            return None;
        }
        self.reporting_tag(t, site, tag, updates)?;
        let node = self.node(site, beacon, NodeRole::Beacon)?;
        self.sites.get_mut(site)?.nodes.sight(node, t);
        self.gather_rssi(site, tag, RoundMeasurement { node, t, measured: MeasuredValue::Rssi(rssi_dbm) })
    }

    /// A receiver received a device. It is a tag from its first position on: most devices are of people who walk by.
    fn receiver_sighting(
        &mut self,
        t: Utc,
        site: &str,
        receiver: &str,
        device: &str,
        rssi_dbm: f64,
        rssi_1m_dbm: Option<f64>,
    ) -> Option<()> {
        for rssi_dbm in [Some(rssi_dbm), rssi_1m_dbm].into_iter().flatten() {
            positioning_core::ble::signal::rssi(rssi_dbm).ok()?;
        }
        if !(is_name(site) && is_name(receiver) && is_name(device)) {
            return None;
        }
        let node = self.node(site, receiver, NodeRole::Receiver)?;
        self.sites.get_mut(site)?.nodes.sight(node, t);
        self.gather_rssi(site, device, RoundMeasurement { node, t, measured: MeasuredValue::Rssi(rssi_dbm) })
    }

    /// The path loss of a node's signals.
    fn path_loss(
        &mut self,
        site: &str,
        node: &str,
        rssi_1m_dbm: Option<f64>,
        path_loss_exponent: Option<f64>,
    ) -> Option<()> {
        if let Some(rssi_1m_dbm) = rssi_1m_dbm {
            positioning_core::ble::signal::rssi(rssi_1m_dbm).ok()?;
        }
        if !path_loss_exponent.is_none_or(|exponent| EXPONENTS.contains(&exponent)) {
            return None;
        }
        let nodes = &mut self.sites.get_mut(site)?.nodes;
        let is_new = nodes.set_path_loss(nodes.index(node)?, rssi_1m_dbm, path_loss_exponent);
        self.is_changed |= is_new;
        self.surveys += u64::from(is_new);
        Some(())
    }

    /// Adds an RSSI to the tag's round. Only kept measurements need it.
    fn gather_rssi(&mut self, site: &str, tag: &str, measurement: RoundMeasurement) -> Option<()> {
        if self.measurements.is_some() { self.gather(site, tag, None, measurement) } else { Some(()) }
    }

    /// Adds a measurement to the tag's round of this number.
    fn gather(&mut self, site: &str, tag: &str, number: Option<u16>, measurement: RoundMeasurement) -> Option<()> {
        let SiteState { nodes, rounds, .. } = self.sites.get_mut(site)?;
        let round = rounds.of(tag);
        keep(&mut self.measurements, site, tag, nodes, round.end_other(number));
        keep(&mut self.measurements, site, tag, nodes, round.add(number, measurement));
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
    fn node(&mut self, site: &str, node: &str, role: NodeRole) -> Option<usize> {
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

/// The position of a report of one, with its round. None where a number cannot be right.
fn tag_position(t: Utc, site: &str, kind: &ReportKind) -> Option<(TagPosition, Option<u16>, SolvedFrom)> {
    let ReportKind::Position {
        tag,
        round,
        position_m: [x_m, y_m],
        z_m,
        sigma_m: [sigma_x_m, sigma_y_m],
        sigma_z_m,
        cov_xy_m2,
        used,
        solved_from,
        doubt,
    } = kind
    else {
        return None;
    };
    let other_m = doubt.and_then(|doubt| doubt.alternative_m()).into_iter().flatten();
    let mut places = [*x_m, *y_m].into_iter().chain(*z_m).chain(other_m);
    let is_place = places.all(|at| at.abs() <= FARTHEST_M);
    let sigmas_m = [Some(*sigma_x_m), Some(*sigma_y_m), *sigma_z_m];
    let is_sigma = sigmas_m.into_iter().flatten().all(|sigma_m| (0.0..=VAGUEST_M).contains(&sigma_m));
    if !(is_place && is_sigma && cov_xy_m2.is_finite()) {
        return None;
    }
    // Rounding may make the covariance greater than the deviations allow.
    let most_m2 = sigma_x_m * sigma_y_m;
    let position = TagPosition {
        site: site.to_owned(),
        tag: tag.clone(),
        t,
        x_m: *x_m,
        y_m: *y_m,
        z_m: *z_m,
        sigma_x_m: *sigma_x_m,
        sigma_y_m: *sigma_y_m,
        sigma_z_m: *sigma_z_m,
        cov_xy_m2: cov_xy_m2.clamp(-most_m2, most_m2),
        room: None,
        used: *used,
        doubt: *doubt,
    };
    Some((position, *round, *solved_from))
}

fn shortened(text: &str) -> &str {
    let end = (0..=LONGEST_REASON.min(text.len())).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
    text.get(..end).unwrap_or_default()
}
