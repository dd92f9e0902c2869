//! Rounds of asynchronous ranges: some recordings have one range an epoch, which makes no fix.

use std::collections::HashSet;

use crate::{Coordinates, Epoch, Epochs, Measured, by_time};

/// The share of the epochs with a single range in a recording that is made of single ranges.
const SINGLES: f64 = 0.9;
/// A round lasts for this many times the usual time between the ranges of all its anchors.
const PATIENCE: f64 = 1.5;
/// The shortest and the longest of rounds that are chosen, seconds.
const USUAL_S: [f64; 2] = [0.1, 0.35];

/// What to do with a recording whose epochs have single ranges, if nobody says for how long a round lasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SingleRanges {
    /// Make rounds of them.
    Group,
    /// Keep them as they are.
    Keep,
}

impl SingleRanges {
    /// The duration of rounds, seconds: what a user asks for (0: no rounds), else what suits the epochs.
    pub fn longest_s(self, asked_s: Option<f64>, epochs: &Epochs) -> Option<f64> {
        match (asked_s, self) {
            (Some(asked_s), _) => Some(asked_s).filter(|asked_s| *asked_s > 0.0),
            (None, Self::Group) => round_s(epochs),
            (None, Self::Keep) => None,
        }
    }
}

/// The duration of rounds that suits a recording of single ranges with times, seconds; `None` for any other recording.
pub fn round_s(epochs: &Epochs) -> Option<f64> {
    let heard = || epochs.iter().filter(|epoch| !epoch.ranges.is_empty());
    let (all, single) = (heard().count(), heard().filter(|epoch| epoch.ranges.len() == 1).count());
    if all < 2 || (single as f64) < SINGLES * all as f64 {
        return None;
    }
    let anchors = heard().flat_map(|epoch| epoch.ranges.iter()).map(|range| range.anchor).collect::<HashSet<_>>().len();
    let mut times_s = heard().map(|epoch| epoch.t_s).collect::<Option<Vec<f64>>>()?;
    if anchors < 2 {
        return None;
    }
    times_s.sort_by(f64::total_cmp);
    let mut steps_s: Vec<f64> = times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps_s.sort_by(f64::total_cmp);
    let [least_s, most_s] = USUAL_S;
    Some((PATIENCE * anchors as f64 * baliza_report::percentile(&steps_s, 0.5)).clamp(least_s, most_s))
}

/// Of several ranges of one anchor at one time in an epoch, keeps the median (of two, the shorter one, because a
/// blocked range is too long). Returns how many were dropped.
pub fn drop_repeats(epochs: &mut Epochs) -> usize {
    // Equal anchors and times stand behind each other, the shorter ranges first.
    let mut sorted: Vec<((usize, Option<u64>), f64, usize)> = Vec::new();
    let mut dropped: Vec<(usize, usize)> = Vec::new();
    for (at, epoch) in epochs.iter().enumerate() {
        sorted.clear();
        let ranges = epoch.ranges.iter().enumerate();
        sorted.extend(ranges.map(|(at, range)| ((range.anchor, range.t_s.map(f64::to_bits)), range.range_m, at)));
        sorted.sort_unstable_by(|(one, one_m, first), (other, other_m, second)| {
            one.cmp(other).then(one_m.total_cmp(other_m)).then(first.cmp(second))
        });
        for alike in sorted.chunk_by(|(one, _, _), (other, _, _)| one == other) {
            let median = (alike.len() - 1) / 2;
            let others = alike.iter().enumerate().filter(|(place, _)| *place != median);
            dropped.extend(others.map(|(_, (_, _, range))| (at, *range)));
        }
    }
    if !dropped.is_empty() {
        dropped.sort_unstable();
        epochs.retain_ranges(|place| dropped.binary_search(&place).is_err());
    }
    dropped.len()
}

/// A round that has not ended. It ends where an anchor repeats, or where more than `longest_s` seconds have passed since
/// its first range. It has the name, time and true position of its last range's epoch.
#[derive(Debug, Default)]
pub struct OpenRound {
    longest_s: f64,
    began_s: Option<f64>,
    /// Of the last range: the name, the true position and, where it is known, the time of its epoch.
    name: String,
    t_s: Option<f64>,
    truth: Option<Coordinates>,
    ranges: Vec<Measured>,
}

impl OpenRound {
    /// The first of rounds that last for `longest_s` seconds at most.
    pub fn new(longest_s: f64) -> Self {
        Self { longest_s, ..Self::default() }
    }

    /// Takes the next range, of an epoch with this name and true position. A round that ends before it is added to
    /// `rounds`.
    pub fn take(&mut self, name: &str, truth: Option<Coordinates>, range: Measured, rounds: &mut Epochs) {
        let is_late = range.t_s.zip(self.began_s).is_some_and(|(t_s, began_s)| t_s - began_s > self.longest_s);
        if is_late || self.ranges.iter().any(|other| other.anchor == range.anchor) {
            self.end(rounds);
        }
        if self.ranges.is_empty() {
            (self.began_s, self.t_s) = (range.t_s, None);
        }
        name.clone_into(&mut self.name);
        (self.t_s, self.truth) = (range.t_s.or(self.t_s), truth);
        self.ranges.push(range);
    }

    /// Ends the round, where it has a range.
    pub fn end(&mut self, rounds: &mut Epochs) {
        if !self.ranges.is_empty() {
            rounds.push(&self.name, self.t_s, self.truth);
            self.ranges.drain(..).for_each(|range| rounds.push_range(&range));
        }
    }
}

/// The ranges of all epochs in rounds of at most `longest_s` seconds. Epochs without ranges make no round.
pub fn rounds(epochs: &Epochs, longest_s: f64) -> Epochs {
    let of_epoch = |at: usize| epochs.get(at).map_or(0, |epoch| epoch.ranges.len());
    // The place of each range: its epoch, and its number in it.
    let singles: Vec<(usize, usize)> = by_time(epochs.times_s())
        .into_iter()
        .flat_map(|epoch| (0..of_epoch(epoch)).map(move |range| (epoch, range)))
        .collect();
    let single = |&(epoch, range): &(usize, usize)| {
        let epoch = epochs.get(epoch)?;
        let range = epoch.ranges.get(range)?;
        Some((epoch, Measured { t_s: range.t_s.or(epoch.t_s), ..range }))
    };
    let (mut rounds, mut round) = (Epochs::default(), OpenRound::new(longest_s));
    for at in by_time(singles.iter().map(|place| single(place)?.1.t_s)) {
        let Some((Epoch { name, truth, .. }, range)) = singles.get(at).and_then(single) else { continue };
        round.take(name, truth, range, &mut rounds);
    }
    round.end(&mut rounds);
    rounds
}
