//! Logistic regression: a sigmoid over a weighted sum.

use heapless::Vec;

use super::{Classifier, Feature, Features, Inputs, MAX_INPUTS, sigmoid};

/// One weight per input, and the intercept.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Logistic {
    /// The inputs.
    pub inputs: Inputs,
    /// One weight per input.
    pub weights: Vec<f32, MAX_INPUTS>,
    /// The constant of the sum.
    pub intercept: f32,
}

impl Classifier for Logistic {
    fn name(&self) -> &'static str {
        "logistic"
    }

    fn for_each_feature(&self, visit: &mut dyn FnMut(Feature)) {
        self.inputs.for_each_feature(visit);
    }

    fn nlos_probability(&self, features: &Features) -> Option<f32> {
        let inputs = self.inputs.of(features)?;
        let sum: f32 = inputs.iter().zip(&self.weights).map(|(input, weight)| input * weight).sum();
        Some(sigmoid(self.intercept + sum))
    }

    fn is_sane(&self) -> bool {
        self.inputs.is_sane()
            && self.weights.len() == self.inputs.len()
            && self.intercept.is_finite()
            && self.weights.iter().all(|weight| weight.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nlos::Input;

    #[test]
    fn the_probability_is_that_of_a_hand_calculation() {
        let input = |feature, mean, deviation| Input { feature, mean, deviation };
        let logistic = Logistic {
            inputs: Inputs(
                [input(Feature::SkewnessNear, 1.0, 0.5), input(Feature::PowerDifference, 8.0, 4.0)]
                    .into_iter()
                    .collect(),
            ),
            weights: [-2.0, 0.5].into_iter().collect(),
            intercept: 0.25,
        };
        let mut features = Features::default();
        features.set(Feature::SkewnessNear, 1.5);
        assert_eq!(logistic.nlos_probability(&features), None);
        features.set(Feature::PowerDifference, 6.0);
        // Inputs 1 and −0.5: 0.25 − 2 − 0.25 = −2; σ(−2) = 0.119203.
        let p = logistic.nlos_probability(&features).expect("known");
        assert!((p - 0.119_203).abs() < 1.0e-5, "{p}");
    }
}
