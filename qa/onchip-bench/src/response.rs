//! A channel impulse response and classifiers of every kind, the same on chip and desktop.

use positioning_core::nlos::{
    BEFORE, Classifier, Feature, Features, Input, Inputs, Logistic, Nearest, Neuron, Perceptron, PowerDifference,
    Quantised, Shape, Skewness, WINDOW, magnitude,
};

/// The position of the first path in the window.
pub const FIRST_PATH: f32 = BEFORE as f32 + 0.4;
/// The number of prototypes of each class. Each has two coordinates of two bytes.
const PROTOTYPES: usize = 32;
/// The number of weights: 2 inputs, layers of 46, 14 and 24, and 2 outputs.
const WEIGHTS: usize = 46 * 3 + 14 * 47 + 24 * 15 + 2 * 25;

/// Real and imaginary parts as in the accumulator: noise, a rise at the first path, and a tail.
pub fn response() -> [[i16; 2]; WINDOW] {
    let mut random = oorandom::Rand32::new(7);
    core::array::from_fn(|at| {
        let level = match at.checked_sub(BEFORE) {
            None | Some(0) => 0,
            Some(after @ 1..=9) => [3000, 7000, 6000, 9000, 4000, 7500, 2000, 5000, 3500][after - 1],
            Some(after) => 30_000 / after as i32,
        };
        let noise = |random: &mut oorandom::Rand32| (random.rand_range(0..240) as i32 - 120) as i16;
        // The phase turns by about a radian from sample to sample.
        let [cos, sin] = [[100, 0], [54, 84], [-42, 91], [-99, 14], [-65, -76], [28, -96]][at % 6];
        [(level * cos / 100) as i16 + noise(&mut random), (level * sin / 100) as i16 + noise(&mut random)]
    })
}

/// The node's computations on a response: magnitudes, then features.
#[inline(never)]
pub fn features(response: &[[i16; 2]; WINDOW]) -> Features {
    let window: [u16; WINDOW] = core::array::from_fn(|at| magnitude(response[at][0], response[at][1]));
    let mut features = Features::default();
    if let Some(shape) = Shape::of(&window, FIRST_PATH) {
        features.set_shape(&shape);
    }
    features.set(Feature::PowerDifference, 7.25);
    features
}

/// Calls `visit` with every classifier that fits a node, and with the large perceptron.
pub fn for_each_classifier(visit: &mut dyn FnMut(&str, &dyn Classifier)) {
    let input = |feature, mean, deviation| Input { feature, mean, deviation };
    let inputs = || {
        Inputs(
            [input(Feature::SkewnessNear, 1.2, 0.4), input(Feature::PowerDifference, 7.0, 5.0)].into_iter().collect(),
        )
    };
    let mut random = oorandom::Rand32::new(8);
    let mut weight = || random.rand_float() - 0.5;
    let skewness = Skewness { feature: Feature::SkewnessNear, los_mean: 1.5, nlos_mean: 0.9, deviation: 0.35 };
    visit("skewness", &skewness);
    visit("power-difference", &PowerDifference::default());
    visit("logistic", &Logistic { inputs: inputs(), weights: [-1.7, 0.4].into_iter().collect(), intercept: 0.1 });
    let mut prototypes = [[0; 4 * PROTOTYPES]; 2];
    for bytes in prototypes.iter_mut().flat_map(|prototypes| prototypes.as_chunks_mut::<2>().0) {
        *bytes = Nearest::coordinate(4.0 * weight());
    }
    let [los, nlos] = &prototypes;
    visit("nearest-reduced", &Nearest { inputs: inputs(), neighbours: 5, los, nlos });
    let hidden = (0..6).filter_map(|_| Neuron::round(weight(), &[2.0 * weight(), 2.0 * weight()])).collect();
    if let Some(output) = Neuron::round(weight(), &[weight(), weight(), weight(), weight(), weight(), weight()]) {
        visit("quantised", &Quantised { inputs: inputs(), hidden, output });
    }
    let mut weights = [0; 4 * WEIGHTS];
    for bytes in weights.as_chunks_mut::<4>().0 {
        *bytes = weight().to_le_bytes();
    }
    let perceptron =
        Perceptron { inputs: inputs(), hidden: [46, 14, 24].into_iter().collect(), outputs: 2, weights: &weights };
    visit("perceptron", &perceptron);
}
