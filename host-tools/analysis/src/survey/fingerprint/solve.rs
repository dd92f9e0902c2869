//! Positions of captures by maps: what `baliza ble fingerprint` does, with the node's own code in `f32` as on the
//! node.

use positioning_core::ble::fingerprint::{
    self, Map, MapError, Motion, Nearest, NeighbourError, OffsetFilter, Posterior, Receiver, Vicinity, Walk, locate,
};
use positioning_core::ble::particles::{ON_HOST, ParticleFilter, Settings, Towards};
use positioning_core::ble::path_loss::Wall;

use super::comparison::Comparison;
use super::maps::Maps;
use super::survey::{Average, scan};
use super::windows::{Window, windows};
use crate::locate::ble::walk_clock::{WalkClock, is_stay};
use recording::beacons::{self, Capture, in_order};
use recording::{Coordinates, NoPosition, Position, Solved};

/// Deviation of a single RSSI, dB, to which the receiver's offset is compared.
const LEVEL_DB: f32 = 3.0;
/// Room for the points of a lattice.
const ROOM: usize = 1000;
/// Fixed seed: equal captures give equal positions.
const SEED: u64 = 1;

/// Options of the solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setup<'a> {
    /// How the RSSI values of a capture become one.
    pub average: Average,
    /// Standard deviation of the receiver's offset against the surveyor's receiver, the same for all beacons, dB.
    pub offset_db: f64,
    /// Sends the comparison's positions through the particle filter, one in each window of this number of seconds.
    /// The position of a capture is the last one of the filter, or of a stay the mean of all.
    pub particles_s: Option<f64>,
    /// Walls that are barriers for the walk and for particles.
    pub walls: &'a [beacons::Wall],
}

impl Default for Setup<'_> {
    fn default() -> Self {
        Self { average: Average::default(), offset_db: 4.0, particles_s: None, walls: &[] }
    }
}

/// Solves captures with the maps of one site.
#[derive(Clone, Copy, Debug)]
pub struct Solver<'a> {
    /// The maps.
    pub maps: &'a Maps,
    /// The options.
    pub setup: &'a Setup<'a>,
}

impl Solver<'_> {
    /// The positions of captures, in their order, and their errors where the true position is known.
    ///
    /// # Errors
    /// The maps lack the one that the comparison reads.
    pub fn solve(&self, comparison: Comparison, captures: &[Capture]) -> Result<Vec<Solved>, MapError> {
        let (origin_m, map) = self.maps.map(comparison)?.about_its_origin();
        let excess = self.maps.excess(comparison);
        let mut way = Way::new(self, comparison, map, origin_m);
        let mut solved = vec![None; captures.len()];
        for at in in_order(captures) {
            let outcome = way.position(&captures[at]).map_err(NoPosition::Unmatched).map(|found| {
                let [x_m, y_m] = [0, 1].map(|axis: usize| f64::from(found.position[axis]) + origin_m[axis]);
                let [xx, xy, yy] = found.covariance.map(|entry| excess * f64::from(entry));
                let sigma = Coordinates { x_m: xx.max(0.0).sqrt(), y_m: yy.max(0.0).sqrt(), z_m: None };
                Position {
                    place: Coordinates { x_m, y_m, z_m: None },
                    sigma,
                    covariance_xy: xy,
                    covariance_z: None,
                    velocity_m_s: None,
                    alternative: None,
                    flag: None,
                    used: found.used,
                }
            });
            solved[at] = Some(captures[at].solved(outcome));
        }
        Ok(solved.into_iter().flatten().collect())
    }
}

const UNHEARD: fingerprint::NoPosition = fingerprint::NoPosition::Unheard;

/// State that is kept from capture to capture, all of one receiver.
struct Way<'a> {
    beacons: &'a [String],
    setup: &'a Setup<'a>,
    comparison: Comparison,
    map: Map<'a>,
    /// The errors of positions by neighbours.
    errors: Option<NeighbourError<f32>>,
    /// Walls in the map's metres.
    walls: Vec<Wall<f32>>,
    /// The receiver, whose offset is learnt from one capture to the next.
    receiver: Receiver<f32>,
    learnt_us: u64,
    /// The receiver as a tag learns it, for the process without memory.
    offset: OffsetFilter<f32>,
    timeline: WalkClock,
    walk: Walk<f32, ROOM>,
    particles: Particles,
}

impl<'a> Way<'a> {
    fn new(solver: &Solver<'a>, comparison: Comparison, map: Map<'a>, origin_m: [f64; 2]) -> Self {
        let Solver { maps, setup } = *solver;
        let local = |end: [f64; 2]| [0, 1].map(|axis: usize| (end[axis] - origin_m[axis]) as f32);
        let barrier = |wall: &beacons::Wall| Wall { ends: wall.ends_m.map(local), attenuation: 0.0 };
        let receiver = Receiver { offset_deviation_db: setup.offset_db as f32, ..Receiver::default() };
        let errors = match comparison {
            Comparison::Nearest { k, weighted } => nearest(k, weighted, &receiver).left_out(&map),
            Comparison::Process | Comparison::Walk => None,
        };
        Self {
            beacons: maps.beacons(),
            setup,
            comparison,
            map,
            errors,
            walls: setup.walls.iter().map(barrier).collect(),
            receiver,
            learnt_us: 0,
            offset: OffsetFilter::new(receiver),
            timeline: WalkClock::default(),
            walk: Walk::new(),
            particles: Particles::new(),
        }
    }

    fn position(&mut self, capture: &Capture) -> Result<Found, fingerprint::NoPosition> {
        if capture.samples.is_empty() {
            return Err(UNHEARD);
        }
        let (now_us, goes_on) = self.timeline.next(capture);
        if !goes_on {
            // The time of a walk begins with its first capture.
            self.walk = if now_us > 0 { Walk::since(0) } else { Walk::new() };
            self.particles = Particles::new();
            self.offset.leave();
        }
        let scan = single_precision(scan(self.beacons, &capture.samples, self.setup.average));
        let before = match self.comparison {
            Comparison::Process => *self.offset.receiver(),
            Comparison::Nearest { .. } | Comparison::Walk => self.receiver,
        };
        let found = match self.comparison {
            Comparison::Walk => {
                let step = self.walk.step(&self.map, &scan, &before, &Motion::default(), &self.walls, now_us);
                step.map(Found::from)
            }
            Comparison::Nearest { .. } | Comparison::Process => self.at_once(&scan, &before),
        };
        if let Ok(found) = &found {
            self.learn(&scan, found, now_us, goes_on);
        }
        match (self.comparison, self.setup.particles_s) {
            (Comparison::Walk, _) | (_, None) => found,
            (Comparison::Nearest { .. } | Comparison::Process, Some(window_s)) => {
                let (mut last, mut mean) = (Err(UNHEARD), Mean::default());
                for Window { before_us, scan } in windows(self.beacons, capture, window_s, self.setup.average) {
                    let found = self.at_once(&single_precision(scan), &before);
                    let now_us = now_us.saturating_sub(before_us);
                    last = found.map(|found| mean.add(self.particles.step(now_us, found, &self.walls))).or(last);
                }
                last.map(|last| if is_stay(capture) { mean.of(last) } else { last })
            }
        }
    }

    /// The position of one scan by itself.
    fn at_once(&self, scan: &[Option<f32>], receiver: &Receiver<f32>) -> Result<Found, fingerprint::NoPosition> {
        match self.comparison {
            Comparison::Nearest { k, weighted } => {
                let scan: Vec<_> = scan.iter().map(|rssi| rssi.map(|rssi| rssi - receiver.offset_db)).collect();
                let found = nearest(k, weighted, receiver).locate(&self.map, &scan)?;
                Ok(Found::of(found, receiver, self.map.beacons(), self.errors))
            }
            Comparison::Process | Comparison::Walk => locate(&self.map, scan, receiver).map(Found::from),
        }
    }

    /// Learns the receiver's offset, but not from scans in quick succession: they have the same shadows, which would
    /// be taken for an offset. A walk learns by itself, and only tells the next walk.
    fn learn(&mut self, scan: &[Option<f32>], found: &Found, now_us: u64, goes_on: bool) {
        let fading_us = (Motion::<f64>::default().fading_s * 1.0e6) as u64;
        if goes_on && self.comparison != Comparison::Walk && now_us.saturating_sub(self.learnt_us) < fading_us {
            return;
        }
        self.learnt_us = now_us;
        match self.comparison {
            // A scan that has a position can be learnt from.
            Comparison::Process => drop(self.offset.learn(&self.map, scan, 0.0, now_us)),
            Comparison::Nearest { .. } | Comparison::Walk => {
                self.receiver.set_offset(found.offset_db, found.offset_deviation_db);
            }
        }
    }
}

/// A comparison with neighbours for this receiver.
fn nearest(k: usize, weighted: bool, receiver: &Receiver<f32>) -> Nearest<f32> {
    Nearest { neighbours: k, weighted, offset: receiver.offset_deviation_db / LEVEL_DB }
}

fn single_precision(scan: Vec<Option<f64>>) -> Vec<Option<f32>> {
    scan.into_iter().map(|rssi| rssi.map(|rssi| rssi as f32)).collect()
}

/// A position in the map's metres, and the offset of the receiver that it implies.
#[derive(Clone, Copy, Debug)]
struct Found {
    position: [f32; 2],
    covariance: [f32; 3],
    used: usize,
    offset_db: f32,
    offset_deviation_db: f32,
}

impl Found {
    /// The offset from neighbours: their mean differences, with the uncertainty of a mean of `beacons` RSSI values.
    fn of(
        vicinity: Vicinity<f32>,
        before: &Receiver<f32>,
        beacons: usize,
        errors: Option<NeighbourError<f32>>,
    ) -> Self {
        let precision = beacons as f32 / LEVEL_DB.powi(2) + before.offset_deviation_db.powi(-2);
        Self {
            position: vicinity.position,
            covariance: vicinity.covariance(errors),
            used: vicinity.heard,
            offset_db: before.offset_db + vicinity.offset_db,
            offset_deviation_db: precision.sqrt().recip(),
        }
    }
}

impl From<Posterior<f32>> for Found {
    fn from(posterior: Posterior<f32>) -> Self {
        Self {
            position: posterior.position,
            covariance: posterior.covariance,
            used: posterior.heard,
            offset_db: posterior.offset_db,
            offset_deviation_db: posterior.offset_deviation_db,
        }
    }
}

/// The mean of a stay's positions: their distributions, each counted alike, are the particles' of the whole stay.
#[derive(Default)]
struct Mean {
    count: f32,
    first: [f32; 2],
    second: [f32; 3],
}

impl Mean {
    fn add(&mut self, found: Found) -> Found {
        let ([x, y], [xx, xy, yy]) = (found.position, found.covariance);
        self.count += 1.0;
        self.first = [self.first[0] + x, self.first[1] + y];
        self.second = [self.second[0] + xx + x * x, self.second[1] + xy + x * y, self.second[2] + yy + y * y];
        found
    }

    fn of(&self, last: Found) -> Found {
        let [x, y] = self.first.map(|sum| sum / self.count);
        let [xx, xy, yy] = self.second.map(|sum| sum / self.count);
        Found { position: [x, y], covariance: [xx - x * x, xy - x * y, yy - y * y], ..last }
    }
}

/// The particle filter of A. Linde Cerezo's thesis (equation 15) over the positions of a comparison.
struct Particles(Box<ParticleFilter<f32, ON_HOST>>);

impl Particles {
    fn new() -> Self {
        Self(Box::new(ParticleFilter::new(Settings::thesis(), SEED)))
    }

    fn step(&mut self, now_us: u64, found: Found, walls: &[Wall<f32>]) -> Found {
        let deviation = Settings::<f32>::thesis().position;
        if !self.0.is_started() {
            // Where there are walls, no particle begins behind one.
            let around = if walls.is_empty() { deviation } else { 0.0 };
            self.0.start_at(found.position, [around; 2]);
        }
        let towards = Towards { position: found.position, deviation };
        self.0.step(now_us, walls, &towards).map_or(found, |estimate| {
            let [[xx, xy], [_, yy]] = estimate.covariance;
            Found { position: estimate.position, covariance: [xx, xy, yy], ..found }
        })
    }
}
