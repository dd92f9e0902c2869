//! `baliza bench fusion`: anchors alone, beacons alone, and both.

use std::path::PathBuf;

use anyhow::Result;
use host_tools::fusion::{self, Algorithm, Heard, Score, Scored, Swept};
use host_tools::plot::{self, Track};

use super::PictureFile;
use crate::progress::Progress;

/// A walking tag with ranges to anchors and powers of beacons: each alone, and both fused
///
/// Three anchors, one of them without line of sight, and five beacons in a hall of 12 m × 8 m, as the documentation of the library's module
/// `fusion::world` states it. By the fusion of patent ES 2 397 388, with the particles of a desktop and of a node, and by the engine's
/// Kalman filter. With --sweep the fusion under other conditions instead.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza bench fusion\n  baliza bench fusion --sweep --walks 20\n  \
                        baliza bench fusion --plot fusion.svg --json")]
pub struct Arguments {
    /// How many walks of two minutes to draw, each with channels of its own
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    walks: u32,
    /// Seed of the random numbers: equal seeds give equal figures
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Two to four anchors, with and without line of sight, few and many beacons
    #[arg(long, conflicts_with = "plot")]
    sweep: bool,
    /// Print JSON: a list of objects with algorithm, heard, rmse_m, mae_m, p90_m, answered; with --sweep anchors, blocked,
    /// range_sigma_m, excess_m, beacons, rmse_m (UWB, BLE, both), ratio
    #[arg(long)]
    json: bool,
    /// Draw how the errors are distributed, as .svg or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    if arguments.sweep {
        return sweep(arguments);
    }
    let picture = PictureFile::plot(arguments.plot.as_deref())?;
    let progress = Progress::new(Algorithm::ALL.len() * Heard::ALL.len());
    let scores = fusion::run(arguments.walks, arguments.seed, || progress.step());
    drop(progress);
    if arguments.json {
        let rounded = scores.iter().map(|(score, _)| Score {
            rmse_m: score.rmse_m.map(super::rounded),
            mae_m: score.mae_m.map(super::rounded),
            p90_m: score.p90_m.map(super::rounded),
            answered: super::rounded(score.answered),
            ..score.clone()
        });
        super::print_json(&rounded.collect::<Vec<_>>())?;
    } else {
        super::print(fusion::to_markdown(&scores).as_bytes())?;
    }
    if let Some(picture) = picture {
        picture.write_and_tell(draw(&scores)?)?;
    }
    Ok(())
}

fn sweep(arguments: &Arguments) -> Result<()> {
    let progress = Progress::new(fusion::conditions().count());
    let rows = fusion::sweep(arguments.walks, arguments.seed, || progress.step());
    drop(progress);
    if !arguments.json {
        return super::print(fusion::sweep_to_markdown(&rows).as_bytes());
    }
    let rounded = rows.iter().map(|row| Swept {
        rmse_m: row.rmse_m.map(|figure| figure.map(super::rounded)),
        ratio: row.ratio.map(super::rounded),
        ..row.clone()
    });
    super::print_json(&rounded.collect::<Vec<_>>())
}

/// The distribution of the errors.
fn draw(scores: &[Scored]) -> Result<String> {
    let tracks = scores.iter().map(|(score, errors_m)| Track {
        method: format!("{}, {}", score.algorithm.as_str(), score.heard.as_str()),
        dots: Vec::new(),
        errors_m: errors_m.clone(),
    });
    plot::distribution(&tracks.collect::<Vec<_>>())
}
