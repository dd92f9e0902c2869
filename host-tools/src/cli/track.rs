//! `baliza track`: sends the epochs in their order through the tag's own engine.

use std::path::PathBuf;

use analysis::Setup;
use analysis::locate::track::{Tracker, Weighting, settings};
use analysis::train::{Chosen, features_of};
use anyhow::Result;
use clap::ValueEnum;
use positioning_core::nlos::{Classifier, Features, Model};
use recording::{Diagnostics, SingleRanges};
use recording::{Recording, Solved};

use super::recording_args::RecordingArgs;
use crate::cli::progress::Progress;

/// Follow a tag through a recording, as the tag itself does: weighting, gates, filter
///
/// The epochs go through the engine of the tag in their order. The first one is solved by itself; from then on every
/// range changes the track. The positions go to standard output or --out as CSV, a summary to standard error.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    #[command(flatten)]
    recording: RecordingArgs,
    /// How to use the probability that a link is without line of sight, which comes from rx_power_dbm and fp_power_dbm,
    /// or from --model
    #[arg(long, value_name = "HOW", default_value = "weigh")]
    nlos: Nlos,
    /// A trained classifier that detects links without line of sight: a file of `nlos train`; where a range lacks the
    /// features for it, the powers are used
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Which of the file's classifiers, where it has several; of several with one name, NAME:1, NAME:2
    #[arg(long, value_name = "NAME", requires = "model")]
    classifier: Option<String>,
}

const EXAMPLES: &str = "\
Examples:
  baliza track run/
  baliza track --anchors anchors.csv --ranges ranges.csv > positions.csv
  baliza track --anchors anchors.csv --ranges ranges.csv --truth truth.csv --dims 2 --height-from-truth --time-offset-s auto --json
  baliza track --anchors anchors.csv --ranges ranges.csv --model nlos.model --classifier logistic";

/// `--nlos`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Nlos {
    /// A range's variance grows with it
    Weigh,
    /// Ranges that are more probably blocked than not are left out, but at least four are kept
    Ignore,
    /// Nothing
    Alike,
}

/// Whether a reception has the diagnostics that the classifier needs. The track itself knows features of time.
fn could_tell(model: &Model<'_>, features: &Features) -> bool {
    let mut could = true;
    model.for_each_feature(&mut |feature| could &= features.get(feature).is_some() || feature.is_of_time());
    could
}

/// Runs `baliza track`.
///
/// # Errors
/// Flags, the classifier or another file are wrong, or an output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let weighting = match arguments.nlos {
        Nlos::Weigh => Weighting::Weigh,
        Nlos::Ignore => Weighting::Ignore,
        Nlos::Alike => Weighting::Alike,
    };
    let chosen =
        arguments.model.as_ref().map(|file| Chosen::read(file, arguments.classifier.as_deref())).transpose()?;
    let mut model = chosen.as_ref().map(Chosen::model).transpose()?;
    let input = arguments.recording.read(SingleRanges::Keep)?;
    let recordings = || input.tags.iter().map(|of| &of.recording);
    if let Some(unused) = model.take_if(|model| !recordings().any(|recording| tells(recording, model))) {
        let asked = features_of(&unused);
        super::note(&format!("no range of the recording tells what the classifier asks for: {asked}\n"));
    }
    let progress = Progress::new(recordings().map(|recording| recording.epochs.len()).sum());
    let follow = |recording| vec![track(recording, input.setup, weighting, model.as_ref(), &progress)];
    let solved: Vec<_> = recordings().map(follow).collect();
    drop(progress);
    input.report(vec!["track".to_owned()], solved)
}

/// Whether any range of a recording has the diagnostics that the classifier needs. Without them it changes nothing.
fn tells(recording: &Recording, model: &Model<'_>) -> bool {
    let has = |diagnostics: &Diagnostics| could_tell(model, &diagnostics.features);
    recording.epochs.iter().any(|epoch| {
        epoch.ranges.iter().any(|range| has(&range.diagnostics))
            || epoch.differences.iter().any(|difference| has(&difference.diagnostics))
    })
}

/// Positions of the epochs, in the order of the file.
pub fn track(
    recording: &Recording,
    setup: Setup,
    weighting: Weighting,
    model: Option<&Model<'_>>,
    progress: &Progress,
) -> Vec<Solved> {
    let settings = settings(&setup, weighting);
    let mut tracker = Tracker::new(&recording.anchors, setup, settings, model);
    tracker.follow_all(&recording.epochs, || progress.step())
}
