//! The difference between the clocks of ranges and truth, from positions: recordings of two computers disagree by some
//! tenths of a second.
//!
//! Input: positions with their times, each found without memory, and the truth. Output: the seconds to add to the times
//! of the truth. A tag with velocity v whose truth is late by d seems wrong by v d. Errors that belong to a place (of
//! blocked links, of antenna delays) look alike where the tag passes once, so only differences of errors and
//! velocities within cells of a metre count: fixed effects, as in J. Wooldridge, Econometric Analysis of Cross Section
//! and Panel Data, chapter 10. A search over ±2 s is followed by weighted least squares with Cauchy's weights, whose
//! standard error comes from blocks of five seconds.

use std::collections::HashMap;

use baliza_report::{mean, percentile};

use positioning_core::Method;

use crate::{Setup, Solver};
use recording::{Coordinates, Epoch, Measured, Recording, Solved, Truth};

/// The greatest offset that is searched for, seconds.
pub const REACH_S: f64 = 2.0;
/// The step of the search, seconds.
const STEP_S: f64 = 0.1;
/// The edge of a cell, metres.
const CELL_M: f64 = 1.0;
/// Half the time over which velocities are taken, seconds.
const HALF_S: f64 = 0.1;
/// The duration of a block, within which errors are alike, seconds.
const BLOCK_S: f64 = 5.0;
/// The least scale of errors, metres.
const LEAST_M: f64 = 0.01;
/// Fewer positions or blocks tell nothing.
const FEWEST: (usize, usize) = (20, 4);
/// A greater standard error tells nothing, seconds.
const VAGUE_S: f64 = 0.1;
/// An offset is believed from this number of standard errors.
const CERTAIN: f64 = 3.0;
/// Iterations of the least squares.
const ITERATIONS: usize = 10;

/// A position with its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedPosition {
    /// The time, seconds.
    pub t_s: f64,
    /// x and y, metres.
    pub at_m: [f64; 2],
}

/// The difference between two clocks, seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Clocks {
    /// These seconds must be added to the times of the truth, with this standard error.
    Differ {
        /// The seconds.
        offset_s: f64,
        /// The standard error, seconds.
        deviation_s: f64,
    },
    /// No difference can be seen.
    Agree {
        /// The standard error, seconds.
        deviation_s: f64,
    },
    /// The tag moves too little for an estimate that is sure.
    Vague {
        /// The estimate, seconds.
        offset_s: f64,
        /// The standard error, seconds.
        deviation_s: f64,
    },
    /// There is no estimate: too few positions have a time and a truth, or the tag rests.
    Unknown,
    /// The best offset is beyond two seconds, or makes the errors no smaller.
    NoneFits,
}

impl Clocks {
    /// The seconds to add to the times of the truth; 0 without a sure estimate.
    pub fn offset_s(self) -> f64 {
        match self {
            Self::Differ { offset_s, .. } => offset_s,
            Self::Agree { .. } | Self::Vague { .. } | Self::Unknown | Self::NoneFits => 0.0,
        }
    }
}

/// The clocks of a recording and of its truth, by the positions of single epochs.
pub fn clocks(recording: &Recording, setup: Setup, truth: &Truth) -> Clocks {
    let epochs = &recording.epochs;
    // Heights change slowly, so those of the unshifted truth are good enough here.
    let (truths, _) = truth.of_epochs(epochs.iter().map(|epoch| (epoch.name, epoch.t_s)), 0.0);
    let solver = Solver::new(&recording.anchors, setup);
    let joined = epochs.iter().zip(truths).map(|(epoch, truth)| Epoch { truth, ..epoch });
    let positions = joined.filter_map(|epoch| timed_position(&epoch, &solver.solve(Method::Robust, &epoch)));
    time_offset(&positions.collect::<Vec<_>>(), truth)
}

/// The position with its time: the mean time of its ranges.
fn timed_position(epoch: &Epoch<'_>, solved: &Solved) -> Option<TimedPosition> {
    let Coordinates { x_m, y_m, .. } = solved.outcome.ok()?.place;
    let times_s = epoch.ranges.iter().map(|Measured { t_s, .. }| t_s.or(epoch.t_s)).collect::<Option<Vec<_>>>()?;
    Some(TimedPosition { t_s: mean(times_s), at_m: [x_m, y_m] }).filter(|position| position.t_s.is_finite())
}

/// The seconds to add to the times of the truth.
fn time_offset(positions: &[TimedPosition], truth: &Truth) -> Clocks {
    if positions.len() < FEWEST.0 {
        return Clocks::Unknown;
    }
    let steps = (REACH_S / STEP_S).round() as i32;
    let tried = (-steps..=steps).map(|step| STEP_S * f64::from(step));
    let costs = tried.map(|offset_s| (offset_s, cost_m(positions, truth, offset_s)));
    let best = costs.filter(|(_, cost)| cost.is_finite()).min_by(|(_, one), (_, other)| one.total_cmp(other));
    let Some((mut offset_s, _)) = best else { return Clocks::Unknown };
    let mut deviation_s = f64::INFINITY;
    for _ in 0..ITERATIONS {
        let Some((step_s, error_s)) = least_squares(positions, truth, offset_s) else { return Clocks::Unknown };
        deviation_s = error_s;
        if deviation_s > REACH_S {
            return Clocks::Unknown;
        }
        offset_s += step_s.clamp(-5.0 * STEP_S, 5.0 * STEP_S);
        if step_s.abs() < 1.0e-4 {
            break;
        }
    }
    if deviation_s > VAGUE_S {
        Clocks::Vague { offset_s, deviation_s }
    } else if offset_s.abs() < CERTAIN * deviation_s {
        Clocks::Agree { deviation_s }
    } else if offset_s.abs() <= REACH_S && cost_m(positions, truth, offset_s) < cost_m(positions, truth, 0.0) {
        Clocks::Differ { offset_s: (offset_s * 1.0e3).round() / 1.0e3, deviation_s }
    } else {
        Clocks::NoneFits
    }
}

/// One position's error and true velocity.
#[derive(Clone, Copy)]
struct Sample {
    t_s: f64,
    error_m: [f64; 2],
    velocity_m_s: [f64; 2],
}

/// Samples by cells of the true position. Positions without truth are left out.
fn cells(positions: &[TimedPosition], truth: &Truth, offset_s: f64) -> Vec<Vec<Sample>> {
    let mut cells: HashMap<[i64; 2], usize> = HashMap::new();
    let mut samples: Vec<Vec<Sample>> = Vec::new();
    for TimedPosition { t_s, at_m } in positions {
        let at = |t_s: f64| truth.at(t_s - offset_s).map(|place| [place.x_m, place.y_m]);
        let (Some(true_m), Some(from), Some(to)) = (at(*t_s), at(t_s - HALF_S), at(t_s + HALF_S)) else { continue };
        let sample = Sample {
            t_s: *t_s,
            error_m: [at_m[0] - true_m[0], at_m[1] - true_m[1]],
            velocity_m_s: [0, 1].map(|axis| (to[axis] - from[axis]) / (2.0 * HALF_S)),
        };
        let cell = *cells.entry(true_m.map(|coordinate| (coordinate / CELL_M).round() as i64)).or_insert_with(|| {
            samples.push(Vec::new());
            samples.len() - 1
        });
        samples[cell].push(sample);
    }
    // What all positions of a cell have in common is taken away.
    for cell in &mut samples {
        let middle = |of: fn(&Sample) -> f64| {
            let mut values: Vec<f64> = cell.iter().map(of).collect();
            values.sort_by(f64::total_cmp);
            percentile(&values, 0.5)
        };
        let error_m = [middle(|sample| sample.error_m[0]), middle(|sample| sample.error_m[1])];
        let velocity_m_s = [0, 1].map(|axis| mean(cell.iter().map(|sample| sample.velocity_m_s[axis])));
        for sample in cell {
            for axis in [0, 1] {
                sample.error_m[axis] -= error_m[axis];
                sample.velocity_m_s[axis] -= velocity_m_s[axis];
            }
        }
    }
    samples
}

/// The mean error that no cell explains, metres; not finite where each cell has one position.
fn cost_m(positions: &[TimedPosition], truth: &Truth, offset_s: f64) -> f64 {
    let cells = cells(positions, truth, offset_s);
    let sum: f64 = cells.iter().flatten().map(|sample| sample.error_m[0].hypot(sample.error_m[1])).sum();
    sum / (cells.iter().map(|cell| cell.len() - 1).sum::<usize>() as f64)
}

/// The step towards the best offset, and its standard error, seconds.
fn least_squares(positions: &[TimedPosition], truth: &Truth, offset_s: f64) -> Option<(f64, f64)> {
    let samples: Vec<Sample> = cells(positions, truth, offset_s).into_iter().flatten().collect();
    let mut errors_m: Vec<f64> = samples.iter().map(|sample| sample.error_m[0].hypot(sample.error_m[1])).collect();
    errors_m.sort_by(f64::total_cmp);
    let scale_m = percentile(&errors_m, 0.5).max(LEAST_M);
    // By block: the sums of weight · error · velocity and weight · velocity².
    let mut blocks: HashMap<i64, [f64; 2]> = HashMap::new();
    for Sample { t_s, error_m: [ex, ey], velocity_m_s: [vx, vy] } in &samples {
        let weight = 1.0 / (1.0 + (ex * ex + ey * ey) / (scale_m * scale_m));
        let block = blocks.entry((t_s / BLOCK_S).floor() as i64).or_default();
        block[0] += weight * (ex * vx + ey * vy);
        block[1] += weight * (vx * vx + vy * vy);
    }
    let [product, square] = blocks.values().fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
    if samples.len() < FEWEST.0 || blocks.len() < FEWEST.1 || square <= 0.0 {
        return None;
    }
    // Later rows of the truth are farther ahead: an error along the velocity means that the truth is stamped too late.
    let step_s = -product / square;
    let variance: f64 = blocks.values().map(|[product, square]| (product + step_s * square).powi(2)).sum();
    Some((step_s, variance.sqrt() / square))
}

#[cfg(test)]
mod tests {
    use super::{Clocks, TimedPosition, time_offset};
    use recording::Truth;

    /// A circle of 2 m radius at 1 m/s, to and fro: the tag turns round every 10 s.
    fn at_m(t_s: f64) -> [f64; 2] {
        let folded = (t_s.rem_euclid(20.0) - 10.0).abs();
        let (sin, cos) = (0.5 * folded).sin_cos();
        [2.0 * cos, 2.0 * sin]
    }

    /// Positions at 5 Hz for a minute with these errors, and a truth at 10 Hz whose clock is `late_s` ahead.
    fn recorded(late_s: f64, speed: f64, error_m: impl Fn(f64) -> f64) -> (Vec<TimedPosition>, Truth) {
        let positions = (0..300).map(|k| {
            let t_s = 0.2 * f64::from(k);
            let [x, y] = at_m(speed * t_s);
            TimedPosition { t_s, at_m: [x + error_m(t_s), y] }
        });
        let truth = (0..640).map(|k| {
            let t_s = 0.1 * f64::from(k) - 2.0;
            let [x, y] = at_m(speed * t_s);
            (t_s + late_s, [x, y, 1.0])
        });
        (positions.collect(), Truth::of(truth))
    }

    #[test]
    fn the_offset_of_a_late_truth_is_negative() {
        for late_s in [-1.3, 0.37] {
            let (positions, truth) = recorded(late_s, 1.0, |t_s| 0.1 + 0.05 * (7.3 * t_s).sin());
            let Clocks::Differ { offset_s, deviation_s } = time_offset(&positions, &truth) else { panic!("{late_s}") };
            assert!((offset_s + late_s).abs() < 0.02 && deviation_s < 0.02, "{late_s}: {offset_s} ± {deviation_s}");
        }
    }

    #[test]
    fn equal_clocks_a_tag_at_rest_and_too_few_positions_give_none() {
        let (positions, truth) = recorded(0.0, 1.0, |t_s| 0.05 * (7.3 * t_s).sin());
        assert!(matches!(time_offset(&positions, &truth), Clocks::Agree { .. }));
        assert_eq!(time_offset(&positions[..19], &truth), Clocks::Unknown);
        let (positions, truth) = recorded(0.5, 0.0, |t_s| 0.05 * (7.3 * t_s).sin());
        assert_eq!(time_offset(&positions, &truth), Clocks::Unknown);
    }
}
