//! A position from the RSSI values of beacons at known positions: weighted linear least squares (6), and nonlinear
//! least squares in the RSSI values themselves.
//!
//! Input: one RSSI per beacon, with its beacon's path loss. Output: a [`Fix`] whose covariance comes from the path
//! loss' deviation and from how far the RSSI values agree. The nonlinear form minimises Σ (zᵢ − Lᵢ(‖p − bᵢ‖) − o)² ⁄
//! σᵢ² + o² ⁄ σₒ², where o is the receiver's own offset. Shadowing is normal in dB, so this is the most probable
//! position. The position of (6) is not.

use heapless::Vec;

use super::rssi::RssiObservation;
use crate::geometry::Survey;
use crate::linalg::{Ldl, Matrix, Vector, add_outer, add_scaled, dot, sub};
use crate::linear::weighted_position;
use crate::sample::PerSample;
use crate::{AnchorSet, Constraints, Fix, MAX_ANCHORS, RangeSample, Real, SolveError};

/// The iteration ends when a step is shorter than this, metres.
const CONVERGED_M: f64 = 1.0e-3;
/// The most steps of an iteration.
const MAX_STEPS: usize = 40;
/// Smaller distances count as this, metres: the path loss is constant there, and has no slope.
const NEAREST_M: f64 = 0.3;
/// The weight of the path loss' own deviation, as a number of RSSI values, when it is pooled with how far the RSSI
/// values agree.
const BELIEF: f64 = 4.0;
/// RSSI values at one position share shadows: this number of them counts as one (the same as in
/// [`PosteriorSettings`](super::posterior::PosteriorSettings)).
const SHARED: f64 = 2.0;

/// The difference between an RSSI and its expected value at a position, dB, and its derivative by each coordinate, dB
/// per metre.
#[inline]
fn residual<T: Real, const D: usize>(heard: &RssiObservation<T, D>, position: &Vector<T, D>) -> (T, Vector<T, D>) {
    let across = sub(position, &heard.beacon_m);
    let square = (dot(&across, &across) + heard.above_m.squared()).at_least(T::of(NEAREST_M * NEAREST_M));
    let slope = -heard.path_loss.exponent * T::of(10.0 / core::f64::consts::LN_10) / square;
    (heard.rssi_dbm - heard.path_loss.rssi(square.sqrt()), across.map(|component| component * slope))
}

/// Weighted linear least squares about the nearest beacon (6); a distance's error grows with the distance, as the
/// thesis assumes.
///
/// # Errors
/// There is no position; [`SolveError`] has the reason. [`TooFewAnchors`](SolveError::TooFewAnchors) means fewer than
/// three beacons in the plane.
pub fn weighted_linear<T: Real, const D: usize>(heard: &[RssiObservation<T, D>]) -> Result<Fix<T, D>, SolveError> {
    let (ranges, survey) = surveyed(heard, &Constraints::default())?;
    let position = linear_position(heard, &ranges, &survey)?;
    // The covariance of the closed form: its weights on squared distances, converted to weights on distances.
    let weight = |heard: &RssiObservation<T, D>| {
        let (distance, relative) = (heard.distance_m(), heard.path_loss.relative_deviation());
        let variance = (distance * relative).squared();
        T::of(4.0) * distance.squared() / (variance * (T::of(4.0) * distance.squared() + T::of(2.0) * variance))
    };
    let (mut outer, mut inner): (Matrix<T, D>, Matrix<T, D>) = ([[T::ZERO; D]; D], [[T::ZERO; D]; D]);
    for heard in heard {
        let across = sub(&position, &heard.beacon_m);
        let distance = dot(&across, &across).sqrt().at_least(T::of(NEAREST_M));
        let unit = across.map(|component| component / distance);
        let weight = weight(heard);
        add_outer(&mut outer, weight, &unit);
        add_outer(&mut inner, (weight * distance * heard.path_loss.relative_deviation()).squared(), &unit);
    }
    let factors = Ldl::new(outer).ok_or(SolveError::Diverged)?;
    let inverse = factors.inverse();
    let agreement = Agreement::of(heard, &position, T::ZERO);
    let covariance = core::array::from_fn(|r| {
        core::array::from_fn(|c| {
            let mut sum = T::ZERO;
            for k in 0..D {
                for l in 0..D {
                    sum += inverse[r][k] * inner[k.max(l)][k.min(l)] * inverse[l][c];
                }
            }
            agreement.inflation() * sum
        })
    });
    conclude(heard, position, covariance, &agreement)
}

/// Nonlinear least squares in the RSSI values (see the module). `offset_deviation` is the standard deviation of the
/// receiver's own offset, dB: 0 for the receiver with which the path losses were calibrated, about 4 for another one.
/// The position stays inside the known area.
///
/// # Errors
/// There is no position; [`SolveError`] has the reason.
pub fn nonlinear<T: Real, const D: usize>(
    heard: &[RssiObservation<T, D>],
    offset_deviation: T,
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, SolveError> {
    let (ranges, survey) = surveyed(heard, constraints)?;
    let loudest = ranges.get(survey.reference).map(|range| range.anchor);
    let starts = [linear_position(heard, &ranges, &survey).ok(), Some(survey.boxed), loudest];
    let mut best: Option<(T, Vector<T, D>, Matrix<T, D>)> = None;
    for start in starts.into_iter().flatten() {
        let Some((position, model)) = descend(heard, offset_deviation, constraints, start) else { continue };
        if best.as_ref().is_none_or(|(least, ..)| model.cost < *least) {
            best = Some((model.cost, position, model.hessian));
        }
    }
    let (_, position, hessian) = best.ok_or(SolveError::Diverged)?;
    let inverse = Ldl::new(hessian).ok_or(SolveError::Diverged)?.inverse();
    let agreement = Agreement::of(heard, &position, offset_deviation);
    let covariance = inverse.map(|row| row.map(|element| agreement.inflation() * element));
    conclude(heard, position, covariance, &agreement)
}

type Ranges<T, const D: usize> = Vec<RangeSample<T, D>, MAX_ANCHORS>;

/// The RSSI values as ranges, and the survey of them.
fn surveyed<T: Real, const D: usize>(
    heard: &[RssiObservation<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<(Ranges<T, D>, Survey<T, D>), SolveError> {
    if heard.len() > MAX_ANCHORS {
        return Err(SolveError::TooManyAnchors);
    }
    if !heard.iter().all(RssiObservation::is_sane) {
        return Err(SolveError::NotFinite);
    }
    let ranges: Ranges<T, D> = heard.iter().map(|heard| RangeSample::new(heard.beacon_m, heard.distance_m())).collect();
    let survey = Survey::of(&ranges, constraints)?;
    Ok((ranges, survey))
}

fn linear_position<T: Real, const D: usize>(
    heard: &[RssiObservation<T, D>],
    ranges: &Ranges<T, D>,
    survey: &Survey<T, D>,
) -> Result<Vector<T, D>, SolveError> {
    let variances: PerSample<T> = core::array::from_fn(|i| {
        heard.get(i).map_or(T::ONE, |heard| (heard.distance_m() * heard.path_loss.relative_deviation()).squared())
    });
    weighted_position(ranges, survey, &variances)
}

/// The cost at a position with its Gauss-Newton model. The offset has its best value.
struct Model<T, const D: usize> {
    cost: T,
    hessian: Matrix<T, D>,
    descent: Vector<T, D>,
}

fn model<T: Real, const D: usize>(
    heard: &[RssiObservation<T, D>],
    offset_deviation: T,
    position: &Vector<T, D>,
) -> Model<T, D> {
    let (mut hessian, mut descent, mut slopes) = ([[T::ZERO; D]; D], [T::ZERO; D], [T::ZERO; D]);
    let (mut weights, mut residuals, mut squares) = (T::ZERO, T::ZERO, T::ZERO);
    for heard in heard {
        let (off, slope) = residual(heard, position);
        let weight = T::ONE / heard.path_loss.deviation.squared();
        weights += weight;
        residuals += weight * off;
        squares += weight * off.squared();
        add_outer(&mut hessian, weight, &slope);
        descent = add_scaled(&descent, weight * off, &slope);
        slopes = add_scaled(&slopes, weight, &slope);
    }
    // The offset, linear in the RSSI values, is eliminated (Schur): o = Σ w r ⁄ (Σ w + 1 ⁄ σₒ²).
    let share = share_of_offset(weights, offset_deviation);
    add_outer(&mut hessian, -share, &slopes);
    let descent = add_scaled(&descent, -share * residuals, &slopes);
    Model { cost: squares - share * residuals.squared(), hessian, descent }
}

/// 1 ⁄ (Σ w + 1 ⁄ σₒ²).
fn share_of_offset<T: Real>(weights: T, offset_deviation: T) -> T {
    let variance = offset_deviation.squared();
    variance / (weights * variance + T::ONE)
}

/// Gauss-Newton from `start`, damped after Levenberg and Marquardt.
fn descend<T: Real, const D: usize>(
    heard: &[RssiObservation<T, D>],
    offset_deviation: T,
    constraints: &Constraints<T, D>,
    start: Vector<T, D>,
) -> Option<(Vector<T, D>, Model<T, D>)> {
    let mut position = constraints.inside(start);
    let mut here = model(heard, offset_deviation, &position);
    let mut damping = T::of(0.01);
    for _ in 0..MAX_STEPS {
        let mut damped = here.hessian;
        let trace = (0..D).fold(T::ZERO, |sum, axis| sum + damped[axis][axis]);
        for (axis, row) in damped.iter_mut().enumerate() {
            row[axis] += damping * (row[axis] + T::of(0.1) * trace) + T::of(1.0e-6) * trace;
        }
        let step = Ldl::new(damped)?.solve(here.descent);
        let next = constraints.inside(add_scaled(&position, T::ONE, &step));
        let moved = sub(&next, &position);
        let there = model(heard, offset_deviation, &next);
        if there.cost <= here.cost {
            (position, here) = (next, there);
            damping *= T::of(0.2);
        } else {
            damping *= T::of(8.0);
        }
        if dot(&moved, &moved) < T::of(CONVERGED_M).squared() {
            break;
        }
    }
    here.cost.is_finite().then_some((position, here))
}

/// How far the RSSI values agree with a position.
struct Agreement<T> {
    /// Σ (r ⁄ σ)².
    squares: T,
    /// The number of RSSI values minus the number of unknowns.
    freedom: T,
    quality: T,
}

impl<T: Real> Agreement<T> {
    fn of<const D: usize>(heard: &[RssiObservation<T, D>], position: &Vector<T, D>, offset_deviation: T) -> Self {
        let (mut weights, mut residuals) = (T::ZERO, T::ZERO);
        for heard in heard {
            let weight = T::ONE / heard.path_loss.deviation.squared();
            weights += weight;
            residuals += weight * residual(heard, position).0;
        }
        let offset = share_of_offset(weights, offset_deviation) * residuals;
        let (mut squares, mut quality) = (T::ZERO, T::ZERO);
        for heard in heard {
            let normalised = ((residual(heard, position).0 - offset) / heard.path_loss.deviation).squared();
            squares += normalised;
            quality += T::ONE / (T::ONE + normalised);
        }
        let freedom = T::count(heard.len().saturating_sub(D));
        Self { squares, freedom, quality: quality / T::count(heard.len().max(1)) }
    }

    /// The factor on the variance: the mean square, pooled with the path loss' own deviation.
    fn inflation(&self) -> T {
        T::of(SHARED) * (self.squares + T::of(BELIEF)) / (self.freedom + T::of(BELIEF))
    }
}

fn conclude<T: Real, const D: usize>(
    heard: &[RssiObservation<T, D>],
    position: Vector<T, D>,
    covariance: Matrix<T, D>,
    agreement: &Agreement<T>,
) -> Result<Fix<T, D>, SolveError> {
    let mut geometry: Matrix<T, D> = [[T::ZERO; D]; D];
    for heard in heard {
        let across = sub(&position, &heard.beacon_m);
        let distance = dot(&across, &across).sqrt().at_least(T::of(NEAREST_M));
        add_outer(&mut geometry, T::ONE, &across.map(|component| component / distance));
    }
    let dilution = Ldl::new(geometry).ok_or(SolveError::Diverged)?.inverse();
    let sum = position.iter().chain(covariance.iter().flatten()).fold(T::ZERO, |sum, number| sum + number.abs());
    // Beyond a kilometre no beacon is received: the linear form has left the room.
    if !(sum <= T::of(1.0e6)) || !(dot(&position, &position).sqrt() <= T::of(1.0e5)) {
        return Err(SolveError::Diverged);
    }
    Ok(Fix {
        position,
        covariance,
        dilution_of_precision: core::array::from_fn(|axis| dilution[axis][axis].at_least(T::ZERO).sqrt()),
        used: AnchorSet(((1_u32 << heard.len().min(MAX_ANCHORS)) - 1) as u16),
        quality: agreement.quality,
        alternative: None,
    })
}

#[cfg(test)]
mod tests {
    use super::{model, nonlinear, residual, weighted_linear};
    use crate::ble::path_loss::PathLoss;
    use crate::ble::rssi::RssiObservation;
    use crate::derivatives::assert_derivatives;
    use crate::{Area, Constraints, SolveError};

    const MODEL: PathLoss<f64> = PathLoss { level_1m: -50.0, exponent: 2.0, deviation: 4.0 };

    /// Exact RSSI values of beacons in the corners of a room of 6 m by 8 m, received at (2, 3), `offset` dB too
    /// strong.
    fn heard(offset: f64) -> [RssiObservation<f64, 2>; 4] {
        // Distances √13, 5, √29, √41: RSSI values −50 − 10 log₁₀ of their squares.
        [([0.0, 0.0], 13.0_f64), ([6.0, 0.0], 25.0), ([0.0, 8.0], 29.0), ([6.0, 8.0], 41.0)].map(|(place, square)| {
            RssiObservation {
                beacon_m: place,
                above_m: 0.0,
                rssi_dbm: -50.0 - 10.0 * square.log10() + offset,
                path_loss: MODEL,
            }
        })
    }

    fn is_near(position: [f64; 2], place: [f64; 2], within: f64) -> bool {
        (position[0] - place[0]).hypot(position[1] - place[1]) < within
    }

    #[test]
    fn derivatives_are_those_of_the_expected_rssi_and_of_the_cost() {
        let heard = heard(2.0);
        // No position is nearer to a beacon than 0.3 m, where the path loss has no slope.
        let (center, spread) = ([3.0, 4.0], [2.5, 3.5]);
        for one in &heard {
            assert_derivatives("rssi", center, spread, |position| {
                let (off, slope) = residual(one, position);
                (-off, slope)
            });
        }
        assert_derivatives("cost", center, spread, |position| {
            let model = model(&heard, 4.0, position);
            (model.cost, model.descent.map(|component| -2.0 * component))
        });
    }

    #[test]
    fn exact_levels_give_the_exact_position() {
        let linear = weighted_linear(&heard(0.0)).expect("a position");
        assert!(is_near(linear.position, [2.0, 3.0], 1e-9), "{linear:?}");
        let nonlinear = nonlinear(&heard(0.0), 0.0, &Constraints::default()).expect("a position");
        assert!(is_near(nonlinear.position, [2.0, 3.0], 1e-3), "{nonlinear:?}");
        assert!(nonlinear.quality > 0.999 && nonlinear.used.len() == 4);
    }

    #[test]
    fn the_covariance_is_that_of_a_hand_calculation() {
        // Slopes (20 ⁄ ln 10) Δ ⁄ d² = 8.685890 Δ ⁄ d², Δ = (2, 3), (−4, 3), (2, −5), (−4, −5):
        // (1.33629, 2.00444), (−1.38974, 1.04231), (0.59903, −1.49757), (−0.84740, −1.05925), in dB per metre, up to
        // the sign.
        // Σ: xx 4.79395, xy 1.23047, yy 8.46893, over 16 dB²: 0.299622, 0.0769044, 0.529308.
        // Inverse: determinant 0.152678; xx 3.46683, xy −0.503703, yy 1.96245.
        // Residuals are 0: times 2 · 4 ⁄ (2 + 4).
        let fix = nonlinear(&heard(0.0), 0.0, &Constraints::default()).expect("a position");
        let expected = [4.0 / 3.0 * 3.46683, -4.0 / 3.0 * 0.503703, 4.0 / 3.0 * 1.96245];
        let found = [fix.covariance[0][0], fix.covariance[1][0], fix.covariance[1][1]];
        assert!(found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 2e-3), "{found:?}");
    }

    #[test]
    fn an_offset_of_the_receiver_is_taken_out_where_it_is_allowed_for() {
        let with = nonlinear(&heard(6.0), 100.0, &Constraints::default()).expect("a position");
        let without = nonlinear(&heard(6.0), 0.0, &Constraints::default()).expect("a position");
        assert!(is_near(with.position, [2.0, 3.0], 0.01), "{with:?}");
        assert!(!is_near(without.position, [2.0, 3.0], 0.2), "{without:?}");
        assert!(with.covariance[0][0] + with.covariance[1][1] > 0.0);
    }

    #[test]
    fn a_beacon_above_the_tag_is_nearer_than_its_level_says() {
        // (2, 3) from corners 2 m above: the squared distances grow by 4.
        let above = heard(0.0).map(|heard| {
            let square = 10_f64.powf((-50.0 - heard.rssi_dbm) / 10.0) + 4.0;
            RssiObservation { above_m: 2.0, rssi_dbm: -50.0 - 10.0 * square.log10(), ..heard }
        });
        let fix = weighted_linear(&above).expect("a position");
        assert!(is_near(fix.position, [2.0, 3.0], 1e-9), "{fix:?}");
        let fix = nonlinear(&above, 0.0, &Constraints::default()).expect("a position");
        assert!(is_near(fix.position, [2.0, 3.0], 1e-3), "{fix:?}");
    }

    #[test]
    fn the_known_area_is_kept() {
        let constraints =
            Constraints { area: Some(Area { min: [3.0, 0.0], max: [6.0, 8.0] }), ..Constraints::default() };
        let fix = nonlinear(&heard(0.0), 0.0, &constraints).expect("a position");
        assert!(fix.position[0] >= 3.0, "{fix:?}");
    }

    #[test]
    fn what_gives_no_position_is_a_reason() {
        let good = heard(0.0);
        let both = |heard: &[RssiObservation<f64, 2>]| {
            (weighted_linear(heard).err(), nonlinear(heard, 0.0, &Constraints::default()).err())
        };
        assert_eq!(both(&good[..2]), (Some(SolveError::TooFewAnchors), Some(SolveError::TooFewAnchors)));
        assert_eq!(both(&[good[0]; 17]), (Some(SolveError::TooManyAnchors), Some(SolveError::TooManyAnchors)));
        assert_eq!(both(&[good[0]; 4]), (Some(SolveError::CoincidentAnchors), Some(SolveError::CoincidentAnchors)));
        for wrong in [f64::NAN, f64::INFINITY] {
            let mut bad = good;
            bad[1].rssi_dbm = wrong;
            assert_eq!(both(&bad), (Some(SolveError::NotFinite), Some(SolveError::NotFinite)));
            let mut bad = good;
            bad[2].path_loss.exponent = wrong;
            assert_eq!(both(&bad), (Some(SolveError::NotFinite), Some(SolveError::NotFinite)));
        }
    }

    #[test]
    fn levels_that_contradict_each_other_widen_the_covariance() {
        let mut torn = heard(0.0);
        torn[0].rssi_dbm -= 25.0;
        torn[3].rssi_dbm += 25.0;
        let [good, torn] =
            [heard(0.0), torn].map(|heard| nonlinear(&heard, 0.0, &Constraints::default()).expect("a position"));
        assert!(torn.covariance[0][0] > 2.0 * good.covariance[0][0], "{torn:?} {good:?}");
        assert!(torn.quality < good.quality);
    }
}
