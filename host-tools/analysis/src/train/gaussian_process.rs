//! Gaussian-process regression with the exponential kernel and one length an input (Barral et al., 3.1.1, equations 2
//! to 4).

use baliza_report::mean;

use super::backpropagation::Example;
use crate::regression::Regression;

/// The parameters of the kernel.
#[derive(Clone, Debug, PartialEq)]
pub struct Kernel {
    /// σ_f: deviation of the function.
    pub signal: f64,
    /// σ_m: the correlation length along each input.
    pub lengths: Vec<f64>,
    /// Deviation of a measurement.
    pub noise: f64,
}

impl Kernel {
    /// σ_f² exp(−r), r² = Σ ((a − b)/σ_m)².
    fn covariance(&self, a: &[f64], b: &[f64]) -> f64 {
        let square: f64 = a.iter().zip(b).zip(&self.lengths).map(|((a, b), length)| ((a - b) / length).powi(2)).sum();
        self.signal.powi(2) * (-square.sqrt()).exp()
    }
}

/// A process, given examples.
#[derive(Clone, Debug)]
pub struct GaussianProcess {
    kernel: Kernel,
    points: Vec<Vec<f64>>,
    regression: Regression,
    /// The prediction far from every point.
    mean: f64,
}

impl GaussianProcess {
    /// The process with this kernel; `None` where its matrix has no root or there is no example.
    pub fn new(examples: &[Example], kernel: Kernel) -> Option<Self> {
        let mean = mean(examples.iter().map(|(_, target)| *target));
        let targets: Vec<f64> = examples.iter().map(|(_, target)| target - mean).collect();
        let regression = Regression::new(&targets, |i, j| {
            let noise = if i == j { kernel.noise.powi(2) } else { 0.0 };
            kernel.covariance(&examples[i].0, &examples[j].0) + noise
        })?;
        let points = examples.iter().map(|(point, _)| point.clone()).collect();
        (!examples.is_empty()).then_some(Self { kernel, points, regression, mean })
    }

    /// The process with the kernel of the greatest likelihood: lengths and deviation from a grid. Each input has its
    /// own length where `each` is true (the mitigator of direct paths in table 1), else all have the same (that of
    /// blocked paths).
    pub fn fit(examples: &[Example], noise: f64, each: bool) -> Option<Self> {
        let inputs = examples.first()?.0.len();
        let steps = [0.3, 1.0, 3.0, 10.0_f64];
        let kinds = if each { steps.len().pow(inputs as u32) } else { steps.len() };
        let lengths = |kind: usize| -> Vec<f64> {
            let digit = |i: u32| if each { kind / steps.len().pow(i) % steps.len() } else { kind };
            (0..inputs as u32).map(|i| steps[digit(i)]).collect()
        };
        let kernels =
            (0..kinds).flat_map(|kind| [0.05, 0.2, 0.8].map(|signal| Kernel { signal, lengths: lengths(kind), noise }));
        let processes = kernels.filter_map(|kernel| Self::new(examples, kernel));
        processes.max_by(|a, b| a.regression.log_likelihood.total_cmp(&b.regression.log_likelihood))
    }

    /// The expected value at a point.
    pub fn predict(&self, point: &[f64]) -> f64 {
        let near: Vec<f64> = self.points.iter().map(|near| self.kernel.covariance(point, near)).collect();
        self.mean + self.regression.mean(&near)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn predictions_are_those_of_scikit_learn() {
        // GaussianProcessRegressor(0.25·Matern(length_scale=[1, 2], nu=0.5), alpha=0.01, optimizer=None), targets
        // minus their mean.
        let examples: Vec<Example> =
            (0..12).map(f64::from).map(|i| (vec![(i * 1.3).sin() * 2.0, (i * 0.7).cos()], (i * 0.9).sin())).collect();
        let kernel = Kernel { signal: 0.5, lengths: vec![1.0, 2.0], noise: 0.1 };
        let process = GaussianProcess::new(&examples, kernel).expect("a root");
        for (point, expected) in [([0.1, 0.2], -0.182320474), ([-1.5, 0.9], 0.880352189), ([9.0, 9.0], 0.143919305)] {
            let found = process.predict(&point);
            assert!((found - expected).abs() < 1e-6, "{point:?}: {found}");
        }
        // log_marginal_likelihood_value_ + 6 ln 2π.
        let found = process.regression.log_likelihood;
        assert!((found - -5.869819731).abs() < 1e-6, "{found}");
    }

    #[test]
    fn the_likeliest_kernel_knows_which_input_matters() {
        let examples: Vec<Example> = (0..40)
            .map(f64::from)
            .map(|i| (vec![(i * 2.3).sin() * 3.0, (i * 1.1).cos() * 3.0], (i * 2.3).sin()))
            .collect();
        let process = GaussianProcess::fit(&examples, 0.05, true).expect("a kernel");
        assert!(process.kernel.lengths[1] > process.kernel.lengths[0], "{:?}", process.kernel);
        assert!(GaussianProcess::fit(&[], 0.05, true).is_none());
    }
}
