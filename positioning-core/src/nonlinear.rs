//! Nonlinear least squares over ranges, Σ βᵢ (dᵢ − ‖z − aᵢ‖)² (6-5, 6-11), plain and weighted.
//!
//! The thesis searches a 0.1 m grid. Here a damped Gauss-Newton iteration finds the same minimum without the grid's
//! step. The grid's bounds matter as much as its step, so the position stays inside a known area: see
//! [`Constraints::area`].

use crate::fix::{blame, conclude_equal, conclude_weighted};
use crate::geometry::Survey;
use crate::linalg::{Ldl, Matrix, Vector, add_outer, add_scaled, dot, sub};
use crate::linear::{DIRECT_M, b_wls_position, least, lls_position, variances};
use crate::sample::PerSample;
use crate::{Area, Constraints, Fix, MAX_ANCHORS, RangeSample, Real, SolveError};

/// The iteration ends when a step is shorter than this, metres.
const CONVERGED_M: f64 = 1.0e-4;
/// The most steps of an iteration: every second step may be a step back.
const MAX_STEPS: usize = 40;
/// The weight of a blocked range, relative to 1 for a direct one (6.1.3.5).
const BLOCKED_WEIGHT: f64 = 0.005;

/// The cost at a point with its Gauss-Newton model.
struct Model<T, const D: usize> {
    cost: T,
    /// Σ β u uᵀ, lower triangle.
    hessian: Matrix<T, D>,
    /// Σ β u (d − ‖z − a‖): the descent direction.
    descent: Vector<T, D>,
}

fn model<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    beta: &PerSample<T>,
    position: &Vector<T, D>,
) -> Model<T, D> {
    let mut model = Model { cost: T::ZERO, hessian: [[T::ZERO; D]; D], descent: [T::ZERO; D] };
    for (sample, &beta) in samples.iter().zip(beta) {
        let across = sub(position, &sample.anchor);
        // At the position of an anchor no direction is better than another: any finite one is valid.
        let distance = (dot(&across, &across) + T::EPSILON.squared()).sqrt();
        let scale = T::ONE / distance;
        let unit = across.map(|component| component * scale);
        let residual = sample.range - distance;
        model.cost += beta * residual.squared();
        add_outer(&mut model.hessian, beta, &unit);
        model.descent = add_scaled(&model.descent, beta * residual, &unit);
    }
    model
}

/// Holds the axes that are at their bound of the area. The other axes take their best step without them.
fn hold_bounds<T: Real, const D: usize>(model: &mut Model<T, D>, position: &Vector<T, D>, area: &Area<T, D>) {
    for axis in 0..D {
        let pull = model.descent[axis];
        if (position[axis] <= area.min[axis] && pull < T::ZERO) || (position[axis] >= area.max[axis] && pull > T::ZERO)
        {
            for other in 0..D {
                model.hessian[axis.max(other)][axis.min(other)] = T::ZERO;
            }
            model.hessian[axis][axis] = T::ONE;
            model.descent[axis] = T::ZERO;
        }
    }
}

/// The minimum of Σ βᵢ (dᵢ − ‖z − aᵢ‖)² that is reached from the best of `starts` by Gauss-Newton. Each step is
/// halved until it lowers the cost.
pub(crate) fn minimise<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    beta: &PerSample<T>,
    starts: &[Vector<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Vector<T, D>, SolveError> {
    let mut best: Option<(T, Vector<T, D>)> = None;
    for &start in starts {
        let start = constraints.inside(start);
        let cost = model(samples, beta, &start).cost;
        if best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, start));
        }
    }
    let Some((_, mut position)) = best else {
        return Err(blame(samples, SolveError::Diverged));
    };
    let mut here = model(samples, beta, &position);
    let diverged = || blame(samples, SolveError::Diverged);
    let mut step = gauss_newton_step(&mut here, &position, constraints).ok_or_else(diverged)?;
    for _ in 0..MAX_STEPS {
        let next = constraints.inside(add_scaled(&position, T::ONE, &step));
        let moved = sub(&next, &position);
        let there = model(samples, beta, &next);
        // Near the minimum the cost no longer changes within the precision of the scalar, but the step is still
        // correct.
        if there.cost <= here.cost * (T::ONE + T::of(8.0) * T::EPSILON) {
            position = next;
            here = there;
            step = gauss_newton_step(&mut here, &position, constraints).ok_or_else(diverged)?;
        } else {
            step = step.map(|component| component * T::of(0.5));
        }
        if dot(&moved, &moved) < T::of(CONVERGED_M).squared() {
            break;
        }
    }
    Ok(position)
}

fn gauss_newton_step<T: Real, const D: usize>(
    model: &mut Model<T, D>,
    position: &Vector<T, D>,
    constraints: &Constraints<T, D>,
) -> Option<Vector<T, D>> {
    if let Some(area) = &constraints.area {
        hold_bounds(model, position, area);
    }
    // A small damping (Levenberg) keeps the step finite along an axis without information: a tag in the anchors'
    // plane.
    let trace = (0..D).fold(T::ZERO, |sum, axis| sum + model.hessian[axis][axis]);
    for axis in 0..D {
        model.hessian[axis][axis] += T::of(1.0e-5) * trace;
    }
    Some(Ldl::new(model.hessian)?.solve(model.descent))
}

/// The starts of every method. The bounding box is insensitive to blocked ranges. The closed form is exact where the
/// ranges are exact, even far outside the anchors.
fn starts<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    survey: &Survey<T, D>,
) -> Result<[Vector<T, D>; 2], SolveError> {
    Ok([survey.boxed, lls_position(samples, survey)?])
}

/// Nonlinear least squares with equal weights for all ranges (6-5).
///
/// # Errors
/// There is no position; [`SolveError`] has the reason.
pub fn nls<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, SolveError> {
    let survey = Survey::of(samples, constraints)?;
    let beta = [T::ONE; MAX_ANCHORS];
    let position = minimise(samples, &beta, &starts(samples, &survey)?, constraints)?;
    conclude_equal(samples, &survey.layout, position)
}

/// Nonlinear least squares that knows the true line of sight (6-17): blocked ranges weigh 0.005. It is an oracle, and
/// shows the least error that weighing can reach.
///
/// # Errors
/// [`SolveError::SightUnknown`] where a sample's `los` is `None`; else see [`SolveError`].
pub fn nls_ccv<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, SolveError> {
    let survey = Survey::of(samples, constraints)?;
    let mut beta = [T::ONE; MAX_ANCHORS];
    for (beta, sample) in beta.iter_mut().zip(samples) {
        if !sample.los.ok_or(SolveError::SightUnknown)? {
            *beta = T::of(BLOCKED_WEIGHT);
        }
    }
    let position = minimise(samples, &beta, &starts(samples, &survey)?, constraints)?;
    conclude_weighted(samples, &survey.layout, position, &beta)
}

/// βᵢ = 1 ⁄ |σᵢ| (6-18).
fn reciprocal_deviations<T: Real>(variances: &PerSample<T>) -> PerSample<T> {
    variances.map(|variance| T::ONE / variance.sqrt())
}

/// Nonlinear least squares weighted by the bounding box, β = 1 ⁄ |σ| (6-18, 6-19).
///
/// # Errors
/// There is no position; [`SolveError`] has the reason.
pub fn bb_nls<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, SolveError> {
    let survey = Survey::of(samples, constraints)?;
    let starts = starts(samples, &survey)?;
    let beta = reciprocal_deviations(&variances(samples, &starts[0]));
    let position = minimise(samples, &beta, &starts, constraints)?;
    conclude_weighted(samples, &survey.layout, position, &beta)
}

/// BB-NLS with equal weights for the ranges classified as direct (6-20).
///
/// The text classifies a range as direct when |σ| ≤ 0.45 m. The annexed code (J) compares |σ|·d with 0.45 instead.
/// Its figures are the printed ones, so this function follows the code. The weight of a direct range is 1 ⁄ min |σ|.
///
/// # Errors
/// There is no position; [`SolveError`] has the reason.
pub fn bb_nls_c<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, SolveError> {
    let survey = Survey::of(samples, constraints)?;
    let starts = starts(samples, &survey)?;
    let mut variances = variances(samples, &starts[0]);
    let least = least(&variances, samples.len());
    for (variance, sample) in variances.iter_mut().zip(samples) {
        // |σ| d ≤ 0.45.
        if *variance * sample.range.squared() <= T::of(DIRECT_M * DIRECT_M) {
            *variance = least;
        }
    }
    let beta = reciprocal_deviations(&variances);
    let position = minimise(samples, &beta, &starts, constraints)?;
    conclude_weighted(samples, &survey.layout, position, &beta)
}

/// Nonlinear least squares weighted by B-WLS, β = 1 ⁄ |σ| (6-21, 6-11).
///
/// # Errors
/// There is no position; [`SolveError`] has the reason.
pub fn bb_nls_r<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, SolveError> {
    let survey = Survey::of(samples, constraints)?;
    let start = b_wls_position(samples, &survey)?;
    let beta = reciprocal_deviations(&variances(samples, &start));
    let starts = [start, survey.boxed];
    let position = minimise(samples, &beta, &starts, constraints)?;
    conclude_weighted(samples, &survey.layout, position, &beta)
}

#[cfg(test)]
mod tests {
    use super::model;
    use crate::derivatives::assert_derivatives;
    use crate::{MAX_ANCHORS, RangeSample};

    #[test]
    fn the_descent_is_half_the_costs_negative_gradient() {
        let anchors = [[0.0, 0.0, 2.5], [8.0, 0.0, 2.0], [8.0, 6.0, 2.7], [0.0, 6.0, 0.4]];
        let samples = anchors.map(|anchor| RangeSample::<f64, 3>::new(anchor, 5.0));
        let beta: [f64; MAX_ANCHORS] = core::array::from_fn(|i| 1.0 + 0.5 * i as f64);
        assert_derivatives("ranges", [4.0, 3.0, 1.2], [6.0, 5.0, 1.0], |position| {
            let model = model(&samples, &beta, position);
            (model.cost, model.descent.map(|component| -2.0 * component))
        });
    }
}
