//! Detection of blocked paths: from the diagnostics of a reception to the probability that its direct path is
//! blocked.
//!
//! Input: the magnitudes of the channel impulse response around the first path ([`Shape`]), the receiver's
//! diagnostics ([`power_difference_db`], [`first_path_to_noise_db`]), and the earlier ranges and powers
//! ([`MovingMean`]). They are collected as [`Features`]. A [`Classifier`] computes from them the probability that the
//! direct path is blocked (NLOS). [`Inflation`] converts the probability to the variance of the range. No range is
//! rejected here: a blocked range weighs less.
//!
//! Classifiers are trained on a desktop. A node reads one as a [`NodeModel`], which is versioned and checksummed
//! bytes in its flash (feature `serde`). A [`NlosDetector`] calls it and keeps the features that depend on earlier
//! receptions. Without a model, [`PowerDifference::default`] is the chip maker's own rule, and [`Skewness::default`]
//! was fitted to recordings in a flat.
//!
//! Sources: E. García et al., *A robust UWB indoor positioning system for highly complex environments* (equations 2 to
//! 4: skewness); V. Barral et al., *Environmental cross-validation of NLOS machine learning classification/mitigation
//! with low-cost UWB positioning systems*, Sensors 2019 (moving means, k-nearest neighbours, perceptrons); S. Marano et
//! al., *NLOS identification and mitigation for localization based on UWB experimental data*, IEEE JSAC 28(7), 2010
//! (kurtosis, rise time, mean excess delay, delay spread); DW1000 user manual, 4.7 (powers).

mod calibration;
mod detector;
mod features;
mod inputs;
mod logistic;
#[cfg(feature = "serde")]
mod model;
mod moving_mean;
mod nearest;
mod perceptron;
mod power_difference;
mod quantised;
mod shape;
mod skewness;
#[cfg(test)]
mod testing;

pub use calibration::{Inflation, Platt};
pub use detector::{LINKS, Means, NlosDetector, Reception};
pub use features::{Feature, Features, first_path_to_noise_db, power_difference_db};
pub use inputs::{Input, Inputs, MAX_INPUTS};
pub use logistic::Logistic;
#[cfg(feature = "serde")]
pub use model::{Kind, LeftOut, Model, NodeModel, StoredError, Trained, VERSION};
pub use moving_mean::MovingMean;
pub use nearest::{MAX_NEIGHBOURS, Nearest};
pub use perceptron::{MAX_LAYERS, MAX_WIDTH, Perceptron};
pub use power_difference::PowerDifference;
pub use quantised::{MAX_HIDDEN, Neuron, Quantised};
pub use shape::{BEFORE, NEAR, SAMPLE_NS, Shape, WINDOW, magnitude};
pub use skewness::Skewness;

/// A classifier of blocked and direct ranges.
pub trait Classifier: Sync {
    /// Its name, as tables and commands use it.
    fn name(&self) -> &'static str;

    /// Calls `visit` for every feature that it needs.
    fn for_each_feature(&self, visit: &mut dyn FnMut(Feature));

    /// The probability that the direct path is blocked, 0 to 1, with equal prior probabilities; `None` where a
    /// feature that it needs is not known.
    fn nlos_probability(&self, features: &Features) -> Option<f32>;

    /// Whether its numbers are valid for a classifier.
    fn is_sane(&self) -> bool;
}

/// 1/(1 + e⁻ˣ), without overflow; ½ for NaN.
fn sigmoid(x: f32) -> f32 {
    use crate::Real;
    // Beyond 30 it is 0 or 1 in an `f32`.
    let x = x.at_least(-30.0).at_most(30.0);
    if x.is_nan() { 0.5 } else { 1.0 / (1.0 + Real::exp(-x)) }
}
