//! `baliza bench garcia`: a filter that knows of blocked paths by their skewness, beside the printed figures.

use std::path::PathBuf;

use anyhow::Result;
use host_tools::garcia::{self, Outcome, Score};
use host_tools::plot::{self, Track};

use super::PictureFile;

/// Differences of arrival from four beacons, with and without detection of blocked paths
///
/// The experiment of E. García et al. (A Robust UWB Indoor Positioning System for Highly Complex Environments): the beacons of table
/// I, 48 points at 1.57 m, a hundred measurements each, root mean square errors beside table II. Impulse responses are drawn (see the
/// documentation of the library's module `garcia`), arrivals and skewness are found in them as the paper does.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza bench garcia\n  baliza bench garcia --rooms 50 --seed 7 --json\n  \
                        baliza bench garcia --plot garcia.svg")]
pub struct Arguments {
    /// How many rooms to draw, each with furniture of its own
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    rooms: u32,
    /// Seed of the random numbers: equal seeds give equal figures
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print JSON: an object with threshold, detected, and scores: a list of objects with way, positions, rmse_x_m, rmse_y_m, rmse_m,
    /// reduction, printed_x_m, printed_y_m
    #[arg(long)]
    json: bool,
    /// Draw how the errors are distributed, as .svg or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

/// What `--json` prints.
#[derive(serde::Serialize)]
struct Document {
    threshold: f64,
    detected: f64,
    scores: Vec<Score>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let picture = PictureFile::plot(arguments.plot.as_deref())?;
    let outcome = garcia::run(arguments.rooms as usize, arguments.seed);
    if arguments.json {
        let scores = outcome.scores.iter().map(|score| Score {
            rmse_x_m: super::rounded(score.rmse_x_m),
            rmse_y_m: super::rounded(score.rmse_y_m),
            rmse_m: super::rounded(score.rmse_m),
            reduction: super::rounded(score.reduction),
            ..score.clone()
        });
        super::print_json(&Document {
            threshold: super::rounded(outcome.threshold),
            detected: super::rounded(outcome.detected),
            scores: scores.collect(),
        })?;
    } else {
        super::print(garcia::to_markdown(&outcome).as_bytes())?;
    }
    if let Some(picture) = picture {
        picture.write_and_tell(draw(&outcome)?)?;
    }
    Ok(())
}

/// The distribution of the horizontal errors.
fn draw(outcome: &Outcome) -> Result<String> {
    let tracks = outcome.errors_m.iter().map(|(way, errors)| Track {
        method: way.as_str().to_owned(),
        dots: Vec::new(),
        errors_m: errors.iter().map(|[x, y]| x.hypot(*y)).collect(),
    });
    plot::distribution(&tracks.collect::<Vec<_>>())
}
