//! `baliza solve`: one fix for each epoch, without memory between epochs.

use analysis::locate::ble::RssiMethod;
use analysis::locate::track::{Tracker, settings_of_single_epochs};
use analysis::{Setup, Solver};
use anyhow::Result;
use positioning_core::Method;
use recording::{MeasurementMode, SingleRanges};
use recording::{Recording, Solved, UserError};

use super::recording_args::RecordingArgs;
use crate::cli::progress::Progress;

/// Solve every epoch of a recording on its own, as the tag's first fix does
///
/// Rows of one `epoch` in the file of ranges make one fix; single ranges are made into rounds. The positions go to
/// standard output or --out as CSV, a summary to standard error. An epoch without position is a row with empty
/// coordinates and a reason. Of ranges in a pipe (--ranges -), each position is written when the next epoch begins; there
/// single ranges are made into rounds only with --group-s. Where a folder has no ranges, its beacons are used.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    #[command(flatten)]
    recording: RecordingArgs,
    /// How ranges become a position: a name, several with commas, or all [default: robust]
    #[arg(long, value_name = "METHOD", value_parser = Methods::parse, long_help = methods_help())]
    method: Option<Methods>,
}

const EXAMPLES: &str = "\
Examples:
  baliza solve run/
  baliza solve --anchors anchors.csv --ranges ranges.csv > positions.csv
  baliza solve --anchors anchors.csv --ranges ranges.csv --truth truth.csv --plot room.png
  baliza solve --anchors anchors.csv --ranges ranges.csv --truth truth.csv --time-offset-s auto --residuals
  baliza solve --anchors anchors.csv --ranges ranges.csv --truth truth.csv --dims 2 --height-from-truth --method all --json";

/// `--method`: the selected methods.
#[derive(Clone, Debug)]
struct Methods(Vec<Method>);

impl Methods {
    fn parse(text: &str) -> Result<Self, positioning_core::UnknownMethod> {
        match text {
            "all" => Ok(Self(Method::ALL.to_vec())),
            names => names.split(',').map(|name| name.trim().parse()).collect::<Result<_, _>>().map(Self),
        }
    }
}

fn methods_help() -> String {
    let names = Method::ALL.map(Method::as_str).join(", ");
    format!("How ranges become a position: a name, several with commas, or all [default: robust]. Names: {names}")
}

/// Runs `baliza solve`.
///
/// # Errors
/// Flags or a file are wrong, or an output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    if arguments.recording.report_by_beacons(RssiMethod::Posterior, arguments.method.is_some())? {
        return Ok(());
    }
    if let Some(piped) = arguments.recording.piped()? {
        let Methods(methods) = arguments.method.clone().unwrap_or(Methods(vec![Method::Robust]));
        let names: Vec<_> = methods.iter().map(|method| method.as_str()).collect();
        let solver = Solver::new(&piped.anchors, piped.setup);
        return piped
            .run(&names, false, |_, epoch| methods.iter().map(|&method| solver.solve(method, epoch)).collect());
    }
    let input = arguments.recording.read(SingleRanges::Group)?;
    let methods = match (&arguments.method, input.mode) {
        (None, MeasurementMode::Ranges) => vec![Method::Robust],
        (Some(Methods(methods)), MeasurementMode::Ranges) => methods.clone(),
        (None, MeasurementMode::Differences) => Vec::new(),
        (Some(_), MeasurementMode::Differences) => {
            return Err(UserError::flag("--method", "only for ranges: differences have one method, hyperbolic").into());
        }
    };
    let names = match input.mode {
        MeasurementMode::Ranges => methods.iter().map(|method| method.as_str()).collect(),
        MeasurementMode::Differences => vec!["hyperbolic"],
    };
    let epochs: usize = input.tags.iter().map(|of| of.recording.epochs.len()).sum();
    let progress = Progress::new(names.len() * epochs);
    let solve = |recording: &Recording| match input.mode {
        MeasurementMode::Differences => vec![hyperbolic(recording, input.setup, &progress)],
        MeasurementMode::Ranges => solve(recording, &methods, input.setup, &progress),
    };
    let solved: Vec<_> = input.tags.iter().map(|of| solve(&of.recording)).collect();
    drop(progress);
    input.report(names.into_iter().map(str::to_owned).collect(), solved)
}

/// The positions of each epoch by each method.
fn solve(recording: &Recording, methods: &[Method], setup: Setup, progress: &Progress) -> Vec<Vec<Solved>> {
    let solver = Solver::new(&recording.anchors, setup);
    let by = |&method| solver.solve_all(method, &recording.epochs, |epochs| progress.advance(epochs as u64));
    methods.iter().map(by).collect()
}

/// The positions where the hyperbolas of each epoch meet.
fn hyperbolic(recording: &Recording, setup: Setup, progress: &Progress) -> Vec<Solved> {
    let mut tracker = Tracker::new(&recording.anchors, setup, settings_of_single_epochs(&setup), None);
    let epochs = recording.epochs.iter();
    epochs
        .map(|epoch| {
            progress.step();
            tracker.follow(&epoch)
        })
        .collect()
}
