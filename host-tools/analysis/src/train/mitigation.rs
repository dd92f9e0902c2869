//! Prediction of a range's error from range and received power (Barral et al., 3.1.1 and 3.1.2), and the quality of
//! the prediction outside the training data: in other placements, in another building.
//!
//! This is a demonstration; no node and no filter calls it.

use positioning_core::nlos::{Feature, Features, Input, Inputs, Perceptron};

use super::backpropagation::{Example, Goal, Network};
use super::folds::deal;
use super::gaussian_process::GaussianProcess;
use super::samples::{Samples, TrainingSample};

/// Inputs of table 1's and table 2's mitigators.
const FEATURES: [Feature; 2] = [Feature::RangeMean, Feature::PowerMean];
/// Number of receptions to which a regressor is fitted: a process of this size takes a tenth of a second for each
/// kernel.
const MOST: usize = 200;
/// Number of folds of placements.
const FOLDS: usize = 8;

/// The method of prediction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Regressor {
    /// Gaussian process, table 1.
    GaussianProcess,
    /// Perceptron, table 2.
    Perceptron,
}

impl Regressor {
    /// Both.
    pub const ALL: [Self; 2] = [Self::GaussianProcess, Self::Perceptron];

    /// Its name in tables.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::GaussianProcess => "gaussian-process",
            Self::Perceptron => "perceptron",
        }
    }
}

/// Origin of the corrected receptions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Whence {
    /// From the placements that it was trained on, but not the receptions.
    SamePlacements,
    /// From others in the same building.
    OtherPlacements,
    /// From another building.
    OtherBuilding,
}

impl Whence {
    /// Its name in tables.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::SamePlacements => "same placements",
            Self::OtherPlacements => "other placements",
            Self::OtherBuilding => "other building",
        }
    }
}

/// Errors before and after correction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// The method of prediction.
    pub regressor: Regressor,
    /// Whether the ranges are blocked.
    pub blocked: bool,
    /// The origin of the ranges.
    pub whence: Whence,
    /// Mean absolute error as measured, metres.
    pub before_m: f64,
    /// Mean absolute error as corrected, metres.
    pub after_m: f64,
    /// Number of receptions.
    pub count: usize,
}

/// Trains both regressors for direct and for blocked ranges of `own`. Corrects ranges from the same placements, from
/// other placements and from `other` buildings with them. In each building the median error of direct ranges is
/// subtracted first: a common bias is a matter of calibration. Ranges of `other` with unknown line of sight count as
/// direct.
pub fn compare(own: &Samples, other: &Samples, seed: u64, mut progress: impl FnMut()) -> Vec<Outcome> {
    let (own_all, other_all) = (unbiased(own), unbiased(other));
    let mut outcomes = Vec::new();
    for regressor in Regressor::ALL {
        for blocked in [false, true] {
            let of_class = |all: &[(Features, usize, bool, f64)]| -> Vec<(Features, usize, f64)> {
                all.iter()
                    .filter(|each| each.2 == blocked)
                    .map(|&(features, place, _, error)| (features, place, error))
                    .collect()
            };
            let (here, there) = (of_class(&own_all), of_class(&other_all));
            // Every second reception of each placement.
            let (seen, unseen): (Vec<_>, Vec<_>) = here.iter().enumerate().partition(|(turn, _)| turn % 2 == 0);
            let plain = |part: Vec<(usize, &(Features, usize, f64))>| -> Vec<(Features, usize, f64)> {
                part.into_iter().map(|(_, each)| *each).collect()
            };
            let mut corrected =
                vec![(Whence::SamePlacements, correct(regressor, blocked, &plain(seen), &plain(unseen), seed))];
            progress();
            corrected.push((Whence::OtherPlacements, held_out(regressor, blocked, &here, own, seed)));
            progress();
            corrected.push((Whence::OtherBuilding, correct(regressor, blocked, &here, &there, seed)));
            progress();
            outcomes.extend(corrected.into_iter().filter_map(|(whence, pairs)| {
                let count = pairs.len();
                let mean = |pick: fn(&(f64, f64)) -> f64| {
                    pairs.iter().map(|pair| pick(pair).abs()).sum::<f64>() / count as f64
                };
                let (before_m, after_m) = (mean(|pair| pair.0), mean(|pair| pair.1));
                (count > 0).then_some(Outcome { regressor, blocked, whence, before_m, after_m, count })
            }));
        }
    }
    outcomes
}

/// Number of calls of `progress` by `compare`.
pub const STEPS: usize = 12;

/// Features, placement, whether blocked, and the error without the building's common bias, of the receptions for
/// which all of these are known.
fn unbiased(samples: &Samples) -> Vec<(Features, usize, bool, f64)> {
    let known = |sample: &TrainingSample| FEATURES.iter().all(|&feature| sample.features.get(feature).is_some());
    let all = samples.all.iter().filter(|sample| known(sample));
    let all: Vec<_> =
        all.filter_map(|s| Some((s.features, s.placement, s.blocked.unwrap_or(false), s.error_m?))).collect();
    let mut direct: Vec<f64> = all.iter().filter(|each| !each.2).map(|each| each.3).collect();
    direct.sort_by(f64::total_cmp);
    let bias = direct.get(direct.len() / 2).copied().unwrap_or(0.0);
    all.into_iter().map(|(features, place, blocked, error)| (features, place, blocked, error - bias)).collect()
}

/// Errors before and after, every placement corrected by a regressor that was trained without it.
fn held_out(
    regressor: Regressor,
    blocked: bool,
    all: &[(Features, usize, f64)],
    samples: &Samples,
    seed: u64,
) -> Vec<(f64, f64)> {
    let of_class: Vec<&TrainingSample> =
        samples.all.iter().filter(|sample| sample.blocked.unwrap_or(false) == blocked).collect();
    let folds = deal(&of_class, samples.placements.len(), FOLDS, seed);
    let mut pairs = Vec::new();
    for fold in 0..FOLDS {
        let (test, training): (Vec<_>, Vec<_>) = all.iter().copied().partition(|each| folds[each.1] == fold);
        pairs.extend(correct(regressor, blocked, &training, &test, seed));
    }
    pairs
}

/// The predicted error of a reception.
type Correction<'a> = dyn Fn(&Features) -> Option<f64> + 'a;

/// Errors of `test` before and after a correction learnt from `training`; `None` where there is no training data.
fn correct(
    regressor: Regressor,
    blocked: bool,
    training: &[(Features, usize, f64)],
    test: &[(Features, usize, f64)],
    seed: u64,
) -> Vec<(f64, f64)> {
    if training.len() < 2 || test.is_empty() {
        return Vec::new();
    }
    let inputs = inputs(training);
    let example = |(features, _, error): &(Features, usize, f64)| -> Option<Example> {
        Some((inputs.of(features)?.iter().map(|&input| f64::from(input)).collect(), *error))
    };
    let count = training.len().min(MOST);
    let chosen: Vec<Example> = (0..count).filter_map(|i| example(&training[i * training.len() / count])).collect();
    let predict: Box<Correction<'_>> = match regressor {
        Regressor::GaussianProcess => {
            // Table 1: lower bounds of the noise, and ARD for direct ranges only.
            let (noise, each) = if blocked { (0.04982, false) } else { (0.04043, true) };
            let Some(process) = GaussianProcess::fit(&chosen, noise, each) else { return Vec::new() };
            let inputs = &inputs;
            Box::new(move |features| {
                let point: Vec<f64> = inputs.of(features)?.iter().map(|&input| f64::from(input)).collect();
                Some(process.predict(&point))
            })
        }
        Regressor::Perceptron => {
            // Table 2.
            let hidden: [u8; 2] = if blocked { [65, 69] } else { [21, 11] };
            let (validation, fitted): (Vec<_>, Vec<_>) = chosen.into_iter().enumerate().partition(|(i, _)| i % 4 == 3);
            let plain = |part: Vec<(usize, Example)>| part.into_iter().map(|(_, example)| example).collect::<Vec<_>>();
            let weights =
                Network::new(inputs.len(), &hidden, Goal::Predict).train(&plain(fitted), &plain(validation), seed);
            let bytes: Vec<u8> = weights.iter().flat_map(|&weight| (weight as f32).to_le_bytes()).collect();
            let inputs = inputs.clone();
            Box::new(move |features| {
                let (inputs, hidden) = (inputs.clone(), hidden.into_iter().collect());
                // The same arithmetic as on the node.
                Perceptron { inputs, hidden, outputs: 1, weights: &bytes }.correction_m(features).map(f64::from)
            })
        }
    };
    test.iter().filter_map(|(features, _, error)| Some((*error, error - predict(features)?))).collect()
}

fn inputs(samples: &[(Features, usize, f64)]) -> Inputs {
    let input = |feature: Feature| {
        let values = samples.iter().filter_map(|(features, _, _)| features.get(feature)).map(f64::from);
        let count = samples.len() as f64;
        let mean = values.clone().sum::<f64>() / count;
        let variance = values.map(|value| (value - mean).powi(2)).sum::<f64>() / count;
        let deviation = if variance > 1e-12 { variance.sqrt() } else { 1.0 };
        Input { feature, mean: mean as f32, deviation: deviation as f32 }
    };
    Inputs(FEATURES.into_iter().map(input).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eight placements two metres apart; the error is a curve of the range, and `shift` moves the curve.
    fn building(shift: f64) -> Samples {
        let mut samples = Samples::default();
        for placement in 0..8 {
            samples.placements.push(placement.to_string());
            for i in 0..30 {
                let range = placement as f64 * 2.0 + f64::from(i % 5) * 0.01;
                let mut features = Features::default();
                features.set(Feature::RangeMean, range as f32);
                features.set(Feature::PowerMean, -80.0 - range as f32);
                // Direct ranges are exact; blocked ones follow the curve.
                let blocked = i % 2 == 1;
                let error = if blocked { 0.4 + 0.3 * (range * 2.5 + shift).sin() } else { 0.01 * f64::from(i % 3) };
                samples.all.push(TrainingSample { placement, blocked: Some(blocked), features, error_m: Some(error) });
            }
        }
        samples
    }

    #[test]
    fn corrections_hold_where_they_were_learnt() {
        let mut steps = 0;
        let outcomes = compare(&building(0.0), &building(2.0), 1, || steps += 1);
        assert_eq!((outcomes.len(), steps), (12, STEPS));
        let of = |regressor, whence| {
            let found = outcomes.iter().find(|o| o.regressor == regressor && o.whence == whence && o.blocked);
            found.copied().expect("scored")
        };
        for regressor in Regressor::ALL {
            let (same, other) = (of(regressor, Whence::SamePlacements), of(regressor, Whence::OtherBuilding));
            assert!(same.after_m < same.before_m / 3.0, "{same:?}");
            assert!(other.after_m > 2.0 * same.after_m, "{other:?}");
        }
    }

    #[test]
    fn without_another_building_there_is_no_figure_for_it() {
        let outcomes = compare(&building(0.0), &Samples::default(), 1, || ());
        assert!(outcomes.iter().all(|outcome| outcome.whence != Whence::OtherBuilding) && outcomes.len() == 8);
    }
}
