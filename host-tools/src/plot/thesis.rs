//! The figure of the thesis' benchmark: error against the number of detected direct paths, ours and as printed.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use positioning_core::Method;

use super::drawing;
use super::map::labels;
use super::style::{AXIS, GRID, INK, number, pen, pixels, stroke, text};
use crate::thesis::Score;
use crate::thesis::printed::{DDP_ANCHORS, printed};

const LEFT: u32 = 66;
const RIGHT: u32 = 18;
const TOP: u32 = 40;
const BOTTOM: u32 = 52;
const LINE: u32 = 24;

/// Draws the scores of every method: a line ours, circles as printed.
///
/// # Errors
/// The drawing library's.
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
        let mut chart = ChartBuilder::on(&left)
            .margin_top(pixels(TOP))
            .margin_right(pixels(RIGHT))
            .x_label_area_size(pixels(BOTTOM))
            .y_label_area_size(pixels(LEFT))
            .build_cartesian_2d(first - 0.2..last + 0.2, 0.0..highest)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID.stroke_width(stroke(1.0)))
            .axis_style(AXIS.stroke_width(stroke(1.0)))
            .set_all_tick_mark_size(pixels(4))
            .x_labels(8)
            .y_labels(10)
            .x_label_formatter(&|x| number(*x))
            .y_label_formatter(&|y| number(*y))
            .label_style(text(Pos::new(HPos::Center, VPos::Center)))
            .draw()?;
        let x = "anchors of 12 whose direct path is detected";
        labels(&left, "Error by number of detected direct paths", x, "RMSE, metres", [LEFT, BOTTOM])?;
        for method in Method::ALL {
            let pen = pen(method.as_str());
            chart.draw_series([pen.line::<(f64, f64)>(ours(method))])?;
            let ring = pen.color.stroke_width(stroke(1.2));
            chart.draw_series(theirs(method).into_iter().map(|at| Circle::new(at, stroke(3.5), ring)))?;
        }
        let style = text(Pos::new(HPos::Left, VPos::Center));
        let mut y = pixels(TOP + LINE / 2) as i32;
        for method in Method::ALL {
            let ends = vec![(pixels(4) as i32, y), (pixels(36) as i32, y)];
            right.draw(&pen(method.as_str()).line::<(i32, i32)>(ends))?;
            right.draw_text(method.as_str(), &style, (pixels(48) as i32, y))?;
            y += pixels(LINE) as i32;
        }
        right.draw(&Circle::new((pixels(20) as i32, y), stroke(3.5), INK.stroke_width(stroke(1.2))))?;
        right.draw_text("as printed", &style, (pixels(48) as i32, y))?;
        Ok(())
    })
}
