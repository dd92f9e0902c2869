//! The benchmark of E. García et al., *A Robust UWB Indoor Positioning System for Highly Complex Environments*: four
//! beacons at the coordinates of table I, 48 points at 1.57 m, a hundred measurements each, with and without
//! detection of blocked paths. The results are compared with table II.
//!
//! The paper's recordings are not available. [`channel`] simulates the impulse responses instead. The arrival is
//! detected in them as in the paper. The skewness of the same window (equation 2) classifies links as blocked or
//! direct (equations 3 and 4), with a threshold learnt from separate responses. Nothing else separates the two, and
//! no bias is added by hand: a blocked first path is late because it is late or missed in the simulated response.

pub mod channel;
mod table;

use baliza_report::{mean, rms};
use positioning_core::engine::{Dimensions, Engine, Measurement, Settings, Tdoa};
use positioning_core::nlos::{Classifier, Feature, Features, Skewness};
use positioning_core::{Area, Blocked, Motion, Noise, TdoaSample, hyperbolic};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use channel::{DrawnLink, FoundArrival};

pub use table::to_markdown;

/// Table I, metres.
pub const BEACONS_M: [[f64; 3]; 4] =
    [[-0.281, 4.19, 2.80], [-0.226, -1.39, 2.80], [7.14, -1.38, 2.81], [5.84, 2.09, 2.82]];
/// The antenna's height, metres.
pub const HEIGHT_M: f64 = 1.57;
/// Eight columns and six rows of points, every second floor tile of 0.4 m: metres. The paper shows its points in a
/// figure only.
pub const COLUMNS_M: [f64; 8] = [0.4, 1.2, 2.0, 2.8, 3.6, 4.4, 5.2, 6.0];
/// The rows.
pub const ROWS_M: [f64; 6] = [-1.2, -0.4, 0.4, 1.2, 2.0, 2.8];
/// Measurements at a point.
pub const MEASUREMENTS: usize = 100;
/// Share of the time in which a person or an object blocks a link: drawn for each link and point between these
/// bounds. "It is a dynamic and complex environment, where people, furniture and different objects obstruct the
/// arriving signals from most of the beacons."
pub const BLOCKED_SHARE: (f64, f64) = (0.1, 0.9);
/// Variance of the first position, m² (P₀ of the paper).
const START_VARIANCE: f32 = 20.0;
/// The room around the beacons, metres: a filter's first position outside of it is moved to its edge.
const AREA_M: Area<f32, 3> = Area { min: [-1.0, -2.0, 0.0], max: [8.0, 5.0, 3.0] };
/// Number of receptions of each kind from which the distributions of the skewness are learnt.
const LEARNT: usize = 4000;

/// How a position is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum BlockedTreatment {
    /// Gauss-Newton on every measurement by itself: "no mitigation" in the paper.
    NoMitigation,
    /// The paper's filter with all variances 0.5 m²: shows how much of the improvement is averaging.
    EkfWithoutDetection,
    /// The paper's filter with its variances, 0.5 and 3 m².
    Ekf,
    /// The same filter with this project's errors of links, weighted by the same detection.
    Calibrated,
}

impl BlockedTreatment {
    /// All, in the order of the table.
    pub const ALL: [Self; 4] = [Self::NoMitigation, Self::EkfWithoutDetection, Self::Ekf, Self::Calibrated];

    /// The name in the table.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::NoMitigation => "no mitigation",
            Self::EkfWithoutDetection => "EKF without detection",
            Self::Ekf => "EKF",
            Self::Calibrated => "calibrated",
        }
    }

    /// Table II, metres along x and y.
    pub fn printed_m(self) -> Option<[f64; 2]> {
        match self {
            Self::NoMitigation => Some([1.42, 0.85]),
            Self::Ekf => Some([0.43, 0.38]),
            Self::EkfWithoutDetection | Self::Calibrated => None,
        }
    }
}

/// Errors of one way over all points.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct TreatmentScore {
    /// The way.
    pub way: BlockedTreatment,
    /// Number of positions.
    pub positions: usize,
    /// Root mean square error along x, metres.
    pub rmse_x_m: f64,
    /// Root mean square error along y, metres.
    pub rmse_y_m: f64,
    /// Both together, metres.
    pub rmse_m: f64,
    /// Reduction of that error against no mitigation, 0 to 1.
    pub reduction: f64,
    /// Table II, metres.
    pub printed_x_m: Option<f64>,
    /// Table II, metres.
    pub printed_y_m: Option<f64>,
}

/// All results.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Experiment {
    /// One score a way.
    pub scores: Vec<TreatmentScore>,
    /// λ: the skewness at which direct and blocked are equally likely.
    pub threshold: f64,
    /// The share of receptions that were classified rightly.
    pub detected: f64,
    /// The errors along x and y of each way, metres, point after point.
    #[serde(skip)]
    pub errors_m: Vec<(BlockedTreatment, Vec<[f64; 2]>)>,
}

/// Measurements of all beacons at a point.
struct Point {
    at_m: [f64; 2],
    receptions: Vec<[FoundArrival; BEACONS_M.len()]>,
}

/// Runs the benchmark in this number of rooms, each with furniture of its own.
pub fn run(rooms: usize, seed: u64) -> Experiment {
    let detector = learn(&mut Pcg64Mcg::seed_from_u64(seed ^ 0x5EED));
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let points: Vec<Point> = (0..rooms).flat_map(|_| places()).map(|at_m| Point::draw(&mut random, at_m)).collect();
    let errors_m: Vec<_> = BlockedTreatment::ALL
        .into_iter()
        .map(|way| (way, points.iter().flat_map(|point| point.errors_m(way, &detector)).collect::<Vec<_>>()))
        .collect();
    let right = points.iter().flat_map(|point| point.receptions.iter().flatten()).map(|reception| {
        let blocked = blocked(&detector, reception).is_some_and(|p| p >= 0.5);
        f64::from(u8::from(blocked == reception.blocked))
    });
    let (told, all) = right.fold((0.0, 0.0), |(told, all), right| (told + right, all + 1.0));
    let bare = errors_m.first().map_or(f64::NAN, |(_, errors)| rms(errors.iter().flatten().copied()));
    let scores = errors_m.iter().map(|(way, errors)| TreatmentScore::of(*way, errors, bare)).collect();
    Experiment { scores, threshold: detector.threshold().into(), detected: told / all, errors_m }
}

/// The 48 points, metres.
fn places() -> impl Iterator<Item = [f64; 2]> {
    ROWS_M.iter().flat_map(|&y| COLUMNS_M.map(|x| [x, y]))
}

impl TreatmentScore {
    fn of(way: BlockedTreatment, errors: &[[f64; 2]], bare: f64) -> Self {
        let [x, y] = [0, 1].map(|axis| rms(errors.iter().map(|error| error[axis])));
        let printed = way.printed_m();
        Self {
            way,
            positions: errors.len(),
            rmse_x_m: x,
            rmse_y_m: y,
            rmse_m: x.hypot(y),
            reduction: 1.0 - rms(errors.iter().flatten().copied()) / bare,
            printed_x_m: printed.map(|[x, _]| x),
            printed_y_m: printed.map(|[_, y]| y),
        }
    }
}

/// Learns the skewness of direct and of blocked receptions, each from separate responses.
fn learn(random: &mut impl Rng) -> Skewness {
    let mut figures = |blocked: bool| {
        let skewness: Vec<f64> = (0..LEARNT)
            .map(|_| {
                let link = DrawnLink::draw(random);
                link.receive(random, 0.0, blocked).skewness
            })
            .collect();
        let mean = mean(skewness.iter().copied());
        let variance = skewness.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / LEARNT as f64;
        (mean, variance)
    };
    let (direct, blocked) = (figures(false), figures(true));
    Skewness {
        feature: Feature::Skewness,
        los_mean: direct.0 as f32,
        nlos_mean: blocked.0 as f32,
        deviation: (0.5 * (direct.1 + blocked.1)).sqrt() as f32,
    }
}

/// The probability that a reception was blocked, by its skewness alone.
fn blocked(detector: &Skewness, reception: &FoundArrival) -> Option<f32> {
    let mut features = Features::default();
    features.set(Feature::Skewness, reception.skewness as f32);
    detector.nlos_probability(&features)
}

impl Point {
    fn draw(random: &mut impl Rng, at_m: [f64; 2]) -> Self {
        let (least, most) = BLOCKED_SHARE;
        let links = BEACONS_M.map(|_| (DrawnLink::draw(random), random.random_range(least..most)));
        let receptions = (0..MEASUREMENTS)
            .map(|_| {
                std::array::from_fn(|i| {
                    let [x, y, z] = BEACONS_M[i];
                    let distance = ((at_m[0] - x).powi(2) + (at_m[1] - y).powi(2) + (HEIGHT_M - z).powi(2)).sqrt();
                    let (link, share) = &links[i];
                    let blocked = random.random_bool(*share);
                    link.receive(random, distance, blocked)
                })
            })
            .collect();
        Self { at_m, receptions }
    }

    /// The errors of all positions at this point, metres. Where there is no position, the middle of the beacons
    /// counts instead.
    fn errors_m(&self, way: BlockedTreatment, detector: &Skewness) -> Vec<[f64; 2]> {
        let middle = [0, 1].map(|axis| BEACONS_M.iter().map(|beacon| beacon[axis]).sum::<f64>() / 4.0);
        let error = |position: Option<[f32; 3]>| {
            let at = position.map_or(middle, |[x, y, _]| [x, y].map(f64::from));
            [at[0] - self.at_m[0], at[1] - self.at_m[1]]
        };
        let mut engine = match settings(way) {
            Some(settings) => Engine::new(settings),
            None => return self.receptions.iter().map(|set| error(gauss_newton(set))).collect(),
        };
        let mut errors = Vec::with_capacity(MEASUREMENTS);
        for (set, k) in self.receptions.iter().zip(1_u64..) {
            let now_us = 100_000 * k;
            for (i, place) in BEACONS_M.iter().enumerate().skip(1) {
                let tdoa = Tdoa {
                    anchor: i as u16,
                    position_m: place.map(|c| c as f32),
                    reference: 0,
                    reference_m: BEACONS_M[0].map(|c| c as f32),
                    difference_m: (set[i].distance_m - set[0].distance_m) as f32,
                    deviations_m: [channel::DIRECT_SIGMA_M; 2],
                    p_nlos: [blocked(detector, &set[0]), blocked(detector, &set[i])],
                };
                engine.step(now_us, &Measurement::Tdoa(tdoa));
            }
            let output = engine.step(now_us, &Measurement::RoundEnd);
            errors.push(error(output.fix.ok().map(|fix| fix.position)));
        }
        errors
    }
}

/// The engine of a way; `None` where there is no filter.
fn settings(way: BlockedTreatment) -> Option<Settings<f32>> {
    let dimensions = Dimensions::Plane { height: HEIGHT_M as f32 };
    // The paper uses no prediction: the tag does not move.
    let still = Motion::Static { wander: 0.0 };
    let plain = |blocked| Settings {
        start_variance: Some(START_VARIANCE),
        area: Some(AREA_M),
        lost: 1.0e3,
        ..Settings::plain(dimensions, still, blocked, 1)
    };
    match way {
        BlockedTreatment::NoMitigation => None,
        BlockedTreatment::EkfWithoutDetection => {
            Some(plain(Blocked::TwoVariances { threshold: 2.0, direct_m2: 0.5, blocked_m2: 0.5 }))
        }
        BlockedTreatment::Ekf => Some(plain(Blocked::TwoVariances { threshold: 0.5, direct_m2: 0.5, blocked_m2: 3.0 })),
        BlockedTreatment::Calibrated => {
            let noise =
                Noise { blocked_noise_sigma: channel::BLOCKED_SIGMA_M, link_seconds: 1.0e3, ..Noise::indoors() };
            let mut settings = Settings::track(dimensions).with_noise(noise);
            (settings.filter.motion, settings.area) = (still, Some(AREA_M));
            Some(settings)
        }
    }
}

/// The position from one set of differences, with equal weights for all beacons.
fn gauss_newton(set: &[FoundArrival; 4]) -> Option<[f32; 3]> {
    let sample = |i: usize| TdoaSample {
        anchor: BEACONS_M[i].map(|c| c as f32),
        difference: (set[i].distance_m - set[0].distance_m) as f32,
        sigma: 0.7,
    };
    let samples = [1, 2, 3].map(sample);
    let reference = BEACONS_M[0].map(|c| c as f32);
    hyperbolic(&samples, reference, 0.7, Some(HEIGHT_M as f32), None).ok().map(|fix| fix.position)
}
