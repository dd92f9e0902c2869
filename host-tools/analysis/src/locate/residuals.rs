//! The ranges' residuals by anchor: how much longer a range is than the distance from the tag to the anchor.
//!
//! Input: a recording, and positions (true ones, or solved ones). Output: figures for each anchor, and a remark where
//! its position, its antenna delay or its line of sight is in doubt.

use baliza_report::{mean, percentile};

use crate::Setup;
use recording::{Anchor, Coordinates, Epoch, Epochs, Height, Measured, Position, Solved, Space, Truth, by_time};

/// A range that is longer than the distance by more than this counts as blocked, metres.
const BLOCKED_M: f64 = 0.3;
/// An anchor with a greater share of blocked ranges is often blocked.
const OFTEN: f64 = 0.2;
/// The median of a right anchor differs from those of the others by no more than this, metres, or by no more than three
/// of their robust standard deviations.
const DIFFERS_M: f64 = 0.15;
/// Ranges of an anchor that are farther apart in time do not follow each other, seconds.
const FOLLOWS_S: f64 = 0.5;
/// The standard deviation of a normal distribution by the median of the absolute values.
const BY_MEDIAN: f64 = 1.4826;

/// The figures of an anchor. They are `None` without ranges.
#[derive(Clone, Debug, PartialEq)]
pub struct AnchorResiduals {
    /// The anchor's name.
    pub anchor: String,
    /// The number of ranges with a residual.
    pub ranges: usize,
    /// Mean residual, metres.
    pub mean_m: Option<f64>,
    /// Standard deviation, metres.
    pub std_m: Option<f64>,
    /// Median, metres.
    pub median_m: Option<f64>,
    /// Standard deviation of the white part, metres: the median absolute difference of ranges that follow each other
    /// within half a second, × 1.4826 ⁄ √2. `None` without such ranges.
    pub white_m: Option<f64>,
    /// The share of the ranges that are more than 0.3 m too long.
    pub blocked_share: Option<f64>,
    /// What is in doubt.
    pub remark: Option<Remark>,
}

/// What is in doubt about an anchor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remark {
    /// Nearly all its ranges are wrong by the same amount.
    Wrong,
    /// Its ranges are too long, and a tag at rest cannot tell why.
    WrongOrBlocked,
    /// Many of its ranges are too long.
    OftenBlocked,
}

impl Remark {
    /// The remark as text.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Wrong => "this anchor's position or antenna delay is wrong",
            Self::WrongOrBlocked => "always blocked, or this anchor's position or antenna delay is wrong",
            Self::OftenBlocked => "often blocked",
        }
    }
}

/// The positions from which residuals are computed.
#[derive(Clone, Copy, Debug)]
pub enum Reference<'a> {
    /// The truth, at the time of each range. The second field is added to the times of the truth, seconds.
    Truth(&'a Truth, f64),
    /// Positions of the epochs.
    Solved(&'a [Solved]),
}

/// The residuals of an anchor's ranges, in the order of time.
#[derive(Clone, Debug, Default)]
struct Series(Vec<(Option<f64>, f64)>);

/// The figures of all anchors, in the order of the recording.
pub fn residuals(anchors: &[Anchor], epochs: &Epochs, setup: &Setup, reference: Reference<'_>) -> Vec<AnchorResiduals> {
    let mut series = vec![Series::default(); anchors.len()];
    let mut places_m: Vec<[f64; 2]> = Vec::new();
    for at in by_time(epochs.times_s()) {
        let Some(epoch) = epochs.get(at) else { continue };
        for index in by_time(epoch.ranges.iter().map(|range| range.t_s)) {
            let Some(range) = epoch.ranges.get(index) else { continue };
            let Some(tag) = reference.at(at, &epoch, &range, setup) else { continue };
            let Some(anchor) = anchors.get(range.anchor) else { continue };
            let Some(distance_m) = distance_m(&tag, &anchor.place, setup) else { continue };
            places_m.push([tag.x_m, tag.y_m]);
            if let Some(Series(series)) = series.get_mut(range.anchor) {
                series.push((range.t_s.or(epoch.t_s), range.range_m - distance_m));
            }
        }
    }
    let mut figures: Vec<_> =
        anchors.iter().zip(&series).map(|(anchor, series)| series.figures(anchor.name.clone())).collect();
    let medians: Vec<Option<f64>> = figures.iter().map(|anchor| anchor.median_m).collect();
    let moves = moves(&places_m);
    for (at, (anchor, series)) in figures.iter_mut().zip(&series).enumerate() {
        let others = medians.iter().enumerate().filter(|(other, _)| *other != at).filter_map(|(_, median)| *median);
        anchor.remark = series.remark(others.collect(), moves);
    }
    figures
}

impl Reference<'_> {
    fn at(&self, index: usize, epoch: &Epoch, range: &Measured, setup: &Setup) -> Option<Coordinates> {
        match *self {
            // An epoch and its ranges usually have one time.
            Self::Truth(truth, offset_s) => match range.t_s {
                Some(t_s) if epoch.t_s != Some(t_s) => truth.at(t_s - offset_s).or(epoch.truth),
                Some(_) | None => epoch.truth,
            },
            Self::Solved(solved) => {
                let Position { place, .. } = solved.get(index)?.outcome.ok()?;
                let z_m = match setup.space {
                    Space::Full(_) => place.z_m,
                    Space::Plane(Height::Unknown) => None,
                    Space::Plane(Height::Fixed(z_m)) => Some(z_m),
                    Space::Plane(Height::FromTruth) => epoch.truth.and_then(|truth| truth.z_m),
                };
                Some(Coordinates { z_m, ..place })
            }
        }
    }
}

/// The distance between tag and anchor. It is horizontal where ranges are taken as horizontal. `None` where a height is
/// missing.
fn distance_m(tag: &Coordinates, anchor: &Coordinates, setup: &Setup) -> Option<f64> {
    let tag_z = match setup.space {
        Space::Plane(Height::Fixed(z_m)) => tag.z_m.or(Some(z_m)),
        Space::Plane(Height::Unknown | Height::FromTruth) | Space::Full(_) => tag.z_m,
    };
    let up_m = match (tag_z.zip(anchor.z_m), setup.space) {
        (Some((tag_z, anchor_z)), _) => tag_z - anchor_z,
        (None, Space::Plane(Height::Unknown)) => 0.0,
        (None, Space::Plane(Height::Fixed(_) | Height::FromTruth) | Space::Full(_)) => return None,
    };
    Some((tag.x_m - anchor.x_m).hypot(tag.y_m - anchor.y_m).hypot(up_m))
}

/// Whether the tag was at places that are a metre apart: nine of ten positions reach over a metre along an axis.
fn moves(places_m: &[[f64; 2]]) -> bool {
    [0, 1].into_iter().any(|axis| {
        let mut along: Vec<f64> = places_m.iter().map(|place| place[axis]).collect();
        along.sort_by(f64::total_cmp);
        percentile(&along, 0.95) - percentile(&along, 0.05) > 1.0
    })
}

/// The median and the robust standard deviation.
fn middle(mut values: Vec<f64>) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    let median = percentile(&values, 0.5);
    let mut distances: Vec<f64> = values.iter().map(|value| (value - median).abs()).collect();
    distances.sort_by(f64::total_cmp);
    (median, BY_MEDIAN * percentile(&distances, 0.5))
}

impl Series {
    fn sorted(&self) -> Vec<f64> {
        let mut sorted: Vec<f64> = self.0.iter().map(|(_, residual)| *residual).collect();
        sorted.sort_by(f64::total_cmp);
        sorted
    }

    fn figures(&self, anchor: String) -> AnchorResiduals {
        let sorted = self.sorted();
        let known = |figure: f64| (!sorted.is_empty()).then_some(figure);
        let mean_m = mean(sorted.iter().copied());
        AnchorResiduals {
            anchor,
            ranges: sorted.len(),
            mean_m: known(mean_m),
            std_m: known(mean(sorted.iter().map(|residual| (residual - mean_m).powi(2))).sqrt()),
            median_m: known(percentile(&sorted, 0.5)),
            white_m: self.white_m(),
            blocked_share: known(share_above(&sorted, BLOCKED_M)),
            remark: None,
        }
    }

    fn white_m(&self) -> Option<f64> {
        let pairs = self.0.iter().zip(self.0.iter().skip(1));
        let steps = pairs.filter(|((before_s, _), (t_s, _))| {
            t_s.zip(*before_s).is_some_and(|(t_s, before_s)| t_s - before_s <= FOLLOWS_S)
        });
        let mut steps_m: Vec<f64> = steps.map(|((_, before), (_, residual))| (residual - before).abs()).collect();
        steps_m.sort_by(f64::total_cmp);
        (!steps_m.is_empty()).then(|| BY_MEDIAN / 2.0_f64.sqrt() * percentile(&steps_m, 0.5))
    }

    /// What is in doubt, given the medians of the other anchors, metres.
    fn remark(&self, others: Vec<f64>, tag_moves: bool) -> Option<Remark> {
        let sorted = self.sorted();
        let comparable = others.len() >= 2;
        let (usual_m, deviation_m) = if comparable { middle(others) } else { (0.0, 0.0) };
        let margin_m = DIFFERS_M.max(3.0 * deviation_m);
        let apart = |share: f64| percentile(&sorted, share) - usual_m;
        // Obstacles make ranges longer, so ranges that are too short, and those of which even the short ones are too
        // long at many places, have another cause.
        if sorted.is_empty() {
            None
        } else if comparable && (apart(0.5) < -margin_m || (apart(0.1) > margin_m && tag_moves)) {
            Some(Remark::Wrong)
        } else if comparable && apart(0.1) > margin_m {
            Some(Remark::WrongOrBlocked)
        } else if share_above(&sorted, usual_m.max(0.0) + BLOCKED_M) > OFTEN {
            Some(Remark::OftenBlocked)
        } else if comparable && apart(0.5).abs() > margin_m {
            Some(if tag_moves { Remark::Wrong } else { Remark::WrongOrBlocked })
        } else {
            None
        }
    }
}

fn share_above(sorted: &[f64], limit_m: f64) -> f64 {
    mean(sorted.iter().map(|residual| f64::from(u8::from(*residual > limit_m))))
}
