//! The settings of the engine.

use crate::linalg::distance_squared;
use crate::linear::b_wls_in_parts;
use crate::link_error::Gaussian;
use crate::measurement::{Tdoa, probability};
use crate::track::state::State;
use crate::track::{Blocked, FilterSettings, Motion, Noise};
use crate::{Area, Constraints, Method, Real, Side, Solver};

/// The standard deviation of an area's outline, metres: outlines of buildings are drawn roughly.
const OUTLINE_SIGMA_M: f64 = 0.2;

/// Whether the engine keeps a state between rounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Mode {
    /// No state: every round is solved by itself, at its end.
    Solve,
    /// A track: every measurement changes it as it comes.
    Track,
}

/// The unknowns of the position.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Dimensions<T> {
    /// x and y of a tag at a known height.
    Plane {
        /// The height, metres.
        height: T,
    },
    /// x, y and z.
    Space {
        /// Which of two mirror images to take, where all anchors lie on a plane.
        side: Side<T, 3>,
    },
}

/// How a round is solved. It holds functions and not a [`Method`], so that an image contains only the methods that it
/// names.
#[derive(Clone, Copy, Debug)]
pub struct Solvers<T> {
    /// In the plane.
    pub plane: Solver<T, 2>,
    /// In space.
    pub space: Solver<T, 3>,
}

/// The methods that a tag's image contains, for a choice at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum NodeMethod {
    /// [`Method::Robust`].
    Robust,
    /// [`Method::BWls`].
    BWls,
    /// [`Method::BWlsR`].
    BWlsR,
    /// [`Method::BoundingBox`].
    BoundingBox,
}

impl NodeMethod {
    /// The corresponding [`Method`].
    pub const fn method(self) -> Method {
        match self {
            Self::Robust => Method::Robust,
            Self::BWls => Method::BWls,
            Self::BWlsR => Method::BWlsR,
            Self::BoundingBox => Method::BoundingBox,
        }
    }
}

impl Solvers<f32> {
    /// One of the methods that an image contains, compiled in this crate, as
    /// [`Engine::step_on_node`](super::Engine::step_on_node) is.
    #[inline(never)]
    pub fn on_node(method: NodeMethod) -> Self {
        match method {
            NodeMethod::Robust => Self::robust(),
            NodeMethod::BWls => Self { plane: b_wls_in_parts, space: b_wls_in_parts },
            NodeMethod::BWlsR => Self { plane: crate::b_wls_r, space: crate::b_wls_r },
            NodeMethod::BoundingBox => Self { plane: crate::bounding_box, space: crate::bounding_box },
        }
    }
}

impl<T: Real> Solvers<T> {
    /// The method `robust`.
    pub fn robust() -> Self {
        Self { plane: crate::robust, space: crate::robust }
    }

    /// Any method.
    pub fn of(method: Method) -> Self {
        Self { plane: method.solver(), space: method.solver() }
    }
}

/// The settings of the engine.
#[derive(Clone, Copy, Debug)]
pub struct Settings<T> {
    /// Whether the engine tracks.
    pub mode: Mode,
    /// The unknowns of the position.
    pub dimensions: Dimensions<T>,
    /// Standard deviation of the height of a tag in the plane, metres. With 0 the height is exact; else it is estimated
    /// as well, with this prior.
    pub height_sigma: T,
    /// How a round is solved: the first one of a track, and in [`Mode::Solve`] each one.
    pub solvers: Solvers<T>,
    /// The area where the tag can be. Solved positions stay inside; of two hypotheses, the one inside wins.
    pub area: Option<Area<T, 3>>,
    /// The settings of a track's filter.
    pub filter: FilterSettings<T>,
    /// Whether ranges are shortened by their `excess_m`. It is off by default: the excess learnt in one building is
    /// wrong in another (V. Barral et al. 2019, tables 4 and 5).
    pub mitigate: bool,
    /// Variance of the first position, m² per axis; `None`: that of the solved position, slightly increased.
    pub start_variance: Option<T>,
    /// A track is given up when its position is more uncertain than this, metres of standard deviation over all axes.
    pub lost: T,
    /// A track without measurements for this time is given up, microseconds.
    pub gap_us: u64,
    /// Whether a track that contradicts the solved rounds is started again.
    pub supervised: bool,
}

impl<T: Real> Settings<T> {
    /// The settings of a tag that tracks.
    pub fn track(dimensions: Dimensions<T>) -> Self {
        Self {
            mode: Mode::Track,
            dimensions,
            height_sigma: T::ZERO,
            solvers: Solvers::robust(),
            area: None,
            filter: FilterSettings {
                motion: Motion::Adaptive { calm: T::of(0.5), brisk: T::of(3.0) },
                noise: Noise::indoors(),
                blocked: Blocked::Weigh,
                iterations: 3,
                gate: T::of(4.0),
                patience_s: T::of(0.5),
                speed: T::of(0.7),
            },
            mitigate: false,
            start_variance: None,
            lost: T::of(5.0),
            gap_us: 10_000_000,
            supervised: true,
        }
    }

    /// The settings of a tag that solves every round by itself. The error of a range consists of its own deviation
    /// and that of its link. Solvers that know the radio's noise alone trust single links too much (`robust` on a
    /// recording: 0.15 m against 0.09 m).
    pub fn solve(dimensions: Dimensions<T>, solvers: Solvers<T>) -> Self {
        Self { mode: Mode::Solve, solvers, ..Self::track(dimensions) }
    }

    /// The textbook's filter: white noise, no gates, one hypothesis, and only the given `motion`, `blocked` and
    /// `iterations`.
    pub fn plain(dimensions: Dimensions<T>, motion: Motion<T>, blocked: Blocked<T>, iterations: u8) -> Self {
        let tracking = Self::track(dimensions);
        let (noise, gate) = (Noise::white(), T::of(1.0e6));
        let filter = FilterSettings { motion, blocked, iterations, noise, gate, ..tracking.filter };
        Self { filter, supervised: false, ..tracking }
    }

    /// The height of a tag in the plane.
    pub(crate) fn height(&self) -> Option<Gaussian<T>> {
        self.dimensions.height().map(|mean| Gaussian { mean, variance: self.height_sigma.squared() })
    }

    /// How far a track is outside of the area: the squared distance over the variances of the track and of the outline.
    #[inline(never)]
    pub(crate) fn outside(&self, state: &State<T>) -> T {
        let position = state.position();
        let nearest = Constraints { side: Side::Unknown, area: self.area }.inside(position);
        distance_squared(&position, &nearest) / (state.spread() + T::of(OUTLINE_SIGMA_M * OUTLINE_SIGMA_M))
    }

    /// Whether a measurement whose link is without line of sight with this probability is used, and not ignored.
    pub(crate) fn admits(&self, p_nlos: Option<T>) -> bool {
        match self.filter.blocked {
            Blocked::Ignore { threshold, .. } => probability(p_nlos) < threshold,
            Blocked::Alike | Blocked::TwoVariances { .. } | Blocked::Weigh => true,
        }
    }

    /// Whether a difference of arrivals may be used: both of its receptions may.
    pub(crate) fn admits_difference(&self, tdoa: &Tdoa<T>) -> bool {
        tdoa.p_nlos.iter().all(|&p_nlos| self.admits(p_nlos))
    }

    /// The same settings with this noise of the ranges.
    pub fn with_noise(self, noise: Noise<T>) -> Self {
        Self { filter: FilterSettings { noise, ..self.filter }, ..self }
    }

    /// The same settings with this treatment of a missing line of sight.
    pub fn with_blocked(self, blocked: Blocked<T>) -> Self {
        Self { filter: FilterSettings { blocked, ..self.filter }, ..self }
    }
}

impl<T: Copy> Dimensions<T> {
    /// The height, where it is known.
    pub(crate) fn height(&self) -> Option<T> {
        match self {
            Self::Plane { height } => Some(*height),
            Self::Space { .. } => None,
        }
    }
}
