//! Questions about the ranges themselves: values that stand for none, negative ones, repeated ones, and their unit.

use std::collections::HashMap;

use baliza_report::percentile;
use recording::{Coordinates, Recording};

use super::layout::ranged;
use super::{Finding, FindingCode};

/// The median range is hardly more than this many times as long as the anchors' extent; from the second number on, the
/// ranges are in millimetres rather than centimetres.
const LONG_RANGES: [f64; 2] = [15.0, 170.0];
/// The anchors' extent is hardly more than this many times as long as the median range, likewise.
const WIDE_ANCHORS: [f64; 2] = [30.0, 530.0];
/// A value that no measurement repeats stands for none where it is this share of the ranges, and this number of them.
const STANDS_FOR_NONE: f64 = 0.005;
const AT_LEAST: usize = 3;

/// What the values say.
pub(super) fn questions(recording: &Recording, repeats: usize) -> Vec<Finding> {
    let none = for_none(recording);
    // What stands for none is no negative range.
    let negative = if none.is_some() { None } else { negative(recording) };
    [none, negative, repeated(repeats)].into_iter().flatten().collect()
}

/// The value at or below zero that stands for none: 0 or -1 as a rule.
fn for_none(recording: &Recording) -> Option<Finding> {
    let mut counts: HashMap<u64, usize> = HashMap::new();
    let mut all = 0;
    for range in recording.epochs.iter().flat_map(|epoch| epoch.ranges.iter()) {
        all += 1;
        if range.range_m <= 0.0 {
            // Both zeros are one.
            *counts.entry((range.range_m + 0.0).to_bits()).or_default() += 1;
        }
    }
    let (value, count) = counts.into_iter().max_by_key(|(value, count)| (*count, *value))?;
    let (value, share) = (f64::from_bits(value), count as f64 / f64::from(all));
    // A zero may be a short range, a negative one that repeats is none.
    let least = if value < 0.0 { 2 } else { AT_LEAST };
    (count >= least && share > STANDS_FOR_NONE).then(|| {
        let message = format!(
            "{count} of {all} ranges are exactly {value}: does {value} stand for none? Leave the field empty, or the row out"
        );
        Finding::new(FindingCode::ZeroForNone, message).with("share", share).with("value_m", value)
    })
}

/// The unit that the lengths seem to have, by the ratio of the ranges to the distances between the anchors.
pub(super) fn unit(recording: &Recording) -> Option<Finding> {
    let ranged = ranged(recording);
    let places: Vec<&Coordinates> = ranged.iter().map(|anchor| &anchor.place).collect();
    let mut ranges: Vec<f64> =
        recording.epochs.iter().flat_map(|epoch| epoch.ranges.iter()).map(|range| range.range_m).collect();
    ranges.sort_unstable_by(f64::total_cmp);
    let extent = |axis: fn(&Coordinates) -> f64| {
        let (least, greatest) = places
            .iter()
            .map(|place| axis(place))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, greatest), at| (least.min(at), greatest.max(at)));
        greatest - least
    };
    let extent_m = extent(|place| place.x_m).hypot(extent(|place| place.y_m));
    let median_m = if ranges.is_empty() { 0.0 } else { percentile(&ranges, 0.5) };
    if !(extent_m > 0.0 && median_m > 0.0) {
        return None;
    }
    let question = |what: &str, ratio: f64, [wrong, millimetres]: [f64; 2]| {
        let (code, unit) = if ratio > millimetres {
            (FindingCode::UnitMillimetres, "millimetres")
        } else {
            (FindingCode::UnitCentimetres, "centimetres")
        };
        (ratio > wrong).then(|| {
            let message = format!(
                "half of the ranges are longer than {median_m:.1} m, and the anchors are within {extent_m:.1} m of each other: \
                 are {what} in {unit}? Metres are expected"
            );
            Finding::new(code, message).with("median_range_m", median_m).with("extent_m", extent_m)
        })
    };
    question("the ranges", median_m / extent_m, LONG_RANGES)
        .or_else(|| question("the anchors", extent_m / median_m, WIDE_ANCHORS))
}

fn negative(recording: &Recording) -> Option<Finding> {
    let mut negative = recording
        .epochs
        .iter()
        .flat_map(|epoch| epoch.ranges.iter().map(move |range| (epoch, range)))
        .filter(|(_, range)| range.range_m < 0.0);
    let (epoch, range) = negative.next()?;
    let count = 1 + negative.count();
    let anchor = recording.anchors.get(range.anchor).map_or("?", |anchor| anchor.name.as_str());
    let message = format!(
        "{count} of the ranges are negative, the first is {} m to anchor {anchor} in epoch {}: calibrate the antenna \
         delays, which are too large",
        range.range_m, epoch.name
    );
    Some(Finding::new(FindingCode::RangesNegative, message).about([anchor.to_owned()]))
}

/// Epochs had several ranges of one anchor, of which `count` were dropped.
fn repeated(count: usize) -> Option<Finding> {
    (count > 0).then(|| {
        let message = format!(
            "epochs have several ranges of one anchor at one time, of which the median counts and {count} were dropped: give \
             each fix an epoch of its own"
        );
        Finding::new(FindingCode::RangesRepeated, message)
    })
}
