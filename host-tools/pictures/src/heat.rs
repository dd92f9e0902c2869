//! Heat maps: one colour a cell, walls, marks, and a scale at the side.

use anyhow::Result;

use super::axes::{Axes, BOTTOM, LEFT, RIGHT, Scale, TOP};
use super::drawing::{Across, Area, Colour, Down, Drawing};
use super::labels::Labels;
use super::style::{AXIS, FINE, INK, pixels, printable, stroke, text};
use super::ticks;
use super::view::View;

/// Room for the scale, pixels.
const SCALE: u32 = 110;
/// The longer side of a map, pixels.
const LONGER: f64 = 640.0;

/// A heat map.
#[derive(Clone, Debug, PartialEq)]
pub struct Heat {
    /// The title above it.
    pub title: String,
    /// The corner with the least coordinates, metres.
    pub least_m: [f64; 2],
    /// The side of a cell, metres.
    pub cell_m: f64,
    /// Number of cells along x.
    pub columns: usize,
    /// The values row by row; cells without a value stay white.
    pub values: Vec<Option<f64>>,
    /// The name of the values, with their unit.
    pub unit: String,
    /// Whether low values are good, as errors are.
    pub low_is_good: bool,
    /// Both ends of every wall, metres.
    pub walls_m: Vec<[[f64; 2]; 2]>,
    /// Beacons or anchors with their names, metres.
    pub stations: Vec<(String, [f64; 2])>,
    /// Points of measurements, metres.
    pub points_m: Vec<[f64; 2]>,
}

/// Draws maps side by side, with one scale.
///
/// # Errors
/// The area is too large.
pub fn heat(maps: &[Heat]) -> Result<Drawing> {
    let values = || maps.iter().flat_map(|map| map.values.iter().flatten().copied()).filter(|value| value.is_finite());
    let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
    let scale = if low <= high { (low, high.max(low + 1e-9)) } else { (0.0, 1.0) };
    let mut corners = maps.iter().flat_map(|map| map.least_m.into_iter().chain(map.sides_m()));
    anyhow::ensure!(corners.all(|c| c.abs() < 1e15), "the area is too large for a picture");
    let sizes: Vec<[u32; 2]> = maps.iter().map(Heat::size).collect();
    let width: u32 = sizes.iter().map(|[width, _]| width + LEFT + RIGHT).sum();
    let height = sizes.iter().map(|[_, height]| height + TOP + BOTTOM).max().unwrap_or(200);
    Ok(Drawing::new([width + SCALE, height], |area| {
        let mut rest = area;
        for (map, [width, height]) in maps.iter().zip(&sizes) {
            let [left, right] = rest.split_at_x(pixels(width + LEFT + RIGHT));
            let [panel, _] = left.split_at_y(pixels(height + TOP + BOTTOM));
            map.draw(panel, scale);
            rest = right;
        }
        if let Some(first) = maps.first() {
            draw_scale(rest, &first.unit, first.low_is_good, scale, height);
        }
    }))
}

impl Heat {
    fn sides_m(&self) -> [f64; 2] {
        let rows = self.values.len() / self.columns.max(1);
        [self.cell_m * self.columns as f64, self.cell_m * rows as f64]
    }

    /// The map's own size, pixels.
    fn size(&self) -> [u32; 2] {
        let sides = self.sides_m();
        let longer = sides[0].max(sides[1]);
        sides.map(|side| (LONGER * side / longer).max(120.0) as u32)
    }

    fn draw(&self, area: Area, scale: (f64, f64)) {
        let unknown = if self.values.iter().any(Option::is_none) { "; white: not known" } else { "" };
        let ([x, y], [wide, high]) = (self.least_m, self.sides_m());
        let axes = Axes {
            title: &printable(&format!("{}{unknown}", self.title)),
            names: ["x, metres", "y, metres"],
            left: LEFT,
            ticks: [8, 8],
            x_scale: Scale::Linear,
            unit: "",
        };
        let view = View { least: [x, y], greatest: [x + wide, y + high] };
        let chart = axes.draw(area, x..x + wide, y..y + high);
        for (index, value) in self.values.iter().enumerate() {
            let Some(value) = value.filter(|value| value.is_finite()) else { continue };
            let (column, row) = (index % self.columns.max(1), index / self.columns.max(1));
            let corner = [x + self.cell_m * column as f64, y + self.cell_m * row as f64];
            // Cells overlap a little: the background would be visible between cells that only touch.
            let side = 1.04 * self.cell_m;
            let end = [(corner[0] + side).min(x + wide), (corner[1] + side).min(y + high)];
            let colour = shade(share(value, scale), self.low_is_good);
            chart.paper.rectangle([corner, end].map(|at| chart.at(at)), colour.fill());
        }
        for wall in self.walls_m.iter().filter_map(|ends| view.cut(*ends)) {
            chart.path(&wall, AXIS.line(stroke(3.0)));
        }
        for at in self.points_m.iter().filter(|at| view.has(**at)) {
            chart.paper.circle(chart.at(*at), pixels(2), INK.fill());
        }
        let metres_a_pixel = wide / f64::from(self.size()[0]);
        let mut labels = Labels::new(&view, metres_a_pixel, &self.walls_m);
        self.stations.iter().for_each(|(_, at)| labels.avoid(*at));
        for (_, at) in self.stations.iter().filter(|(_, at)| view.has(*at)) {
            chart.paper.triangle(chart.at(*at), pixels(7), Colour::WHITE);
            chart.paper.triangle(chart.at(*at), pixels(5), INK);
        }
        for (name, at) in &self.stations {
            labels.draw(&chart, *at, name, INK, true);
        }
    }
}

fn draw_scale(area: Area, unit: &str, low_is_good: bool, scale: (f64, f64), height: u32) {
    const STEPS: u32 = 64;
    let (top, bottom) = (pixels(TOP) as i32, pixels(height - BOTTOM) as i32);
    let at = |step: u32| bottom - (bottom - top) * step as i32 / STEPS as i32;
    let (left, right) = (pixels(6) as i32, pixels(24) as i32);
    for step in 0..STEPS {
        let colour = shade((f64::from(step) + 0.5) / f64::from(STEPS), low_is_good);
        // Steps overlap a little, as cells do.
        let top = (at(step + 1) - FINE as i32).max(top);
        area.rectangle([[left, top], [right, at(step)]], colour.fill());
    }
    let beside = text(Across::Left, Down::Middle);
    for (value, number) in ticks::linear(&(scale.0..scale.1), 8) {
        let y = bottom - (f64::from(bottom - top) * share(value, scale)).round() as i32;
        area.path([[right - left, y], [right, y]], INK.line(stroke(1.0)));
        area.text(number, [right + left, y], beside);
    }
    area.text(unit, [left, pixels(TOP / 2) as i32], beside);
}

/// The place of a value between the ends of a scale, 0 to 1.
fn share(value: f64, (low, high): (f64, f64)) -> f64 {
    ((value - low) / (high - low)).clamp(0.0, 1.0)
}

/// From dark to light, where light is good: the colours of Viridis (van der Walt and Smith), which are also distinct
/// for the colour-blind.
fn shade(share: f64, low_is_good: bool) -> Colour {
    const STOPS: [[f64; 3]; 5] =
        [[68.0, 1.0, 84.0], [59.0, 82.0, 139.0], [33.0, 145.0, 140.0], [94.0, 201.0, 98.0], [253.0, 231.0, 37.0]];
    let share = if low_is_good { 1.0 - share } else { share };
    let place = share.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let first = (place as usize).min(STOPS.len() - 2);
    let mix = |channel: usize| {
        let (from, to) = (STOPS[first][channel], STOPS[first + 1][channel]);
        (from + (place - first as f64) * (to - from)).round() as u8
    };
    Colour::of(mix(0), mix(1), mix(2))
}

#[cfg(test)]
mod tests {
    use super::{Colour, shade, share};

    #[test]
    fn the_ends_and_the_middle_of_the_scale_are_those_of_viridis() {
        assert_eq!((shade(0.0, false), shade(1.0, true)), (Colour::of(68, 1, 84), Colour::of(68, 1, 84)));
        assert_eq!((shade(0.5, false), shade(1.0, false)), (Colour::of(33, 145, 140), Colour::of(253, 231, 37)));
        // Halfway between the first two.
        assert_eq!(shade(0.125, false), Colour::of(64, 42, 112));
        assert_eq!((share(-80.0, (-90.0, -70.0)), share(5.0, (0.0, 1.0))), (0.5, 1.0));
    }
}
