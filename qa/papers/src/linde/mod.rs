//! The benchmark of A. Linde Cerezo's thesis (Universitat Oberta de Catalunya, 2024), annex A: four beacons at A, E,
//! H and J of table 4.1, a mesh of receivers in the middle of the room, RSSI values and times of flight with Gaussian
//! noise. Positions are computed by fingerprints and by multilateration.
//!
//! - RSSI (1): RSSI₀ − 10 n log₁₀(d ⁄ d₀) + N(0, σ²), RSSI₀ = −50 dBm at d₀ = 1 m, σ = 5 and 10 dB.
//! - Time of flight (2): ToF₀ + (d − d₀) ⁄ c + N(0, σ²), ToF₀ = 1 ms, σ = 100 µs: 30 km.
//!
//! The thesis prints these. We assume the rest: n = 2 where the beacon is in line of sight and 3 where a wall of
//! [`room`] is between, in the plane; the two meshes; a position from one measurement of each beacon; fingerprints
//! that are means of a hundred measurements (ten seconds, section 4.2), compared by the five nearest weighted by 1 ⁄
//! d² (7). Multilateration knows RSSI₀ and n = 2 and does not know which links are blocked.

pub mod room;
mod table;

use baliza_report::{Statistics, mean};
use positioning_core::ble::fingerprint::{Map, MapError, Nearest, Point, encode};
use positioning_core::ble::multilateration;
use positioning_core::ble::path_loss::{PathLoss, Wall};
use positioning_core::ble::rssi::RssiObservation;
use positioning_core::{Area, Constraints, Method, RangeSample, Side};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use accuracy::draw::normal;
use room::BEACONS_M;

pub use table::{name, to_markdown};

/// The RSSI at one metre, dBm.
const LEVEL_1M_DBM: f64 = -50.0;
/// n where the beacon is in line of sight, and where it is not.
const EXPONENTS: [f64; 2] = [2.0, 3.0];
/// The time of flight at one metre, seconds.
const TOF_1M_S: f64 = 1.0e-3;
/// Speed of light, metres a second.
const LIGHT_M_PER_S: f64 = 299_792_458.0;
/// Number of measurements in the mean of a fingerprint.
const SURVEYED: usize = 100;
/// Number of nearest fingerprints in a position.
const NEIGHBOURS: usize = 5;
/// A map holds RSSI values from −127.5 to −0.5 dBm. Times are mapped to values around the first number; the second
/// number is their deviation, in decibels.
const TOF_IN_MAP_DB: [f64; 2] = [-64.0, 20.0];
/// Least and greatest RSSI in a map, dBm.
const MAP_DBM: [f64; 2] = [-127.0, -0.5];
/// More bytes than the map needs: some 45 fingerprints of four beacons.
const MOST_BYTES: usize = 4096;

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parameter {
    /// RSSI values with this noise, dB.
    Rssi(f64),
    /// Times of flight with this noise, microseconds.
    Tof(f64),
}

/// What is measured, without the noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MeasuredParameter {
    /// RSSI values.
    Rssi,
    /// Times of flight.
    Tof,
}

/// How a position is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum RoomAlgorithm {
    /// The nearest fingerprints, weighted.
    Fingerprinting,
    /// Weighted linear least squares (6): for RSSI values [`multilateration::weighted_linear`], for times
    /// [`Method::BWls`].
    Multilateration,
    /// Nonlinear least squares within the box around the room: for RSSI values [`multilateration::nonlinear`], for
    /// times [`Method::Nls`].
    Nonlinear,
}

/// A row: what is measured, how it is solved, and RMSE and MAE as the annex prints them, metres.
pub type Row = (Parameter, RoomAlgorithm, Option<[f64; 2]>);

/// The value in the rows where the annex prints "> 5 m", metres.
pub const PRINTED_MOST_M: f64 = 5.0;

/// The rows of the annex, each with the nonlinear form added.
pub const ROWS: [Row; 9] = [
    (Parameter::Rssi(5.0), RoomAlgorithm::Fingerprinting, Some([1.32, 0.86])),
    (Parameter::Rssi(5.0), RoomAlgorithm::Multilateration, Some([2.08, 1.09])),
    (Parameter::Rssi(5.0), RoomAlgorithm::Nonlinear, None),
    (Parameter::Rssi(10.0), RoomAlgorithm::Fingerprinting, Some([1.6, 1.17])),
    (Parameter::Rssi(10.0), RoomAlgorithm::Multilateration, Some([2.24, 1.39])),
    (Parameter::Rssi(10.0), RoomAlgorithm::Nonlinear, None),
    (Parameter::Tof(100.0), RoomAlgorithm::Fingerprinting, Some([2.14, 1.75])),
    (Parameter::Tof(100.0), RoomAlgorithm::Multilateration, Some([PRINTED_MOST_M; 2])),
    (Parameter::Tof(100.0), RoomAlgorithm::Nonlinear, None),
];

/// The errors of one row.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RoomScore {
    /// What was measured.
    pub parameter: MeasuredParameter,
    /// Deviation of a measurement.
    pub noise: f64,
    /// Its unit: `dB` or `us`.
    pub unit: &'static str,
    /// How positions were computed.
    pub algorithm: RoomAlgorithm,
    /// Root mean square error, metres; none without positions.
    pub rmse_m: Option<f64>,
    /// Mean error, metres.
    pub mae_m: Option<f64>,
    /// The share of measurements with a position.
    pub answered: f64,
    /// The annex' root mean square error, metres; 5 is "> 5".
    pub printed_rmse_m: Option<f64>,
    /// The annex' mean error, metres; 5 is "> 5".
    pub printed_mae_m: Option<f64>,
}

/// The result of a row: the score, and the errors in order, metres.
pub type Scored = (RoomScore, Vec<f64>);

/// Runs all rows, with this number of trials for every receiver. Rows of one parameter have the same measurements.
///
/// # Errors
/// A survey makes no map.
pub fn run(trials: u32, seed: u64) -> Result<Vec<Scored>, MapError> {
    let walls = room::walls();
    ROWS.into_iter()
        .map(|(parameter, algorithm, printed)| {
            let mut random = Pcg64Mcg::seed_from_u64(seed);
            let bytes = parameter.survey(&mut random, &walls)?;
            let (map, _) = Map::decode(&bytes)?;
            let (mut errors, mut tried) = (Vec::new(), 0_usize);
            for at in room::receivers() {
                for _ in 0..trials {
                    let measured = BEACONS_M.map(|beacon| parameter.measure(&mut random, &walls, beacon, at));
                    let found = parameter.locate(algorithm, &map, &measured);
                    errors.extend(found.map(|[x, y]| (x - at[0]).hypot(y - at[1])));
                    tried += 1;
                }
            }
            Ok((RoomScore::of(parameter, algorithm, printed, &errors, tried), errors))
        })
        .collect()
}

/// The share of links between receivers and beacons that a wall blocks.
pub fn blocked() -> f64 {
    let (walls, receivers) = (room::walls(), room::receivers());
    let links = receivers.iter().flat_map(|&at| BEACONS_M.map(|beacon| !room::in_sight(&walls, beacon, at)));
    links.filter(|blocked| *blocked).count() as f64 / (receivers.len() * BEACONS_M.len()) as f64
}

/// RMSE and MAE of the mean of all receivers, metres: the errors without any measurement.
pub fn unmeasured() -> [f64; 2] {
    let receivers = room::receivers();
    let middle = [0, 1].map(|axis| mean(receivers.iter().map(|at| at[axis])));
    let errors: Vec<f64> = receivers.iter().map(|at| (at[0] - middle[0]).hypot(at[1] - middle[1])).collect();
    Statistics::of(&errors).map_or([f64::NAN; 2], |figures| [figures.rmse, figures.mae])
}

impl RoomScore {
    fn of(
        parameter: Parameter,
        algorithm: RoomAlgorithm,
        printed: Option<[f64; 2]>,
        errors: &[f64],
        tried: usize,
    ) -> Self {
        let figures = Statistics::of(errors);
        let (measured, noise, unit) = match parameter {
            Parameter::Rssi(db) => (MeasuredParameter::Rssi, db, "dB"),
            Parameter::Tof(us) => (MeasuredParameter::Tof, us, "us"),
        };
        Self {
            parameter: measured,
            noise,
            unit,
            algorithm,
            rmse_m: figures.map(|figures| figures.rmse),
            mae_m: figures.map(|figures| figures.mae),
            answered: errors.len() as f64 / tried.max(1) as f64,
            printed_rmse_m: printed.map(|[rmse, _]| rmse),
            printed_mae_m: printed.map(|[_, mae]| mae),
        }
    }
}

impl Parameter {
    /// One measurement: an RSSI, dBm, or a time, seconds.
    fn measure(self, random: &mut impl Rng, walls: &[Wall<f64>], beacon: [f64; 2], at: [f64; 2]) -> f64 {
        let distance = (at[0] - beacon[0]).hypot(at[1] - beacon[1]);
        match self {
            Self::Rssi(sigma_db) => {
                let [direct, blocked] = EXPONENTS;
                let exponent = if room::in_sight(walls, beacon, at) { direct } else { blocked };
                let path_loss = PathLoss { level_1m: LEVEL_1M_DBM, exponent, deviation: sigma_db };
                path_loss.rssi(distance) + sigma_db * normal(random)
            }
            Self::Tof(sigma_us) => TOF_1M_S + (distance - 1.0) / LIGHT_M_PER_S + 1.0e-6 * sigma_us * normal(random),
        }
    }

    /// A measurement as the map stores it, dBm.
    fn in_map(self, measured: f64) -> f64 {
        let rssi = match self {
            Self::Rssi(_) => measured,
            Self::Tof(sigma_us) => {
                let [middle, deviation] = TOF_IN_MAP_DB;
                middle - deviation * (measured - TOF_1M_S) / (1.0e-6 * sigma_us)
            }
        };
        let [least, most] = MAP_DBM;
        rssi.clamp(least, most)
    }

    /// The bytes of a map of fingerprints.
    fn survey(self, random: &mut impl Rng, walls: &[Wall<f64>]) -> Result<Vec<u8>, MapError> {
        let surveyed = room::fingerprints().into_iter().map(|position_m| {
            let rssis = BEACONS_M.map(|beacon| {
                let sum: f64 = (0..SURVEYED).map(|_| self.measure(random, walls, beacon, position_m)).sum();
                Some(self.in_map(sum / SURVEYED as f64))
            });
            (position_m, rssis)
        });
        let surveyed: Vec<_> = surveyed.collect();
        let points: Vec<Point> = surveyed
            .iter()
            .map(|(position_m, rssis)| Point { position_m: *position_m, rssis, deviations: &[] })
            .collect();
        let [least, _] = MAP_DBM;
        let mut buffer = vec![0; MOST_BYTES];
        encode(&points, &[0, 4, 7, 9], &[least; BEACONS_M.len()], None, &mut buffer).map(<[u8]>::to_vec)
    }

    /// A position from one measurement of each beacon; `None` where the algorithm finds none.
    fn locate(self, algorithm: RoomAlgorithm, map: &Map<'_>, measured: &[f64; BEACONS_M.len()]) -> Option<[f64; 2]> {
        let [min, max] = room::BOX_M;
        let within = Constraints { side: Side::Unknown, area: Some(Area { min, max }) };
        let solve = |method, constraints: &Constraints<f64, 2>| {
            // A distance is not negative, even if the measured time is too short.
            let range = |time: f64| (1.0 + (time - TOF_1M_S) * LIGHT_M_PER_S).max(0.0);
            let samples: [_; BEACONS_M.len()] =
                std::array::from_fn(|i| RangeSample::new(BEACONS_M[i], range(measured[i])));
            positioning_core::solve(method, &samples, constraints).ok().map(|fix| fix.position)
        };
        let heard = |deviation| -> [RssiObservation<f64, 2>; BEACONS_M.len()] {
            let path_loss = PathLoss { level_1m: LEVEL_1M_DBM, exponent: EXPONENTS[0], deviation };
            std::array::from_fn(|i| RssiObservation {
                beacon_m: BEACONS_M[i],
                above_m: 0.0,
                rssi_dbm: measured[i],
                path_loss,
            })
        };
        match (algorithm, self) {
            (RoomAlgorithm::Fingerprinting, _) => {
                let nearest = Nearest { neighbours: NEIGHBOURS, weighted: true, offset: 0.0 };
                let scan = measured.map(|measured| Some(self.in_map(measured)));
                nearest.locate(map, &scan).ok().map(|vicinity| vicinity.position)
            }
            (RoomAlgorithm::Multilateration, Self::Rssi(sigma_db)) => {
                multilateration::weighted_linear(&heard(sigma_db)).ok().map(|fix| fix.position)
            }
            (RoomAlgorithm::Nonlinear, Self::Rssi(sigma_db)) => {
                multilateration::nonlinear(&heard(sigma_db), 0.0, &within).ok().map(|fix| fix.position)
            }
            (RoomAlgorithm::Multilateration, Self::Tof(_)) => solve(Method::BWls, &Constraints::default()),
            (RoomAlgorithm::Nonlinear, Self::Tof(_)) => solve(Method::Nls, &within),
        }
    }
}
