//! `baliza bench fusion`: anchors alone, beacons alone, and both.

use anyhow::Result;
use papers::fusion::bench::{self, FusionAlgorithm, Inputs, Scored};

use super::{Drawing, distribution};
use host_tools::cli::progress::Progress;

/// A walking tag with ranges to anchors and powers of beacons: each alone, and both fused
///
/// Three anchors, one of them without line of sight, and five beacons in a hall of 12 m × 8 m, as the documentation of
/// the library's module `fusion::bench::world` states it. By the fusion of patent ES 2 397 388, with the hypotheses of
/// a desktop and of a node, and by the engine's Kalman filter. With --sweep the fusion under other conditions instead.
///
/// As JSON: a list of objects with algorithm, heard, rmse_m, mae_m, p90_m, answered, nees, inside_1_sigma; with --sweep
/// anchors, blocked, range_sigma_m, excess_m, beacons, rmse_m (UWB, BLE, both), ratio, and of both nees,
/// inside_1_sigma. NEES is the squared error over its covariance, on average: 2 where the covariance is honest, as 39 %
/// of the errors are inside one sigma.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza bench fusion\n  baliza bench fusion --sweep --walks 20\n  \
                        baliza bench fusion --plot fusion.svg --json")]
pub struct Arguments {
    /// How many walks of two minutes to draw, each with channels of its own
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    walks: u32,
    /// Two to four anchors, with and without line of sight, few and many beacons
    #[arg(long, conflicts_with = "plot")]
    sweep: bool,
    #[command(flatten)]
    drawing: Drawing,
}

/// Runs `baliza bench fusion`.
///
/// # Errors
/// The picture cannot be drawn or written, or the output cannot be printed.
pub fn run(arguments: &Arguments) -> Result<()> {
    let shown = arguments.drawing.check()?;
    if arguments.sweep {
        let progress = Progress::new(bench::conditions().count());
        let rows = bench::sweep(arguments.walks, arguments.drawing.seed, || progress.step());
        drop(progress);
        return shown.print(&rows, || bench::sweep_to_markdown(&rows));
    }
    let progress = Progress::new(FusionAlgorithm::ALL.len() * Inputs::ALL.len());
    let rows = bench::run(arguments.walks, arguments.drawing.seed, || progress.step());
    drop(progress);
    let scores: Vec<_> = rows.iter().map(|(score, _)| score).collect();
    shown.show(&scores, || bench::to_markdown(&rows), || draw(&rows))
}

/// The distribution of the errors.
fn draw(scores: &[Scored]) -> pictures::Drawing {
    distribution(
        scores.iter().map(|(score, errors_m)| {
            (format!("{}, {}", score.algorithm.as_str(), score.heard.as_str()), errors_m.clone())
        }),
    )
}
