//! Trains perceptrons: value and gradient by backpropagation, minimised by scaled conjugate gradients. It is written
//! here because the machine-learning library has no perceptron, and libraries that have one come with a tensor
//! compiler.

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use super::conjugate_gradient::{Limits, minimise};

/// The meaning of the last layer's sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Goal {
    /// Two outputs, softmax, cross entropy: the target is 1 where the path is blocked, else 0.
    Classify,
    /// One output, squared error: the target is a number.
    Predict,
}

impl Goal {
    /// Number of outputs.
    pub fn outputs(self) -> usize {
        match self {
            Self::Classify => 2,
            Self::Predict => 1,
        }
    }
}

/// One example: inputs and target.
pub type Example = (Vec<f64>, f64);

/// The layers, without their weights. Weights are ordered layer by layer, neuron by neuron: the bias, then a weight
/// an input.
#[derive(Clone, Debug)]
pub struct Network {
    widths: Vec<usize>,
    goal: Goal,
}

impl Network {
    /// A network with these hidden layers.
    pub fn new(inputs: usize, hidden: &[u8], goal: Goal) -> Self {
        let mut widths = vec![inputs];
        widths.extend(hidden.iter().map(|&width| usize::from(width)));
        widths.push(goal.outputs());
        Self { widths, goal }
    }

    /// Number of weights.
    pub fn size(&self) -> usize {
        self.widths.windows(2).map(|pair| pair[1] * (pair[0] + 1)).sum()
    }

    /// Weights fitted to `examples`, with early stopping by `validation`.
    pub fn train(&self, examples: &[Example], validation: &[Example], seed: u64) -> Vec<f64> {
        let objective = |weights: &[f64], gradient: &mut [f64]| self.loss(weights, examples, Some(gradient));
        minimise(self.start(seed), Limits::default(), objective, |weights| self.loss(weights, validation, None))
    }

    /// Uniform within ±√(6/(in + out)) (Glorot and Bengio, 2010); biases zero.
    fn start(&self, seed: u64) -> Vec<f64> {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut weights = Vec::with_capacity(self.size());
        for pair in self.widths.windows(2) {
            let most = (6.0 / (pair[0] + pair[1]) as f64).sqrt();
            for _ in 0..pair[1] {
                weights.push(0.0);
                weights.extend((0..pair[0]).map(|_| random.random_range(-most..most)));
            }
        }
        weights
    }

    /// Mean loss over the examples; its gradient goes to `gradient`.
    pub fn loss(&self, weights: &[f64], examples: &[Example], mut gradient: Option<&mut [f64]>) -> f64 {
        if let Some(gradient) = &mut gradient {
            gradient.fill(0.0);
        }
        let scale = 1.0 / examples.len().max(1) as f64;
        let mut total = 0.0;
        let mut layers: Vec<Vec<f64>> = self.widths.iter().map(|&width| vec![0.0; width]).collect();
        for (inputs, target) in examples {
            layers[0].copy_from_slice(inputs);
            self.forward(weights, &mut layers);
            let outputs = &layers[layers.len() - 1];
            let (loss, delta) = match self.goal {
                Goal::Classify => {
                    // ln(1 + eᶻ) − tz with z = blocked − direct.
                    let z = outputs[1] - outputs[0];
                    let slope = 1.0 / (1.0 + (-z).exp()) - target;
                    (z.max(0.0) + (-z.abs()).exp().ln_1p() - target * z, vec![-slope, slope])
                }
                Goal::Predict => {
                    let error = outputs[0] - target;
                    (error * error / 2.0, vec![error])
                }
            };
            total += loss * scale;
            if let Some(gradient) = &mut gradient {
                self.backward(weights, &layers, delta, scale, gradient);
            }
        }
        total
    }

    fn forward(&self, weights: &[f64], layers: &mut [Vec<f64>]) {
        let mut at = 0;
        for layer in 1..layers.len() {
            let (before, after) = layers.split_at_mut(layer);
            let (inputs, last) = (&before[layer - 1], after.len() == 1);
            for output in &mut after[0] {
                let own = &weights[at..at + inputs.len() + 1];
                at += own.len();
                let sum = own[0] + own[1..].iter().zip(inputs).map(|(w, x)| w * x).sum::<f64>();
                *output = if last { sum } else { sum.tanh() };
            }
        }
    }

    fn backward(&self, weights: &[f64], layers: &[Vec<f64>], mut delta: Vec<f64>, scale: f64, gradient: &mut [f64]) {
        let mut end = weights.len();
        for layer in (1..layers.len()).rev() {
            let inputs = &layers[layer - 1];
            let row = inputs.len() + 1;
            let begin = end - delta.len() * row;
            let mut below = vec![0.0; inputs.len()];
            for (neuron, slope) in delta.iter().enumerate() {
                let own = begin + neuron * row;
                gradient[own] += scale * slope;
                for (i, input) in inputs.iter().enumerate() {
                    gradient[own + 1 + i] += scale * slope * input;
                    below[i] += slope * weights[own + 1 + i];
                }
            }
            // tanh′ = 1 − tanh².
            delta = below.iter().zip(inputs).map(|(slope, output)| slope * (1.0 - output * output)).collect();
            end = begin;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn examples() -> Vec<Example> {
        (0..7).map(|i| (vec![f64::from(i) * 0.3 - 1.0, (f64::from(i) * 1.7).sin()], f64::from(i % 2))).collect()
    }

    #[test]
    fn the_gradient_is_that_of_finite_differences() {
        for goal in [Goal::Classify, Goal::Predict] {
            let network = Network::new(2, &[4, 3], goal);
            // 4·3 + 3·5 + outputs·4.
            assert_eq!(network.size(), 27 + 4 * goal.outputs());
            let weights = network.start(5);
            let mut gradient = vec![0.0; network.size()];
            network.loss(&weights, &examples(), Some(&mut gradient));
            for place in 0..network.size() {
                let moved = |by: f64| {
                    let mut weights = weights.clone();
                    weights[place] += by;
                    network.loss(&weights, &examples(), None)
                };
                let difference = (moved(1e-5) - moved(-1e-5)) / 2e-5;
                assert!((gradient[place] - difference).abs() < 1e-8, "{goal:?} {place}");
            }
        }
    }

    #[test]
    fn what_no_straight_line_separates_is_learnt() {
        // Exclusive or.
        let examples: Vec<Example> =
            [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)].map(|(a, b)| (vec![a, b], f64::abs(a - b))).to_vec();
        let network = Network::new(2, &[6], Goal::Classify);
        let weights = network.train(&examples, &examples, 1);
        // A guess by chance costs ln 2 = 0.69.
        let loss = network.loss(&weights, &examples, None);
        assert!(loss < 0.05, "{loss}");
        assert_eq!(weights, network.train(&examples, &examples, 1), "the same for the same seed");
    }

    #[test]
    fn a_curve_is_predicted() {
        let curve = |from: f64| -> Vec<Example> {
            (0..30).map(|i| from + f64::from(i) * 0.1).map(|x| (vec![x], (2.0 * x).sin())).collect()
        };
        let network = Network::new(1, &[8], Goal::Predict);
        let weights = network.train(&curve(-1.5), &curve(-1.45), 2);
        // Half the mean square of the curve is about 0.25.
        let loss = network.loss(&weights, &curve(-1.45), None);
        assert!(loss < 0.01, "{loss}");
    }
}
