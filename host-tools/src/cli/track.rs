//! `baliza track`: sends the epochs in their order through the tag's own engine.

use std::collections::HashMap;
use std::path::PathBuf;

use analysis::Setup;
use analysis::locate::ble::RssiMethod;
use analysis::locate::track::{Tracker, Weighting, settings};
use analysis::train::{Chosen, features_of};
use anyhow::Result;
use clap::ValueEnum;
use positioning_core::nlos::{Classifier, Features, Model};
use recording::{Diagnostics, SingleRanges};
use recording::{Recording, UserError};

use super::recording_args::RecordingArgs;
use crate::cli::progress::Progress;

/// Follow a tag through a recording, as the tag itself does: weighting, gates, filter
///
/// The epochs go through the engine of the tag in their order. The first one is solved by itself; from then on every
/// range changes the track. The positions go to standard output or --out as CSV, a summary to standard error. Of
/// ranges in a pipe (--ranges -), each position is written when the next epoch begins. Where a folder has no ranges, its
/// beacons are used.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    #[command(flatten)]
    recording: RecordingArgs,
    /// How to use the probability that a link is without line of sight, which comes from rx_power_dbm and fp_power_dbm,
    /// or from --model [default: as recording.toml says, else weigh]
    #[arg(long, value_name = "HOW")]
    nlos: Option<Nlos>,
    /// A trained classifier that detects links without line of sight: a file of `nlos train`; where a range lacks the
    /// features for it, the powers are used
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Which of the file's classifiers, where it has several; of several with one name, NAME:1, NAME:2
    #[arg(long, value_name = "NAME", requires = "model")]
    classifier: Option<String>,
    /// Also go back through the recording: the method track-smooth has each position by all measurements, those after it
    /// too
    #[arg(long)]
    smooth: bool,
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
    if arguments.recording.report_by_beacons(RssiMethod::Engine, false)? {
        return Ok(());
    }
    let asked = arguments.nlos.map(|nlos| match nlos {
        Nlos::Weigh => Weighting::Weigh,
        Nlos::Ignore => Weighting::Ignore,
        Nlos::Alike => Weighting::Alike,
    });
    let chosen =
        arguments.model.as_ref().map(|file| Chosen::read(file, arguments.classifier.as_deref())).transpose()?;
    let mut model = chosen.as_ref().map(Chosen::model).transpose()?;
    if let Some(piped) = arguments.recording.piped()? {
        if arguments.smooth {
            let message = "it needs the whole recording: write the ranges into a file first";
            return Err(UserError::flag("--smooth", message).into());
        }
        let settings = settings(&piped.setup, asked.unwrap_or(Weighting::Weigh));
        let mut trackers: HashMap<Option<String>, Tracker> = HashMap::new();
        return piped.run(&["track"], true, |tag, epoch| {
            let new = || Tracker::new(&piped.anchors[..], piped.setup, settings, model.as_ref());
            vec![trackers.entry(tag.map(str::to_owned)).or_insert_with(new).follow(epoch)]
        });
    }
    let input = arguments.recording.read(SingleRanges::Keep)?;
    let weighting = asked.unwrap_or(input.weighting);
    let recordings = || input.tags.iter().map(|of| &of.recording);
    if let Some(unused) = model.take_if(|model| !recordings().any(|recording| tells(recording, model))) {
        let asked = features_of(&unused);
        super::note(&format!("no range of the recording tells what the classifier asks for: {asked}\n"));
    }
    let progress = Progress::new(recordings().map(|recording| recording.epochs.len()).sum());
    let follow = |recording: &Recording| {
        let mut tracker = tracker(recording, input.setup, weighting, model.as_ref());
        let step = || progress.step();
        match arguments.smooth {
            true => tracker.smooth_all(&recording.epochs, step).into(),
            false => vec![tracker.follow_all(&recording.epochs, step)],
        }
    };
    let solved: Vec<_> = recordings().map(follow).collect();
    drop(progress);
    let methods = ["track", "track-smooth"].iter().take(1 + usize::from(arguments.smooth));
    input.report(methods.map(|method| (*method).to_owned()).collect(), solved)
}

/// Whether any range of a recording has the diagnostics that the classifier needs. Without them it changes nothing.
fn tells(recording: &Recording, model: &Model<'_>) -> bool {
    let has = |diagnostics: &Diagnostics| could_tell(model, &diagnostics.features);
    recording.epochs.iter().any(|epoch| {
        epoch.ranges.iter().any(|range| has(&range.diagnostics))
            || epoch.differences.iter().any(|difference| has(&difference.diagnostics))
    })
}

/// The tracker of a recording.
pub fn tracker<'a>(
    recording: &'a Recording,
    setup: Setup,
    weighting: Weighting,
    model: Option<&'a Model<'a>>,
) -> Tracker<'a> {
    Tracker::new(&recording.anchors, setup, settings(&setup, weighting), model)
}
