//! `baliza bench barral`: positioning with classifiers and mitigation of blocked ranges, beside the published figures.

use anyhow::Result;
use papers::barral::{self, Row};

use super::{Drawing, distribution};

/// Ranges from five anchors with blocked ranges ignored, corrected or weighted, by filter and by least squares
///
/// The configurations of V. Barral et al. (Sensors 19, 2019, tables 4 and 5), on ranges drawn with statistics that the
/// documentation of the library's module `barral::hall` states; mean errors beside the tables'.
///
/// As JSON: a list of objects with algorithm, configuration, mae_m, p90_m, printed_measured_m, printed_simulated_m.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza bench barral\n  baliza bench barral --halls 100 --json\n  \
                        baliza bench barral --plot barral.svg")]
pub struct Arguments {
    /// How many halls to draw, each with obstacles of its own
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    halls: u32,
    #[command(flatten)]
    drawing: Drawing,
}

/// Runs `baliza bench barral`.
///
/// # Errors
/// The picture cannot be drawn or written, or the output cannot be printed.
pub fn run(arguments: &Arguments) -> Result<()> {
    let shown = arguments.drawing.check()?;
    let rows = barral::run(arguments.halls, arguments.drawing.seed);
    let scores: Vec<_> = rows.iter().map(|(score, _)| score).collect();
    shown.show(&scores, || barral::to_markdown(&rows), || draw(&rows))
}

/// The configurations that are drawn. The results of the others are between theirs.
const DRAWN: [&str; 7] = [
    "IEKF, no ignore",
    "IEKF, ignore NLOS",
    "IEKF, ignore NLOS, mitigate",
    "NLS, ignore NLOS",
    "NLS, ignore NLOS, min. 4",
    "engine, no ignore",
    "engine, weigh",
];

/// The distribution of the errors, as in the paper's figure 4.
fn draw(rows: &[Row]) -> pictures::Drawing {
    let named = rows.iter().map(|(score, errors_m)| {
        (format!("{}, {}", score.algorithm.as_str(), score.configuration.as_str()), errors_m.clone())
    });
    distribution(named.filter(|(name, _)| DRAWN.contains(&name.as_str())))
}
