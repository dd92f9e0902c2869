//! Gathers the measurements of each tag until its round ends, with a position or without one.
//!
//! ```text
//!            first measurement                its position, its NoPosition
//!   ended ───────────────────────▶ open ──────────────────────────────────▶ ended, complete
//!                                   │
//!                                   └── a measurement or an end of another number, MOST measurements,
//!                                       TICKS ticks ────────────────────────▶ ended, its end did not arrive
//! ```
//!
//! Tags number their rounds, and a measurement has the number of its round. So the measurements of a round whose end was
//! lost are not taken for those of the next one. Measurements without a number (sightings, receivers) belong to the
//! round that is open.

use std::collections::HashMap;

use super::nodes::Nodes;
use crate::Utc;
use crate::model::{MeasuredValue, NodeMeasurement};

/// The most measurements of a round.
pub(super) const MOST: usize = 64;
/// Ticks after which a round has ended, whatever comes: a device that is never located has no positions.
const TICKS: u8 = 5;

/// A measurement of an open round.
#[derive(Clone, Copy, Debug)]
pub(super) struct RoundMeasurement {
    /// The node's index.
    pub(super) node: usize,
    pub(super) t: Utc,
    pub(super) measured: MeasuredValue,
}

impl RoundMeasurement {
    /// The node and the range to it, metres, if it is a range.
    pub(super) fn range_m(&self) -> Option<(usize, f64)> {
        match self.measured {
            MeasuredValue::Range(range) => Some((self.node, range.range_m)),
            MeasuredValue::Rssi(_) => None,
        }
    }
}

/// A round of a tag: the one that is open, or the last one.
#[derive(Debug, Default)]
pub(super) struct Round {
    is_open: bool,
    number: Option<u16>,
    measurements: Vec<RoundMeasurement>,
    ticks: u8,
}

/// A round that has ended.
#[derive(Clone, Copy, Debug)]
pub(super) struct EndedRound<'a> {
    /// The time of its end, or of its last measurement where the end did not arrive.
    t: Utc,
    pub(super) measurements: &'a [RoundMeasurement],
}

impl EndedRound<'_> {
    /// Its measurements, as they are kept.
    pub(super) fn kept(self, site: &str, tag: &str, nodes: &Nodes) -> impl Iterator<Item = NodeMeasurement> {
        self.measurements.iter().filter_map(move |&RoundMeasurement { node, t, measured }| {
            let node = nodes.name(node)?.to_owned();
            Some(NodeMeasurement { site: site.to_owned(), tag: tag.to_owned(), node, round: self.t, t, what: measured })
        })
    }
}

impl Round {
    /// Ends the open round where it has another number than this one.
    pub(super) fn end_other(&mut self, number: Option<u16>) -> Option<EndedRound<'_>> {
        let is_other = self.number.zip(number).is_some_and(|(open, other)| open != other);
        if is_other { self.end_with_last() } else { None }
    }

    /// Takes a measurement of the open round, or begins one with it. Returns the round where that is full.
    pub(super) fn add(&mut self, number: Option<u16>, measurement: RoundMeasurement) -> Option<EndedRound<'_>> {
        if !self.is_open {
            (self.is_open, self.number, self.ticks) = (true, None, 0);
            self.measurements.clear();
        }
        self.number = self.number.or(number);
        self.measurements.push(measurement);
        if self.measurements.len() >= MOST { self.end(measurement.t) } else { None }
    }

    /// The end at this time.
    pub(super) fn end(&mut self, t: Utc) -> Option<EndedRound<'_>> {
        std::mem::take(&mut self.is_open).then_some(EndedRound { t, measurements: &self.measurements })
    }

    /// The end at the time of the last measurement.
    pub(super) fn end_with_last(&mut self) -> Option<EndedRound<'_>> {
        let t = self.measurements.last().map_or_else(Utc::default, |measurement| measurement.t);
        self.end(t)
    }
}

/// The rounds of a site, by tag.
#[derive(Debug, Default)]
pub(super) struct Rounds {
    by_tag: HashMap<String, Round>,
}

impl Rounds {
    /// The tag's round, which may have ended.
    pub(super) fn of(&mut self, tag: &str) -> &mut Round {
        self.by_tag.entry(tag.to_owned()).or_default()
    }

    /// The tag's round, where it has begun one.
    pub(super) fn known(&mut self, tag: &str) -> Option<&mut Round> {
        self.by_tag.get_mut(tag)
    }

    /// Ends the rounds that have lasted too long.
    pub(super) fn tick(&mut self, mut ended: impl FnMut(&str, EndedRound<'_>)) {
        self.by_tag.retain(|tag, round| {
            round.ticks += 1;
            let is_over = round.ticks > TICKS;
            if is_over && let Some(round) = round.end_with_last() {
                ended(tag, round);
            }
            !is_over
        });
    }

    /// Ends all rounds.
    pub(super) fn end_all(&mut self, mut ended: impl FnMut(&str, EndedRound<'_>)) {
        for (tag, round) in &mut self.by_tag {
            if let Some(round) = round.end_with_last() {
                ended(tag, round);
            }
        }
        self.by_tag.clear();
    }

    /// Ends the round of a tag that is forgotten.
    pub(super) fn forget(&mut self, tag: &str, mut ended: impl FnMut(EndedRound<'_>)) {
        if let Some(round) = self.by_tag.remove(tag).as_mut().and_then(Round::end_with_last) {
            ended(round);
        }
    }

    #[cfg(test)]
    pub(super) fn capacity(&self, tag: &str) -> usize {
        self.by_tag[tag].measurements.capacity()
    }
}
