//! `baliza track`: the tag's own engine over the epochs in order.

use anyhow::Result;
use clap::ValueEnum;
use host_tools::track::{Tracker, Weighting, settings};

use super::recorded::Recorded;
use crate::progress::Progress;

/// Follow a tag through a recording, as the tag itself does: weighting, gates, filter
///
/// The epochs go through the engine of the tag in their order. The first one is solved by itself; from then on every range
/// changes the track. The positions go to standard output or --out as CSV, a summary to standard error.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    #[command(flatten)]
    recorded: Recorded,
    /// What to make of the probability that a link is without line of sight, which comes from rx_power_dbm and fp_power_dbm
    #[arg(long, value_name = "HOW", default_value = "weigh")]
    nlos: Nlos,
    /// Tell also how the errors go with the uncertainties (in JSON: inside_1_sigma, nees)
    #[arg(long, requires = "truth")]
    consistency: bool,
}

const EXAMPLES: &str = "\
Examples:
  baliza track --anchors anchors.csv --ranges ranges.csv > positions.csv
  baliza track --anchors anchors.csv --ranges ranges.csv --truth truth.csv --dims 2 --height-from-truth --consistency --json";

/// `--nlos`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Nlos {
    /// A range's variance grows with it
    Weigh,
    /// Ranges that are rather blocked are left out, but four are kept
    Ignore,
    /// Nothing
    Alike,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let weighting = match arguments.nlos {
        Nlos::Weigh => Weighting::Weigh,
        Nlos::Ignore => Weighting::Ignore,
        Nlos::Alike => Weighting::Alike,
    };
    arguments.recorded.run(arguments.consistency, |recording, setup| {
        let mut tracker = Tracker::new(&recording.anchors, setup, settings(&setup, weighting));
        let progress = Progress::new(recording.epochs.len());
        let epochs = recording.epochs.iter();
        let solved = epochs.map(|epoch| {
            progress.step();
            tracker.follow(epoch)
        });
        vec![("track", solved.collect())]
    })
}
