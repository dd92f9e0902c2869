//! Curves of methods with their printed points, and a legend.

use std::ops::Range;

use super::axes::{Axes, LEFT, Scale};
use super::drawing::{Across, Down, Drawing};
use super::legend;
use super::style::{INK, pen, pixels, stroke, text};

/// A chart with a curve a method.
#[derive(Clone, Debug, PartialEq)]
pub struct Curves<'a> {
    /// The title above it.
    pub title: &'a str,
    /// The names of x and y, with their units.
    pub names: [&'a str; 2],
    /// What is shown of x; y begins with 0.
    pub x: Range<f64>,
    /// What the rings are.
    pub rings: &'a str,
    /// The curves.
    pub curves: Vec<Curve<'a>>,
}

/// A curve of a method.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve<'a> {
    /// The method's name.
    pub method: &'a str,
    /// A line through points.
    pub line: Vec<[f64; 2]>,
    /// Points that are rings.
    pub rings: Vec<[f64; 2]>,
}

impl Curves<'_> {
    /// Draws the curves, with the names of their methods beside the chart.
    pub fn draw(&self) -> Drawing {
        let highest = self.curves.iter().flat_map(|curve| curve.line.iter().chain(&curve.rings)).map(|[_, y]| *y);
        let highest = 1.05 * highest.fold(0.1, f64::max);
        Drawing::new([1000, 560], |area| {
            let [left, right] = area.split_at_x(pixels(790));
            let axes = Axes {
                title: self.title,
                names: self.names,
                left: LEFT,
                ticks: [8, 10],
                x_scale: Scale::Linear,
                unit: "",
            };
            let chart = axes.draw(left, self.x.clone(), 0.0..highest);
            for Curve { method, line, rings } in &self.curves {
                let pen = pen(method);
                pen.line(chart.paper, line.iter().map(|at| chart.at(*at)));
                let ring = pen.color.line(stroke(1.2));
                rings.iter().for_each(|at| chart.paper.circle(chart.at(*at), stroke(3.5), ring));
            }
            let y = legend::methods_beside(right, self.curves.iter().map(|curve| curve.method));
            right.circle([pixels(20) as i32, y], stroke(3.5), INK.line(stroke(1.2)));
            right.text(self.rings, [pixels(48) as i32, y], text(Across::Left, Down::Middle));
        })
    }
}
