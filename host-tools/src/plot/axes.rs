//! A panel's chart: grid, axes with their numbers, title and the names of the axes.

use std::ops::Range;

use anyhow::Result;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::Area;
use super::style::{AXIS, GRID, number, pixels, stroke, text, title, upright};

/// Room for axes and title around a chart, pixels; the left one is for short numbers.
pub const LEFT: u32 = 66;
pub const RIGHT: u32 = 18;
pub const TOP: u32 = 40;
pub const BOTTOM: u32 = 52;

/// A chart of numbers against numbers.
pub type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// The labels around a chart.
pub struct Axes<'a> {
    pub title: &'a str,
    /// The names of x and y, with their units.
    pub names: [&'a str; 2],
    /// Room for the vertical axis, pixels.
    pub left: u32,
    /// Greatest number of labels along x and y.
    pub ticks: [usize; 2],
    /// The unit behind the numbers of y.
    pub unit: &'a str,
}

impl Axes<'_> {
    /// Draws the axes over the whole area, and returns the chart between them, which has these ranges.
    ///
    /// # Errors
    /// The drawing library fails.
    pub fn draw<'a, 'b>(&self, area: &'a Area<'b>, x: Range<f64>, y: Range<f64>) -> Result<Chart<'a, 'b>> {
        let mut chart = ChartBuilder::on(area)
            .margin_top(pixels(TOP))
            .margin_right(pixels(RIGHT))
            .x_label_area_size(pixels(BOTTOM))
            .y_label_area_size(pixels(self.left))
            .build_cartesian_2d(x, y)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID.stroke_width(stroke(1.0)))
            .axis_style(AXIS.stroke_width(stroke(1.0)))
            .set_all_tick_mark_size(pixels(4))
            .x_labels(self.ticks[0])
            .y_labels(self.ticks[1])
            .x_label_formatter(&|x| number(*x))
            .y_label_formatter(&|y| number(*y) + self.unit)
            .label_style(text(Pos::new(HPos::Center, VPos::Center)))
            .draw()?;
        self.labels(area)?;
        Ok(chart)
    }

    /// Title and names, at the edges.
    fn labels(&self, area: &Area) -> Result<()> {
        let (width, height) = area.dim_in_pixel();
        let at = |x: u32, y: u32| (x as i32, y as i32);
        area.draw_text(self.title, &title(Pos::new(HPos::Left, VPos::Top)), at(pixels(self.left), pixels(14)))?;
        let middle = (pixels(self.left) + width - pixels(RIGHT)) / 2;
        area.draw_text(self.names[0], &text(Pos::new(HPos::Center, VPos::Bottom)), at(middle, height - pixels(6)))?;
        let middle = (pixels(TOP) + height - pixels(BOTTOM)) / 2;
        area.draw_text(self.names[1], &upright(Pos::new(HPos::Center, VPos::Center)), at(pixels(14), middle))?;
        Ok(())
    }
}
