//! Regression by a Gaussian process with any kernel (C. Rasmussen and C. Williams, *Gaussian Processes for Machine
//! Learning*, 2006, algorithm 2.1). The input is covariances of the points, and their targets. The output is means
//! and variances at other points.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// A process of mean zero, given targets at points.
#[derive(Clone, Debug)]
pub struct Regression {
    root: Cholesky<f64, Dyn>,
    /// K⁻¹ y.
    weights: DVector<f64>,
    /// Logarithm of the marginal likelihood of the targets, without its constant −n ⁄ 2 ln 2π.
    pub log_likelihood: f64,
}

impl Regression {
    /// The process whose points have these targets, y, and these covariances, K(i, j) for i ≥ j, the noise of the
    /// targets on its diagonal included; `None` where K has no Cholesky root.
    pub fn new(targets: &[f64], mut covariance: impl FnMut(usize, usize) -> f64) -> Option<Self> {
        let (count, targets) = (targets.len(), DVector::from_column_slice(targets));
        // The root is computed from the lower triangle alone.
        let lower = |i, j| if i < j { 0.0 } else { covariance(i, j) };
        let root = Cholesky::new(DMatrix::from_fn(count, count, lower))?;
        let weights = root.solve(&targets);
        let half_ln_determinant: f64 = root.l_dirty().diagonal().iter().map(|entry| entry.ln()).sum();
        let log_likelihood = -targets.dot(&weights) / 2.0 - half_ln_determinant;
        log_likelihood.is_finite().then_some(Self { root, weights, log_likelihood })
    }

    /// The expected value where the covariances with the points are `near`.
    pub fn mean(&self, near: &[f64]) -> f64 {
        self.weights.iter().zip(near).map(|(weight, near)| weight * near).sum()
    }

    /// The weights of the points in [`Self::mean`] there, K⁻¹ near.
    pub fn weights(&self, near: &[f64]) -> DVector<f64> {
        self.root.solve(&DVector::from_column_slice(near))
    }

    /// For each point, with A = K⁻¹ and α = A y, αᵢ ⁄ Aᵢᵢ and 1 ⁄ Aᵢᵢ (section 5.4.2): where the point has the weight w and
    /// is left out, the mean is less by w αᵢ ⁄ Aᵢᵢ, and the variance greater by w² ⁄ Aᵢᵢ.
    pub fn left_out(&self) -> Vec<[f64; 2]> {
        let inverse = self.root.inverse();
        self.weights.iter().zip(inverse.diagonal().iter()).map(|(weight, own)| [weight / own, own.recip()]).collect()
    }

    /// Reduction of the variance there by the points: nearᵀ K⁻¹ near.
    pub fn explained(&self, near: &[f64]) -> f64 {
        let near = DVector::from_column_slice(near);
        self.root.l_dirty().solve_lower_triangular(&near).map_or(0.0, |half| half.norm_squared())
    }
}

#[cfg(test)]
mod tests {
    use super::Regression;

    #[test]
    fn two_points_are_those_of_a_hand_calculation() {
        // K = [[4, 2], [2, 5]]: |K| = 16; K (1, 1) = (6, 7); yᵀ K⁻¹ y = 13. K⁻¹ (4, 2) = (1, 0), since it is the first
        // column.
        let k = [[4.0, 2.0], [2.0, 5.0]];
        let process = Regression::new(&[6.0, 7.0], |i, j| k[i][j]).expect("a root");
        assert!((process.mean(&[1.0, 2.0]) - 3.0).abs() < 1e-12);
        assert!((process.explained(&[4.0, 2.0]) - 4.0).abs() < 1e-12);
        assert!((process.log_likelihood + 6.5 + 4.0_f64.ln()).abs() < 1e-12);
        // Where the covariances are (4, 2), the mean is 6, and all of a variance of 4 is explained. Without the first point
        // the second gives 2 ⁄ 5 · 7 = 2.8, and explains 4 ⁄ 5.
        let ([mean, variance], weight) = (process.left_out()[0], process.weights(&[4.0, 2.0])[0]);
        assert!(
            (weight * mean - (6.0 - 2.8)).abs() < 1e-12 && (weight * weight * variance - (4.0 - 0.8)).abs() < 1e-12
        );
        assert!(Regression::new(&[1.0, 1.0], |i, j| [[1.0, 2.0], [2.0, 1.0]][i][j]).is_none());
    }
}
