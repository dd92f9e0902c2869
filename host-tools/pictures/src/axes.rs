//! A panel's chart: grid, axes with their numbers, title and the names of the axes.

use std::ops::Range;

use super::drawing::{Across, Area, Down, Line, Point};
use super::style::{AXIS, GRID, pixels, stroke, text, title, upright};
use super::ticks::{self, Tick};

/// Room for axes and title around a chart, pixels; the left one is for short numbers.
pub const LEFT: u32 = 66;
pub const RIGHT: u32 = 18;
pub const TOP: u32 = 40;
pub const BOTTOM: u32 = 52;

/// A chart of numbers against numbers.
#[derive(Clone, Debug)]
pub struct Chart<'a> {
    /// The paper between the axes.
    pub paper: Area<'a>,
    x: Range<f64>,
    y: Range<f64>,
}

impl Chart<'_> {
    /// The place of a point on the paper.
    pub fn at(&self, [x, y]: [f64; 2]) -> Point {
        let [width, height] = self.paper.size();
        let (right, down) = (share(x, &self.x), share(y, &self.y));
        let [last_column, last_row] = [width - 1, height - 1].map(f64::from);
        // What is nearly on a place is there.
        let column = (last_column * right + 1e-3).floor() as i32;
        let row = (-last_row * down - 1e-3).ceil() as i32;
        [column, (height - 1).saturating_add(row)]
    }

    /// Draws a line through points.
    pub fn path(&self, points: &[[f64; 2]], line: Line) {
        self.paper.path(points.iter().map(|at| self.at(*at)), line);
    }
}

/// The place of a value in a range, 0 to 1.
fn share(value: f64, range: &Range<f64>) -> f64 {
    if range.start == range.end { 0.5 } else { (value - range.start) / (range.end - range.start) }
}

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
    pub fn draw<'a>(&self, area: Area<'a>, x: Range<f64>, y: Range<f64>) -> Chart<'a> {
        let of_x = match self.x_scale {
            Scale::Linear => ticks::linear(&x, self.ticks[0]),
            Scale::Logarithmic => ticks::logarithmic(&x, self.ticks[0]),
        };
        let of_y = ticks::linear(&y, self.ticks[1]);
        let chart = Chart { paper: area.inside([self.left, TOP, RIGHT, BOTTOM].map(pixels)), x, y };
        self.grid(&chart, &of_x, &of_y);
        self.labels(area);
        chart
    }

    /// The lines behind the chart, the axes with their marks, and the numbers.
    fn grid(&self, chart: &Chart, of_x: &[Tick], of_y: &[Tick]) {
        let mark = pixels(4) as i32;
        let (axis, behind) = (AXIS.line(stroke(1.0)), GRID.line(stroke(1.0)));
        let Chart { paper, x, y } = chart;
        for (at, _) in of_x {
            chart.path(&[[*at, y.start], [*at, y.end]], behind);
        }
        for (at, _) in of_y {
            chart.path(&[[x.start, *at], [x.end, *at]], behind);
        }
        chart.path(&[[x.start, y.end], [x.start, y.start], [x.end, y.start]], axis);
        for (at, number) in of_x {
            let [column, row] = chart.at([*at, y.start]);
            paper.path([[column, row], [column, row + mark]], axis);
            paper.text(number, [column, row + 2 * mark], text(Across::Middle, Down::Top));
        }
        for (at, number) in of_y {
            let [column, row] = chart.at([x.start, *at]);
            paper.path([[column - mark, row], [column, row]], axis);
            let number = format!("{number}{}", self.unit);
            paper.text(number, [column - 2 * mark, row], text(Across::Right, Down::Middle));
        }
    }

    /// Title and names, at the edges.
    fn labels(&self, area: Area) {
        let [width, height] = area.size();
        let [left, top, right, bottom] = [self.left, TOP, RIGHT, BOTTOM].map(|side| pixels(side) as i32);
        area.text(self.title, [left, pixels(14) as i32], title(Across::Left, Down::Top));
        let below = [(left + width - right) / 2, height - pixels(6) as i32];
        area.text(self.names[0], below, text(Across::Middle, Down::Bottom));
        let beside = [pixels(14) as i32, (top + height - bottom) / 2];
        area.text(self.names[1], beside, upright(Across::Middle, Down::Middle));
    }
}

#[cfg(test)]
mod tests {
    use super::super::drawing::Drawing;
    use super::Chart;

    #[test]
    fn the_ends_of_the_axes_are_the_borders_of_the_paper() {
        let drawing = Drawing::new([10, 5], |paper| {
            let chart = Chart { paper, x: -1.0..1.0, y: 0.0..4.0 };
            // Units 0 to 79 across, and 39 to 0 up.
            assert_eq!([[-1.0, 0.0], [1.0, 4.0], [0.0, 1.0]].map(|at| chart.at(at)), [[0, 39], [79, 0], [39, 30]]);
            // What is on no paper is no panic.
            chart.path(&[[f64::INFINITY, f64::NEG_INFINITY], [f64::NAN, 1e300]], super::AXIS.line(1));
        });
        assert_eq!(drawing.shapes.len(), 1);
    }
}
