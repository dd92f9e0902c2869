//! `baliza bench linde`: RSSI and times of flight of four beacons in a room, beside the published figures.

use anyhow::{Context, Result};
use papers::linde::{self, Parameter, RoomAlgorithm, Scored};

use super::{Drawing, distribution};

/// Four beacons in a room, by RSSI and by times of flight, by fingerprints and by multilateration
///
/// The study of feasibility in annex A of A. Linde Cerezo's thesis (Universitat Oberta de Catalunya, 2024), beside the
/// figures it prints. The documentation of the library's module `linde` states what is printed of the simulation and
/// what is assumed. The nonlinear form of multilateration, which keeps to the room, is not in the annex.
///
/// As JSON: a list of objects with parameter, noise, unit, algorithm, rmse_m, mae_m, answered, printed_rmse_m,
/// printed_mae_m (5 is "> 5"; null where the annex has no such row). The picture leaves out times by multilateration,
/// which would flatten the rest.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza bench linde\n  baliza bench linde --trials 500 --seed 7 --json\n  \
                        baliza bench linde --plot linde.svg")]
pub struct Arguments {
    /// How many times each of the mesh's receivers measures
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    trials: u32,
    #[command(flatten)]
    drawing: Drawing,
}

/// Runs `baliza bench linde`.
///
/// # Errors
/// A simulated survey makes no map, the picture cannot be drawn or written, or the output cannot be printed.
pub fn run(arguments: &Arguments) -> Result<()> {
    let shown = arguments.drawing.check()?;
    let rows = linde::run(arguments.trials, arguments.drawing.seed).context("a survey makes no map")?;
    let scores: Vec<_> = rows.iter().map(|(score, _)| score).collect();
    shown.show(&scores, || linde::to_markdown(&rows), || draw(&rows))
}

/// The distribution of the errors, without times by multilateration, whose large errors would flatten the other curves.
fn draw(rows: &[Scored]) -> pictures::Drawing {
    let drawn = rows.iter().zip(linde::ROWS).filter(|(_, (parameter, algorithm, _))| {
        !matches!((parameter, algorithm), (Parameter::Tof(_), RoomAlgorithm::Multilateration))
    });
    distribution(
        drawn.map(|((_, errors_m), (parameter, algorithm, _))| (linde::name(parameter, algorithm), errors_m.clone())),
    )
}
