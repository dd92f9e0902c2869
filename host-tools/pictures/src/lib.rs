//! Pictures of positions: a map with anchors, true positions, estimated positions and their error ellipses, and the
//! distribution of the errors.
//!
//! A [`Picture`] has a list of [`Series`], one a method and tag, and a list of [`Way`]s, one a tag; a
//! [`PictureBuilder`] makes it of positions one at a time. Pictures, and charts of plain numbers, become a
//! [`Drawing`]: shapes, lines of text and images, which `svg` writes as text and `pixels` as PNG. The size of a picture
//! does not grow with the recording: marks that would cover each other are left out (`thin`). Coordinates and errors
//! may be any numbers: what is on no map is counted in the legend, and is not drawn.
#![forbid(unsafe_code)]

mod arrangement;
mod axes;
mod builder;
mod cdf;
mod confusion;
mod coverage;
mod curves;
mod distribution;
mod drawing;
mod ellipses;
mod font;
mod format;
mod heat;
mod image;
mod labels;
mod legend;
mod map;
mod outline;
mod path_loss;
mod pens;
mod pixels;
mod plan;
mod style;
mod svg;
mod text;
mod thin;
mod ticks;
mod view;

use baliza_report::Statistics;

pub use builder::PictureBuilder;
pub use confusion::confusion;
pub use curves::{Curve, Curves};
pub use distribution::distribution;
pub use drawing::{Area, Colour, Drawing};
pub use ellipses::{SIGMAS, outline as ellipse};
pub use format::PictureFormat;
pub use heat::{Heat, heat};
pub use image::{Image, ImageError};
pub use path_loss::path_loss;
pub use plan::Plan;
pub use style::{Pen, pen};

/// What to draw.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// What is drawn, for the legend: the file of the positions, say.
    pub source: String,
    /// Names and positions of the anchors, metres.
    pub anchors: Vec<(String, [f64; 2])>,
    /// Names and positions of the beacons, metres.
    pub beacons: Vec<(String, [f64; 2])>,
    /// Lines from anchors to where the ranges prefer them, metres.
    pub preferred_m: Vec<[[f64; 2]; 2]>,
    /// The walls: both ends of each, metres.
    pub walls_m: Vec<[[f64; 2]; 2]>,
    /// The image of the floor plan.
    pub plan: Option<Plan>,
    /// The true positions, a tag each.
    pub truth: Vec<Way>,
    /// The estimated positions, a method and tag each.
    pub series: Vec<Series>,
    /// In which space the errors are.
    pub errors: Errors,
    /// The first and the last time of the positions, seconds.
    pub times_s: Option<[f64; 2]>,
}

/// The true positions of a tag.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Way {
    /// The tag's name; empty where there is only one tag.
    pub tag: String,
    /// The positions in the order of time, metres.
    pub points_m: Vec<[f64; 2]>,
    /// Whether the tag dwelt at these points, and was not followed on its way from one to the next: they are drawn as
    /// crosses, each with a line to its estimates.
    pub are_dwells: bool,
}

/// The results of one method for one tag.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// The method's name.
    pub method: String,
    /// The tag's name; empty where there is only one tag.
    pub tag: String,
    /// The positions in the order of time.
    pub dots: Vec<Dot>,
    /// Distances from the true positions, metres.
    pub errors_m: Vec<f64>,
}

/// A position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Dot {
    /// Its coordinates, metres.
    pub at_m: [f64; 2],
    /// The true position at its time, metres.
    pub truth_m: Option<[f64; 2]>,
    /// The variance of x, the covariance of x and y, and the variance of y, m².
    pub covariance_m2: Option<[f64; 3]>,
}

/// The space of errors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Errors {
    /// Of x and y.
    Horizontal,
    /// Of x, y and z.
    Spatial,
    /// None: the residuals of ranges stand in their place.
    Residuals,
    /// Not known.
    #[default]
    Unknown,
}

impl Picture {
    /// The picture, drawn.
    pub fn draw(&self) -> Drawing {
        arrangement::draw(self)
    }

    fn has_errors(&self) -> bool {
        self.series.iter().any(|series| !series.errors_m.is_empty())
    }
}

impl Errors {
    /// The space of errors between positions and truth: in space where both have heights.
    pub fn between(positions_have_heights: bool, truth_has_heights: bool) -> Self {
        if positions_have_heights && truth_has_heights { Self::Spatial } else { Self::Horizontal }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Horizontal => "horizontal error (x, y)",
            Self::Spatial => "3-D error (x, y, z)",
            Self::Residuals => "residual of a range",
            Self::Unknown => "error",
        }
    }
}

impl Series {
    fn statistics(&self) -> Option<Statistics> {
        Statistics::of(&self.errors_m)
    }
}
