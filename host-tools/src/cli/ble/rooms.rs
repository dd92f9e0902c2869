//! `baliza ble rooms`: finds the room of each dwell, or the rooms of a walk.

mod walk;

use std::path::{Path, PathBuf};

use analysis::survey::rooms::{self, Method, ModelFile, Names, Point, Score, Survey, Trained};
use anyhow::{Context, Result};
use baliza_report::MarkdownTable;
use clap::ValueEnum;
use pictures as plot;
use positioning_core::ble::rooms::Model;
use recording::UserError;
use recording::beacons::read_stays;
use recording::output;

use crate::cli::progress::Progress;
use crate::cli::{self, PictureFile};

/// Find the room of each dwell, or the rooms of a walk, by classifiers trained on fingerprints
///
/// A dwell is classified by its mean RSSI values, by each of its windows, and by what the tag answers from the windows:
/// a room, or between two rooms. Of a walk (--rssi), each minute (--every-s) has a row of CSV: the most frequent room
/// of its windows, and what the tag answers at its end.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza ble rooms --fingerprints fingerprints.csv --targets targets.csv\n  \
                        baliza ble rooms --fingerprints fingerprints.csv --leave-one-out --plot rooms.svg\n  \
                        baliza ble rooms --fingerprints fingerprints.csv --out rooms.model\n  \
                        baliza ble rooms --model rooms.model --targets targets.csv\n  \
                        baliza ble rooms --model rooms.model --rssi run/rssi.csv")]
pub struct Arguments {
    /// Fingerprints: CSV with point,room,x_m,y_m,beacon,rssi_dbm,t_s
    #[arg(long, value_name = "FILE", required_unless_present = "model")]
    fingerprints: Option<PathBuf>,
    /// A model that --out has written, instead of fingerprints
    #[arg(long, value_name = "FILE", requires = "what", conflicts_with_all = ["fingerprints", "leave_one_out", "method", "out"])]
    model: Option<PathBuf>,
    /// Dwells to be classified: CSV with the same columns
    #[arg(long, value_name = "FILE", group = "what", conflicts_with = "leave_one_out")]
    targets: Option<PathBuf>,
    /// A walk, whose rooms are to be found: CSV with epoch,t_s,beacon,rssi_dbm and, where there are several, tag
    #[arg(long, value_name = "FILE", group = "what", conflicts_with_all = ["leave_one_out", "plot"])]
    rssi: Option<PathBuf>,
    /// The interval of a row of a walk, seconds
    #[arg(long, value_name = "S", default_value_t = 60.0, value_parser = positive, requires = "rssi")]
    every_s: f64,
    /// Classify each fingerprint by all the others
    #[arg(long)]
    leave_one_out: bool,
    /// The classifier: its figures are printed first, its confusion is drawn, its model is written
    #[arg(long, value_name = "METHOD", default_value = "svm")]
    method: MethodName,
    /// Integration time of a window, seconds
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = positive)]
    window_s: f64,
    /// Write the model of all fingerprints, for the node record
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Draw the confusion matrix, as .svg or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Print JSON: results has one object, with method, accuracy, points, rooms, confusion_matrix (a row a true room, a
    /// column a room answered, the last none), window_s, window_accuracy, windows, window_changes, settled (right,
    /// wrong, between, changes); in methods the same of all. With --rssi, an object a tag, with method, window_s,
    /// every_s, intervals (t_s, windows, classified, room, share, answer, between)
    #[arg(long)]
    json: bool,
}

/// `--method`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum MethodName {
    /// Linear support vector machine
    Svm,
    /// The three nearest fingerprints
    Knn,
}

impl From<MethodName> for Method {
    fn from(name: MethodName) -> Self {
        match name {
            MethodName::Svm => Self::Svm,
            MethodName::Knn => Self::Nearest,
        }
    }
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number > 0.0 && number <= 3600.0 => Ok(number),
        Ok(_) | Err(_) => Err(format!("{text:?} is not a number of seconds above 0")),
    }
}

/// A method's part of the output of `--json`.
#[derive(serde::Serialize)]
struct Row<'a> {
    method: &'static str,
    accuracy: Option<f64>,
    points: usize,
    rooms: &'a [String],
    confusion_matrix: &'a [Vec<usize>],
    window_s: f64,
    window_accuracy: Option<f64>,
    windows: usize,
    window_changes: usize,
    settled: Settled,
}

#[derive(serde::Serialize)]
struct Settled {
    right: usize,
    wrong: usize,
    between: usize,
    changes: usize,
}

/// The output of `--json`.
#[derive(serde::Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    chosen: Row<'a>,
    methods: Vec<Row<'a>>,
}

fn share(part: usize, whole: usize) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

fn row<'a>(score: &'a Score, rooms: &'a [String], window_s: f64) -> Row<'a> {
    let rooms::Settled { right, wrong, between, changes } = score.settled;
    Row {
        method: score.method.as_str(),
        accuracy: share(score.right, score.points()),
        points: score.points(),
        rooms,
        confusion_matrix: &score.confusion,
        window_s,
        window_accuracy: share(score.windows_right, score.windows),
        windows: score.windows,
        window_changes: score.changes,
        settled: Settled { right, wrong, between, changes },
    }
}

/// Runs `baliza ble rooms`.
///
/// # Errors
/// Flags or a file are wrong, a model cannot be trained, or an output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let picture = PictureFile::plot(arguments.plot.as_deref())?;
    if let Some(file) = &arguments.out {
        output::check("--out", file)?;
    }
    if let Some(rssi) = &arguments.rssi {
        return walk::run(arguments, rssi);
    }
    if arguments.targets.is_none() && !arguments.leave_one_out && arguments.out.is_none() {
        return Err(UserError::flag(
            "--targets",
            "say what is to be judged: --targets FILE, --rssi FILE or --leave-one-out",
        )
        .into());
    }
    let (scores, names) = match (&arguments.fingerprints, &arguments.model, &arguments.targets) {
        (Some(file), _, _) => arguments.learn(file)?,
        (None, Some(model), Some(targets)) => by_model(model, targets, arguments.window_s)?,
        (None, _, _) => return Err(UserError::flag("--fingerprints", "a survey or --model is needed").into()),
    };
    let Some(chosen) = scores.first() else { return Ok(()) };
    if arguments.json {
        let row = |score| row(score, &names, arguments.window_s);
        cli::print_json(&Document { chosen: row(chosen), methods: scores.iter().map(row).collect() })?;
    } else {
        cli::print(table(&scores, &names).as_bytes())?;
    }
    if let Some(picture) = picture {
        picture.write_and_note(&plot::confusion(chosen.method.as_str(), &names, &chosen.confusion))?;
    }
    Ok(())
}

/// A model that was trained before, with the names of its beacons and rooms.
fn read_model(file: &Path) -> Result<(Method, Trained, Names)> {
    let ModelFile { model: bytes, names } =
        ModelFile::parse(&super::read_bytes(file)?).map_err(|what| UserError::file(file, what))?;
    let (model, _) = Model::decode(&bytes).map_err(|fault| UserError::file(file, fault.to_string()))?;
    let method = Method::from(&model.kind);
    Ok((method, Trained { bytes, rooms: (0..names.rooms.len()).collect() }, names))
}

/// The scores of a model that was trained before, and the rooms' names.
fn by_model(file: &Path, targets: &Path, window_s: f64) -> Result<(Vec<Score>, Vec<String>)> {
    let (method, trained, names) = read_model(file)?;
    let targets = Survey::of_names(&names).targets(targets, &read_stays(targets)?, window_s)?;
    let progress = Progress::new(targets.points.len());
    let score = rooms::evaluate(method, &trained, &targets, window_s, || progress.step())?;
    Ok((vec![score], targets.rooms))
}

impl Arguments {
    /// Trains all methods on a survey. Returns their scores, those of the selected method first, and the rooms' names.
    fn learn(&self, file: &Path) -> Result<(Vec<Score>, Vec<String>)> {
        let window_s = self.window_s;
        let survey = Survey::of_fingerprints(file, &read_stays(file)?, window_s)?;
        let targets =
            self.targets.as_deref().map(|file| survey.targets(file, &read_stays(file)?, window_s)).transpose()?;
        let method = Method::from(self.method);
        self.write(method, &survey)?;
        if targets.is_none() && !self.leave_one_out {
            return Ok((Vec::new(), survey.rooms));
        }
        let steps = targets.as_ref().map_or(survey.points.len(), |targets| targets.points.len());
        let progress = Progress::new(steps * Method::ALL.len());
        let others = Method::ALL.into_iter().filter(|other| *other != method);
        let scores = std::iter::once(method).chain(others).map(|method| match &targets {
            Some(targets) => rooms::score(method, &survey, targets, window_s, || progress.step()),
            None => rooms::leave_one_out(method, &survey, window_s, || progress.step()),
        });
        let scores = scores.collect::<Result<Vec<_>>>()?;
        Ok((scores, targets.unwrap_or(survey).rooms))
    }

    /// Writes the model of all fingerprints, if it is asked for.
    fn write(&self, method: Method, survey: &Survey) -> Result<()> {
        let Some(file) = &self.out else { return Ok(()) };
        let (trained, names) = model_of(method, survey)?;
        cli::note(&format!(
            "model: {}, {} bytes on a node; beacons {}; rooms {}\n",
            file.display(),
            trained.bytes.len(),
            names.beacons.join(","),
            names.rooms.join(",")
        ));
        cli::write(file, &ModelFile { model: trained.bytes, names }.bytes()?)
    }
}

/// The model of all fingerprints, and the names of its beacons and rooms.
fn model_of(method: Method, survey: &Survey) -> Result<(Trained, Names)> {
    let chosen: Vec<&Point> = survey.points.iter().collect();
    let trained = rooms::train(method, survey, &chosen)?.context("the fingerprints are of one room")?;
    let rooms = trained.rooms.iter().map(|room| survey.rooms[*room].clone()).collect();
    Ok((trained, Names { beacons: survey.beacons.clone(), rooms }))
}

/// The scores of all methods, and the confusion matrix of the first method.
fn table(scores: &[Score], rooms: &[String]) -> String {
    let percent =
        |part: usize, whole: usize| share(part, whole).map_or("-".to_owned(), |s| format!("{:.1} %", 100.0 * s));
    let mut table = MarkdownTable::new([
        "method",
        "points:",
        "right:",
        "windows:",
        "right windows:",
        "changes:",
        "settled right:",
        "settled wrong:",
        "between:",
        "changes when settled:",
    ]);
    for score in scores {
        let settled = score.settled;
        table.row(format_args!(
            "{} | {} | {} | {} | {} | {} | {} | {} | {} | {}",
            score.method.as_str(),
            score.points(),
            percent(score.right, score.points()),
            score.windows,
            percent(score.windows_right, score.windows),
            score.changes,
            percent(settled.right, score.windows),
            percent(settled.wrong, score.windows),
            percent(settled.between, score.windows),
            settled.changes
        ));
    }
    let mut text = table.into_columns();
    let Some(first) = scores.first() else { return text };
    let heads = rooms.iter().map(|room| format!("{room}:")).chain(["no answer:".to_owned()]);
    let mut confusion = MarkdownTable::new([format!("by {}, in", first.method.as_str())].into_iter().chain(heads));
    for (room, row) in rooms.iter().zip(&first.confusion) {
        let counts: Vec<String> = row.iter().map(ToString::to_string).collect();
        confusion.row(format_args!("{room} | {}", counts.join(" | ")));
    }
    text.push('\n');
    text += &confusion.into_columns();
    text
}
