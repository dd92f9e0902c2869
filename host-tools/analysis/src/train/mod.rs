//! Trains and scores the classifiers of blocked ranges: reads files, returns models and figures.
//!
//! [`Samples`] reads receptions. [`train`] makes a classifier from every [`Recipe`] whose features the receptions
//! have. [`cross_validate`] scores recipes on placements that are held out. [`score`] scores models. The classifiers
//! themselves are `positioning_core::nlos`, the same as on the node.

mod backpropagation;
mod chosen;
mod conjugate_gradient;
mod fit;
mod folds;
mod gaussian_process;
pub mod mitigation;
mod platt;
mod recipe;
mod samples;
mod score;

pub use backpropagation::{Example, Goal, Network};
pub use chosen::Chosen;
pub use fit::IS_AVAILABLE;
pub use recipe::{Method, RECIPES, Recipe};
pub use samples::{DEFAULT_PLACEMENT, Samples, TrainingSample};
pub use score::Score;

use positioning_core::nlos::{Classifier, Feature, Model, Platt, StoredError};

/// Number of folds of placements for calibration.
const CALIBRATION_FOLDS: usize = 4;

/// The names of a classifier's features, joined, as in tables and commands.
pub fn features_of(classifier: &dyn Classifier) -> String {
    let mut names: Vec<&str> = Vec::new();
    classifier.for_each_feature(&mut |feature| names.push(feature.as_str()));
    names.join("+")
}

/// The same for a recipe.
pub fn features_of_recipe(recipe: &Recipe) -> String {
    recipe.features.iter().map(|feature| Feature::as_str(*feature)).collect::<Vec<_>>().join("+")
}

/// The labelled receptions.
fn labelled(samples: &Samples) -> Vec<&TrainingSample> {
    samples.all.iter().filter(|sample| sample.blocked.is_some()).collect()
}

/// Trains a recipe on labelled receptions and calibrates it. The scores for the calibration come from models that
/// were trained without the reception's placement. `None` where the recipe cannot be trained on them.
pub fn train(recipe: &Recipe, samples: &Samples, seed: u64) -> Option<Vec<u8>> {
    train_on(recipe, &labelled(samples), samples.placements.len(), seed)
}

fn train_on(recipe: &Recipe, samples: &[&TrainingSample], placements: usize, seed: u64) -> Option<Vec<u8>> {
    let held_out =
        held_out(samples, placements, CALIBRATION_FOLDS, seed, |training| recipe.train(training, Platt::NONE, seed));
    let calibration = if held_out.is_empty() { Platt::NONE } else { platt::fit(&held_out) };
    recipe.train(samples, calibration, seed)
}

/// The probabilities of receptions, each from a model trained without its fold of placements.
fn held_out<'a>(
    samples: &[&'a TrainingSample],
    placements: usize,
    count: usize,
    seed: u64,
    mut train: impl FnMut(&[&'a TrainingSample]) -> Option<Vec<u8>>,
) -> Vec<(f32, &'a TrainingSample)> {
    let folds = folds::deal(samples, placements, count, seed);
    let mut scored = Vec::new();
    for fold in 0..count {
        let (test, training): (Vec<&TrainingSample>, Vec<&TrainingSample>) =
            samples.iter().copied().partition(|sample| folds[sample.placement] == fold);
        if test.is_empty() {
            continue;
        }
        let Some(bytes) = train(&training) else { continue };
        let Ok((model, _)) = Model::decode(&bytes) else { continue };
        scored.extend(test.into_iter().filter_map(|s| Some((model.nlos_probability(&s.features)?, s))));
    }
    scored
}

/// Scores a recipe by cross-validation: it is trained and calibrated `count` times, each time without a fold of whole
/// placements, and each reception is scored by the model that was trained without it. `None` where it cannot be
/// trained.
pub fn cross_validate(
    recipe: &Recipe,
    samples: &Samples,
    count: usize,
    seed: u64,
    mut progress: impl FnMut(),
) -> Option<Score> {
    let placements = samples.placements.len();
    let scored = held_out(&labelled(samples), placements, count, seed, |training| {
        progress();
        train_on(recipe, training, placements, seed)
    });
    Score::of(&pairs(&scored))
}

/// Scores a model on the labelled receptions that have its features; `None` where there are none.
pub fn score(model: &Model<'_>, samples: &Samples) -> Option<Score> {
    let probability = |sample: &'_ TrainingSample| model.nlos_probability(&sample.features);
    let scored: Vec<(f32, &TrainingSample)> =
        labelled(samples).into_iter().filter_map(|s| Some((probability(s)?, s))).collect();
    Score::of(&pairs(&scored))
}

fn pairs(scored: &[(f32, &TrainingSample)]) -> Vec<(f32, bool)> {
    scored.iter().filter_map(|(p, sample)| Some((*p, sample.blocked?))).collect()
}

/// Reads the models of a file, one after the other.
///
/// # Errors
/// There is no model, or one of them is not valid.
pub fn models(mut bytes: &[u8]) -> Result<Vec<Model<'_>>, StoredError> {
    let mut models = Vec::new();
    loop {
        let (model, rest) = Model::decode(bytes)?;
        models.push(model);
        if rest.is_empty() {
            return Ok(models);
        }
        bytes = rest;
    }
}
