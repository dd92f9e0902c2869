//! Anchors and beacons of a site, and the anchors' health.
//!
//! The input is the ranges of rounds that end with a position; the output is means over some minutes (exponential
//! forgetting, two minutes):
//!
//! - **Residual**: the range minus the distance between the anchor's surveyed position and the tag's position, in space.
//!   A position without z gives none: a tag's height is needed where anchors hang above it. (A tag that was located at
//!   a configured height has that one as z.)
//! - **Success**: a round (one range at least, and a position) counts for an anchor that has a range in it, and for one
//!   that is nearer to the position than the mean of its ranges. The share of the former is its success rate. So rounds
//!   that are too far for an anchor do not count. An anchor that fails keeps its mean range, so its rate falls.
//! - **Moved**: for two minutes, the mean residual has been greater than the limit, and greater than four times its
//!   standard error; values of one second count as one for the latter. The anchor counts as moved until the mean is
//!   below half of the limit, or until it is surveyed anew.

use std::collections::{BTreeMap, HashMap};
use std::time::Duration;

use super::StateLimits;
use super::rate::{Mean, Rate};
use super::rounds::RoundMeasurement;
use super::supply::Supply;
use crate::Utc;
use crate::model::{HealthFigures, NodeHealth, NodeRole, NodeStatus, RangeMeasurement};
use crate::rssi::KnownNode;

/// Residuals must be off for this time.
const MOVED_FOR: Duration = Duration::from_secs(120);
/// The mean of residuals must be this number of standard errors from zero.
const STANDARD_ERRORS: f64 = 4.0;
/// It is known from values of this number of different seconds at least.
const LEAST_SECONDS: f64 = 30.0;
/// The share of the limit below which an anchor is back at its place.
const BACK_AGAIN: f64 = 0.5;

/// Whether an anchor is where it was surveyed.
///
/// ```text
///            mean residual is off           … for MOVED_FOR
///   AtPlace ────────────────────▶ Off ───────────────────────▶ Moved (an event)
///      ▲ ◀────────────────────────┘                             │
///      │          it is not                                     │
///      └────────────────────────────────────────────────────────┘
///         below BACK_AGAIN of the limit, or surveyed anew
/// ```
#[derive(Clone, Copy, Debug)]
enum Placement {
    /// Its ranges fit.
    AtPlace,
    /// Its ranges have not fitted since this time.
    Off { since: Utc },
    /// They have not fitted for so long that it was probably moved.
    Moved,
}

/// An anchor or a beacon.
#[derive(Debug)]
struct NodeState {
    node: String,
    role: NodeRole,
    name: Option<String>,
    position_m: Option<[f64; 3]>,
    rssi_1m_dbm: Option<f64>,
    path_loss_exponent: Option<f64>,
    last_seen: Option<Utc>,
    /// Seen since its health was taken.
    is_seen: bool,
    means: Means,
    placement: Placement,
    supply: Supply,
}

/// How a node's ranges were over the last minutes.
#[derive(Debug, Default)]
struct Means {
    rate: Rate,
    ranges: Mean,
    residuals: Mean,
    power: Mean,
    clock_offset: Mean,
    success: Mean,
}

/// What a round needs of a node, side by side in memory: a round looks at all nodes of its site.
#[derive(Clone, Copy, Debug)]
struct Reach {
    /// Not a number where it is unknown.
    position_m: [f64; 3],
    /// The mean range; 0 where there is none.
    mean_m: f64,
    /// The last round in which it had a range.
    round: u64,
}

/// The nodes of a site.
#[derive(Debug, Default)]
pub(super) struct Nodes {
    by_name: HashMap<String, usize>,
    states: Vec<NodeState>,
    reaches: Vec<Reach>,
    rounds: u64,
}

impl Nodes {
    pub(super) fn index(&self, node: &str) -> Option<usize> {
        self.by_name.get(node).copied()
    }

    pub(super) fn add(&mut self, node: &str, role: NodeRole) -> usize {
        let index = self.states.len();
        self.by_name.insert(node.to_owned(), index);
        self.states.push(NodeState::new(node, role));
        self.reaches.push(Reach { position_m: [f64::NAN; 3], mean_m: 0.0, round: 0 });
        index
    }

    /// Takes what is said of a node; what is not said stays. Returns whether something is new.
    pub(super) fn describe(
        &mut self,
        index: usize,
        name: Option<&str>,
        role: NodeRole,
        position_m: Option<[f64; 3]>,
    ) -> bool {
        let (Some(state), Some(reach)) = (self.states.get_mut(index), self.reaches.get_mut(index)) else {
            return false;
        };
        let is_renamed = name.is_some() && name != state.name.as_deref();
        if is_renamed {
            state.name = name.map(str::to_owned);
        }
        let is_surveyed = position_m.is_some() && position_m != state.position_m;
        if let Some(position_m) = position_m.filter(|_| is_surveyed) {
            (state.position_m, reach.position_m) = (Some(position_m), position_m);
            (state.means.residuals, state.means.success) = (Mean::default(), Mean::default());
            state.placement = Placement::AtPlace;
        }
        let is_other = role != state.role;
        state.role = role;
        is_renamed || is_surveyed || is_other
    }

    /// Forgets a node; the last one gets its index. Returns whether there was one.
    pub(super) fn remove(&mut self, node: &str) -> bool {
        let Some(index) = self.by_name.remove(node) else { return false };
        self.states.swap_remove(index);
        self.reaches.swap_remove(index);
        if let Some(moved) = self.states.get(index) {
            self.by_name.insert(moved.node.clone(), index);
        }
        true
    }

    /// Takes a node's path loss. Returns whether it is new.
    pub(super) fn set_path_loss(&mut self, index: usize, rssi_1m_dbm: Option<f64>, exponent: Option<f64>) -> bool {
        let Some(state) = self.states.get_mut(index) else { return false };
        let is_new = (state.rssi_1m_dbm, state.path_loss_exponent) != (rssi_1m_dbm, exponent);
        (state.rssi_1m_dbm, state.path_loss_exponent) = (rssi_1m_dbm, exponent);
        is_new
    }

    /// The nodes of a role whose places are known.
    pub(super) fn known(&self, role: NodeRole) -> BTreeMap<String, KnownNode> {
        let known = self.states.iter().filter(|state| state.role == role).filter_map(|state| {
            let &NodeState { position_m, rssi_1m_dbm, path_loss_exponent, .. } = state;
            Some((state.node.clone(), KnownNode { position_m: position_m?, rssi_1m_dbm, path_loss_exponent }))
        });
        known.collect()
    }

    /// A tag received a beacon's advertisement, or a receiver that of a device.
    pub(super) fn sight(&mut self, index: usize, t: Utc) {
        if let Some(state) = self.states.get_mut(index) {
            state.last_seen = Some(t);
            state.is_seen = true;
            state.means.rate.count(t);
        }
    }

    /// Its supply.
    pub(super) fn supply_mut(&mut self, index: usize) -> Option<&mut Supply> {
        Some(&mut self.states.get_mut(index)?.supply)
    }

    /// Its name.
    pub(super) fn name(&self, index: usize) -> Option<&str> {
        Some(&self.states.get(index)?.node)
    }

    /// A tag measured a range.
    pub(super) fn range(&mut self, index: usize, t: Utc, range: &RangeMeasurement) {
        self.sight(index, t);
        let (Some(state), Some(reach)) = (self.states.get_mut(index), self.reaches.get_mut(index)) else { return };
        state.means.ranges.add(t, range.range_m);
        reach.mean_m = state.means.ranges.mean().unwrap_or(0.0);
        if let Some((first_path_dbm, received_dbm)) = range.first_path_power_dbm.zip(range.rx_power_dbm) {
            state.means.power.add(t, first_path_dbm - received_dbm);
        }
        if let Some(offset_ppm) = range.clock_offset_ppm {
            state.means.clock_offset.add(t, offset_ppm);
        }
    }

    /// The end of a round at a position. `moved` gets the anchors that count as moved from now on. Returns whether one
    /// is back at its place.
    pub(super) fn end_round(
        &mut self,
        t: Utc,
        at_m: [f64; 3],
        round: &[RoundMeasurement],
        limits: &StateLimits,
        mut moved: impl FnMut(&str),
    ) -> bool {
        let mut is_back = false;
        if !round.iter().any(|measurement| measurement.range_m().is_some()) {
            return false;
        }
        self.rounds += 1;
        for (node, range_m) in round.iter().filter_map(RoundMeasurement::range_m) {
            let (Some(state), Some(reach)) = (self.states.get_mut(node), self.reaches.get_mut(node)) else {
                continue;
            };
            let distance_m = distance(reach.position_m, at_m);
            if distance_m.is_nan() || reach.round == self.rounds {
                continue;
            }
            reach.round = self.rounds;
            state.means.success.add(t, 1.0);
            state.means.residuals.add(t, range_m - distance_m);
            let was_moved = state.is_moved();
            state.check_place(t, limits);
            if state.is_moved() && !was_moved {
                moved(&state.node);
            }
            is_back |= was_moved && !state.is_moved();
        }
        for (state, reach) in self.states.iter_mut().zip(&self.reaches) {
            if reach.round != self.rounds && distance(reach.position_m, at_m) < reach.mean_m {
                state.means.success.add(t, 0.0);
            }
        }
        is_back
    }

    /// What the API shows of them.
    pub(super) fn show(&self, site: &str, now: Utc) -> impl Iterator<Item = NodeStatus> {
        self.states.iter().map(move |state| state.show(site, now))
    }

    /// The health of those that were seen since the last time.
    pub(super) fn take_health(&mut self, site: &str, now: Utc) -> impl Iterator<Item = NodeHealth> {
        let seen = self.states.iter_mut().filter_map(|state| std::mem::take(&mut state.is_seen).then_some(state));
        seen.map(move |state| NodeHealth {
            site: site.to_owned(),
            node: state.node.clone(),
            t: now,
            health: state.health(now),
        })
    }
}

impl NodeState {
    fn new(node: &str, role: NodeRole) -> Self {
        Self {
            node: node.to_owned(),
            role,
            name: None,
            position_m: None,
            rssi_1m_dbm: None,
            path_loss_exponent: None,
            last_seen: None,
            is_seen: false,
            means: Means::default(),
            placement: Placement::AtPlace,
            supply: Supply::default(),
        }
    }

    fn show(&self, site: &str, now: Utc) -> NodeStatus {
        NodeStatus {
            node: self.node.clone(),
            site: site.to_owned(),
            name: self.name.clone(),
            role: self.role,
            position_m: self.position_m,
            rssi_1m_dbm: self.rssi_1m_dbm,
            path_loss_exponent: self.path_loss_exponent,
            last_seen: self.last_seen,
            health: self.health(now),
        }
    }

    fn health(&self, now: Utc) -> HealthFigures {
        let Means { rate, ranges: _, residuals, power, clock_offset, success } = &self.means;
        HealthFigures {
            rate_hz: rate.hz(now),
            success_rate: success.mean(),
            residual_mean_m: residuals.mean(),
            residual_sigma_m: residuals.sigma(),
            first_path_minus_received_db: power.mean(),
            clock_offset_ppm: clock_offset.mean(),
            moved: self.is_moved(),
            supply_v: self.supply.volts,
        }
    }

    fn check_place(&mut self, t: Utc, limits: &StateLimits) {
        let Some(mean_m) = self.means.residuals.mean().map(f64::abs) else { return };
        let error_m = self.means.residuals.standard_error(LEAST_SECONDS);
        let is_off = mean_m > limits.moved_m && error_m.is_some_and(|error_m| mean_m > STANDARD_ERRORS * error_m);
        self.placement = match self.placement {
            Placement::Moved if !is_off && mean_m < BACK_AGAIN * limits.moved_m => Placement::AtPlace,
            Placement::Moved => Placement::Moved,
            Placement::AtPlace | Placement::Off { .. } if !is_off => Placement::AtPlace,
            Placement::AtPlace => Placement::Off { since: t },
            Placement::Off { since } if t.since(since) >= MOVED_FOR => Placement::Moved,
            // A clock that was set back begins anew.
            Placement::Off { since } => Placement::Off { since: since.min(t) },
        };
    }

    fn is_moved(&self) -> bool {
        match self.placement {
            Placement::AtPlace | Placement::Off { .. } => false,
            Placement::Moved => true,
        }
    }
}

/// Not a number where one of both is unknown.
fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let [x, y, z] = [0, 1, 2].map(|axis: usize| a[axis] - b[axis]);
    (x * x + y * y + z * z).sqrt()
}
