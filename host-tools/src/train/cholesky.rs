//! The root of a positive matrix, K = L Lᵀ, and what Gaussian processes do with it.

use smartcore::linalg::basic::arrays::Array;
use smartcore::linalg::basic::matrix::DenseMatrix;
use smartcore::linalg::traits::cholesky::CholeskyDecomposable;

/// L, row by row without its zeros.
#[derive(Clone, Debug, Default)]
pub struct Root(Vec<Vec<f64>>);

impl Root {
    /// The root of a square matrix; `None` where it has none.
    pub fn of(matrix: &Vec<Vec<f64>>) -> Option<Self> {
        let lower = DenseMatrix::from_2d_vec(matrix).ok()?.cholesky().ok()?.L();
        let rows: Vec<Vec<f64>> =
            (0..matrix.len()).map(|row| (0..=row).map(|column| *lower.get((row, column))).collect()).collect();
        rows.iter().flatten().all(|entry| entry.is_finite()).then_some(Self(rows))
    }

    /// z with L z = y; its square is yᵀ K⁻¹ y.
    pub fn half_solve(&self, y: &[f64]) -> Vec<f64> {
        let mut z: Vec<f64> = Vec::with_capacity(y.len());
        for (row, y) in self.0.iter().zip(y) {
            let known: f64 = row.iter().zip(&z).map(|(entry, z)| entry * z).sum();
            z.push((y - known) / row[z.len()]);
        }
        z
    }

    /// w with Lᵀ w = z: K⁻¹ y where z is the half solution for y.
    pub fn other_half(&self, mut z: Vec<f64>) -> Vec<f64> {
        for at in (0..z.len()).rev() {
            z[at] /= self.0[at][at];
            let solved = z[at];
            for (entry, earlier) in self.0[at].iter().zip(&mut z[..at]) {
                *earlier -= entry * solved;
            }
        }
        z
    }

    /// ½ ln |K|.
    pub fn half_ln_determinant(&self) -> f64 {
        self.0.iter().filter_map(|row| row.last()).map(|entry| entry.ln()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::Root;

    #[test]
    fn a_matrix_is_solved_through_its_root() {
        // [[4, 2], [2, 5]] = [[2, 0], [1, 2]] · its transpose; K (1, 1) = (6, 7); |K| = 16.
        let root = Root::of(&vec![vec![4.0, 2.0], vec![2.0, 5.0]]).expect("a root");
        let z = root.half_solve(&[6.0, 7.0]);
        assert_eq!(z, [3.0, 2.0]);
        assert_eq!(root.other_half(z), [1.0, 1.0]);
        assert!((root.half_ln_determinant() - 4.0_f64.ln()).abs() < 1e-12);
        assert!(Root::of(&vec![vec![1.0, 2.0], vec![2.0, 1.0]]).is_none());
    }
}
