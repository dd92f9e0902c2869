//! The start from differences of arrival: weighted Gauss-Newton on hyperbolas (E. García et al., section II, after N.
//! Sirola, *Closed-form algorithms in mobile positioning: myths and misconceptions*, WPNC 2010).
//!
//! All differences of a set have the same reference, and so the covariance of García et al., equation 6:
//! R = σ₁² 1 1ᵀ + diag σᵢ². By Sherman and Morrison R⁻¹ = W − W 1 1ᵀ W ⁄ (1 ⁄ σ₁² + Σ w) with W = diag 1 ⁄ σᵢ². So the
//! sums are over single differences, and no matrix larger than the position's is inverted.

use crate::linalg::{Ldl, Matrix, add_outer, add_scaled, dot, sub};
use crate::{AnchorSet, Fix, MAX_ANCHORS, Real, SolveError};

/// One difference of arrival.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TdoaSample<T> {
    /// The anchor's position, metres.
    pub anchor: [T; 3],
    /// Its distance minus that of the reference anchor, metres.
    pub difference: T,
    /// Deviation of the anchor's arrival, metres.
    pub sigma: T,
}

/// The most iterations.
const MAX_STEPS: usize = 30;
/// The iteration ends when a step is shorter than this, metres.
const CONVERGED_M: f64 = 1.0e-4;
/// The longest step, metres.
const STEP_LIMIT_M: f64 = 5.0;
/// A dilution of precision beyond this leaves the position undetermined, metres of position per metre.
const WORST_DILUTION: f64 = 1.0e3;
/// A sum of magnitudes beyond this is not a valid measurement, metres.
const FARTHEST_M: f64 = 1.0e5;

/// The position that explains differences to one reference anchor, whose arrival has the deviation `reference_sigma`.
/// With a `height` only x and y are computed. `start` is the start of the search: the middle of the anchors, if no
/// better position is known.
///
/// # Errors
/// There are fewer differences than coordinates, or the anchors do not determine the position; see [`SolveError`].
pub fn hyperbolic<T: Real>(
    samples: &[TdoaSample<T>],
    reference: [T; 3],
    reference_sigma: T,
    height: Option<T>,
    start: Option<[T; 3]>,
) -> Result<Fix<T, 3>, SolveError> {
    if samples.len() > MAX_ANCHORS {
        return Err(SolveError::TooManyAnchors);
    }
    if samples.len() < if height.is_some() { 2 } else { 3 } {
        return Err(SolveError::TooFewAnchors);
    }
    let magnitude = |point: &[T; 3]| point.iter().fold(T::ZERO, |sum, c| sum + c.abs());
    let sane = samples.iter().all(|sample| {
        magnitude(&sample.anchor) + sample.difference.abs() <= T::of(FARTHEST_M) && sample.sigma > T::ZERO
    });
    let rest = magnitude(&reference) + reference_sigma + height.unwrap_or(T::ZERO).abs();
    if !sane || !(rest <= T::of(FARTHEST_M)) || !(reference_sigma > T::ZERO) {
        return Err(SolveError::NotFinite);
    }
    let middle = samples.iter().fold(reference, |sum, sample| add_scaled(&sum, T::ONE, &sample.anchor));
    let share = T::ONE / T::count(samples.len() + 1);
    let mut position = start.unwrap_or(middle.map(|component| component * share));
    if let Some(height) = height {
        position[2] = height;
    }

    let problem = Problem { samples, reference, prior: T::ONE / reference_sigma.squared(), flat: height.is_some() };
    let mut here = problem.model(&position);
    let mut damping = T::of(1.0e-3);
    for _ in 0..MAX_STEPS {
        let mut step = here.step(damping).ok_or(SolveError::Diverged)?;
        let square = dot(&step, &step);
        if square > T::of(STEP_LIMIT_M).squared() {
            let scale = T::of(STEP_LIMIT_M) / square.sqrt();
            step = step.map(|component| component * scale);
        }
        let next = add_scaled(&position, T::ONE, &step);
        let there = problem.model(&next);
        if there.cost <= here.cost * (T::ONE + T::of(8.0) * T::EPSILON) {
            (position, here) = (next, there);
            damping = (damping * T::of(0.1)).at_least(T::of(1.0e-6));
        } else {
            damping *= T::of(10.0);
        }
        if square < T::of(CONVERGED_M).squared() {
            break;
        }
    }
    problem.conclude(position, &here)
}

/// The differences, and the data of the reference anchor.
struct Problem<'a, T> {
    samples: &'a [TdoaSample<T>],
    reference: [T; 3],
    /// 1 ⁄ σ₁².
    prior: T,
    flat: bool,
}

/// The cost near a position.
struct Model<T> {
    cost: T,
    /// Jᵀ R⁻¹ J, lower triangle.
    hessian: Matrix<T, 3>,
    /// Jᵀ R⁻¹ e.
    descent: [T; 3],
    flat: bool,
}

impl<T: Real> Problem<'_, T> {
    fn model(&self, position: &[T; 3]) -> Model<T> {
        let (near, from) = sight(position, &self.reference);
        let mut model = Model { cost: T::ZERO, hessian: [[T::ZERO; 3]; 3], descent: [T::ZERO; 3], flat: self.flat };
        let (mut weights, mut residuals, mut slopes) = (self.prior, T::ZERO, [T::ZERO; 3]);
        for sample in self.samples {
            let (far, towards) = sight(position, &sample.anchor);
            let slope = sub(&towards, &from);
            let residual = sample.difference - (far - near);
            let weight = T::ONE / sample.sigma.squared();
            model.cost += weight * residual.squared();
            add_outer(&mut model.hessian, weight, &slope);
            model.descent = add_scaled(&model.descent, weight * residual, &slope);
            weights += weight;
            residuals += weight * residual;
            slopes = add_scaled(&slopes, weight, &slope);
        }
        let share = T::ONE / weights;
        model.cost += -share * residuals.squared();
        add_outer(&mut model.hessian, -share, &slopes);
        model.descent = add_scaled(&model.descent, -share * residuals, &slopes);
        if self.flat {
            model.hessian[2] = [T::ZERO, T::ZERO, T::ONE];
            model.descent[2] = T::ZERO;
        }
        model
    }

    fn conclude(&self, position: [T; 3], model: &Model<T>) -> Result<Fix<T, 3>, SolveError> {
        let mut covariance = Ldl::new(model.hessian).ok_or(SolveError::Diverged)?.inverse();
        let unit = self.samples.iter().fold(T::ZERO, |least, sample| least.at_least(sample.sigma.squared()));
        if self.flat {
            covariance[2] = [T::ZERO; 3];
            covariance[0][2] = T::ZERO;
            covariance[1][2] = T::ZERO;
        }
        let trace = covariance[0][0] + covariance[1][1] + covariance[2][2];
        let sum = position.iter().fold(trace, |sum, component| sum + component.abs());
        if !(sum <= T::of(FARTHEST_M)) || trace > T::of(WORST_DILUTION * WORST_DILUTION) * unit {
            return Err(SolveError::Diverged);
        }
        let normalised = model.cost.at_least(T::ZERO) / T::count(self.samples.len());
        Ok(Fix {
            position,
            covariance,
            dilution_of_precision: core::array::from_fn(|axis| (covariance[axis][axis] / unit).sqrt()),
            used: AnchorSet(((1_u32 << self.samples.len()) - 1) as u16),
            quality: T::of(9.0) / (T::of(9.0) + normalised),
            alternative: None,
        })
    }
}

impl<T: Real> Model<T> {
    /// The Gauss-Newton step, damped (Marquardt).
    fn step(&self, damping: T) -> Option<[T; 3]> {
        let mut hessian = self.hessian;
        for axis in 0..if self.flat { 2 } else { 3 } {
            hessian[axis][axis] *= T::ONE + damping;
        }
        Some(Ldl::new(hessian)?.solve(self.descent))
    }
}

/// The distance between two points, and the unit vector from the second to the first.
fn sight<T: Real>(from: &[T; 3], to: &[T; 3]) -> (T, [T; 3]) {
    let across = sub(from, to);
    let distance = (dot(&across, &across) + T::of(1.0e-6)).sqrt();
    let inverse = T::ONE / distance;
    (distance, across.map(|component| component * inverse))
}

#[cfg(test)]
mod tests {
    use super::Problem;
    use crate::TdoaSample;
    use crate::derivatives::assert_derivatives;

    #[test]
    fn the_descent_is_half_the_costs_negative_gradient() {
        let anchors = [[8.0, 0.5, 2.5], [7.5, 6.0, 2.9], [0.5, 6.5, 0.4], [4.0, 7.0, 1.5]];
        let samples = anchors.map(|anchor| TdoaSample { anchor, difference: 0.5, sigma: 0.3 });
        let problem = Problem { samples: &samples, reference: [0.0, 0.0, 2.8], prior: 1.0 / (0.2 * 0.2), flat: false };
        assert_derivatives("differences", [4.0, 3.0, 1.2], [5.0, 4.0, 1.0], |position| {
            let model = problem.model(position);
            (model.cost, model.descent.map(|component| -2.0 * component))
        });
    }
}
