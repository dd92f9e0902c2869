//! The classifiers that are trained, with their features and their training.
//!
//! Learnt classifiers use the skewness near the maximum and the difference of powers. Neither depends on the distance
//! or the strength of a signal, so that a classifier learnt in one flat is useful in another. One pair of classifiers
//! uses the features of Barral et al., range and received power, to show the difference.

use baliza_report::mean;
use positioning_core::nlos::{
    Feature, Features, Input, Inputs, Kind, Logistic, MAX_NEIGHBOURS, Model, Nearest, Neuron, Perceptron, Platt,
    PowerDifference, Quantised, Skewness,
};

use super::backpropagation::{Example, Goal, Network};
use super::fit;
use super::folds::{balanced, deal, weights};
use super::samples::TrainingSample;

/// Number of receptions of either class to which a learnt classifier is fitted.
const MOST: usize = 600;
/// Number of prototypes of either class on a node, and number of neighbours that vote.
const PROTOTYPES: usize = 32;
const PROTOTYPE_NEIGHBOURS: u8 = 5;
/// Hidden layers of table 2 of Barral et al.
const LAYERS: [u8; 3] = [46, 14, 24];
/// Hidden neurons of the perceptron with weights of one byte.
const SMALL_LAYER: [u8; 1] = [6];
/// Penalty on the weights of the logistic regression: ½·α·|w|² beside a sum over some 1,200 receptions.
const LOGISTIC_ALPHA: f64 = 1.0;

/// How a classifier is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Two normal densities.
    Skewness,
    /// The chip maker's rule; only its calibration is learnt.
    PowerDifference,
    /// Logistic regression.
    Logistic,
    /// k-nearest neighbours with k = 47.
    Nearest,
    /// The same with few prototypes.
    NearestReduced,
    /// The large perceptron.
    Perceptron,
    /// The perceptron with weights of one byte.
    Quantised,
}

impl Method {
    /// The name that the model will have.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Skewness => "skewness",
            Self::PowerDifference => "power-difference",
            Self::Logistic => "logistic",
            Self::Nearest => "nearest",
            Self::NearestReduced => "nearest-reduced",
            Self::Perceptron => "perceptron",
            Self::Quantised => "quantised",
        }
    }
}

/// A classifier to train.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Recipe {
    /// Its method.
    pub method: Method,
    /// Its features.
    pub features: &'static [Feature],
}

const SHAPE: &[Feature] = &[Feature::SkewnessNear, Feature::PowerDifference];
const LEVEL: &[Feature] = &[Feature::RangeMean, Feature::PowerMean];

/// All recipes; each is trained where its features are known.
pub const RECIPES: [Recipe; 12] = [
    Recipe { method: Method::Skewness, features: &[Feature::SkewnessNear] },
    Recipe { method: Method::Skewness, features: &[Feature::Skewness] },
    Recipe { method: Method::PowerDifference, features: &[Feature::PowerDifference] },
    Recipe { method: Method::Logistic, features: SHAPE },
    Recipe { method: Method::Nearest, features: SHAPE },
    Recipe { method: Method::NearestReduced, features: SHAPE },
    Recipe { method: Method::Perceptron, features: SHAPE },
    Recipe { method: Method::Quantised, features: SHAPE },
    Recipe { method: Method::Logistic, features: &[Feature::PowerDifference, Feature::FirstPathToNoise] },
    Recipe { method: Method::Nearest, features: LEVEL },
    Recipe { method: Method::Perceptron, features: LEVEL },
    Recipe { method: Method::Logistic, features: &[Feature::SkewnessNear, Feature::PowerMean] },
];

impl Recipe {
    /// Whether a reception has all its features.
    pub fn knows(&self, features: &Features) -> bool {
        self.features.iter().all(|&feature| features.get(feature).is_some())
    }

    /// Trains on the labelled receptions that have its features. Returns the bytes of the model with this
    /// calibration; `None` where one of the classes is missing, or the library that fits it.
    pub fn train(&self, samples: &[&TrainingSample], calibration: Platt, seed: u64) -> Option<Vec<u8>> {
        let known: Vec<&TrainingSample> =
            samples.iter().copied().filter(|s| s.blocked.is_some() && self.knows(&s.features)).collect();
        let classes = [false, true].map(|class| known.iter().any(|sample| sample.blocked == Some(class)));
        let is_fitted = matches!(self.method, Method::Logistic | Method::NearestReduced);
        if classes != [true; 2] || is_fitted && !fit::IS_AVAILABLE {
            return None;
        }
        let chosen = balanced(&known, MOST);
        let inputs = || inputs(self.features, &chosen);
        let (prototypes, weights);
        let kind = match self.method {
            Method::Skewness => Kind::Skewness(skewness(self.features.first().copied()?, &chosen)),
            Method::PowerDifference => Kind::PowerDifference(PowerDifference::default()),
            Method::Logistic => Kind::Logistic(logistic(inputs(), &chosen)?),
            Method::Nearest => {
                let inputs = inputs();
                prototypes = [false, true].map(|class| coordinates(&points(&inputs, &chosen, class)));
                let [los, nlos] = &prototypes;
                let neighbours = chosen.len().min(MAX_NEIGHBOURS) as u8;
                Kind::Nearest(Nearest { inputs, neighbours, los, nlos })
            }
            Method::NearestReduced => {
                let inputs = inputs();
                prototypes = [false, true].map(|class| coordinates(&centres(points(&inputs, &chosen, class), seed)));
                let [los, nlos] = &prototypes;
                let all = (los.len() + nlos.len()) / (2 * inputs.len().max(1));
                let neighbours = all.min(usize::from(PROTOTYPE_NEIGHBOURS)) as u8;
                Kind::Nearest(Nearest { inputs, neighbours, los, nlos })
            }
            Method::Perceptron => {
                let inputs = inputs();
                let trained = perceptron(&inputs, &LAYERS, &known, seed);
                weights = trained.iter().flat_map(|&w| (w as f32).to_le_bytes()).collect::<Vec<u8>>();
                let hidden = LAYERS.into_iter().collect();
                Kind::Perceptron(Perceptron { inputs, hidden, outputs: 2, weights: &weights })
            }
            Method::Quantised => Kind::Quantised(quantised(inputs(), &known, seed)?),
        };
        encode(&Model { kind, calibration })
    }
}

/// The bytes of a model.
fn encode(model: &Model<'_>) -> Option<Vec<u8>> {
    // 1,200 prototypes of eight inputs are 19 kB, the large perceptron 6 kB.
    let mut buffer = vec![0; 64 * 1024];
    let length = model.encode(&mut buffer).ok()?.len();
    buffer.truncate(length);
    Some(buffer)
}

/// Means and deviations of the features, with equal weights for both classes.
fn inputs(features: &[Feature], samples: &[&TrainingSample]) -> Inputs {
    let input = |&feature: &Feature| {
        let (mean, deviation) = moments(feature, samples);
        Input { feature, mean: mean as f32, deviation: deviation as f32 }
    };
    Inputs(features.iter().map(input).collect())
}

/// Weighted mean and deviation of a feature; a deviation of zero becomes one.
fn moments(feature: Feature, samples: &[&TrainingSample]) -> (f64, f64) {
    let values = samples.iter().map(|sample| f64::from(sample.features.get(feature).unwrap_or(0.0)));
    let weights = weights(samples);
    let mean: f64 = values.clone().zip(&weights).map(|(value, weight)| value * weight).sum();
    let variance: f64 = values.zip(&weights).map(|(value, weight)| (value - mean).powi(2) * weight).sum();
    (mean, if variance > 1e-12 { variance.sqrt() } else { 1.0 })
}

fn skewness(feature: Feature, samples: &[&TrainingSample]) -> Skewness {
    let [(los_mean, los), (nlos_mean, nlos)] = [false, true].map(|class| {
        let of: Vec<&TrainingSample> = samples.iter().copied().filter(|sample| sample.blocked == Some(class)).collect();
        moments(feature, &of)
    });
    let deviation = ((los * los + nlos * nlos) / 2.0).sqrt();
    Skewness { feature, los_mean: los_mean as f32, nlos_mean: nlos_mean as f32, deviation: deviation as f32 }
}

/// The inputs of every reception of a class.
fn points(inputs: &Inputs, samples: &[&TrainingSample], class: bool) -> Vec<Vec<f64>> {
    let of = samples.iter().filter(|sample| sample.blocked == Some(class));
    of.filter_map(|sample| point(inputs, sample)).collect()
}

fn point(inputs: &Inputs, sample: &TrainingSample) -> Option<Vec<f64>> {
    Some(inputs.of(&sample.features)?.iter().map(|&input| f64::from(input)).collect())
}

fn coordinates(points: &[Vec<f64>]) -> Vec<u8> {
    points.iter().flatten().flat_map(|&input| Nearest::coordinate(input as f32)).collect()
}

/// The centres of clusters of the points; the points themselves where they are few.
fn centres(points: Vec<Vec<f64>>, seed: u64) -> Vec<Vec<f64>> {
    if points.len() <= PROTOTYPES {
        return points;
    }
    let Some(members) = fit::clusters(&points, PROTOTYPES, seed) else { return points };
    (0..PROTOTYPES as i32)
        .filter_map(|cluster| {
            let own: Vec<&Vec<f64>> =
                points.iter().zip(&members).filter(|(_, member)| **member == cluster).map(|(point, _)| point).collect();
            let mean = |i: usize| mean(own.iter().map(|point| point[i]));
            own.first().map(|point| (0..point.len()).map(mean).collect())
        })
        .collect()
}

fn logistic(inputs: Inputs, samples: &[&TrainingSample]) -> Option<Logistic> {
    let examples = examples(&inputs, samples);
    let rows: Vec<Vec<f64>> = examples.iter().map(|(point, _)| point.clone()).collect();
    let labels: Vec<i32> = examples.iter().map(|(_, target)| i32::from(*target > 0.5)).collect();
    let (weights, intercept) = fit::logistic(&rows, &labels, LOGISTIC_ALPHA)?;
    Some(Logistic { weights: weights.into_iter().collect(), intercept, inputs })
}

fn examples(inputs: &Inputs, samples: &[&TrainingSample]) -> Vec<Example> {
    let example = |sample: &&TrainingSample| {
        let target = f64::from(u8::from(sample.blocked == Some(true)));
        Some((point(inputs, sample)?, target))
    };
    samples.iter().filter_map(example).collect()
}

/// Trained on most placements, with early stopping by the others.
fn perceptron(inputs: &Inputs, hidden: &[u8], known: &[&TrainingSample], seed: u64) -> Vec<f64> {
    let placements = known.iter().map(|sample| sample.placement + 1).max().unwrap_or(0);
    let folds = deal(known, placements, 4, seed);
    let (validation, training): (Vec<&TrainingSample>, Vec<&TrainingSample>) =
        known.iter().copied().partition(|sample| folds[sample.placement] == 0);
    let [training, validation] = [training, validation].map(|part| examples(inputs, &balanced(&part, MOST)));
    // Where all receptions are of one placement, it also serves for early stopping.
    let (training, validation) =
        if training.is_empty() { (validation.clone(), validation) } else { (training, validation) };
    Network::new(inputs.len(), hidden, Goal::Classify).train(&training, &validation, seed)
}

fn quantised(inputs: Inputs, known: &[&TrainingSample], seed: u64) -> Option<Quantised> {
    let weights = perceptron(&inputs, &SMALL_LAYER, known, seed);
    let [width] = SMALL_LAYER.map(usize::from);
    let (hidden, outputs) = weights.split_at_checked(width * (inputs.len() + 1))?;
    let single = |row: &[f64]| -> Vec<f32> { row.iter().map(|&weight| weight as f32).collect() };
    let hidden = hidden
        .chunks_exact(inputs.len() + 1)
        .map(|row| Neuron::round(row[0] as f32, &single(&row[1..])))
        .collect::<Option<_>>()?;
    // Softmax over two outputs is a sigmoid of their difference, so that one output is enough.
    let (direct, blocked) = outputs.split_at_checked(width + 1)?;
    let difference: Vec<f64> = blocked.iter().zip(direct).map(|(blocked, direct)| blocked - direct).collect();
    let output = Neuron::round(*difference.first()? as f32, &single(&difference[1..]))?;
    Some(Quantised { inputs, hidden, output })
}

#[cfg(test)]
mod tests {
    use positioning_core::nlos::Classifier;

    use super::*;

    /// Sixty receptions in six placements: x = (1.5 sin 1.7i, cos 0.9i + 0.3 sin i), blocked where x₀ − 0.8x₁ + sin
    /// 5.3i > 0.2.
    fn receptions() -> Vec<TrainingSample> {
        (0..60)
            .map(|i| {
                let r = i as f64;
                let x = [(1.7 * r).sin() * 1.5, (0.9 * r).cos() + 0.3 * r.sin()];
                let mut features = Features::default();
                features.set(Feature::SkewnessNear, x[0] as f32);
                features.set(Feature::PowerDifference, x[1] as f32);
                let blocked = Some(x[0] - 0.8 * x[1] + (5.3 * r).sin() > 0.2);
                TrainingSample { placement: i % 6, blocked, features, error_m: None }
            })
            .collect()
    }

    /// The features without normalisation.
    fn plain() -> Inputs {
        let input = |&feature: &Feature| Input { feature, mean: 0.0, deviation: 1.0 };
        Inputs(SHAPE.iter().map(input).collect())
    }

    fn at(x: [f32; 2]) -> Features {
        let mut features = Features::default();
        features.set(Feature::SkewnessNear, x[0]);
        features.set(Feature::PowerDifference, x[1]);
        features
    }

    #[test]
    fn the_regression_is_that_of_scikit_learn() {
        // sklearn 1.9: LogisticRegression(C=1, tol=1e-12), the inverse of our α.
        let samples = receptions();
        let logistic = logistic(plain(), &samples.iter().collect::<Vec<_>>()).expect("a minimum");
        for (found, expected) in
            logistic.weights.iter().chain([&logistic.intercept]).zip([1.528_998, -1.738_027, -0.900_210])
        {
            assert!((found - expected).abs() < 1e-3, "{found} is not {expected}");
        }
    }

    #[test]
    fn neighbours_are_those_of_scikit_learn() {
        // sklearn 1.9: KNeighborsClassifier(47, metric="cityblock"): 22, 9 and 20 votes of 47.
        let samples = receptions();
        let all: Vec<&TrainingSample> = samples.iter().collect();
        let [los, nlos] = [false, true].map(|class| coordinates(&points(&plain(), &all, class)));
        let nearest = Nearest { inputs: plain(), neighbours: 47, los: &los, nlos: &nlos };
        for (x, votes) in [([0.5, -0.5], 22.0), ([-1.0, 1.0], 9.0), ([1.2, 0.1], 20.0)] {
            let p = nearest.nlos_probability(&at(x)).expect("known");
            assert!((p - (votes + 1.0) / 49.0).abs() < 1e-6, "{x:?}: {p}");
        }
    }

    #[test]
    fn every_recipe_makes_a_model_of_its_name_and_features() {
        let mut samples = receptions();
        for (i, sample) in samples.iter_mut().enumerate() {
            for feature in [Feature::Skewness, Feature::FirstPathToNoise, Feature::RangeMean, Feature::PowerMean] {
                sample.features.set(feature, (i % 7) as f32);
            }
        }
        let all: Vec<&TrainingSample> = samples.iter().collect();
        for recipe in RECIPES {
            let bytes = recipe.train(&all, Platt::NONE, 1).unwrap_or_else(|| panic!("{recipe:?}"));
            let (model, rest) = Model::decode(&bytes).expect("a model");
            assert_eq!((model.name(), rest.len()), (recipe.method.as_str(), 0));
            let mut features = Vec::new();
            model.for_each_feature(&mut |feature| features.push(feature));
            assert_eq!(features, recipe.features);
            assert!(model.nlos_probability(&samples[0].features).is_some());
        }
        let direct: Vec<&TrainingSample> = all.iter().copied().filter(|sample| sample.blocked == Some(false)).collect();
        assert!(
            RECIPES.iter().all(|recipe| recipe.train(&direct, Platt::NONE, 1).is_none()),
            "one class teaches nothing"
        );
    }

    #[test]
    fn the_skewness_of_either_class_is_its_placements_mean() {
        // Direct: one placement, 2 and 4: mean 3, variance 1. Blocked: placements of 0, 0, 0 and of 2: mean 1, variance
        // 1.
        let sample = |placement, blocked, value| {
            let mut features = Features::default();
            features.set(Feature::SkewnessNear, value);
            TrainingSample { placement, blocked: Some(blocked), features, error_m: None }
        };
        let samples = [
            sample(0, false, 2.0),
            sample(0, false, 4.0),
            sample(1, true, 0.0),
            sample(1, true, 0.0),
            sample(1, true, 0.0),
            sample(2, true, 2.0),
        ];
        let found = skewness(Feature::SkewnessNear, &samples.iter().collect::<Vec<_>>());
        let expected = Skewness { feature: Feature::SkewnessNear, los_mean: 3.0, nlos_mean: 1.0, deviation: 1.0 };
        assert_eq!(found, expected);
    }

    #[test]
    fn few_points_are_their_own_prototypes_and_many_are_clustered() {
        let points = |count: usize| -> Vec<Vec<f64>> { (0..count).map(|i| vec![i as f64, 0.5]).collect() };
        assert_eq!(centres(points(PROTOTYPES), 1), points(PROTOTYPES));
        let centres = centres(points(400), 1);
        assert!((PROTOTYPES / 2..=PROTOTYPES).contains(&centres.len()), "{}", centres.len());
        assert!(centres.iter().all(|centre| (0.0..400.0).contains(&centre[0]) && (centre[1] - 0.5).abs() < 1e-9));
    }
}
