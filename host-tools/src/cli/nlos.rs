//! `baliza nlos`: trains and scores classifiers of blocked and direct ranges.

use baliza_report::MarkdownTable;
use std::collections::HashMap;
use std::path::PathBuf;

use analysis::train::{self, Method, RECIPES, Recipe, Samples, Score, mitigation};
use anyhow::Result;
use positioning_core::nlos::Classifier;
use recording::{Coordinates, Truths, UserError, read_anchors};
use recording::{DOCUMENT_BYTES, output, read_limited, spelled};

use crate::cli::progress::Progress;

/// Classifiers of line of sight: train them, score them
#[derive(clap::Subcommand)]
pub enum Arguments {
    Train(Train),
    Eval(Eval),
    Mitigation(Mitigation),
}

/// Labelled receptions.
#[derive(clap::Args)]
struct Receptions {
    /// Impulse responses: CSV with label,fp_idx,c-16 to c135 and, where known, the receiver's diagnostics; `los`
    /// against every other label; several files together
    #[arg(long, value_name = "FILE", num_args = 1.., required_unless_present = "ranges", conflicts_with = "ranges")]
    cir: Vec<PathBuf>,
    /// Ranges with the receiver's diagnostics: CSV with anchor,range_m,los and what is known; several files together
    #[arg(long, value_name = "FILE", num_args = 1..)]
    ranges: Vec<PathBuf>,
}

/// Train every classifier on labelled receptions, and write them to one file
///
/// Classifiers whose features the files do not know are left out. Their probabilities are calibrated on placements
/// (`file` of a CIR file, `anchor` of ranges) held out in turn, blocked and direct counting as equally likely.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza nlos train --cir cir.csv --out nlos.model\n  \
                        baliza nlos train --cir cir.csv --folds file --out nlos.model --json\n  \
                        baliza nlos train --ranges ranges.csv --classifiers logistic,power-difference --out nlos.model")]
pub struct Train {
    #[command(flatten)]
    receptions: Receptions,
    /// Where the models go
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Also score every classifier by cross-validation, with whole placements left out; this column distinguishes the
    /// placements
    #[arg(long, value_name = "COLUMN")]
    folds: Option<String>,
    /// How many folds
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(2..=1000))]
    fold_count: u32,
    /// Only these, by name, with commas
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    classifiers: Vec<String>,
    /// Seed of the random numbers: equal seeds give equal models
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print JSON: results has an object a classifier, with features, accuracy, auc, n (those of the folds; without
    /// --folds, of the receptions that it was trained on), brier, held_out, bytes
    #[arg(long)]
    json: bool,
}

/// Score the classifiers of a file on labelled receptions
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza nlos eval --model nlos.model --cir other.csv\n  \
                        baliza nlos eval --model nlos.model --ranges ranges.csv --json")]
pub struct Eval {
    /// The file that `train` wrote
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    #[command(flatten)]
    receptions: Receptions,
    /// Print JSON: results has an object a classifier, with features, accuracy, auc, n and brier; null where the
    /// receptions lack its features (n 0) or have only one class
    #[arg(long)]
    json: bool,
}

/// Learn a range's error from range and power, and see how far the result can be transferred
///
/// Gaussian process and perceptron, with separate models for direct and for blocked ranges, by their true labels.
/// Ranges are corrected from the training placements, from other placements in the same building, and from another
/// building. This is a demonstration: neither a node nor a filter corrects ranges so.
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  baliza nlos mitigation --cir cir.csv --anchors anchors.csv --ranges ranges.csv --truth truth.csv"
)]
pub struct Mitigation {
    /// The building to learn: CSV with label,fp_idx,range_m,gt_m,rsl_dbm,c-16 to c135
    #[arg(long, value_name = "FILE", num_args = 1.., required = true)]
    cir: Vec<PathBuf>,
    /// Anchors of another building
    #[arg(long, value_name = "FILE", requires = "ranges")]
    anchors: Option<PathBuf>,
    /// Ranges of another building; whose `los` is not known counts as direct
    #[arg(long, value_name = "FILE", requires = "truth")]
    ranges: Option<PathBuf>,
    /// Where the tag truly was there
    #[arg(long, value_name = "FILE", requires = "anchors")]
    truth: Option<PathBuf>,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print JSON: results has an object a regressor and kind of ranges, with whence, before_mae_m, after_mae_m, n
    #[arg(long)]
    json: bool,
}

/// The printed results of a classifier.
#[derive(Debug, serde::Serialize)]
struct Row {
    features: String,
    classifier: &'static str,
    accuracy: Option<f64>,
    auc: Option<f64>,
    n: usize,
    brier: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    held_out: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    bytes: Option<usize>,
}

impl Row {
    fn new(features: String, classifier: &'static str, score: Option<Score>) -> Self {
        Self {
            features,
            classifier,
            accuracy: score.map(|score| score.accuracy),
            auc: score.and_then(|score| score.auc),
            n: score.map_or(0, |score| score.count),
            brier: score.map(|score| score.brier),
            held_out: None,
            bytes: None,
        }
    }
}

/// Runs `baliza nlos`.
///
/// # Errors
/// Flags or a file are wrong, or an output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    match arguments {
        Arguments::Train(arguments) => train(arguments),
        Arguments::Eval(arguments) => eval(arguments),
        Arguments::Mitigation(arguments) => mitigate(arguments),
    }
}

impl Receptions {
    fn read(&self, placement: Option<&str>) -> Result<Samples, UserError> {
        // The column's name is needed until the end of the program, and there is only one.
        let placement: &'static str = match placement {
            Some(column) => String::leak(column.to_owned()),
            None => train::DEFAULT_PLACEMENT,
        };
        let mut samples = Samples::default();
        for file in &self.cir {
            samples.read_cir(file, placement)?;
        }
        for file in &self.ranges {
            samples.read_ranges(file, placement, |_| None)?;
        }
        Ok(samples)
    }

    /// The first file. Errors about all files name it.
    fn first(&self) -> PathBuf {
        self.cir.iter().chain(&self.ranges).next().cloned().unwrap_or_default()
    }
}

fn train(arguments: &Train) -> Result<()> {
    if !train::IS_AVAILABLE {
        return Err(super::without("nlos train", "training").into());
    }
    output::check("--out", &arguments.out)?;
    let recipes = recipes(&arguments.classifiers)?;
    let samples = arguments.receptions.read(arguments.folds.as_deref())?;
    for (class, what) in [(false, "direct"), (true, "blocked")] {
        if !samples.all.iter().any(|sample| sample.blocked == Some(class)) {
            let wrong = format!(
                "none of its receptions is known to be {what}, by `label` or `los`: there is nothing to learn from"
            );
            return Err(UserError::file(&arguments.receptions.first(), wrong).into());
        }
    }
    let folds = arguments.fold_count as usize;
    let progress = Progress::new(recipes.len() * if arguments.folds.is_some() { folds + 1 } else { 1 });
    let (mut file, mut rows) = (Vec::new(), Vec::new());
    for recipe in recipes {
        let trained = train::train(recipe, &samples, arguments.seed);
        progress.step();
        let Some(bytes) = trained else {
            continue;
        };
        let score = match arguments.folds {
            Some(_) => train::cross_validate(recipe, &samples, folds, arguments.seed, || progress.step()),
            None => train::models(&bytes)?.first().and_then(|model| train::score(model, &samples)),
        };
        rows.push(Row {
            held_out: Some(arguments.folds.is_some()),
            bytes: Some(bytes.len()),
            ..Row::new(train::features_of_recipe(recipe), recipe.method.as_str(), score)
        });
        file.extend(bytes);
    }
    drop(progress);
    if file.is_empty() {
        let wrong = "it lacks the columns for each classifier that was asked for: rx_power_dbm and fp_power_dbm, or fp_amp1, \
                     fp_amp2, fp_amp3 with cir_pwr or std_noise, or an impulse response (--cir)";
        return Err(UserError::file(&arguments.receptions.first(), wrong).into());
    }
    super::write(&arguments.out, &file)?;
    if arguments.json {
        return super::print_json(&rows);
    }
    let scored = match arguments.folds {
        Some(_) => format!("scored on {folds} folds of placements held out"),
        None => "scored on the very receptions that they were trained on: not how they will do elsewhere".to_owned(),
    };
    super::print(table(&rows).as_bytes())?;
    super::note(&format!("{scored}\nmodels: {}\n", arguments.out.display()));
    Ok(())
}

fn eval(arguments: &Eval) -> Result<()> {
    let file = &arguments.model;
    let bytes = read_limited(file, DOCUMENT_BYTES)?;
    let models = train::models(&bytes).map_err(|fault| UserError::file(file, fault.to_string()))?;
    let samples = arguments.receptions.read(None)?;
    if samples.all.iter().all(|sample| sample.blocked.is_none()) {
        let wrong = "none of its receptions is known to be direct or blocked, by `label` or `los`: nothing to score by";
        return Err(UserError::file(&arguments.receptions.first(), wrong).into());
    }
    let progress = Progress::new(models.len());
    let row = |model| {
        let score = train::score(model, &samples);
        progress.step();
        Row::new(train::features_of(model), model.name(), score)
    };
    let rows: Vec<Row> = models.iter().map(row).collect();
    drop(progress);
    if arguments.json { super::print_json(&rows) } else { super::print(table(&rows).as_bytes()) }
}

fn mitigate(arguments: &Mitigation) -> Result<()> {
    let (mut own, mut other) = (Samples::default(), Samples::default());
    for file in &arguments.cir {
        own.read_cir(file, train::DEFAULT_PLACEMENT)?;
    }
    if let (Some(anchors), Some(ranges), Some(truth)) = (&arguments.anchors, &arguments.ranges, &arguments.truth) {
        let anchors: HashMap<String, Coordinates> = read_anchors(anchors)?
            .into_iter()
            .map(|anchor| (spelled(&anchor.name).into_owned(), anchor.place))
            .collect();
        let truths = Truths::read(truth, true)?;
        other.read_ranges(ranges, train::DEFAULT_PLACEMENT, |measured| {
            let truth = truths.of(measured.tag).ok()??;
            let tag = truth.of_epoch(measured.epoch, measured.t_s, 0.0)?;
            let anchor = anchors.get(&*spelled(measured.anchor))?;
            let dz = tag.z_m? - anchor.z_m?;
            Some((tag.x_m - anchor.x_m).hypot(tag.y_m - anchor.y_m).hypot(dz))
        })?;
    }
    let progress = Progress::new(mitigation::STEPS);
    let outcomes = mitigation::compare(&own, &other, arguments.seed, || progress.step());
    drop(progress);
    if arguments.json {
        let rows: Vec<_> = outcomes
            .iter()
            .map(|outcome| {
                serde_json::json!({
                    "regressor": outcome.regressor.as_str(),
                    "ranges": ranges_of(outcome),
                    "whence": outcome.whence.as_str(),
                    "before_mae_m": outcome.before_m,
                    "after_mae_m": outcome.after_m,
                    "n": outcome.count,
                })
            })
            .collect();
        return super::print_json(&rows);
    }
    let titles = ["regressor", "ranges", "from", "MAE as measured, m:", "as corrected, m:", "receptions:"];
    let mut table = MarkdownTable::new(titles);
    for outcome in &outcomes {
        let (regressor, ranges, whence) = (outcome.regressor.as_str(), ranges_of(outcome), outcome.whence.as_str());
        let (before, after, count) = (outcome.before_m, outcome.after_m, outcome.count);
        table.row(format_args!("{regressor} | {ranges} | {whence} | {before:.3} | {after:.3} | {count}"));
    }
    super::print(table.into_columns().as_bytes())
}

fn ranges_of(outcome: &mitigation::Outcome) -> &'static str {
    if outcome.blocked { "blocked" } else { "direct" }
}

/// The selected classifiers; all where none is selected.
fn recipes(names: &[String]) -> Result<Vec<&'static Recipe>, UserError> {
    for name in names {
        if !RECIPES.iter().any(|recipe| recipe.method.as_str() == name) {
            let mut known: Vec<&str> = RECIPES.iter().map(|recipe| Method::as_str(recipe.method)).collect();
            known.sort_unstable();
            known.dedup();
            let wrong = format!("no classifier is called {name:?}; there are {}", known.join(", "));
            return Err(UserError::flag("--classifiers", wrong));
        }
    }
    let asked = |recipe: &&Recipe| names.is_empty() || names.iter().any(|name| recipe.method.as_str() == name);
    Ok(RECIPES.iter().filter(asked).collect())
}

/// The results as a Markdown table, as in qa/accuracy/README.md.
fn table(rows: &[Row]) -> String {
    let sizes = rows.iter().any(|row| row.bytes.is_some());
    let titles = ["classifier", "features", "AUC:", "accuracy:", "Brier:", "receptions:"];
    let mut table = MarkdownTable::new(titles.into_iter().chain(sizes.then_some("bytes:")));
    for row in rows {
        let figure = |figure: Option<f64>| figure.map_or_else(|| "-".to_owned(), |figure| format!("{figure:.3}"));
        let [auc, accuracy, brier] = [row.auc, row.accuracy, row.brier].map(figure);
        let features = row.features.replace('+', ", ");
        let bytes = row.bytes.map_or_else(String::new, |bytes| format!(" | {bytes}"));
        let (classifier, n) = (&row.classifier, row.n);
        table.row(format_args!("`{classifier}` | {features} | {auc} | {accuracy} | {brier} | {n}{bytes}"));
    }
    table.into_columns()
}
