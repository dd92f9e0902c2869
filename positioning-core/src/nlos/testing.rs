//! Two features and their plane, for the tests of classifiers.

use super::{Feature, Features, Input, Inputs};

/// The features without scaling.
pub fn two_inputs() -> Inputs {
    let input = |feature| Input { feature, mean: 0.0, deviation: 1.0 };
    Inputs([input(Feature::RangeMean), input(Feature::PowerMean)].into_iter().collect())
}

/// A point of the plane.
pub fn at(x: f32, y: f32) -> Features {
    let mut features = Features::default();
    features.set(Feature::RangeMean, x);
    features.set(Feature::PowerMean, y);
    features
}
