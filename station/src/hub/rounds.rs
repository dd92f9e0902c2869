//! Gathers the measurements of a tag until its round ends, with a position or without one. So they have the time of
//! the position for which they were made.

use std::collections::HashMap;

use crate::model::{Measured, Measurement};
use crate::{Report, ReportKind, Utc};

/// The most measurements of a round.
const MOST: usize = 64;
/// Ticks after which a round has ended, whatever comes: a device that is never located has no positions.
const TICKS: u8 = 5;

/// The measurements of a tag since its last position.
#[derive(Debug, Default)]
struct Round {
    measurements: Vec<Measurement>,
    ticks: u8,
}

impl Round {
    /// Its end at the time of its last measurement.
    fn end_with_last(self) -> Vec<Measurement> {
        let t = self.measurements.last().map_or_else(Utc::default, |measurement| measurement.t);
        self.end(t)
    }

    fn end(mut self, t: Utc) -> Vec<Measurement> {
        self.measurements.iter_mut().for_each(|measurement| measurement.round = t);
        self.measurements
    }
}

/// Rounds that have not ended.
#[derive(Debug, Default)]
pub(super) struct Rounds {
    /// By site and tag.
    open: HashMap<(String, String), Round>,
}

impl Rounds {
    /// Takes a report that the state has taken as one of the time `t`. Returns the measurements of the round that it
    /// ends.
    pub(super) fn take(&mut self, t: Utc, report: &Report) -> Vec<Measurement> {
        let (tag, node, what) = match &report.what {
            ReportKind::Range { tag, anchor, range_m, rx_power_dbm, first_path_power_dbm, clock_offset_ppm } => {
                let range = Measured::Range {
                    range_m: *range_m,
                    rx_power_dbm: *rx_power_dbm,
                    first_path_power_dbm: *first_path_power_dbm,
                    clock_offset_ppm: *clock_offset_ppm,
                };
                (tag, anchor, range)
            }
            ReportKind::Sighting { tag, beacon, rssi_dbm } => (tag, beacon, Measured::Rssi(*rssi_dbm)),
            ReportKind::ReceiverSighting { receiver, device, rssi_dbm, .. } => {
                (device, receiver, Measured::Rssi(*rssi_dbm))
            }
            ReportKind::Position { tag, .. } | ReportKind::NoPosition { tag, .. } => {
                return self.end(&(report.site.clone(), tag.clone()), t);
            }
            ReportKind::Node { .. } | ReportKind::Supply { .. } | ReportKind::PathLoss { .. } => return Vec::new(),
        };
        let of = (report.site.clone(), tag.clone());
        let round = self.open.entry(of.clone()).or_default();
        let (site, tag, node) = (report.site.clone(), tag.clone(), node.clone());
        round.measurements.push(Measurement { site, tag, node, round: t, t, what });
        if round.measurements.len() >= MOST { self.end(&of, t) } else { Vec::new() }
    }

    fn end(&mut self, of: &(String, String), t: Utc) -> Vec<Measurement> {
        self.open.remove(of).map_or_else(Vec::new, |round| round.end(t))
    }

    /// The measurements of rounds that have lasted too long.
    pub(super) fn tick(&mut self) -> Vec<Measurement> {
        let is_over = |round: &mut Round| {
            round.ticks += 1;
            round.ticks > TICKS
        };
        self.open.extract_if(|_, round| is_over(round)).flat_map(|(_, round)| round.end_with_last()).collect()
    }

    /// The measurements of all rounds.
    pub(super) fn end_all(&mut self) -> Vec<Measurement> {
        self.open.drain().flat_map(|(_, round)| round.end_with_last()).collect()
    }
}
