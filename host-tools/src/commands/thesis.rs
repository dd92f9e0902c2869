//! `baliza bench thesis`: every method on the simulated ranges of a thesis, beside its printed figures.

use std::path::PathBuf;

use anyhow::Result;
use host_tools::plot;
use host_tools::thesis::{self, Score};
use positioning_core::Method;

use super::PictureFile;
use crate::progress::Progress;

/// Every method on simulated ranges, half of which lack their direct path
///
/// The benchmark of P. M. de Rojas Malpartida's thesis (Universidad de Sevilla, 2021, chapter 8): 12 anchors on the perimeter of a
/// room of 9.5 × 7.5 m, errors as Alavi and Pahlavan modelled them. DDP is a detected direct path. The thesis never printed where its
/// anchors were, so its figures are matched in kind and not to the digit.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza bench thesis\n  baliza bench thesis --points 100000 --json\n  \
                        baliza bench thesis --plot thesis.svg")]
pub struct Arguments {
    /// How many points to draw
    #[arg(long, default_value_t = 3000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    points: u32,
    /// Seed of the random numbers: equal seeds give equal figures
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print JSON: a list of objects with method, ddp_anchors (null: all points), points, rmse_m, mae_m
    #[arg(long)]
    json: bool,
    /// Draw the errors by number of detected direct paths, as .svg or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let picture = PictureFile::plot(arguments.plot.as_deref())?;
    let scores = scores(arguments.points as usize, arguments.seed);
    if arguments.json {
        let rounded = |metres: Option<f64>| metres.map(super::rounded);
        let scores = scores.iter().cloned();
        let scores = scores.map(|s| Score { rmse_m: rounded(s.rmse_m), mae_m: rounded(s.mae_m), ..s });
        super::print_json(&scores.collect::<Vec<_>>())?;
    } else {
        super::print(thesis::to_markdown(&scores).as_bytes())?;
    }
    if let Some(picture) = picture {
        picture.write_and_tell(plot::thesis(&scores)?)?;
    }
    Ok(())
}

fn scores(count: usize, seed: u64) -> Vec<Score> {
    let points = thesis::points(count, seed);
    let progress = Progress::new(Method::ALL.len() * count);
    Method::ALL
        .into_iter()
        .flat_map(|method| {
            let errors: Vec<_> = points
                .iter()
                .map(|point| {
                    progress.step();
                    thesis::error_m(method, point)
                })
                .collect();
            thesis::score(method, &points, &errors)
        })
        .collect()
}
