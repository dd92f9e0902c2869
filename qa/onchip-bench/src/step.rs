//! One step of weighted nonlinear least squares in the plane, Δ = (Σ w u uᵀ)⁻¹ Σ w u (d − ‖z − a‖) with u the unit
//! vector from anchor to position. It is written in three ways: by hand, with nalgebra in a careful form, and with
//! nalgebra in the textbook's form. Their costs decide whether the solvers use a library for their matrices.

use positioning_core::{MAX_ANCHORS, RangeSample};

/// The arguments of the square roots in the comparison.
pub const ROOTS_OF: [f32; 3] = [2.0, 100.0, 0.37];
/// The number of anchors of the step.
pub const ANCHORS: usize = 12;
/// The starting point of the step, metres.
pub const START: [f32; 2] = [4.0, 3.0];

/// The weights of the step. They differ, so that an optimiser cannot merge them.
pub fn weights() -> [f32; MAX_ANCHORS] {
    core::array::from_fn(|i| 1.0 / (0.01 + 0.001 * i as f32))
}

/// Accumulates the three distinct elements of the normal matrix and the two of the right-hand side, then solves by
/// Cramer's rule.
#[inline(never)]
pub fn by_hand(samples: &[RangeSample<f32, 2>], weights: &[f32], at: [f32; 2], root: impl Fn(f32) -> f32) -> [f32; 2] {
    let (mut xx, mut xy, mut yy, mut bx, mut by) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (sample, &weight) in samples.iter().zip(weights) {
        let (dx, dy) = (at[0] - sample.anchor[0], at[1] - sample.anchor[1]);
        let distance = root(dx * dx + dy * dy);
        let inverse = 1.0 / distance;
        let (ux, uy) = (dx * inverse, dy * inverse);
        let (wx, wy) = (weight * ux, weight * uy);
        let residual = sample.range - distance;
        xx += wx * ux;
        xy += wx * uy;
        yy += wy * uy;
        bx += wx * residual;
        by += wy * residual;
    }
    let inverse = 1.0 / (xx * yy - xy * xy);
    [at[0] + (yy * bx - xy * by) * inverse, at[1] + (xx * by - xy * bx) * inverse]
}

/// The same sums as 2 × 2 and 2 × 1 matrices of nalgebra.
#[cfg(feature = "methods")]
#[inline(never)]
pub fn by_nalgebra_sums(
    samples: &[RangeSample<f32, 2>],
    weights: &[f32],
    at: [f32; 2],
    root: impl Fn(f32) -> f32,
) -> Option<[f32; 2]> {
    use nalgebra::{Matrix2, Vector2};
    let at = Vector2::from(at);
    let mut normal = Matrix2::zeros();
    let mut rhs = Vector2::zeros();
    for (sample, &weight) in samples.iter().zip(weights) {
        let across = at - Vector2::from(sample.anchor);
        let distance = root(across.dot(&across));
        let unit = across / distance;
        normal += unit * unit.transpose() * weight;
        rhs += unit * (weight * (sample.range - distance));
    }
    Some((at + normal.try_inverse()? * rhs).into())
}

/// The formula as printed: (JᵀWJ)⁻¹JᵀWe with a 12 × 2 matrix J and a 12 × 12 matrix W.
#[cfg(feature = "methods")]
#[inline(never)]
pub fn by_nalgebra_matrices(
    samples: &[RangeSample<f32, 2>],
    weights: &[f32],
    at: [f32; 2],
    root: impl Fn(f32) -> f32,
) -> Option<[f32; 2]> {
    use nalgebra::{SMatrix, SVector, Vector2};
    const N: usize = ANCHORS;
    let mut jacobian = SMatrix::<f32, N, 2>::zeros();
    let mut residuals = SVector::<f32, N>::zeros();
    for (i, sample) in samples.iter().enumerate().take(N) {
        let across = Vector2::from(at) - Vector2::from(sample.anchor);
        let distance = root(across.dot(&across));
        jacobian[(i, 0)] = across.x / distance;
        jacobian[(i, 1)] = across.y / distance;
        residuals[i] = sample.range - distance;
    }
    let weight = SMatrix::<f32, N, N>::from_diagonal(&SVector::from_fn(|i, _| weights[i]));
    let weighted = jacobian.transpose() * weight;
    let step = (weighted * jacobian).try_inverse()? * (weighted * residuals);
    Some((Vector2::from(at) + step).into())
}
