//! When something counts, and what is an alarm.

use std::time::Duration;

/// When something counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StateLimits {
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

/// Probabilities at which a tag enters a room or a zone, and leaves it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Thresholds {
    /// It enters from outside of all.
    pub(super) enter: f64,
    /// It goes from one room directly to another one, while the old one has at most the rest.
    pub(super) changes: f64,
    /// It leaves.
    pub(super) leave: f64,
}

impl StateLimits {
    /// Of positions by ranges. A change is clear halfway between ½ and the limit for entering.
    pub(super) fn thresholds(&self) -> Thresholds {
        Thresholds { enter: self.enter, changes: 0.5 * (0.5 + self.enter), leave: self.leave }
    }
}

/// Which events are alarms, besides those of zones, which say so themselves
/// ([`Zone::alarm`](crate::model::Zone::alarm)).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Alarms {
    /// [`EventKind::Silent`](crate::model::EventKind::Silent).
    pub silent: bool,
    /// [`EventKind::Moved`](crate::model::EventKind::Moved).
    pub moved: bool,
    /// [`EventKind::Uncertain`](crate::model::EventKind::Uncertain).
    pub uncertain: bool,
    /// [`EventKind::LowSupply`](crate::model::EventKind::LowSupply).
    pub low_supply: bool,
    /// [`EventKind::Refusals`](crate::model::EventKind::Refusals).
    pub refusals: bool,
}

impl Default for Alarms {
    fn default() -> Self {
        Self { silent: true, moved: true, uncertain: true, low_supply: true, refusals: true }
    }
}

impl Default for StateLimits {
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
