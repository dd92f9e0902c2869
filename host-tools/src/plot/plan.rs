//! An image of a floor plan beneath a map.
//!
//! The drawing library has no images in SVG, so that the image's element is put into the finished text, after the
//! background.

use std::fmt::Write as _;
use std::ops::Range;

use super::view::View;

/// A floor plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The image as a `data:` URL.
    pub url: String,
    /// The places of its lower left and upper right corners, metres.
    pub corners_m: [[f64; 2]; 2],
}

/// What is drawn beneath everything else: SVG text.
#[derive(Debug, Default)]
pub struct Beneath(pub String);

impl Beneath {
    /// Puts a plan beneath a map that shows the view within these pixels.
    pub fn put(&mut self, plan: &Plan, view: &View, (columns, rows): (Range<i32>, Range<i32>)) {
        let [width, height] = [&columns, &rows].map(|pixels| f64::from(pixels.end - pixels.start));
        let [[x0, y0], [x1, y1]] = plan.corners_m;
        let metres_a_pixel = view.sides()[0] / width;
        // The inner document cuts the image to the map. Its y goes down.
        let [x, y] = [(x0 - view.least[0]) / metres_a_pixel, (view.greatest[1] - y1) / metres_a_pixel];
        let [wide, high] = [(x1 - x0) / metres_a_pixel, (y1 - y0) / metres_a_pixel];
        let _ = write!(
            self.0,
            r#"<svg x="{}" y="{}" width="{width}" height="{height}" overflow="hidden"><image x="{x:.1}" y="{y:.1}" width="{wide:.1}" height="{high:.1}" preserveAspectRatio="none" opacity="0.6" href="{}"/></svg>"#,
            columns.start, rows.start, plan.url
        );
    }
}
