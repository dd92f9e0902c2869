//! The closed forms: linear least squares about a reference anchor, plain (LLS) and weighted (B-WLS and its variants).
//!
//! Subtracting the circle of the reference anchor r from the others leaves lines. With coordinates relative to the
//! reference anchor, 2 aᵢ·z = d_r² − dᵢ² + |aᵢ|² (6-8, 6-9). The constants k become |aᵢ|², which keeps the equations
//! well conditioned in `f32`, for any distance of the origin.

use crate::fix::{blame, conclude, conclude_equal, conclude_weighted};
use crate::geometry::{Survey, centroid};
use crate::linalg::{Ldl, Matrix, Vector, add_outer, add_scaled, dot, sub};
use crate::sample::PerSample;
use crate::{Constraints, Fix, MAX_ANCHORS, RangeSample, Real, SolveError};

/// An independent part that is added to every uncertainty, metres. σ = 0 would divide by zero (6-13), and a single
/// range that agrees with the weighing position to the millimetre must not outweigh all others.
const SIGMA_FLOOR_M: f64 = 0.01;
/// A range is classified as direct when it differs from the weighing position by less than this, metres (table 8-9
/// and annex P).
pub(crate) const DIRECT_M: f64 = 0.45;

/// The number of passes of a closed form over coplanar anchors. The anchors' distance from the plane has an effect
/// that shrinks twentyfold per pass.
const FLAT_PASSES: usize = 4;

/// σ² with σ = d − ‖z − a‖, the uncertainty of a range as seen from `position` (6-14, 6-21).
#[inline(always)]
fn variance<T: Real, const D: usize>(sample: &RangeSample<T, D>, position: &Vector<T, D>) -> T {
    let across = sub(position, &sample.anchor);
    let sigma = sample.range - dot(&across, &across).sqrt();
    sigma.squared() + T::of(SIGMA_FLOOR_M * SIGMA_FLOOR_M)
}

/// The [`variance`] of every range.
#[inline(never)]
pub(crate) fn variances<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    position: &Vector<T, D>,
) -> PerSample<T> {
    core::array::from_fn(|i| samples.get(i).map_or(T::ONE, |sample| variance(sample, position)))
}

/// The least of the variances of `count` samples.
pub(crate) fn least<T: Real>(variances: &PerSample<T>, count: usize) -> T {
    variances.iter().take(count).fold(variances[0], |least, &variance| least.at_most(variance))
}

/// What a sample adds to the linear system.
#[derive(Clone, Copy)]
struct Row<T> {
    /// Half of it is the right side of the anchor's line (6-9).
    p: T,
    /// The inverse of the anchor's own part of the covariance (6-13); zero for the reference anchor.
    lambda: T,
    /// σ² of the range.
    variance: T,
}

type Rows<T> = heapless::Vec<Row<T>, MAX_ANCHORS>;

/// z = ½ (AᵀC⁻¹A)⁻¹ AᵀC⁻¹p. It is 6-12 with the covariance 6-13 and σ² of each range from `variance`. Without
/// `variance` it is 6-10, with C = 1. The rows are empty before, and hold the samples' parts afterwards.
///
/// C is a constant c plus a diagonal 1 ⁄ λᵢ, so by Sherman and Morrison AᵀC⁻¹A = Σ λᵢ (aᵢ − ā)(aᵢ − ā)ᵀ + Λ ⁄ (1 + c
/// Λ) ā āᵀ, with Λ = Σ λᵢ and ā the mean weighted by λ. This takes O(N) operations. It is a sum of positive terms, so
/// nothing cancels in `f32`.
#[inline(always)]
fn solve_rows<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    survey: &Survey<T, D>,
    variance: Option<impl Fn(usize, &RangeSample<T, D>) -> T>,
    rows: &mut Rows<T>,
) -> Result<Vector<T, D>, SolveError> {
    let reference = &samples[survey.reference];
    let square = reference.range.squared();
    let mut total = T::ZERO;
    let mut a_mean = [T::ZERO; D];
    let mut p_mean = T::ZERO;
    for (i, sample) in samples.iter().enumerate() {
        let a = sub(&sample.anchor, &reference.anchor);
        let own_square = sample.range.squared();
        let p = a.iter().fold(square - own_square, |p, component| p + component.squared());
        let (variance, lambda) = match &variance {
            Some(variance) => {
                // 1 ⁄ (4 σ² d² + 2 σ⁴) (6-13), except for a factor that is common to all of C.
                let variance = variance(i, sample);
                (variance, T::ONE / (variance * (own_square + own_square + variance)))
            }
            None => (T::ONE, T::ONE),
        };
        // The row of the reference anchor is zero: it adds nothing to the other sums.
        if i != survey.reference {
            total += lambda;
        }
        a_mean = add_scaled(&a_mean, lambda, &a);
        p_mean += lambda * p;
        // Never full: the survey has refused more samples than there are rows.
        let _ = rows.push(Row { p, lambda, variance });
    }
    let share = T::ONE / total;
    a_mean = a_mean.map(|sum| sum * share);
    p_mean *= share;
    // Λ ⁄ (1 + c Λ). Without weights the reference anchor's noise is left out: c = 0.
    let mut common = total;
    if let Some(row) = rows.get_mut(survey.reference) {
        if variance.is_some() {
            common = total * row.lambda / (row.lambda + total);
        }
        row.lambda = T::ZERO;
    }

    let mut normal: Matrix<T, D> = [[T::ZERO; D]; D];
    add_outer(&mut normal, common, &a_mean);
    let mut rhs = a_mean.map(|component| common * component * p_mean);
    let origin = add_scaled(&reference.anchor, T::ONE, &a_mean);
    for (sample, row) in samples.iter().zip(rows.iter()) {
        let a = sub(&sample.anchor, &origin);
        add_outer(&mut normal, row.lambda, &a);
        rhs = add_scaled(&rhs, row.lambda * (row.p - p_mean), &a);
    }
    let half = T::of(0.5);
    let position = match survey.layout.normal() {
        None => Ldl::new(normal).map(|factors| add_scaled(&reference.anchor, half, &factors.solve(rhs))),
        Some(across) => {
            // Lines give almost no information across the plane of the anchors. The point is held at a height there,
            // then the ranges lift it. The next pass holds it at that height, for anchors that are not exactly on a
            // plane.
            let trace = (0..D).fold(T::ZERO, |sum, axis| sum + normal[axis][axis]);
            add_outer(&mut normal, trace, across);
            Ldl::new(normal).map(|factors| {
                let mut point = centroid(samples);
                for _ in 0..FLAT_PASSES {
                    let height = dot(across, &sub(&point, &reference.anchor));
                    let solved = factors.solve(add_scaled(&rhs, T::of(2.0) * trace * height, across));
                    point = survey.layout.lift(add_scaled(&reference.anchor, half, &solved), samples);
                }
                point
            })
        }
    };
    position.ok_or_else(|| blame(samples, SolveError::Diverged))
}

/// The position of LLS, without its covariance.
#[inline(never)]
pub(crate) fn lls_position<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    survey: &Survey<T, D>,
) -> Result<Vector<T, D>, SolveError> {
    solve_rows(samples, survey, None::<fn(usize, &RangeSample<T, D>) -> T>, &mut Rows::new())
}

/// The position of the weighted closed form, without its covariance.
#[inline(never)]
pub(crate) fn weighted_position<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    survey: &Survey<T, D>,
    variances: &PerSample<T>,
) -> Result<Vector<T, D>, SolveError> {
    solve_rows(samples, survey, Some(|i: usize, _: &RangeSample<T, D>| variances[i]), &mut Rows::new())
}

/// The position of B-WLS, without its covariance.
pub(crate) fn b_wls_position<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    survey: &Survey<T, D>,
) -> Result<Vector<T, D>, SolveError> {
    weighted_position(samples, survey, &variances(samples, &survey.boxed))
}

/// The weighted closed form and its covariance.
fn solve_weighted<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    survey: &Survey<T, D>,
    variances: &PerSample<T>,
) -> Result<Fix<T, D>, SolveError> {
    let position = weighted_position(samples, survey, variances)?;
    conclude_weighted(samples, &survey.layout, position, &variances.map(|variance| T::ONE / variance))
}

/// Linear least squares about the anchor of least range (6-8 to 6-10, 6-16).
///
/// # Errors
/// There is no position; [`SolveError`] has the reason.
pub fn lls<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, SolveError> {
    let survey = Survey::of(samples, constraints)?;
    let position = lls_position(samples, &survey)?;
    conclude_equal(samples, &survey.layout, position)
}

/// Linear least squares weighted by the bounding box (6-12 to 6-16).
///
/// # Errors
/// There is no position; [`SolveError`] has the reason.
pub fn b_wls<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, SolveError> {
    let survey = Survey::of_inlined(samples, constraints)?;
    let mut rows = Rows::new();
    let variance = |_, sample: &RangeSample<T, D>| variance(sample, &survey.boxed);
    let position = solve_rows(samples, &survey, Some(variance), &mut rows)?;
    conclude(samples, &survey.layout, position, rows.iter().map(|row| T::ONE / row.variance))
}

/// [`b_wls`] by the functions of [`b_wls_r`], for images that contain both: exactly the same position with 6 kB less
/// code, and more instructions.
pub(crate) fn b_wls_in_parts<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, SolveError> {
    let survey = Survey::of(samples, constraints)?;
    solve_weighted(samples, &survey, &variances(samples, &survey.boxed))
}

/// B-WLS with equal weights for the ranges classified as direct (6.2.2.2): each |σ| under 0.45 m becomes the least
/// |σ|, as in annex P.
///
/// # Errors
/// There is no position; [`SolveError`] has the reason.
pub fn b_wls_c<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, SolveError> {
    let survey = Survey::of(samples, constraints)?;
    let mut variances = variances(samples, &survey.boxed);
    let least = least(&variances, samples.len());
    for variance in variances.iter_mut().filter(|v| **v < T::of(DIRECT_M * DIRECT_M)) {
        *variance = least;
    }
    solve_weighted(samples, &survey, &variances)
}

/// B-WLS repeated, weighted by its own result instead of the bounding box (6.2.3.2, 6-21).
///
/// # Errors
/// There is no position; [`SolveError`] has the reason.
pub fn b_wls_r<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, SolveError> {
    let survey = Survey::of(samples, constraints)?;
    let first = b_wls_position(samples, &survey)?;
    solve_weighted(samples, &survey, &variances(samples, &first))
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;
    use crate::Side;

    fn compare<const D: usize>() {
        let mut rng = Pcg64::seed_from_u64(1);
        let constraints = Constraints { side: Side::Unknown, area: None };
        let mut found = 0;
        for _ in 0..1000 {
            let count = rng.random_range(1..=MAX_ANCHORS);
            let samples: std::vec::Vec<RangeSample<f32, D>> = (0..count)
                .map(|_| {
                    let anchor = core::array::from_fn(|_| rng.random_range(0.0..10.0));
                    RangeSample::new(anchor, rng.random_range(0.5..12.0))
                })
                .collect();
            let (inlined, in_parts) = (b_wls(&samples, &constraints), b_wls_in_parts(&samples, &constraints));
            assert_eq!(inlined, in_parts);
            found += usize::from(inlined.is_ok());
        }
        // Random ranges mostly do not meet, and that is found too.
        assert!(found > 100, "{found}");
    }

    #[test]
    fn b_wls_in_parts_has_the_bits_of_b_wls() {
        compare::<2>();
        compare::<3>();
    }
}
