//! `baliza bench thesis`: every method on the simulated ranges of P. M. de Rojas Malpartida's thesis (Universidad de
//! Sevilla, 2021), beside the published figures.

use anyhow::Result;
use host_tools::cli::progress::Progress;
use papers::thesis::printed::{DDP_ANCHORS, printed};
use papers::thesis::{self, ThesisScore};
use pictures::{Curve, Curves};
use positioning_core::Method;

use super::Drawing;

/// Every method on simulated ranges, half of which lack their direct path
///
/// The benchmark of P. M. de Rojas Malpartida's thesis (Universidad de Sevilla, 2021, chapter 8): 12 anchors on the
/// perimeter of a room of 9.5 × 7.5 m, errors as Alavi and Pahlavan modelled them. DDP is a detected direct path. The
/// thesis never printed where its anchors were, so its figures are matched in kind and not to the digit.
///
/// As JSON: a list of objects with method, ddp_anchors (null: all points), points, rmse_m, mae_m.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza bench thesis\n  baliza bench thesis --points 100000 --json\n  \
                        baliza bench thesis --plot thesis.svg")]
pub struct Arguments {
    /// How many points to draw
    #[arg(long, default_value_t = 3000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    points: u32,
    #[command(flatten)]
    drawing: Drawing,
}

/// Runs `baliza bench thesis`.
///
/// # Errors
/// The picture cannot be drawn or written, or the output cannot be printed.
pub fn run(arguments: &Arguments) -> Result<()> {
    let shown = arguments.drawing.check()?;
    let scores = scores(arguments.points as usize, arguments.drawing.seed);
    shown.show(&scores, || thesis::to_markdown(&scores), || draw(&scores))
}

fn scores(count: usize, seed: u64) -> Vec<ThesisScore> {
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

/// Error against the number of detected direct paths: a line for ours, rings for the printed ones.
fn draw(scores: &[ThesisScore]) -> pictures::Drawing {
    let curve = |method: Method| {
        let of = |number| scores.iter().find(|s| s.method == method.as_str() && s.ddp_anchors == Some(number));
        let line = DDP_ANCHORS.filter_map(|number| Some([number as f64, of(number)?.rmse_m?])).collect();
        let figures = printed(method).and_then(|printed| printed.by_ddp).into_iter().flatten();
        let rings = DDP_ANCHORS.zip(figures).map(|(number, figure)| [number as f64, figure]).collect();
        Curve { method: method.as_str(), line, rings }
    };
    let curves = Curves {
        title: "Error by number of detected direct paths",
        names: ["anchors of 12 whose direct path is detected", "RMSE, metres"],
        x: *DDP_ANCHORS.start() as f64 - 0.2..*DDP_ANCHORS.end() as f64 + 0.2,
        rings: "as printed",
        curves: Method::ALL.into_iter().map(curve).collect(),
    };
    curves.draw()
}
