//! A sample of the rounds of a site's last minutes, from which a check finds whether its ranges fit its anchors.
//!
//! The input is rounds that end with a position or without one; the output is at most [`MOST`] of those of the last
//! [`TICKS`] ticks, which are seconds. Of n tags, each gives at most one round in n ticks, so that the sample is spread
//! evenly over tags and time. A round has at most 64 ranges, so a sample takes less than 1.5 MB, and about 100 kB where
//! tags measure to eight anchors.

use std::collections::{HashMap, VecDeque};

use super::nodes::Nodes;
use super::rounds::{EndedRound, RoundMeasurement};

/// The most rounds.
const MOST: usize = 300;
/// Rounds stay for this number of ticks: five minutes.
const TICKS: u64 = 300;
/// No position needs fewer ranges.
const LEAST_RANGES: usize = 3;

/// The ranges of a round.
#[derive(Clone, Debug, PartialEq)]
pub struct RecentRound {
    /// The tick in which it ended.
    tick: u64,
    /// The height at which the tag takes itself to be, metres. None: it finds its height, too.
    pub height_m: Option<f64>,
    /// The anchors' addresses, and the ranges to them, metres.
    pub ranges: Vec<(String, f64)>,
}

/// The sample of a site.
#[derive(Debug, Default)]
pub(super) struct RecentRounds {
    tick: u64,
    rounds: VecDeque<RecentRound>,
    /// The tick of each tag's last round in the sample.
    last: HashMap<String, u64>,
}

impl RecentRounds {
    /// Takes a round, if it is its tag's turn.
    pub(super) fn add(&mut self, tag: &str, height_m: Option<f64>, round: EndedRound<'_>, nodes: &Nodes) {
        let tags = u64::try_from(self.last.len()).unwrap_or(u64::MAX);
        if self.last.get(tag).is_some_and(|last| self.tick - last < tags) {
            return;
        }
        let ranges = round.measurements.iter().filter_map(RoundMeasurement::range_m);
        let ranges: Vec<_> =
            ranges.filter_map(|(node, range_m)| Some((nodes.name(node)?.to_owned(), range_m))).collect();
        if ranges.len() < LEAST_RANGES {
            return;
        }
        if self.rounds.len() >= MOST {
            self.rounds.pop_front();
        }
        self.rounds.push_back(RecentRound { tick: self.tick, height_m, ranges });
        self.last.insert(tag.to_owned(), self.tick);
    }

    /// A tick is over: forgets what is too old.
    pub(super) fn tick(&mut self) {
        self.tick += 1;
        let is_recent = |tick: u64| self.tick - tick <= TICKS;
        while self.rounds.front().is_some_and(|round| !is_recent(round.tick)) {
            self.rounds.pop_front();
        }
        self.last.retain(|_, last| is_recent(*last));
    }

    /// The rounds, the oldest first.
    pub(super) fn rounds(&self) -> impl Iterator<Item = &RecentRound> {
        self.rounds.iter()
    }
}
