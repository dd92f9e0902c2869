//! The map: anchors, beacons, true positions, estimated positions and ellipses. One metre has the same length in x
//! and y.

use std::f64::consts::TAU;

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axes::{Axes, BOTTOM, Chart, RIGHT, TOP};
use super::style::{AXIS, INK, pen, pixels, printable, stroke, text};
use super::{Area, Picture, Track};

/// The least and the greatest height of a map, pixels.
const HEIGHTS: (u32, u32) = (260, 760);
/// Greatest number of ellipses: more would cover each other.
const ELLIPSES: usize = 48;
/// Radius of an ellipse in standard deviations.
pub const SIGMAS: f64 = 2.0;
/// A true position that stays within a box of this size is drawn as a point and not as a path, metres.
const STILL_M: f64 = 0.02;

/// A box in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    least: [f64; 2],
    greatest: [f64; 2],
}

impl View {
    /// The area of the map: all anchors and true positions, and the positions within a margin of half that size.
    /// Farther outliers are left out, because they would shrink the rest to a dot.
    pub fn of(picture: &Picture) -> Self {
        let dots = || picture.tracks.iter().flat_map(|track| &track.dots).map(|dot| dot.at_m);
        let known = Self::around(
            picture
                .anchors
                .iter()
                .chain(&picture.beacons)
                .map(|(_, at)| *at)
                .chain(picture.truth_m.iter().flatten().copied())
                .chain(picture.walls_m.iter().flatten().copied()),
        );
        let view = match known {
            Some(known) => {
                let reach = known.grown(0.5, 1.0);
                Self::around([known.least, known.greatest].into_iter().chain(dots().filter(|at| reach.has(*at))))
            }
            None => Self::around(middle(dots())),
        };
        view.unwrap_or(Self { least: [0.0; 2], greatest: [1.0; 2] }).grown(0.05, 0.5)
    }

    fn around(points: impl Iterator<Item = [f64; 2]>) -> Option<Self> {
        points.map(|at| Self { least: at, greatest: at }).reduce(|a, b| Self {
            least: std::array::from_fn(|axis| a.least[axis].min(b.least[axis])),
            greatest: std::array::from_fn(|axis| a.greatest[axis].max(b.greatest[axis])),
        })
    }

    /// Enlarged on every side by a share of its longer side, and by at least `least_m`.
    fn grown(self, share: f64, least_m: f64) -> Self {
        let [width, height] = self.sides();
        let more = (share * width.max(height)).max(least_m);
        Self { least: self.least.map(|c| c - more), greatest: self.greatest.map(|c| c + more) }
    }

    fn sides(&self) -> [f64; 2] {
        std::array::from_fn(|axis| self.greatest[axis] - self.least[axis])
    }

    /// Whether a point is inside.
    pub fn has(&self, at: [f64; 2]) -> bool {
        (0..2).all(|axis| (self.least[axis]..=self.greatest[axis]).contains(&at[axis]))
    }

    /// Whether the map should have the whole width of a picture.
    pub fn is_wide(&self) -> bool {
        let [width, height] = self.sides();
        width > 1.7 * height
    }

    /// Width of the numbers along an axis, pixels.
    fn numbers_width(&self, axis: usize) -> u32 {
        let longest = [self.least[axis], self.greatest[axis]].map(|c| format!("{c:.0}").len()).into_iter().max();
        8 * (longest.unwrap_or(0) as u32).clamp(3, 16)
    }

    /// Room for the vertical axis, pixels: it grows with the numbers.
    fn left(&self) -> u32 {
        38 + self.numbers_width(1)
    }

    /// Height of a map of that width, pixels.
    pub fn height_for(&self, width: u32) -> u32 {
        let [metres_wide, metres_high] = self.sides();
        let plot = f64::from(width - self.left() - RIGHT) * metres_high / metres_wide;
        (plot as u32 + TOP + BOTTOM).clamp(HEIGHTS.0, HEIGHTS.1)
    }

    /// Enlarged on two sides to the shape of the paper.
    fn shaped(self, paper: [f64; 2]) -> Self {
        let sides = self.sides();
        let metres_a_pixel = (sides[0] / paper[0]).max(sides[1] / paper[1]);
        let more: [f64; 2] = std::array::from_fn(|axis| 0.5 * (metres_a_pixel * paper[axis] - sides[axis]));
        Self {
            least: std::array::from_fn(|axis| self.least[axis] - more[axis]),
            greatest: std::array::from_fn(|axis| self.greatest[axis] + more[axis]),
        }
    }
}

/// The points whose coordinates are both among the middle 98 %.
fn middle(points: impl Iterator<Item = [f64; 2]>) -> impl Iterator<Item = [f64; 2]> {
    let points: Vec<_> = points.collect();
    let bounds: [(f64, f64); 2] = std::array::from_fn(|axis| {
        let mut sorted: Vec<f64> = points.iter().map(|at| at[axis]).collect();
        sorted.sort_by(f64::total_cmp);
        let cut = sorted.len() / 100;
        let kept = sorted.get(cut..sorted.len() - cut).unwrap_or(&[]);
        (kept.first().copied().unwrap_or(0.0), kept.last().copied().unwrap_or(0.0))
    });
    points.into_iter().filter(move |at| (0..2).all(|axis| (bounds[axis].0..=bounds[axis].1).contains(&at[axis])))
}

/// An ellipse is drawn for every n-th position of a picture: n.
pub fn ellipse_step(picture: &Picture) -> usize {
    let ellipses = picture.tracks.iter().flat_map(|track| &track.dots).filter(|dot| dot.sigma_m.is_some()).count();
    ellipses.div_ceil(ELLIPSES).max(1)
}

/// Whether the true position is one point.
pub fn is_still(truth_m: &[[f64; 2]]) -> bool {
    View::around(truth_m.iter().copied()).is_some_and(|view| view.sides().iter().all(|side| *side < STILL_M))
}

/// Draws the map over the whole area.
///
/// # Errors
/// The drawing library fails.
pub fn draw(area: &Area, picture: &Picture, view: &View) -> Result<()> {
    let (width, height) = area.dim_in_pixel();
    let left = view.left();
    let paper = [width - pixels(left + RIGHT), height - pixels(TOP + BOTTOM)].map(f64::from);
    let view = view.shaped(paper);
    let ticks = |axis: usize, spacing: u32| (paper[axis] / f64::from(pixels(spacing))).ceil() as usize;
    let axes = Axes {
        title: "Positions",
        names: ["x, metres", "y, metres"],
        left,
        ticks: [ticks(0, 46 + view.numbers_width(0)), ticks(1, 70)],
        unit: "",
    };
    let mut chart = axes.draw(area, view.least[0]..view.greatest[0], view.least[1]..view.greatest[1])?;

    let walls = picture.walls_m.iter().map(|ends| ends.map(|at| (at[0], at[1])).to_vec());
    chart.draw_series(walls.map(|wall| PathElement::new(wall, AXIS.stroke_width(stroke(3.0)))))?;
    let step = ellipse_step(picture);
    for track in &picture.tracks {
        ellipses(&mut chart, track, &view, step)?;
    }
    for track in &picture.tracks {
        let color = pen(&track.method).color.mix(0.6).filled();
        let dots = track.dots.iter().filter(|dot| view.has(dot.at_m));
        chart.draw_series(dots.map(|dot| Circle::new((dot.at_m[0], dot.at_m[1]), stroke(2.0), color)))?;
    }
    for way in &picture.truth_m {
        truth(&mut chart, way)?;
    }
    anchors(&mut chart, picture, &view)
}

fn ellipses(chart: &mut Chart, track: &Track, view: &View, step: usize) -> Result<()> {
    let color = pen(&track.method).color;
    for dot in track.dots.iter().step_by(step) {
        let Some(sigma_m) = dot.sigma_m else { continue };
        let outline: Vec<(f64, f64)> = (0..48)
            .map(|i| (TAU * f64::from(i) / 48.0).sin_cos())
            .map(|(sin, cos)| (dot.at_m[0] + SIGMAS * sigma_m[0] * cos, dot.at_m[1] + SIGMAS * sigma_m[1] * sin))
            .collect();
        if outline.iter().all(|(x, y)| view.has([*x, *y])) {
            chart.draw_series([Polygon::new(outline.clone(), color.mix(0.08))])?;
            let closed = outline.iter().chain(outline.first()).copied().collect::<Vec<_>>();
            chart.draw_series([PathElement::new(closed, color.mix(0.45).stroke_width(stroke(0.7)))])?;
        }
    }
    Ok(())
}

fn truth(chart: &mut Chart, truth_m: &[[f64; 2]]) -> Result<()> {
    let points = || truth_m.iter().map(|at| (at[0], at[1]));
    if is_still(truth_m) {
        chart.draw_series(points().take(1).map(|at| Cross::new(at, pixels(6), INK.stroke_width(stroke(2.2)))))?;
    } else {
        chart.draw_series(LineSeries::new(points(), INK.stroke_width(stroke(1.3))))?;
    }
    Ok(())
}

fn anchors(chart: &mut Chart, picture: &Picture, view: &View) -> Result<()> {
    let named = |(name, at): &(String, [f64; 2]), pos: Pos, away: [i32; 2]| {
        let away = away.map(|steps| steps * pixels(1) as i32);
        EmptyElement::at((at[0], at[1])) + Text::new(printable(name), (away[0], away[1]), text(pos))
    };
    // An anchor's name is above it. A beacon may be beside an anchor, so that its name is on the side with more room.
    for anchor in &picture.anchors {
        let name = named(anchor, Pos::new(HPos::Center, VPos::Bottom), [0, -7]);
        chart.draw_series([name + TriangleMarker::new((0, 0), pixels(6), INK.filled())])?;
    }
    for beacon in &picture.beacons {
        let right = beacon.1[0] < 0.5 * (view.least[0] + view.greatest[0]);
        let (side, away) = if right { (HPos::Left, 9) } else { (HPos::Right, -9) };
        let name = named(beacon, Pos::new(side, VPos::Center), [away, 0]);
        chart.draw_series([name + Circle::new((0, 0), pixels(5), INK.stroke_width(stroke(1.6)))])?;
    }
    Ok(())
}
