//! What a tag makes of its rounds, and by what: the engine's settings, the places of the anchors; positions with their covariance.

use heapless::Vec;
use positioning_core::ble::beacon_monitor::Known;
use positioning_core::engine::{Dimensions, NodeMethod, Settings, Solvers};
use positioning_core::nlos::Classifier;
use positioning_core::{Noise, Real, Side, SolveError};
use wire::config::Solver;

use crate::{HEARS_BEACONS, KnownBeacons, LoadedModels, Measured, Sounding};

/// A track by beacons that has become more uncertain than this is given up, metres, all axes together.
const LOST_AMONG_BEACONS_M: f32 = 10.0;

/// An anchor that the tag knows of by its configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AnchorPlace {
    /// Its short address.
    pub address: u16,
    /// Where it stands, metres.
    pub position_m: [f32; 3],
}

/// A position is sure that deviates by less, metres an axis: a tenth of what RSSI values tell.
const SURE_M: f32 = 0.3;

/// How a tag makes positions.
#[derive(Clone)]
pub struct Locator<'a> {
    /// How the engine is to work.
    pub settings: Settings<f32>,
    /// What that is called.
    pub solver: Solver,
    /// Places known by configuration; they count more than what the anchors say of themselves.
    pub anchors: &'a [AnchorPlace],
    /// What tells blocked links; `None`: their powers.
    pub model: Option<&'a dyn Classifier>,
    /// Beacons by whose RSSI values it finds itself as well, where it follows a track.
    pub beacons: KnownBeacons<'a>,
    /// What it knows of their RSSI values on the spot.
    pub surveyed: Option<&'a LoadedModels<'a>>,
}

/// What became of one round, or of a window of RSSI values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Epoch<'a> {
    /// The round with its ranges or differences, or the RSSI values.
    pub measured: Measured<'a>,
    /// When its poll left or came, or its window ended, since the node started, microseconds: the time of the position.
    pub poll_us: u64,
    /// The position, or why there is none.
    pub outcome: Result<Position, SolveError>,
    /// The impulse response of its last frame, where it was read.
    pub sounding: Option<&'a Sounding>,
    /// What made the position.
    pub solver: Solver,
}

/// A position in space; a tag at a known height has that height, and no variance in z.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Position {
    /// Metres, in the anchors' frame.
    pub position_m: [f32; 3],
    /// Covariance, m²; zero in the row and column of a height that was given.
    pub covariance_m2: [[f32; 3]; 3],
    /// What of the round went into it: bit i is the i-th range, difference or RSSI.
    pub used: u16,
    /// How far the round agrees with it, 0 to 1.
    pub quality: f32,
}

/// The method by which a tag with this solver solves each round by itself; `None`: it follows a track.
pub const fn method(solver: Solver) -> Option<NodeMethod> {
    match solver {
        Solver::Track => None,
        Solver::Robust => Some(NodeMethod::Robust),
        Solver::BWls => Some(NodeMethod::BWls),
        Solver::BWlsR => Some(NodeMethod::BWlsR),
        Solver::BoundingBox => Some(NodeMethod::BoundingBox),
    }
}

/// Where the anchors of a record stand, for a locator.
pub fn places(record: &wire::config::Record) -> Vec<AnchorPlace, { wire::config::MAX_ANCHORS }> {
    record.anchors.iter().map(|anchor| AnchorPlace { address: anchor.address, position_m: anchor.position_m }).collect()
}

impl<'a> Locator<'a> {
    /// That of a tag at this height, metres, or anywhere in space; ranges are doubted by their powers.
    ///
    /// A track is followed, so that a round with one answer is still a position; [`by`](Self::by) chooses otherwise.
    pub fn new(height_m: Option<f32>, anchors: &'a [AnchorPlace]) -> Self {
        let dimensions = match height_m {
            Some(height) => Dimensions::Plane { height },
            None => Dimensions::Space { side: Side::Unknown },
        };
        let solvers = Solvers::on_node(NodeMethod::Robust);
        let settings = Settings { noise: Noise::by_powers(), solvers, ..Settings::track(dimensions) };
        Self {
            settings,
            solver: Solver::Track,
            anchors,
            model: None,
            beacons: KnownBeacons::new(&[], None),
            surveyed: None,
        }
    }

    /// The same, by this solver.
    pub fn by(self, solver: Solver) -> Self {
        let locator = match method(solver) {
            None => self,
            Some(method) => self.solving(Solvers::on_node(method)),
        };
        Self { solver, ..locator }
    }

    /// The same, that solves each round by itself.
    pub fn solving(self, solvers: Solvers<f32>) -> Self {
        let Settings { noise, dimensions, .. } = self.settings;
        Self { settings: Settings { noise, ..Settings::solve(dimensions, solvers) }, ..self }
    }

    /// That of a tag with this record.
    pub fn of(tag: &wire::config::Tag, record: &'a wire::config::Record, anchors: &'a [AnchorPlace]) -> Self {
        let locator = Self::new(tag.height_m, anchors).by(tag.solver);
        if HEARS_BEACONS { locator.with_beacons(KnownBeacons::of(record)) } else { locator }
    }

    /// Has this classifier, where there is one, tell blocked links.
    pub fn with_model(mut self, model: Option<&'a impl Classifier>) -> Self {
        self.model = model.map(|model| model as _);
        if model.is_some() {
            self.settings.noise = Noise::by_model();
        }
        self
    }

    /// The same, that knows this of beacons' RSSI values on the spot.
    pub fn with_surveyed(self, surveyed: &'a LoadedModels<'a>) -> Self {
        Self { surveyed: Some(surveyed), ..self }
    }

    /// The same, that listens for these beacons. By them alone a track is uncertain by metres, and no less a track.
    pub fn with_beacons(self, beacons: KnownBeacons<'a>) -> Self {
        let lost = if beacons.listed().is_empty() { self.settings.lost } else { LOST_AMONG_BEACONS_M };
        Self { settings: Settings { lost, ..self.settings }, beacons, ..self }
    }
}

impl Position {
    /// Standard deviation along each axis, metres.
    pub fn deviation_m(&self) -> [f32; 3] {
        core::array::from_fn(|axis| Real::sqrt(self.covariance_m2[axis][axis]))
    }

    /// Where the tag is, if that is sure enough to tell by it what RSSI values err by.
    pub(crate) fn sure(&self) -> Option<Known<f32>> {
        let ([x, y, _], [[xx, ..], [_, yy, _], _]) = (self.position_m, self.covariance_m2);
        let variance = xx.max(yy);
        (variance <= SURE_M * SURE_M).then_some(Known { position: [x, y], variance })
    }

    /// Whether the height was given and not found.
    pub fn height_is_given(&self) -> bool {
        self.covariance_m2[2][2] == 0.0
    }
}
