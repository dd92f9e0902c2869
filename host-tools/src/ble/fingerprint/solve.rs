//! Positions of captures by a survey: what `baliza ble fingerprint` does, with the node's own code in the node's own `f32`.

use std::collections::{BTreeMap, BTreeSet};

use positioning_core::ble::fingerprint::{
    self, Fault, MAX_NEIGHBOURS, Map, Motion, Nearest, Posterior, Receiver, Vicinity, Walk, locate,
};
use positioning_core::ble::particles::{ON_HOST, ParticleFilter, Settings, Towards};

use super::chart::{Grid, chart};
use super::process::{Kernel, Process};
use super::survey::{Average, Survey, scan};
use super::trend::{Plan, Trend};
use super::windows::{Window, span_s, windows};
use crate::ble::files::{Capture, Stay};
use crate::{NoPosition, Place, Position, Solved};

/// Captures that follow each other sooner than this are of one walk, seconds.
const ONE_WALK_S: f64 = 2.0;
/// Deviation of a single level, dB, that an offset of all is compared with.
const LEVEL_DB: f32 = 3.0;
/// Room for the points of a lattice.
const ROOM: usize = 1000;
/// Equal captures give equal positions.
const SEED: u64 = 1;

/// How a scan is compared with a survey.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Comparison {
    /// With the K nearest points (7).
    Nearest {
        /// K, 1 to [`MAX_NEIGHBOURS`].
        k: usize,
        /// By the inverse square of their distances, or alike.
        weighted: bool,
    },
    /// With a Gaussian process on a lattice.
    Process,
    /// The same, from scan to scan.
    Walk,
}

impl Comparison {
    /// The thesis' neighbours, weighted and plain, and both uses of the process.
    pub fn all() -> Vec<Self> {
        let nearest = [true, false].into_iter().flat_map(|weighted| [3, 4, 5].map(|k| Self::Nearest { k, weighted }));
        nearest.chain([Self::Process, Self::Walk]).collect()
    }

    /// Its name; those of neighbours are the thesis' (table 4.4).
    pub fn name(self) -> String {
        match self {
            Self::Nearest { k, weighted: true } => format!("w{k}nn"),
            Self::Nearest { k, weighted: false } => format!("{k}nn"),
            Self::Process => "gp".to_owned(),
            Self::Walk => "gp-walk".to_owned(),
        }
    }

    /// K, where there is one.
    pub fn k(self) -> Option<usize> {
        match self {
            Self::Nearest { k, .. } => Some(k.clamp(1, MAX_NEIGHBOURS)),
            Self::Process | Self::Walk => None,
        }
    }
}

/// How captures are solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setup<'a> {
    /// How the levels of a capture become one.
    pub average: Average,
    /// By how much the receiver may hear all beacons louder or weaker than the surveyor's did, dB (deviation).
    pub offset_db: f64,
    /// The lattice of the process.
    pub grid: Grid,
    /// Send the comparison's positions through the particle filter (15), one a window of so many seconds; the position of a capture
    /// is the filter's last one.
    pub particles_s: Option<f64>,
    /// Levels are expected to follow path loss from these beacons through these walls, where nothing was measured nearby; without a
    /// plan, to be the same everywhere.
    pub plan: Option<&'a Plan>,
}

impl Default for Setup<'_> {
    fn default() -> Self {
        Self { average: Average::default(), offset_db: 4.0, grid: Grid::default(), particles_s: None, plan: None }
    }
}

/// Solves captures with one survey.
#[derive(Clone, Debug)]
pub struct Solver {
    beacons: Vec<String>,
    average: Average,
    offset_db: f64,
    particles_s: Option<f64>,
    /// What is zero for the maps, metres: a site grid that begins far away costs no digits.
    middle_m: [f64; 2],
    /// The survey's points as a map.
    points: Vec<u8>,
    /// The process' map.
    lattice: Vec<u8>,
    kernel: Kernel,
}

impl Solver {
    /// A solver of a survey; the search for the process' kernel begins at `guess`.
    ///
    /// # Errors
    /// The survey makes no map.
    pub fn new(survey: &Survey, setup: &Setup, guess: Option<Kernel>) -> Result<Self, Fault> {
        let middle_m = survey.middle_m();
        let back_m = middle_m.map(|x| -x);
        let survey = survey.moved(back_m);
        let points = survey.map()?;
        let process = process(&survey, setup.plan.map(|plan| plan.moved(back_m)).as_ref(), guess)?;
        let lattice = chart(&survey, &process, setup.grid)?;
        let &Setup { average, offset_db, particles_s, .. } = setup;
        let (beacons, kernel) = (survey.beacons, process.kernel());
        Ok(Self { beacons, average, offset_db, particles_s, middle_m, points, lattice, kernel })
    }

    /// The kernel of its process.
    pub fn kernel(&self) -> Kernel {
        self.kernel
    }

    /// The positions of captures, in their order, and their errors where the truth is known.
    ///
    /// # Errors
    /// Its own maps are damaged: never.
    pub fn solve(&self, comparison: Comparison, captures: &[Capture]) -> Result<Vec<Solved>, Fault> {
        let ((points, _), (lattice, _)) = (Map::decode(&self.points)?, Map::decode(&self.lattice)?);
        // All captures are of one receiver, whose offset is learnt from one to the next.
        let mut receiver = Receiver { offset_deviation_db: self.offset_db as f32, ..Receiver::default() };
        let mut walk = Walk::<f32, ROOM>::new();
        let at_once = |scan: &[Option<f32>], receiver: &Receiver<f32>| match comparison {
            Comparison::Nearest { k, weighted } => {
                let offset = receiver.offset_deviation_db / LEVEL_DB;
                let scan: Vec<_> = scan.iter().map(|level| level.map(|level| level - receiver.offset_db)).collect();
                Nearest { neighbours: k, weighted, offset }.locate(&points, &scan).map(Found::from)
            }
            Comparison::Process | Comparison::Walk => locate(&lattice, scan, receiver).map(Found::from),
        };
        let mut particles = Particles::new();
        let mut timeline = Timeline::default();
        let fading_us = (Motion::<f64>::default().fading_s * 1.0e6) as u64;
        let mut learnt_us = 0;
        let position = |capture: &Capture| {
            let (now_us, goes_on) = timeline.next(capture);
            let scan = self.single(capture);
            // Scans in quick succession are shadowed alike, and would pass their shadows off as an offset.
            let learns = !goes_on || now_us.saturating_sub(learnt_us) >= fading_us;
            if learns {
                learnt_us = now_us;
            }
            if comparison == Comparison::Walk {
                if !goes_on {
                    walk = Walk::new();
                }
                let posterior = walk.step(&lattice, &scan, &receiver, &Motion::default(), now_us)?;
                if learns {
                    receiver.learn(&posterior);
                }
                return Ok(Found::from(posterior));
            }
            let before = receiver;
            if let Some(posterior) = locate(&lattice, &scan, &receiver).ok().filter(|_| learns) {
                receiver.learn(&posterior);
            }
            let Some(window_s) = self.particles_s else { return at_once(&scan, &before) };
            if !goes_on {
                particles = Particles::new();
            }
            let mut last = Err(fingerprint::NoPosition::Unheard);
            for Window { before_us, scan } in windows(&self.beacons, capture, window_s, self.average) {
                let found = at_once(&single_precision(scan), &before);
                let now_us = now_us.saturating_sub(before_us);
                last = found.map(|found| particles.step(now_us, found)).or(last);
            }
            last
        };
        let mut position = position;
        Ok(captures.iter().map(|capture| self.solved(capture, position(capture))).collect())
    }

    fn single(&self, capture: &Capture) -> Vec<Option<f32>> {
        single_precision(scan(&self.beacons, &capture.samples, self.average))
    }

    fn solved(&self, capture: &Capture, found: Result<Found, fingerprint::NoPosition>) -> Solved {
        let outcome = found.map_err(NoPosition::Unmatched).map(|Found { position, covariance, used }| {
            let [x_m, y_m] = [0, 1].map(|axis: usize| f64::from(position[axis]) + self.middle_m[axis]);
            let [xx, xy, yy] = covariance.map(f64::from);
            let sigma = Place { x_m: xx.max(0.0).sqrt(), y_m: yy.max(0.0).sqrt(), z_m: None };
            Position { place: Place { x_m, y_m, z_m: None }, sigma, covariance_xy: xy, used }
        });
        let truth = capture.truth_m.map(|[x_m, y_m]| Place { x_m, y_m, z_m: None });
        let error_m = outcome.ok().zip(truth).map(|(position, truth)| position.place.distance_m(&truth));
        Solved { outcome, error_m }
    }
}

/// The process of a survey, about what its plan lets expect.
///
/// # Errors
/// Nothing is heard anywhere.
pub fn process(survey: &Survey, plan: Option<&Plan>, guess: Option<Kernel>) -> Result<Process, Fault> {
    let trends = plan.map_or_else(|| Trend::levels(survey), |plan| Trend::rays(survey, plan));
    Process::fit(survey, trends, guess).ok_or(Fault::Invalid)
}

fn single_precision(scan: Vec<Option<f64>>) -> Vec<Option<f32>> {
    scan.into_iter().map(|level| level.map(|level| level as f32)).collect()
}

/// A position about the middle.
#[derive(Clone, Copy, Debug)]
struct Found {
    position: [f32; 2],
    covariance: [f32; 3],
    used: usize,
}

impl From<Vicinity<f32>> for Found {
    fn from(vicinity: Vicinity<f32>) -> Self {
        Self { position: vicinity.position, covariance: vicinity.scatter, used: vicinity.heard }
    }
}

impl From<Posterior<f32>> for Found {
    fn from(posterior: Posterior<f32>) -> Self {
        Self { position: posterior.position, covariance: posterior.covariance, used: posterior.heard }
    }
}

/// The thesis' particle filter over the positions of a comparison (15).
struct Particles(Box<ParticleFilter<f32, ON_HOST>>);

impl Particles {
    fn new() -> Self {
        Self(Box::new(ParticleFilter::new(Settings::thesis(), SEED)))
    }

    fn step(&mut self, now_us: u64, found: Found) -> Found {
        let deviation = Settings::<f32>::thesis().position;
        if !self.0.is_started() {
            self.0.start_at(found.position, [deviation; 2]);
        }
        let towards = Towards { position: found.position, deviation };
        self.0.step(now_us, &[], &towards).map_or(found, |estimate| {
            let [[xx, xy], [_, yy]] = estimate.covariance;
            Found { position: estimate.position, covariance: [xx, xy, yy], used: found.used }
        })
    }
}

/// Which captures are of one walk, and when they end.
#[derive(Default)]
struct Timeline {
    begun_s: Option<f64>,
    ended_s: f64,
}

impl Timeline {
    /// When the capture ends, since the walk began, microseconds; and whether it goes on with the walk before it.
    fn next(&mut self, capture: &Capture) -> (u64, bool) {
        let Some((first_s, last_s)) = span_s(capture) else {
            self.begun_s = None;
            return (0, false);
        };
        let gap_s = first_s - self.ended_s;
        let begun_s = self.begun_s.filter(|_| (0.0..=ONE_WALK_S).contains(&gap_s));
        let goes_on = begun_s.is_some();
        let begun_s = begun_s.unwrap_or(first_s);
        (self.begun_s, self.ended_s) = (Some(begun_s), last_s);
        (((last_s - begun_s) * 1.0e6) as u64, goes_on)
    }
}

/// Positions of stays that their solver has not seen, in the survey's order: every fold's stays by a survey of the others.
/// `fold_of` tells which fold a stay is in, `None`: it is in every survey and never solved. `done` hears of each fold.
///
/// # Errors
/// What is left of the survey makes no map.
pub fn held_out(
    stays: &[Stay],
    setup: &Setup,
    comparisons: &[Comparison],
    fold_of: impl Fn(usize) -> Option<usize>,
    mut done: impl FnMut(),
) -> Result<HeldOut, Fault> {
    let survey = Survey::of(stays, setup.average);
    let folds: BTreeSet<usize> = (0..stays.len()).filter_map(&fold_of).collect();
    // The kernels of many folds are alike.
    let guess = if folds.len() > 1 { Some(Solver::new(&survey, setup, None)?.kernel()) } else { None };
    let mut solved: Vec<BTreeMap<usize, Solved>> = vec![BTreeMap::new(); comparisons.len()];
    for fold in folds {
        let solver = Solver::new(&survey.only(|stay| fold_of(stay) != Some(fold)), setup, guess)?;
        let held: Vec<usize> = (0..stays.len()).filter(|&stay| fold_of(stay) == Some(fold)).collect();
        let captures: Vec<Capture> = held.iter().map(|&stay| Capture::from(stays[stay].clone())).collect();
        for (&comparison, solved) in comparisons.iter().zip(&mut solved) {
            solved.extend(held.iter().copied().zip(solver.solve(comparison, &captures)?));
        }
        done();
    }
    let stays = (0..stays.len()).filter(|&stay| fold_of(stay).is_some()).collect();
    Ok(HeldOut { stays, solved: solved.into_iter().map(|solved| solved.into_values().collect()).collect() })
}

/// What [`held_out`] solved.
#[derive(Clone, Debug)]
pub struct HeldOut {
    /// Which stays, in their order.
    pub stays: Vec<usize>,
    /// Their positions, by each comparison.
    pub solved: Vec<Vec<Solved>>,
}
