//! A panel's chart: grid, axes with their numbers, title and the names of the axes.

use std::ops::Range;

use anyhow::Result;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::Area;
use super::style::{AXIS, GRID, pixels, stroke, text, title, upright};
use super::ticks::{self, Tick};

/// Room for axes and title around a chart, pixels; the left one is for short numbers.
pub const LEFT: u32 = 66;
pub const RIGHT: u32 = 18;
pub const TOP: u32 = 40;
pub const BOTTOM: u32 = 52;

/// A chart of numbers against numbers.
pub type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// What the numbers of an axis are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// The values.
    Linear,
    /// The common logarithms of the values.
    Logarithmic,
}

/// The labels around a chart.
pub struct Axes<'a> {
    pub title: &'a str,
    /// The names of x and y, with their units.
    pub names: [&'a str; 2],
    /// Room for the vertical axis, pixels.
    pub left: u32,
    /// Greatest number of labels along x and y.
    pub ticks: [usize; 2],
    /// What x is.
    pub x_scale: Scale,
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
            .build_cartesian_2d(x.clone(), y.clone())?;
        let of_x = match self.x_scale {
            Scale::Linear => ticks::linear(&x, self.ticks[0]),
            Scale::Logarithmic => ticks::logarithmic(&x, self.ticks[0]),
        };
        let of_y = ticks::linear(&y, self.ticks[1]);
        self.grid(&mut chart, [&x, &y], [&of_x, &of_y])?;
        self.labels(area)?;
        Ok(chart)
    }

    /// The lines behind the chart, the axes with their marks, and the numbers.
    fn grid(&self, chart: &mut Chart, [x, y]: [&Range<f64>; 2], [of_x, of_y]: [&[Tick]; 2]) -> Result<()> {
        let mark = pixels(4) as i32;
        let axis = AXIS.stroke_width(stroke(1.0));
        let behind = |ends| PathElement::new(ends, GRID.stroke_width(stroke(1.0)));
        chart.draw_series(of_x.iter().map(|(at, _)| behind(vec![(*at, y.start), (*at, y.end)])))?;
        chart.draw_series(of_y.iter().map(|(at, _)| behind(vec![(x.start, *at), (x.end, *at)])))?;
        let corners = vec![(x.start, y.end), (x.start, y.start), (x.end, y.start)];
        chart.draw_series([PathElement::new(corners, axis)])?;
        let below = text(Pos::new(HPos::Center, VPos::Top));
        chart.draw_series(of_x.iter().map(|(at, number)| {
            EmptyElement::at((*at, y.start))
                + PathElement::new(vec![(0, 0), (0, mark)], axis)
                + Text::new(number.clone(), (0, 2 * mark), below.clone())
        }))?;
        let beside = text(Pos::new(HPos::Right, VPos::Center));
        chart.draw_series(of_y.iter().map(|(at, number)| {
            EmptyElement::at((x.start, *at))
                + PathElement::new(vec![(-mark, 0), (0, 0)], axis)
                + Text::new(format!("{number}{}", self.unit), (-2 * mark, 0), beside.clone())
        }))?;
        Ok(())
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
