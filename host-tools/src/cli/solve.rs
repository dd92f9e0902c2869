//! `baliza solve`: one fix for each epoch, without memory between epochs.

use anyhow::Result;
use host_tools::{Recording, Setup, Solver};
use positioning_core::Method;

use super::recording_args::{RecordingArgs, SingleRanges};
use super::report::ByMethod;
use crate::cli::progress::Progress;

/// Solve every epoch of a recording on its own, as the tag's first fix does
///
/// Rows of one `epoch` in the file of ranges make one fix; single ranges are made into rounds. The positions go to
/// standard output or --out as CSV, a summary to standard error. An epoch without position is a row with empty
/// coordinates and a reason.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    #[command(flatten)]
    recording: RecordingArgs,
    /// How ranges become a position: a name, several with commas, or all
    #[arg(long, value_name = "METHOD", default_value = "robust", value_parser = Methods::parse, long_help = methods_help())]
    method: Methods,
}

const EXAMPLES: &str = "\
Examples:
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
    format!("How ranges become a position: a name, several with commas, or all. Names: {names}")
}

/// Runs `baliza solve`.
///
/// # Errors
/// Flags or a file are wrong, or an output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let input = arguments.recording.read(SingleRanges::Group)?;
    let solved = solve(&input.recording, &arguments.method.0, input.setup);
    input.report(&solved)
}

fn solve(recording: &Recording, methods: &[Method], setup: Setup) -> ByMethod {
    let solver = Solver::new(&recording.anchors, setup);
    let progress = Progress::new(methods.len() * recording.epochs.len());
    let by = |method| {
        let epochs = recording.epochs.iter();
        epochs
            .map(|epoch| {
                progress.step();
                solver.solve(method, epoch)
            })
            .collect()
    };
    methods.iter().map(|&method| (method.as_str().to_owned(), by(method))).collect()
}
