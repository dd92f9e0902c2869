//! The multilayer perceptron of Barral et al. (3.1.2, table 2): layers of hyperbolic tangents, with softmax over two
//! outputs, or with one linear output where it predicts a range's error.
//!
//! Weights are little-endian `f32`, layer by layer, neuron by neuron: the bias, then one weight per input. They are
//! read from flash without a copy.

use heapless::Vec;

use super::{Classifier, Feature, Features, Inputs, sigmoid};
use crate::Real;

/// The most hidden layers.
pub const MAX_LAYERS: usize = 3;
/// The most neurons of a layer: 65 and 69 neurons predict the error of blocked ranges in table 2.
pub const MAX_WIDTH: usize = 72;

/// A perceptron.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Perceptron<'a> {
    /// The inputs.
    pub inputs: Inputs,
    /// Neurons of the hidden layers: 46, 14, 24 in table 2.
    pub hidden: Vec<u8, MAX_LAYERS>,
    /// Neurons of the last layer: two classify (direct, blocked), one predicts.
    pub outputs: u8,
    /// The weights.
    pub weights: &'a [u8],
}

impl Perceptron<'_> {
    /// The number of weights of a perceptron with these layers.
    pub fn weights_of(inputs: usize, hidden: &[u8], outputs: u8) -> usize {
        let widths = hidden.iter().chain([&outputs]).map(|&width| usize::from(width));
        widths.fold((inputs, 0), |(from, sum), width| (width, sum + width * (from + 1))).1
    }

    /// The last layer's sums; `None` where a feature is not known.
    pub fn outputs(&self, features: &Features) -> Option<Vec<f32, MAX_WIDTH>> {
        let mut layer: Vec<f32, MAX_WIDTH> = self.inputs.of(features)?.into_iter().collect();
        let mut weights = self.weights.as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes));
        for (&width, last) in self.hidden.iter().zip(core::iter::repeat(false)).chain([(&self.outputs, true)]) {
            let mut next = Vec::new();
            for _ in 0..width {
                let bias = weights.next()?;
                let sum = layer.iter().try_fold(bias, |sum, input| Some(sum + input * weights.next()?))?;
                next.push(if last { sum } else { tanh(sum) }).ok()?;
            }
            layer = next;
        }
        Some(layer)
    }
}

impl Classifier for Perceptron<'_> {
    fn name(&self) -> &'static str {
        "perceptron"
    }

    fn for_each_feature(&self, visit: &mut dyn FnMut(Feature)) {
        self.inputs.for_each_feature(visit);
    }

    fn nlos_probability(&self, features: &Features) -> Option<f32> {
        match self.outputs(features)?.as_slice() {
            // Softmax over two is a sigmoid of their difference.
            [direct, blocked] => Some(sigmoid(blocked - direct)),
            _ => None,
        }
    }

    fn is_sane(&self) -> bool {
        let narrow = |&width: &u8| (1..=MAX_WIDTH).contains(&usize::from(width));
        self.inputs.is_sane()
            && self.hidden.iter().all(narrow)
            && (1..=2).contains(&self.outputs)
            && self.weights.len() == 4 * Self::weights_of(self.inputs.len(), &self.hidden, self.outputs)
            && self.weights.as_chunks::<4>().0.iter().all(|&bytes| f32::from_le_bytes(bytes).is_finite())
    }
}

/// tanh x = 1 − 2/(e²ˣ + 1).
pub(super) fn tanh(x: f32) -> f32 {
    2.0 * sigmoid(2.0 * x) - 1.0
}

/// The predicted error of a range, from a perceptron with one linear output (table 2, "mitigation").
impl Perceptron<'_> {
    /// Metres to add to the range; `None` where a feature is not known or the perceptron classifies. Barral et al.
    /// found that it does not carry over to another building, and this project's recordings confirm it: nothing calls
    /// it by default.
    pub fn correction_m(&self, features: &Features) -> Option<f32> {
        match self.outputs(features)?.as_slice() {
            [correction] => Some(correction.at_least(-10.0).at_most(10.0)),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nlos::testing::{at, two_inputs};

    fn bytes(weights: &[f32]) -> std::vec::Vec<u8> {
        weights.iter().flat_map(|weight| weight.to_le_bytes()).collect()
    }

    #[test]
    fn outputs_are_those_of_a_hand_calculation() {
        // Two hidden neurons: tanh(0.1 + 0.5x − 0.25y), tanh(−0.2 + y); outputs 0.3 + h1 − h2, −0.1 + 2h2.
        let weights = bytes(&[0.1, 0.5, -0.25, -0.2, 0.0, 1.0, 0.3, 1.0, -1.0, -0.1, 0.0, 2.0]);
        let perceptron =
            Perceptron { inputs: two_inputs(), hidden: [2].into_iter().collect(), outputs: 2, weights: &weights };
        assert_eq!(Perceptron::weights_of(2, &[2], 2), 12);
        // The perceptron of table 2 with two inputs: 46·3 + 14·47 + 24·15 + 2·25 = 138 + 658 + 360 + 50.
        assert_eq!(Perceptron::weights_of(2, &[46, 14, 24], 2), 1206);
        // x = 1, y = 2: h1 = tanh(0.1) = 0.0996680, h2 = tanh(1.8) = 0.9468060.
        // o1 = 0.3 + 0.099668 − 0.946806 = −0.547138; o2 = −0.1 + 1.893612 = 1.793612; σ(2.340750) = 0.912205.
        let p = perceptron.nlos_probability(&at(1.0, 2.0)).expect("known");
        assert!((p - 0.912_205).abs() < 1.0e-5, "{p}");
        assert_eq!(perceptron.nlos_probability(&Features::default()), None);
        assert_eq!(perceptron.correction_m(&at(1.0, 2.0)), None, "it classifies");
    }

    #[test]
    fn one_linear_output_is_a_correction() {
        let weights = bytes(&[0.0, 1.0, 0.0, 0.5, -2.0]);
        let perceptron =
            Perceptron { inputs: two_inputs(), hidden: [1].into_iter().collect(), outputs: 1, weights: &weights };
        // 0.5 − 2·tanh(0.5) = 0.5 − 2·0.4621172 = −0.4242343.
        let correction = perceptron.correction_m(&at(0.5, 9.0)).expect("known");
        assert!((correction + 0.424_234).abs() < 1.0e-5, "{correction}");
        assert_eq!(perceptron.nlos_probability(&at(0.5, 9.0)), None);
    }

    #[test]
    fn missing_weights_are_no_panic() {
        let weights = bytes(&[1.0; 7]);
        let perceptron =
            Perceptron { inputs: two_inputs(), hidden: [200].into_iter().collect(), outputs: 2, weights: &weights };
        assert_eq!(perceptron.nlos_probability(&at(1.0, 2.0)), None);
    }

    #[test]
    fn tanh_is_that_of_the_standard_library() {
        for i in -400..400 {
            let x = i as f32 * 0.05;
            assert!((tanh(x) - x.tanh()).abs() < 4.0e-7, "{x}");
        }
    }
}
