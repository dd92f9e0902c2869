//! Rounds of asynchronous ranges: some recordings have one range an epoch, which makes no fix.

use std::collections::{HashMap, HashSet};

use crate::{Coordinates, Epoch, Measured, by_time};

/// The share of the epochs with a single range in a recording that is made of single ranges.
const SINGLES: f64 = 0.9;
/// A round lasts for this many times the usual time between the ranges of all its anchors.
const PATIENCE: f64 = 1.5;
/// The shortest and the longest of rounds that are chosen, seconds.
const USUAL_S: [f64; 2] = [0.1, 0.35];

/// A range, its epoch's name, its time, and the true position at its time.
type Single = (Measured, String, Option<f64>, Option<Coordinates>);

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
    pub fn longest_s(self, asked_s: Option<f64>, epochs: &[Epoch]) -> Option<f64> {
        match (asked_s, self) {
            (Some(asked_s), _) => Some(asked_s).filter(|asked_s| *asked_s > 0.0),
            (None, Self::Group) => round_s(epochs),
            (None, Self::Keep) => None,
        }
    }
}

/// The duration of rounds that suits a recording of single ranges with times, seconds; `None` for any other recording.
pub fn round_s(epochs: &[Epoch]) -> Option<f64> {
    let heard = || epochs.iter().filter(|epoch| !epoch.ranges.is_empty());
    let (all, single) = (heard().count(), heard().filter(|epoch| epoch.ranges.len() == 1).count());
    let anchors = heard().flat_map(|epoch| &epoch.ranges).map(|range| range.anchor).collect::<HashSet<_>>().len();
    let mut times_s = heard().map(|epoch| epoch.t_s).collect::<Option<Vec<f64>>>()?;
    if all < 2 || anchors < 2 || (single as f64) < SINGLES * all as f64 {
        return None;
    }
    times_s.sort_by(f64::total_cmp);
    let mut steps_s: Vec<f64> = times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps_s.sort_by(f64::total_cmp);
    let [least_s, most_s] = USUAL_S;
    Some((PATIENCE * anchors as f64 * baliza_report::percentile(&steps_s, 0.5)).clamp(least_s, most_s))
}

/// Of several ranges of one anchor at one time in an epoch, keeps the median (of two, the shorter one, because a blocked
/// range is too long). Returns how many were dropped.
pub fn drop_repeats(epochs: &mut [Epoch]) -> usize {
    let key = |range: &Measured| (range.anchor, range.t_s.map(f64::to_bits));
    let mut dropped = 0;
    for epoch in epochs {
        let mut alike: HashMap<_, Vec<usize>> = HashMap::new();
        for (at, range) in epoch.ranges.iter().enumerate() {
            alike.entry(key(range)).or_default().push(at);
        }
        if alike.len() == epoch.ranges.len() {
            continue;
        }
        let median = |places: &mut Vec<usize>| {
            places.sort_by(|a, b| epoch.ranges[*a].range_m.total_cmp(&epoch.ranges[*b].range_m));
            places[(places.len() - 1) / 2]
        };
        let mut kept: Vec<usize> = alike.values_mut().map(median).collect();
        kept.sort_unstable();
        dropped += epoch.ranges.len() - kept.len();
        epoch.ranges = kept.into_iter().map(|at| epoch.ranges[at]).collect();
    }
    dropped
}

/// The ranges of all epochs in rounds. A round ends where an anchor repeats, or where more than `longest_s` seconds
/// have passed since its first range. It has the name, time and true position of its last range's epoch. Epochs without
/// ranges make no round.
pub fn rounds(epochs: Vec<Epoch>, longest_s: f64) -> Vec<Epoch> {
    let order = by_time(epochs.iter().map(|epoch| epoch.t_s));
    let mut epochs: Vec<_> = epochs.into_iter().map(Some).collect();
    let in_order = order.into_iter().filter_map(|at| epochs.get_mut(at)?.take());
    let singles: Vec<Single> = in_order
        .flat_map(|Epoch { name, t_s, ranges, truth, .. }| {
            ranges.into_iter().map(move |range| (range, name.clone(), range.t_s.or(t_s), truth))
        })
        .collect();
    let mut rounds: Vec<Epoch> = Vec::new();
    let mut began_s = None;
    for at in by_time(singles.iter().map(|(_, _, t_s, _)| *t_s)) {
        let Some((range, name, t_s, truth)) = singles.get(at) else { continue };
        let is_late = t_s.zip(began_s).is_some_and(|(t_s, began_s)| t_s - began_s > longest_s);
        let range = Measured { t_s: *t_s, ..*range };
        match rounds.last_mut() {
            Some(round) if !is_late && round.ranges.iter().all(|other| other.anchor != range.anchor) => {
                round.ranges.push(range);
                round.name.clone_from(name);
                round.t_s = t_s.or(round.t_s);
                round.truth = *truth;
            }
            Some(_) | None => {
                began_s = *t_s;
                rounds.push(Epoch {
                    name: name.clone(),
                    t_s: *t_s,
                    ranges: vec![range],
                    truth: *truth,
                    ..Epoch::default()
                });
            }
        }
    }
    rounds
}
