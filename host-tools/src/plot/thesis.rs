//! The figure for the benchmark of P. M. de Rojas Malpartida's thesis: error against the number of detected direct
//! paths, ours and as printed.

use anyhow::Result;
use baliza_research::thesis::Score;
use baliza_research::thesis::printed::{DDP_ANCHORS, printed};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use positioning_core::Method;

use super::axes::{Axes, LEFT, Scale};
use super::style::{INK, pen, pixels, stroke, text};
use super::{drawing, legend};

/// Draws the scores of every method: a line for ours, circles for the printed ones.
///
/// # Errors
/// The drawing library fails.
pub fn thesis(scores: &[Score]) -> Result<String> {
    let ours = |method: Method| -> Vec<(f64, f64)> {
        let of = |number| scores.iter().find(|s| s.method == method.as_str() && s.ddp_anchors == Some(number));
        DDP_ANCHORS.filter_map(|number| Some((number as f64, of(number)?.rmse_m?))).collect()
    };
    let theirs = |method: Method| -> Vec<(f64, f64)> {
        let figures = printed(method).and_then(|printed| printed.by_ddp).into_iter().flatten();
        DDP_ANCHORS.map(|number| number as f64).zip(figures).collect()
    };
    let highest = Method::ALL.iter().flat_map(|m| ours(*m).into_iter().chain(theirs(*m))).map(|(_, y)| y);
    let highest = 1.05 * highest.fold(0.1, f64::max);
    let (first, last) = (*DDP_ANCHORS.start() as f64, *DDP_ANCHORS.end() as f64);
    drawing((1000, 560), |area| {
        let (left, right) = area.split_horizontally(pixels(790));
        let axes = Axes {
            title: "Error by number of detected direct paths",
            names: ["anchors of 12 whose direct path is detected", "RMSE, metres"],
            left: LEFT,
            ticks: [8, 10],
            x_scale: Scale::Linear,
            unit: "",
        };
        let mut chart = axes.draw(&left, first - 0.2..last + 0.2, 0.0..highest)?;
        for method in Method::ALL {
            let pen = pen(method.as_str());
            chart.draw_series([pen.line::<(f64, f64)>(ours(method))])?;
            let ring = pen.color.stroke_width(stroke(1.2));
            chart.draw_series(theirs(method).into_iter().map(|at| Circle::new(at, stroke(3.5), ring)))?;
        }
        let y = legend::methods_beside(&right, Method::ALL.iter().map(|method| method.as_str()))?;
        right.draw(&Circle::new((pixels(20) as i32, y), stroke(3.5), INK.stroke_width(stroke(1.2))))?;
        let style = text(Pos::new(HPos::Left, VPos::Center));
        right.draw_text("as printed", &style, (pixels(48) as i32, y))?;
        Ok(())
    })
}
