//! The result of an epoch: a position with its covariance, or why there is none. In which space it is.

use positioning_core::ble::fingerprint;
use positioning_core::engine::Missing;
use positioning_core::{Alternative, Flag, SolveError};

use crate::Coordinates;

/// The space in which to solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Space {
    /// In the plane. The tag's height gives the horizontal part of each range.
    Plane(Height),
    /// In space. The side of the anchors on which the tag is matters where all anchors lie in one plane. `None`: below
    /// the anchors, but the uncertainty reaches to the mirror image above.
    Full(Option<Half>),
}

/// The tag's height, for the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Height {
    /// Not known: ranges are treated as if they were in the plane.
    Unknown,
    /// A constant height, metres.
    Fixed(f64),
    /// The height of the true position of each epoch.
    FromTruth,
}

impl Space {
    /// The height that is given, where positions are in the plane.
    pub fn height(self) -> Height {
        match self {
            Self::Plane(height) => height,
            Self::Full(_) => Height::Unknown,
        }
    }
}

/// A side of the anchors' plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Half {
    /// Lower than the anchors.
    Below,
    /// Higher than the anchors.
    Above,
}

/// A position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// The coordinates; without a height in the plane.
    pub place: Coordinates,
    /// Standard deviation of each coordinate, metres.
    pub sigma: Coordinates,
    /// Covariance of x and y, m².
    pub covariance_xy: f64,
    /// Covariances of x and z and of y and z, m²; `None` in the plane.
    pub covariance_z: Option<[f64; 2]>,
    /// The velocity, metres per second, where the method has one; without a vertical part in the plane.
    pub velocity_m_s: Option<Coordinates>,
    /// The number of anchors whose ranges were used.
    pub used: usize,
    /// The second of two places that explain the ranges, if there are two: `place` is the likelier one, and the covariance
    /// reaches from it to the other.
    pub alternative: Option<Alternative<f64, 3>>,
    /// What makes the position doubtful beyond its covariance.
    pub flag: Option<Flag>,
}

/// Why there is no position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoPosition {
    /// The solver found no position.
    SolveError(SolveError),
    /// The height should come from the epoch's true position, which has no height.
    HeightUnknown,
    /// The track has no position.
    Missing(Missing),
    /// The RSSI map has no position for the scan.
    Unmatched(fingerprint::NoPosition),
}

impl NoPosition {
    /// The reason as written in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::SolveError(reason) => reason.as_str(),
            Self::HeightUnknown => "height-unknown",
            Self::Missing(reason) => reason.as_str(),
            Self::Unmatched(reason) => reason.as_str(),
        }
    }
}

/// The result of an epoch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solved {
    /// The position, or why there is none.
    pub outcome: Result<Position, NoPosition>,
    /// The distance from the true position, metres: in space where both have a height, else horizontal.
    pub error_m: Option<f64>,
}

impl Solved {
    /// An outcome, with its error where the true position is known.
    pub fn of(outcome: Result<Position, NoPosition>, truth: Option<Coordinates>) -> Self {
        let error_m = outcome.ok().zip(truth).map(|(position, truth)| position.place.distance_m(&truth));
        Self { outcome, error_m }
    }
}

impl Position {
    /// The variance of x, the covariance of x and y, and the variance of y, m².
    pub fn covariance_m2(&self) -> [f64; 3] {
        [self.sigma.x_m.powi(2), self.covariance_xy, self.sigma.y_m.powi(2)]
    }

    /// The squared horizontal error in units of its covariance. Its mean is 2 where the covariance is right. It is 1 on
    /// the 1σ ellipse. It is not finite without a covariance.
    pub fn normalised_square(&self, truth: &Coordinates) -> f64 {
        let (x, y) = (self.place.x_m - truth.x_m, self.place.y_m - truth.y_m);
        let [xx, xy, yy] = self.covariance_m2();
        (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)
    }
}

impl Coordinates {
    /// The horizontal distance between two positions, metres.
    pub fn horizontal_m(&self, other: &Self) -> f64 {
        (self.x_m - other.x_m).hypot(self.y_m - other.y_m)
    }

    /// The distance between two positions, metres: in space where both have a height, else horizontal.
    pub fn distance_m(&self, other: &Self) -> f64 {
        let up = self.z_m.zip(other.z_m).map_or(0.0, |(one, other)| one - other);
        ((self.x_m - other.x_m).powi(2) + (self.y_m - other.y_m).powi(2) + up.powi(2)).sqrt()
    }
}
