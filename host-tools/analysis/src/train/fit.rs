//! What a library of learning fits: clusters and logistic regressions. It is a feature of the program.

/// Whether it is there.
pub const IS_AVAILABLE: bool = cfg!(feature = "training");

#[cfg(feature = "training")]
pub use with::{clusters, logistic};
#[cfg(not(feature = "training"))]
pub use without::{clusters, logistic};

#[cfg(feature = "training")]
mod with {
    use smartcore::cluster::kmeans::{KMeans, KMeansParameters};
    use smartcore::linalg::basic::arrays::Array;
    use smartcore::linalg::basic::matrix::DenseMatrix;
    use smartcore::linear::logistic_regression::{LogisticRegression, LogisticRegressionParameters};

    /// The number of each point's cluster, of this many (k-means).
    pub fn clusters(points: &Vec<Vec<f64>>, count: usize, seed: u64) -> Option<Vec<i32>> {
        let parameters = KMeansParameters { k: count, max_iter: 100, seed: Some(seed) };
        let matrix = DenseMatrix::from_2d_vec(points).ok()?;
        let clusters: KMeans<f64, i32, DenseMatrix<f64>, Vec<i32>> = KMeans::fit(&matrix, parameters).ok()?;
        clusters.predict(&matrix).ok()
    }

    /// The weights of the inputs, and the intercept, of a regression of labels 0 and 1; `alpha` is the penalty on the
    /// weights.
    pub fn logistic(points: &Vec<Vec<f64>>, labels: &Vec<i32>, alpha: f64) -> Option<(Vec<f32>, f32)> {
        let matrix = DenseMatrix::from_2d_vec(points).ok()?;
        let parameters = LogisticRegressionParameters::default().with_alpha(alpha);
        let fitted = LogisticRegression::fit(&matrix, labels, parameters).ok()?;
        let inputs = points.first().map_or(0, Vec::len);
        let weights = (0..inputs).map(|input| *fitted.coefficients().get((0, input)) as f32).collect();
        Some((weights, *fitted.intercept().get((0, 0)) as f32))
    }
}

#[cfg(not(feature = "training"))]
mod without {
    /// There are none.
    pub fn clusters(_: &Vec<Vec<f64>>, _: usize, _: u64) -> Option<Vec<i32>> {
        None
    }

    /// There is none.
    pub fn logistic(_: &Vec<Vec<f64>>, _: &Vec<i32>, _: f64) -> Option<(Vec<f32>, f32)> {
        None
    }
}
