//! Positions from the RSSI values of beacons whose positions and path losses are known: the methods of `baliza ble
//! solve`.
//!
//! The input is captures. A method without memory takes the mean of a capture's RSSI values (equation 14). A method
//! with memory processes the capture window by window, and the last position is the capture's position. The method
//! `engine` is the tag's own: its locator receives the advertisements one by one. All positions are relative to the
//! middle of the beacons, in `f32`. Equation numbers are those of A. Linde Cerezo's thesis (Universitat Oberta de
//! Catalunya, 2024).

mod follow;
pub(crate) mod walk_clock;

use baliza_report::mean;
use positioning_core::ble::beacon_monitor::HealthChange;
use positioning_core::ble::multilateration::{nonlinear, weighted_linear};
use positioning_core::ble::path_loss::{PathLoss, Wall};
use positioning_core::ble::posterior::{PosteriorSettings, posterior};
use positioning_core::ble::rssi::RssiObservation;
use positioning_core::ble::signal::ListedBeacon;
use positioning_core::{Area, Constraints, Fix, MAX_ANCHORS, Side, SolveError};

use self::follow::{Particles, Tag, listed};
use recording::beacons::{self as files, Beacon, Capture, Sample, in_order, rssis_by_beacon};
use recording::{Coordinates, NoPosition, Position, Solved};

/// The maximum number of beacons.
pub const MOST_BEACONS: usize = 64;

/// How RSSI values become a position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RssiMethod {
    /// Weighted linear least squares (equation 6).
    WeightedLinear,
    /// Nonlinear least squares in the RSSI values.
    Nonlinear,
    /// The posterior mean of the position.
    Posterior,
    /// The tag's locator: one position for each window.
    Engine,
    /// A particle filter over the RSSI values' likelihood, window by window.
    ParticleFilter,
}

impl RssiMethod {
    /// All methods.
    pub const ALL: [Self; 5] =
        [Self::WeightedLinear, Self::Nonlinear, Self::Posterior, Self::ParticleFilter, Self::Engine];

    /// The method's name.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::WeightedLinear => "weighted-linear",
            Self::Nonlinear => "nonlinear",
            Self::Posterior => "posterior",
            Self::Engine => "engine",
            Self::ParticleFilter => "particle-filter",
        }
    }
}

/// The settings of a solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeaconSetup {
    /// The window of integration, seconds.
    pub window_s: f64,
    /// The tag's height, metres, where it is known. The beacons' heights are used only if it is known.
    pub height_m: Option<f64>,
    /// The area in which the tag can be: least and greatest x and y, metres.
    pub area_m: Option<[[f64; 2]; 2]>,
    /// The standard deviation of the receiver's own offset, dB.
    pub offset_db: f64,
    /// The attenuation of a wall for which the file gives none, dB.
    pub wall_db: f64,
    /// Seed of the particles' random numbers.
    pub seed: u64,
}

impl Default for BeaconSetup {
    fn default() -> Self {
        Self { window_s: 0.5, height_m: None, area_m: None, offset_db: 2.0, wall_db: 0.0, seed: 1 }
    }
}

/// Solves captures with the same beacons.
#[derive(Debug)]
pub struct Solver<'a> {
    pub(super) beacons: &'a [Beacon],
    pub(super) setup: BeaconSetup,
    /// The kernels' origin of coordinates, metres.
    origin: [f64; 2],
    /// Barriers for particles. For signals, their attenuation counts.
    pub(super) walls: Vec<Wall<f32>>,
}

impl<'a> Solver<'a> {
    /// A solver for these beacons. Only the first [`MOST_BEACONS`] are used.
    pub fn new(beacons: &'a [Beacon], walls: &[files::Wall], setup: BeaconSetup) -> Self {
        let beacons = beacons.get(..MOST_BEACONS).unwrap_or(beacons);
        let origin = std::array::from_fn(|axis| {
            beacons.iter().map(|beacon| beacon.position_m[axis]).sum::<f64>() / beacons.len().max(1) as f64
        });
        let mut solver = Self { beacons, setup, origin, walls: Vec::new() };
        let wall = |wall: &files::Wall| Wall {
            ends: wall.ends_m.map(|end| solver.local(end)),
            attenuation: wall.attenuation_db.unwrap_or(setup.wall_db) as f32,
        };
        solver.walls = walls.iter().map(wall).collect();
        solver
    }

    /// The positions of all captures, in their order, with their errors where the true position is known, and the
    /// changes of the beacons' health that the engine found. The changes name beacons by their indices in the list.
    pub fn solve(&self, kernel: RssiMethod, captures: &[Capture]) -> (Vec<Solved>, Vec<HealthChange>) {
        let offset = self.setup.offset_db as f32;
        let solved = match kernel {
            RssiMethod::WeightedLinear => in_turn(captures, |capture| self.at_once(capture, weighted_linear)),
            RssiMethod::Nonlinear => in_turn(captures, |capture| {
                self.at_once(capture, |heard| nonlinear(heard, offset, &self.constraints()))
            }),
            RssiMethod::Posterior => {
                let belief = PosteriorSettings { offset_deviation: offset, ..PosteriorSettings::default() };
                in_turn(captures, |capture| {
                    self.at_once(capture, |heard| {
                        posterior(heard, &self.reach(), self.attenuating(), &belief).map(|found| found.fix)
                    })
                })
            }
            RssiMethod::ParticleFilter => {
                let mut particles = Particles::new(self);
                in_turn(captures, |capture| particles.follow(capture))
            }
            RssiMethod::Engine => {
                let list = listed(self);
                let list: &[ListedBeacon] = &list;
                let mut tag = Tag::new(self, &list);
                let solved = in_turn(captures, |capture| tag.follow(capture));
                return (solved, tag.news);
            }
        };
        (solved, Vec::new())
    }

    /// A kernel without memory, applied to the means of a capture's RSSI values.
    fn at_once(
        &self,
        capture: &Capture,
        kernel: impl FnOnce(&[RssiObservation<f32, 2>]) -> Result<Fix<f32, 2>, SolveError>,
    ) -> Result<Position, NoPosition> {
        let scan = means(self.beacons, &capture.samples);
        let mut heard = self.heard(&scan);
        loudest(&mut heard);
        let fix = kernel(&heard).map_err(NoPosition::SolveError)?;
        Ok(self.global(fix.position, &fix.covariance, fix.used.len()))
    }

    /// A scan, with the known parameters of the beacons.
    pub(super) fn heard(&self, scan: &[Option<f32>]) -> Vec<RssiObservation<f32, 2>> {
        let observation = |(beacon, rssi_dbm): (&Beacon, &Option<f32>)| {
            let (beacon_m, path_loss) = (self.local(beacon.position_m), path_loss(beacon));
            Some(RssiObservation { beacon_m, above_m: self.above_m(beacon), rssi_dbm: (*rssi_dbm)?, path_loss })
        };
        self.beacons.iter().zip(scan).filter_map(observation).collect()
    }

    /// The height of a beacon above the tag, metres; 0 where it is not known.
    pub(super) fn above_m(&self, beacon: &Beacon) -> f32 {
        beacon.height_m.zip(self.setup.height_m).map_or(0.0, |(beacon, tag)| beacon - tag) as f32
    }

    /// The walls, if at least one attenuates signals; else none.
    pub(super) fn attenuating(&self) -> &[Wall<f32>] {
        if self.walls.iter().any(|wall| wall.attenuation > 0.0) { &self.walls } else { &[] }
    }

    pub(super) fn constraints(&self) -> Constraints<f32, 2> {
        let area = self.setup.area_m.map(|corners| {
            let [min, max] = corners.map(|corner| self.local(corner));
            Area { min, max }
        });
        Constraints { side: Side::Unknown, area }
    }

    /// The area in which the tag can be: the configured area, else the box around the beacons.
    pub(super) fn reach(&self) -> Area<f32, 2> {
        /// The least reach of the box from its origin along each axis, metres.
        const LEAST_M: f32 = 0.5;
        self.constraints().area.unwrap_or_else(|| {
            let places = self.beacons.iter().map(|beacon| self.local(beacon.position_m));
            places.fold(Area { min: [-LEAST_M; 2], max: [LEAST_M; 2] }, |area, place| Area {
                min: std::array::from_fn(|axis| area.min[axis].min(place[axis])),
                max: std::array::from_fn(|axis| area.max[axis].max(place[axis])),
            })
        })
    }

    pub(super) fn local(&self, at_m: [f64; 2]) -> [f32; 2] {
        std::array::from_fn(|axis| (at_m[axis] - self.origin[axis]) as f32)
    }

    pub(super) fn global(&self, at: [f32; 2], covariance: &[[f32; 2]; 2], used: usize) -> Position {
        let [x_m, y_m] = std::array::from_fn(|axis| f64::from(at[axis]) + self.origin[axis]);
        let [sigma_x, sigma_y] = [0, 1].map(|axis: usize| f64::from(covariance[axis][axis]).sqrt());
        Position {
            place: Coordinates { x_m, y_m, z_m: None },
            sigma: Coordinates { x_m: sigma_x, y_m: sigma_y, z_m: None },
            covariance_xy: covariance[0][1].into(),
            covariance_z: None,
            velocity_m_s: None,
            alternative: None,
            flag: None,
            used,
        }
    }
}

/// The positions of all captures. They are computed in the order of time, and returned in the order of the file.
fn in_turn(captures: &[Capture], mut position: impl FnMut(&Capture) -> Result<Position, NoPosition>) -> Vec<Solved> {
    let mut solved = vec![None; captures.len()];
    for at in in_order(captures) {
        solved[at] = Some(captures[at].solved(position(&captures[at])));
    }
    solved.into_iter().flatten().collect()
}

/// Keeps the strongest RSSI values where there are more than a kernel can take.
pub(super) fn loudest(heard: &mut Vec<RssiObservation<f32, 2>>) {
    if heard.len() > MAX_ANCHORS {
        heard.sort_by(|a, b| b.rssi_dbm.total_cmp(&a.rssi_dbm));
        heard.truncate(MAX_ANCHORS);
    }
}

/// The known path loss of a beacon, with usual values where a parameter is not known.
pub fn path_loss(beacon: &Beacon) -> PathLoss<f32> {
    let usual = PathLoss::default();
    let known = |value: Option<f64>, usual: f32| value.map_or(usual, |value| value as f32);
    PathLoss {
        level_1m: known(beacon.rssi_1m_dbm, usual.level_1m),
        exponent: known(beacon.path_loss_exponent, usual.exponent),
        deviation: known(beacon.deviation_db, usual.deviation),
    }
}

/// The mean RSSI of every beacon, in the order of the beacons, dBm (equation 14). Values that no receiver can have
/// measured are left out.
pub fn means(beacons: &[Beacon], samples: &[Sample]) -> Vec<Option<f32>> {
    let heard = rssis_by_beacon(samples);
    beacons.iter().map(|beacon| Some(mean(heard.get(beacon.name.as_str())?.iter().copied()) as f32)).collect()
}
