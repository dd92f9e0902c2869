//! `baliza bench garcia`: a filter that detects blocked paths by their skewness, beside the published figures.

use anyhow::Result;
use papers::garcia::{self, Experiment};

use super::{Drawing, distribution};

/// Differences of arrival from four beacons, with and without detection of blocked paths
///
/// The experiment of E. García et al. (A Robust UWB Indoor Positioning System for Highly Complex Environments): the
/// beacons of table I, 48 points at 1.57 m, a hundred measurements each, root mean square errors beside table II.
/// Impulse responses are drawn (see the documentation of the library's module `garcia`), arrivals and skewness are
/// found in them as the paper does.
///
/// As JSON: an object with threshold, detected, and scores: a list of objects with way, positions, rmse_x_m, rmse_y_m,
/// rmse_m, reduction, printed_x_m, printed_y_m.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza bench garcia\n  baliza bench garcia --rooms 50 --seed 7 --json\n  \
                        baliza bench garcia --plot garcia.svg")]
pub struct Arguments {
    /// How many rooms to draw, each with furniture of its own
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    rooms: u32,
    #[command(flatten)]
    drawing: Drawing,
}

/// Runs `baliza bench garcia`.
///
/// # Errors
/// The picture cannot be drawn or written, or the output cannot be printed.
pub fn run(arguments: &Arguments) -> Result<()> {
    let shown = arguments.drawing.check()?;
    let outcome = garcia::run(arguments.rooms as usize, arguments.drawing.seed);
    shown.show(&outcome, || garcia::to_markdown(&outcome), || draw(&outcome))
}

/// The distribution of the horizontal errors.
fn draw(outcome: &Experiment) -> pictures::Drawing {
    distribution(
        outcome
            .errors_m
            .iter()
            .map(|(way, errors)| (way.as_str().to_owned(), errors.iter().map(|[x, y]| x.hypot(*y)).collect())),
    )
}
