//! A small perceptron in bytes for a node: one hidden layer, weights and activations of eight bits, sums of integers.
//!
//! A weight is its byte times the neuron's step. Inputs are limited to ±4 and have steps of 4/127. Hidden values have
//! steps of 1/127.

use heapless::Vec;

use super::perceptron::tanh;
use super::{Classifier, Feature, Features, Inputs, MAX_INPUTS, sigmoid};
use crate::Real;

/// The most hidden neurons.
pub const MAX_HIDDEN: usize = 16;
/// The step of an input.
const INPUT_STEP: f32 = 4.0 / 127.0;
/// The step of a hidden value.
const HIDDEN_STEP: f32 = 1.0 / 127.0;

/// One neuron.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Neuron<const N: usize> {
    /// The constant of the sum.
    pub bias: f32,
    /// The size of one step of a weight.
    pub step: f32,
    /// One weight per input, in steps.
    pub weights: Vec<i8, N>,
}

impl<const N: usize> Neuron<N> {
    /// Rounds weights to bytes; the largest is 127 steps. `None` where there are more than `N`.
    pub fn round(bias: f32, weights: &[f32]) -> Option<Self> {
        let largest = weights.iter().fold(0.0_f32, |largest, weight| largest.at_least(weight.abs()));
        let step = if largest > 0.0 { largest / 127.0 } else { 1.0 };
        let mut bytes = Vec::new();
        for weight in weights {
            bytes.push(rounded(weight / step)).ok()?;
        }
        Some(Self { bias, step, weights: bytes })
    }

    fn sum(&self, inputs: &[i8], input_step: f32) -> f32 {
        let products = inputs.iter().zip(&self.weights).map(|(&input, &weight)| i32::from(input) * i32::from(weight));
        self.bias + products.sum::<i32>() as f32 * (self.step * input_step)
    }

    fn is_sane(&self, inputs: usize) -> bool {
        self.bias.is_finite() && self.step.is_finite() && self.weights.len() == inputs
    }
}

/// The perceptron.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Quantised {
    /// The inputs.
    pub inputs: Inputs,
    /// The hidden layer.
    pub hidden: Vec<Neuron<MAX_INPUTS>, MAX_HIDDEN>,
    /// The output neuron: blocked minus direct.
    pub output: Neuron<MAX_HIDDEN>,
}

impl Classifier for Quantised {
    fn name(&self) -> &'static str {
        "quantised"
    }

    fn for_each_feature(&self, visit: &mut dyn FnMut(Feature)) {
        self.inputs.for_each_feature(visit);
    }

    fn nlos_probability(&self, features: &Features) -> Option<f32> {
        let inputs = self.inputs.of(features)?;
        let inputs: Vec<i8, MAX_INPUTS> = inputs.iter().map(|input| rounded(input / INPUT_STEP)).collect();
        let hidden = self.hidden.iter().map(|neuron| rounded(tanh(neuron.sum(&inputs, INPUT_STEP)) / HIDDEN_STEP));
        let hidden: Vec<i8, MAX_HIDDEN> = hidden.collect();
        Some(sigmoid(self.output.sum(&hidden, HIDDEN_STEP)))
    }

    fn is_sane(&self) -> bool {
        self.inputs.is_sane()
            && self.hidden.iter().all(|neuron| neuron.is_sane(self.inputs.len()))
            && self.output.is_sane(self.hidden.len())
    }
}

/// The nearest integer, half away from zero; the conversion saturates.
fn rounded(x: f32) -> i8 {
    (x + if x < 0.0 { -0.5 } else { 0.5 }) as i8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nlos::Input;

    #[test]
    fn weights_are_rounded_to_steps_of_the_largest() {
        // The largest, 2.54, is 127 steps of 0.02. 1.0 is 50 steps. −0.03 is −1.5 steps, rounded to −2.
        let neuron = Neuron::<3>::round(0.5, &[1.0, -2.54, -0.031]).expect("three");
        assert!((neuron.step - 0.02).abs() < 1.0e-6);
        assert_eq!(neuron.weights.as_slice(), [50, -127, -2]);
        // 10 and 20 input steps of 4/127: (500 − 2540)·0.02·0.0314961 + 0.5 = −0.785039.
        let sum = neuron.sum(&[10, 20, 0], INPUT_STEP);
        assert!((sum + 0.785_039).abs() < 1.0e-5, "{sum}");
        assert_eq!(Neuron::<2>::round(0.0, &[0.0; 3]), None);
    }

    #[test]
    fn bytes_stay_near_the_same_perceptron_in_floats() {
        let input = |feature| Input { feature, mean: 0.0, deviation: 1.0 };
        let hidden = [(0.1, [0.9, -0.4]), (-0.5, [-1.3, 0.2]), (0.7, [0.3, 1.1])];
        let output = (0.2, [1.4, -0.9, -1.7]);
        let quantised = Quantised {
            inputs: Inputs([input(Feature::SkewnessNear), input(Feature::PowerDifference)].into_iter().collect()),
            hidden: hidden.iter().map(|(bias, weights)| Neuron::round(*bias, weights).expect("two")).collect(),
            output: Neuron::round(output.0, &output.1).expect("three"),
        };
        let mut features = Features::default();
        for i in 0..40 {
            let [x, y] = [i as f32 * 0.17 - 3.4, 2.9 - i as f32 * 0.13];
            features.set(Feature::SkewnessNear, x);
            features.set(Feature::PowerDifference, y);
            // The reference in `f64` with the standard library's tanh.
            let float: f64 = hidden
                .iter()
                .zip(output.1)
                .map(|((bias, [a, b]), weight)| {
                    let [bias, a, b] = [*bias, *a, *b].map(f64::from);
                    f64::from(weight) * (bias + a * f64::from(x) + b * f64::from(y)).tanh()
                })
                .sum();
            let expected = 1.0 / (1.0 + (-(float + f64::from(output.0))).exp());
            let p = quantised.nlos_probability(&features).expect("known");
            assert!((f64::from(p) - expected).abs() < 0.02, "{p} {expected}");
        }
    }
}
