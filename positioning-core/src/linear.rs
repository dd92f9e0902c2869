//! The closed forms: linear least squares about a reference anchor, plain (LLS) and weighted (B-WLS and its variants).
//!
//! Subtracting the circle of the reference anchor r from the others leaves lines: with coordinates relative to the
//! reference anchor, 2 aᵢ·z = d_r² − dᵢ² + |aᵢ|² (6-8, 6-9; the constants k shrink to |aᵢ|², which is what keeps the
//! equations well conditioned in `f32`, however far the origin).

use crate::bounding_box;
use crate::fix::{Weighing, conclude};
use crate::geometry::{Layout, centroid};
use crate::linalg::{Ldl, Matrix, Vector, add_outer, add_scaled, dot, sub};
use crate::sample::check;
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

/// |dᵢ − ‖z − aᵢ‖|, the uncertainty of each range as seen from `position` (6-14, 6-21), not under the floor.
#[inline(always)]
pub(crate) fn uncertainties<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    position: &Vector<T, D>,
) -> PerSample<T> {
    let mut sigma = [T::ZERO; MAX_ANCHORS];
    for (sigma, sample) in sigma.iter_mut().zip(samples) {
        let across = sub(position, &sample.anchor);
        *sigma = (sample.distance() - dot(&across, &across).sqrt()).abs().at_least(T::of(SIGMA_FLOOR_M));
    }
    sigma
}

/// The least of the first `count` uncertainties.
pub(crate) fn least<T: Real>(sigma: &PerSample<T>, count: usize) -> T {
    sigma.iter().take(count).fold(sigma[0], |least, &s| least.at_most(s))
}

/// z = ½ (AᵀC⁻¹A)⁻¹ AᵀC⁻¹p (6-10 with C = 1, 6-12 with the covariance 6-13 where `sigma` is given).
///
/// C is a constant c plus a diagonal 1 ⁄ λᵢ, so by Sherman and Morrison AᵀC⁻¹A = Σ λᵢ (aᵢ − ā)(aᵢ − ā)ᵀ + Λ ⁄ (1 + c Λ) ā āᵀ,
/// with Λ = Σ λᵢ and ā the mean weighted by λ: O(N), and a sum of positive terms, so that nothing cancels in `f32`.
#[inline(always)]
pub(crate) fn solve_linear<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    layout: &Layout<T, D>,
    sigma: Option<&PerSample<T>>,
) -> Result<Vector<T, D>, NoFix> {
    let two = T::of(2.0);
    let variance = |s: T, d: T| two * s.squared() * (two * d.squared() + s.squared());

    // The reference anchor is the one of least range (6-16).
    let mut r = 0;
    for (i, sample) in samples.iter().enumerate() {
        if sample.distance() < samples[r].distance() {
            r = i;
        }
    }
    let reference = &samples[r];
    let square = reference.distance().squared();

    let mut lambda = [T::ZERO; MAX_ANCHORS];
    let mut p = [T::ZERO; MAX_ANCHORS];
    let mut total = T::ZERO;
    let mut a_mean = [T::ZERO; D];
    let mut p_mean = T::ZERO;
    for (i, sample) in samples.iter().enumerate().filter(|&(i, _)| i != r) {
        let a = sub(&sample.anchor, &reference.anchor);
        p[i] = square - sample.distance().squared() + dot(&a, &a);
        lambda[i] = match sigma {
            Some(sigma) => T::ONE / variance(sigma[i], sample.distance()),
            None => T::ONE,
        };
        total += lambda[i];
        a_mean = add_scaled(&a_mean, lambda[i], &a);
        p_mean += lambda[i] * p[i];
    }
    let share = T::ONE / total;
    a_mean = a_mean.map(|component| component * share);
    p_mean *= share;
    let common = match sigma {
        Some(sigma) => total / (T::ONE + variance(sigma[r], reference.distance()) * total),
        None => total,
    };

    let mut normal: Matrix<T, D> = [[T::ZERO; D]; D];
    add_outer(&mut normal, common, &a_mean);
    let mut rhs = a_mean.map(|component| common * component * p_mean);
    for (i, sample) in samples.iter().enumerate().filter(|&(i, _)| i != r) {
        let a = sub(&sub(&sample.anchor, &reference.anchor), &a_mean);
        add_outer(&mut normal, lambda[i], &a);
        rhs = add_scaled(&rhs, lambda[i] * (p[i] - p_mean), &a);
    }
    let half = T::of(0.5);
    match layout {
        Layout::Full => {
            let solved = Ldl::new(normal).ok_or(NoFix::Diverged)?.solve(rhs);
            Ok(add_scaled(&reference.anchor, half, &solved))
        }
        Layout::Flat { normal: across, .. } => {
            // Lines say next to nothing across the plane of the anchors: hold the point at a height there, let the ranges lift
            // it, and hold it at that height in the next pass, for anchors that are not quite on a plane.
            let trace = (0..D).fold(T::ZERO, |sum, axis| sum + normal[axis][axis]);
            add_outer(&mut normal, trace, across);
            let factors = Ldl::new(normal).ok_or(NoFix::Diverged)?;
            let mut point = centroid(samples);
            for _ in 0..FLAT_PASSES {
                let height = dot(across, &sub(&point, &reference.anchor));
                let solved = factors.solve(add_scaled(&rhs, T::of(2.0) * trace * height, across));
                point = layout.lift(add_scaled(&reference.anchor, half, &solved), samples);
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
    check(samples)?;
    let layout = Layout::of(samples, constraints)?;
    let position = solve_linear(samples, &layout, None)?;
    conclude(samples, &layout, position, Weighing::Equal)
}

/// The position of B-WLS, without its covariance.
#[inline(always)]
pub(crate) fn b_wls_position<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    layout: &Layout<T, D>,
) -> Result<Vector<T, D>, NoFix> {
    let sigma = uncertainties(samples, &layout.lift(bounding_box::centre(samples), samples));
    solve_linear(samples, layout, Some(&sigma))
}

/// Linear least squares weighted by the bounding box (6-12 to 6-16).
///
/// # Errors
/// See [`NoFix`].
pub fn b_wls<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, NoFix> {
    check(samples)?;
    let layout = Layout::of(samples, constraints)?;
    let sigma = uncertainties(samples, &layout.lift(bounding_box::centre(samples), samples));
    let position = solve_linear(samples, &layout, Some(&sigma))?;
    conclude(samples, &layout, position, Weighing::Uncertainty(&sigma))
}

/// B-WLS that treats the ranges judged direct alike (6.2.2.2): each |σ| under 0.45 m becomes the least |σ|, as in annex P.
///
/// # Errors
/// See [`NoFix`].
pub fn b_wls_c<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, NoFix> {
    check(samples)?;
    let layout = Layout::of(samples, constraints)?;
    let mut sigma = uncertainties(samples, &layout.lift(bounding_box::centre(samples), samples));
    let least = least(&sigma, samples.len());
    for sigma in sigma.iter_mut().filter(|s| **s < T::of(DIRECT_M)) {
        *sigma = least;
    }
    let position = solve_linear(samples, &layout, Some(&sigma))?;
    conclude(samples, &layout, position, Weighing::Uncertainty(&sigma))
}

/// B-WLS once more, weighted by its own answer instead of the bounding box (6.2.3.2, 6-21).
///
/// # Errors
/// See [`NoFix`].
pub fn b_wls_r<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, NoFix> {
    check(samples)?;
    let layout = Layout::of(samples, constraints)?;
    let sigma = uncertainties(samples, &b_wls_position(samples, &layout)?);
    let position = solve_linear(samples, &layout, Some(&sigma))?;
    conclude(samples, &layout, position, Weighing::Uncertainty(&sigma))
}
