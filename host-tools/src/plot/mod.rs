//! Pictures of positions: a map with anchors, true positions, estimated positions and their error ellipses, and the
//! distribution of the errors.
//!
//! A [`Picture`] becomes SVG text, drawn by `plotters`; PNG is that SVG, rendered by `resvg` with a font of its own.

mod axes;
mod cdf;
mod confusion;
mod distribution;
mod format;
mod heat;
mod legend;
mod map;
mod path_loss;
mod style;
mod thesis;

use anyhow::Result;
use baliza_report::Statistics;
use plotters::coord::Shift;
use plotters::prelude::{DrawingArea, SVGBackend};

pub use confusion::confusion;
pub use distribution::distribution;
pub use format::Format;
pub use heat::{Heat, heat};
pub use path_loss::path_loss;
pub use thesis::thesis;

/// What to draw.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Names and positions of the anchors, metres.
    pub anchors: Vec<(String, [f64; 2])>,
    /// Names and positions of the beacons, metres.
    pub beacons: Vec<(String, [f64; 2])>,
    /// The floor plan: both ends of every wall, metres.
    pub walls_m: Vec<[[f64; 2]; 2]>,
    /// The true positions of each tag, in order of time, metres.
    pub truth_m: Vec<Vec<[f64; 2]>>,
    /// The results of each method.
    pub tracks: Vec<Track>,
}

/// The results of one method.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track {
    /// The method's name.
    pub method: String,
    /// The positions in order of time.
    pub dots: Vec<Dot>,
    /// Distances from the true positions, metres.
    pub errors_m: Vec<f64>,
}

/// A position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dot {
    /// Its coordinates, metres.
    pub at_m: [f64; 2],
    /// Standard deviation of x and y, metres.
    pub sigma_m: Option<[f64; 2]>,
}

impl Picture {
    /// The picture as SVG.
    ///
    /// # Errors
    /// The drawing library fails.
    pub fn to_svg(&self) -> Result<String> {
        let has_errors = self.tracks.iter().any(|track| !track.errors_m.is_empty());
        let view = map::View::of(self);
        let key = legend::Key::of(self, &view);
        let key_height = key.height();
        if view.is_wide() {
            // Below the wide map: the legend, and the errors beside it.
            let map_height = view.height_for(1200);
            let lower = if has_errors { key_height.max(360) } else { key_height };
            drawing((1200, map_height + lower), |area| {
                let (upper, lower) = area.split_vertically(style::pixels(map_height));
                let (left, right) = lower.split_horizontally(style::pixels(if has_errors { 680 } else { 0 }));
                map::draw(&upper, self, &view)?;
                if has_errors {
                    cdf::draw(&left, &self.tracks)?;
                }
                key.draw(&right)
            })
        } else {
            // Beside the map: the errors above, the legend below.
            let errors_height = if has_errors { 400 } else { 0 };
            let height = view.height_for(740).max(errors_height + key_height);
            drawing((1240, height), |area| {
                let (left, right) = area.split_horizontally(style::pixels(740));
                let (upper, lower) = right.split_vertically(style::pixels(errors_height));
                map::draw(&left, self, &view)?;
                if has_errors {
                    cdf::draw(&upper, &self.tracks)?;
                }
                key.draw(&lower)
            })
        }
    }
}

impl Track {
    fn statistics(&self) -> Option<Statistics> {
        Statistics::of(&self.errors_m)
    }
}

/// An area to draw on.
type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// An SVG document of this size in pixels, with a white background.
fn drawing(size: (u32, u32), draw: impl FnOnce(&Area) -> Result<()>) -> Result<String> {
    use plotters::prelude::IntoDrawingArea;
    let mut svg = String::new();
    let fine = (style::FINE * size.0, style::FINE * size.1);
    {
        let area = SVGBackend::with_string(&mut svg, fine).into_drawing_area();
        area.fill(&plotters::style::WHITE)?;
        draw(&area)?;
        area.present()?;
    }
    let (drawn, shown) = (header(fine), header(size));
    Ok(svg.replacen(&drawn, &shown, 1))
}

/// The size of a document, as the SVG backend writes it.
fn header((width, height): (u32, u32)) -> String {
    format!(r#"<svg width="{width}" height="{height}""#)
}
