//! Small symmetric matrices. A D × D normal matrix (D ≤ 4) is accumulated row by row and solved once per position, in
//! fewer instructions than a general library needs (the manifest of the workspace has the counts).

use crate::Real;

/// A vector of D components.
pub type Vector<T, const D: usize> = [T; D];
/// A D × D matrix, row by row.
pub type Matrix<T, const D: usize> = [[T; D]; D];

/// a · b.
#[inline(always)]
pub fn dot<T: Real, const D: usize>(a: &Vector<T, D>, b: &Vector<T, D>) -> T {
    let mut sum = T::ZERO;
    for axis in 0..D {
        sum += a[axis] * b[axis];
    }
    sum
}

/// a − b.
#[inline(always)]
pub fn sub<T: Real, const D: usize>(a: &Vector<T, D>, b: &Vector<T, D>) -> Vector<T, D> {
    core::array::from_fn(|axis| a[axis] - b[axis])
}

/// The squared distance of two points, |a − b|².
pub fn distance_squared<T: Real, const D: usize>(a: &Vector<T, D>, b: &Vector<T, D>) -> T {
    let apart = sub(a, b);
    dot(&apart, &apart)
}

/// a + scale · b.
#[inline(always)]
pub fn add_scaled<T: Real, const D: usize>(a: &Vector<T, D>, scale: T, b: &Vector<T, D>) -> Vector<T, D> {
    core::array::from_fn(|axis| a[axis] + scale * b[axis])
}

/// Adds weight · v vᵀ to the lower triangle of `m`.
#[inline(always)]
pub fn add_outer<T: Real, const D: usize>(m: &mut Matrix<T, D>, weight: T, v: &Vector<T, D>) {
    for row in 0..D {
        let scaled = weight * v[row];
        for column in 0..=row {
            m[row][column] += scaled * v[column];
        }
    }
}

/// Adds weight · v vᵀ to both triangles of `m`.
#[inline(always)]
pub fn add_outer_full<T: Real, const D: usize>(m: &mut Matrix<T, D>, weight: T, v: &Vector<T, D>) {
    for row in 0..D {
        for column in 0..D {
            m[row][column] += weight * v[row] * v[column];
        }
    }
}

/// The factors of a symmetric positive definite matrix, M = L D Lᵀ, which need no square root.
#[derive(Clone, Copy)]
pub struct Ldl<T, const D: usize> {
    /// Below the diagonal: L. On it: 1 ⁄ D.
    factors: Matrix<T, D>,
}

impl<T: Real, const D: usize> Ldl<T, D> {
    /// Factors the matrix whose lower triangle is `m`. Returns `None` where a pivot is less than `D · ε` of its
    /// diagonal element: the matrix is singular at the precision of `T`.
    #[inline(always)]
    pub fn new(mut m: Matrix<T, D>) -> Option<Self> {
        for column in 0..D {
            let diagonal = m[column][column];
            let mut pivot = diagonal;
            for k in 0..column {
                // m[k][column] holds L·D of the row in the unused upper triangle.
                pivot -= m[column][k] * m[k][column];
            }
            let regular = pivot > T::of(8.0) * T::EPSILON * diagonal;
            if !regular {
                return None;
            }
            let inverse = T::ONE / pivot;
            for row in column + 1..D {
                let mut sum = m[row][column];
                for k in 0..column {
                    sum -= m[row][k] * m[k][column];
                }
                m[column][row] = sum;
                m[row][column] = sum * inverse;
            }
            m[column][column] = inverse;
        }
        Some(Self { factors: m })
    }

    /// det M.
    pub fn determinant(&self) -> T {
        let mut inverse = T::ONE;
        for axis in 0..D {
            inverse *= self.factors[axis][axis];
        }
        T::ONE / inverse
    }

    /// M⁻¹ b.
    #[inline(always)]
    pub fn solve(&self, mut b: Vector<T, D>) -> Vector<T, D> {
        let m = &self.factors;
        for row in 1..D {
            for k in 0..row {
                let known = b[k];
                b[row] -= m[row][k] * known;
            }
        }
        for row in (0..D).rev() {
            b[row] *= m[row][row];
            for k in row + 1..D {
                let known = b[k];
                b[row] -= m[k][row] * known;
            }
        }
        b
    }

    /// M⁻¹, both triangles.
    #[inline(always)]
    pub fn inverse(&self) -> Matrix<T, D> {
        let mut inverse = [[T::ZERO; D]; D];
        for column in 0..D {
            let mut unit = [T::ZERO; D];
            unit[column] = T::ONE;
            let solved = self.solve(unit);
            for row in 0..D {
                inverse[row][column] = solved[row];
            }
        }
        inverse
    }
}

/// Eigenvalues (ascending) and unit eigenvectors of the symmetric matrix whose lower triangle is `m`, by cyclic Jacobi
/// rotations (Golub and Van Loan, Matrix Computations, 8.5).
pub fn symmetric_eigen<T: Real, const D: usize>(m: &Matrix<T, D>) -> (Vector<T, D>, [Vector<T, D>; D]) {
    let mut a: Matrix<T, D> =
        core::array::from_fn(|r| core::array::from_fn(|c| if c <= r { m[r][c] } else { m[c][r] }));
    let mut v: Matrix<T, D> = core::array::from_fn(|r| core::array::from_fn(|c| if r == c { T::ONE } else { T::ZERO }));
    const SWEEPS: usize = 6;
    for _ in 0..if D == 2 { 1 } else { SWEEPS } {
        for p in 0..D {
            for q in p + 1..D {
                rotate(&mut a, &mut v, p, q);
            }
        }
    }
    let mut order: [usize; D] = core::array::from_fn(|axis| axis);
    order.sort_unstable_by(|&i, &j| a[i][i].partial_cmp(&a[j][j]).unwrap_or(core::cmp::Ordering::Equal));
    (
        core::array::from_fn(|k| a[order[k]][order[k]]),
        core::array::from_fn(|k| core::array::from_fn(|row| v[row][order[k]])),
    )
}

/// One Jacobi rotation that sets a[p][q] to zero, applied to `a` and accumulated in `v`.
fn rotate<T: Real, const D: usize>(a: &mut Matrix<T, D>, v: &mut Matrix<T, D>, p: usize, q: usize) {
    let off = a[p][q];
    if off == T::ZERO {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (T::of(2.0) * off);
    let sign = if theta < T::ZERO { -T::ONE } else { T::ONE };
    let t = sign / (theta.abs() + (theta.squared() + T::ONE).sqrt());
    let c = T::ONE / (t.squared() + T::ONE).sqrt();
    let s = t * c;
    for k in 0..D {
        let (kp, kq) = (a[k][p], a[k][q]);
        a[k][p] = c * kp - s * kq;
        a[k][q] = s * kp + c * kq;
    }
    for k in 0..D {
        let (pk, qk) = (a[p][k], a[q][k]);
        a[p][k] = c * pk - s * qk;
        a[q][k] = s * pk + c * qk;
    }
    for row in v.iter_mut() {
        let (rp, rq) = (row[p], row[q]);
        row[p] = c * rp - s * rq;
        row[q] = s * rp + c * rq;
    }
}
