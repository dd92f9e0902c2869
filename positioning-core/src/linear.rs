//! The closed forms: linear least squares about a reference anchor, plain (LLS) and weighted (B-WLS and its variants).
//!
//! Subtracting the circle of the reference anchor r from the others leaves lines: with coordinates relative to the
//! reference anchor, 2 aᵢ·z = d_r² − dᵢ² + |aᵢ|² (6-8, 6-9; the constants k shrink to |aᵢ|², which is what keeps the
//! equations well conditioned in `f32`, however far the origin).

use crate::fix::{blame, conclude_equal, conclude_weighted};
use crate::geometry::{Survey, centroid};
use crate::linalg::{Ldl, Matrix, Vector, add_outer, add_scaled, dot, sub};
use crate::{Constraints, Fix, MAX_ANCHORS, NoFix, RangeSample, Real};

/// An uncertainty below this counts as this, metres: σ = 0 would divide by zero (6-13), and a single range that happens to
/// agree with the weighing position to the millimetre must not outweigh all others.
const SIGMA_FLOOR_M: f64 = 0.01;
/// A range is judged direct when it differs from the weighing position by less than this, metres (table 8-9 and annex P).
pub(crate) const DIRECT_M: f64 = 0.45;

/// Passes of a closed form over coplanar anchors: what they are off the plane shrinks twentyfold a pass.
const FLAT_PASSES: usize = 4;

/// One number a sample.
pub(crate) type PerSample<T> = [T; MAX_ANCHORS];

/// 1 ⁄ σᵢ² with σᵢ = dᵢ − ‖z − aᵢ‖, the uncertainty of each range as seen from `position` (6-14, 6-21).
#[inline(never)]
pub(crate) fn precisions<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    position: &Vector<T, D>,
) -> PerSample<T> {
    // Not an array of zeros to be filled: clearing it would cost as much as a fifth of the rest.
    core::array::from_fn(|i| {
        samples.get(i).map_or(T::ZERO, |sample| {
            let across = sub(position, &sample.anchor);
            let sigma = sample.range - dot(&across, &across).sqrt();
            T::ONE / sigma.squared().at_least(T::of(SIGMA_FLOOR_M * SIGMA_FLOOR_M))
        })
    })
}

/// The greatest precision.
pub(crate) fn greatest<T: Real>(precisions: &PerSample<T>) -> T {
    precisions.iter().fold(T::ZERO, |greatest, &p| greatest.at_least(p))
}

/// z = ½ (AᵀC⁻¹A)⁻¹ AᵀC⁻¹p (6-10 with C = 1, 6-12 with the covariance 6-13 where `precisions` are given).
///
/// C is a constant c plus a diagonal 1 ⁄ λᵢ, so by Sherman and Morrison AᵀC⁻¹A = Σ λᵢ (aᵢ − ā)(aᵢ − ā)ᵀ + Λ ⁄ (1 + c Λ) ā āᵀ,
/// with Λ = Σ λᵢ and ā the mean weighted by λ: O(N), and a sum of positive terms, so that nothing cancels in `f32`.
#[inline(never)]
pub(crate) fn solve_linear<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    survey: &Survey<T, D>,
    precisions: Option<&PerSample<T>>,
) -> Result<Vector<T, D>, NoFix> {
    let two = T::of(2.0);
    // 1 ⁄ (4 σ² d² + 2 σ⁴) with 1 ⁄ σ² = w.
    let weight = |w: T, square: T| w.squared() / (two + two * two * w * square);

    let r = survey.reference;
    let reference = &samples[r];
    let square = reference.range.squared();

    // The row of an anchor: a, p, λ. Computed twice, since storing it costs more. The reference anchor's own row is zero, and
    // its λ is made so: it takes part in the sums without a trace.
    let row = |i: usize, sample: &RangeSample<T, D>| {
        let a = sub(&sample.anchor, &reference.anchor);
        let own_square = sample.range.squared();
        let p = square - own_square + dot(&a, &a);
        let lambda = match precisions {
            _ if i == r => T::ZERO,
            Some(precisions) => weight(precisions[i], own_square),
            None => T::ONE,
        };
        (a, p, lambda)
    };
    let mut total = T::ZERO;
    let mut a_mean = [T::ZERO; D];
    let mut p_mean = T::ZERO;
    for (i, sample) in samples.iter().take(MAX_ANCHORS).enumerate() {
        let (a, p, lambda) = row(i, sample);
        total += lambda;
        a_mean = add_scaled(&a_mean, lambda, &a);
        p_mean += lambda * p;
    }
    let share = T::ONE / total;
    a_mean = a_mean.map(|component| component * share);
    p_mean *= share;
    // Λ ⁄ (1 + c Λ); without weights the reference anchor's noise is not told from the others'.
    let common = precisions.map_or(total, |w| total / (T::ONE + total / weight(w[r], square)));

    let mut normal: Matrix<T, D> = [[T::ZERO; D]; D];
    add_outer(&mut normal, common, &a_mean);
    let mut rhs = a_mean.map(|component| common * component * p_mean);
    for (i, sample) in samples.iter().take(MAX_ANCHORS).enumerate() {
        let (a, p, lambda) = row(i, sample);
        let a = sub(&a, &a_mean);
        add_outer(&mut normal, lambda, &a);
        rhs = add_scaled(&rhs, lambda * (p - p_mean), &a);
    }
    let half = T::of(0.5);
    match survey.layout.normal() {
        None => {
            let solved = Ldl::new(normal).ok_or_else(|| blame(samples, NoFix::Diverged))?.solve(rhs);
            Ok(add_scaled(&reference.anchor, half, &solved))
        }
        Some(across) => {
            // Lines say next to nothing across the plane of the anchors: hold the point at a height there, let the ranges lift
            // it, and hold it at that height in the next pass, for anchors that are not quite on a plane.
            let trace = (0..D).fold(T::ZERO, |sum, axis| sum + normal[axis][axis]);
            add_outer(&mut normal, trace, across);
            let factors = Ldl::new(normal).ok_or_else(|| blame(samples, NoFix::Diverged))?;
            let mut point = centroid(samples);
            for _ in 0..FLAT_PASSES {
                let height = dot(across, &sub(&point, &reference.anchor));
                let solved = factors.solve(add_scaled(&rhs, T::of(2.0) * trace * height, across));
                point = survey.layout.lift(add_scaled(&reference.anchor, half, &solved), samples);
            }
            Ok(point)
        }
    }
}

/// Linear least squares about the anchor of least range (6-8 to 6-10, 6-16).
///
/// # Errors
/// See [`NoFix`].
pub fn lls<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, NoFix> {
    let survey = Survey::of(samples, constraints)?;
    let position = solve_linear(samples, &survey, None)?;
    conclude_equal(samples, &survey.layout, position)
}

/// The position of B-WLS, without its covariance.
pub(crate) fn b_wls_position<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    survey: &Survey<T, D>,
) -> Result<Vector<T, D>, NoFix> {
    solve_linear(samples, survey, Some(&precisions(samples, &survey.boxed)))
}

/// The weighted closed form and its covariance.
fn solve_weighted<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    survey: &Survey<T, D>,
    precisions: &PerSample<T>,
) -> Result<Fix<T, D>, NoFix> {
    let position = solve_linear(samples, survey, Some(precisions))?;
    conclude_weighted(samples, &survey.layout, position, precisions)
}

/// Linear least squares weighted by the bounding box (6-12 to 6-16).
///
/// # Errors
/// See [`NoFix`].
pub fn b_wls<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, NoFix> {
    let survey = Survey::of(samples, constraints)?;
    solve_weighted(samples, &survey, &precisions(samples, &survey.boxed))
}

/// B-WLS that treats the ranges judged direct alike (6.2.2.2): each |σ| under 0.45 m becomes the least |σ|, as in annex P.
///
/// # Errors
/// See [`NoFix`].
pub fn b_wls_c<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, NoFix> {
    let survey = Survey::of(samples, constraints)?;
    let mut precisions = precisions(samples, &survey.boxed);
    let greatest = greatest(&precisions);
    for precision in precisions.iter_mut().filter(|p| **p > T::of(1.0 / (DIRECT_M * DIRECT_M))) {
        *precision = greatest;
    }
    solve_weighted(samples, &survey, &precisions)
}

/// B-WLS once more, weighted by its own answer instead of the bounding box (6.2.3.2, 6-21).
///
/// # Errors
/// See [`NoFix`].
pub fn b_wls_r<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, NoFix> {
    let survey = Survey::of(samples, constraints)?;
    let first = b_wls_position(samples, &survey)?;
    solve_weighted(samples, &survey, &precisions(samples, &first))
}
