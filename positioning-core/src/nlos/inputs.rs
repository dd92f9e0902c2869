//! From features to the inputs of a trained classifier: selected, centred, scaled.

use heapless::Vec;

use super::{Feature, Features};
use crate::Real;

/// The most inputs of a trained classifier.
pub const MAX_INPUTS: usize = 8;
/// Inputs are limited to this number of deviations, so that an outlier does not outweigh the others.
const FARTHEST: f32 = 4.0;

/// One input.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Input {
    /// The feature.
    pub feature: Feature,
    /// The mean, which is subtracted from the feature.
    pub mean: f32,
    /// The deviation, by which the difference is divided.
    pub deviation: f32,
}

/// The inputs of a trained classifier, in order.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Inputs(pub Vec<Input, MAX_INPUTS>);

impl Inputs {
    /// The inputs of these features; `None` where one of them is not known.
    pub fn of(&self, features: &Features) -> Option<Vec<f32, MAX_INPUTS>> {
        let mut values = Vec::new();
        for input in &self.0 {
            let value = (features.get(input.feature)? - input.mean) / input.deviation;
            // There is one value per input, and the inputs fit.
            values.push(value.at_least(-FARTHEST).at_most(FARTHEST)).ok()?;
        }
        Some(values)
    }

    /// The number of inputs.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are no inputs.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether there are inputs and all their numbers are plausible.
    pub(crate) fn is_sane(&self) -> bool {
        !self.is_empty()
            && self.0.iter().all(|input| input.mean.is_finite() && input.deviation.is_finite() && input.deviation > 0.0)
    }

    pub(crate) fn for_each_feature(&self, visit: &mut dyn FnMut(Feature)) {
        self.0.iter().for_each(|input| visit(input.feature));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_are_scaled_and_held() {
        let input = |feature, mean, deviation| Input { feature, mean, deviation };
        let inputs = Inputs(
            Vec::from_slice(&[input(Feature::Kurtosis, 3.0, 2.0), input(Feature::PowerDifference, 8.0, 4.0)])
                .expect("two"),
        );
        let mut features = Features::default();
        features.set(Feature::Kurtosis, 6.0);
        assert_eq!(inputs.of(&features), None, "one is not known");
        features.set(Feature::PowerDifference, -800.0);
        // (6 − 3)/2 = 1.5; (−800 − 8)/4 = −202, limited to −4.
        assert_eq!(inputs.of(&features).as_deref(), Some(&[1.5, -4.0][..]));
    }
}
