//! Kernels with memory over captures: the tag's engine and the particle filter, window by window, and the receiver's offset, learnt on the
//! way.

use positioning_core::SolveError;
use positioning_core::ble::beacon_monitor::{BeaconMonitor, HealthChange, Level, Site};
use positioning_core::ble::multilateration::Heard;
use positioning_core::ble::offset::ReceiverOffset;
use positioning_core::ble::particles::{self, Levels, Likelihood, ON_HOST, ParticleFilter};
use positioning_core::ble::posterior::PosteriorSettings;
use positioning_core::ble::signal::{Beacons, Smoothing};
use positioning_core::engine::{Dimensions, Engine, Measurement, Settings};

use super::{MOST_BEACONS, Solver, loudest, means};
use crate::files::beacons::{Capture, Sample};
use crate::{NoPosition, Position};

/// The kernel's time at the start of the first capture, microseconds: times a little earlier are still times.
const BEGIN_US: u64 = 3_600_000_000;
/// Between two captures of which nobody says, microseconds.
const BETWEEN_US: u64 = 10_000_000;
/// What is left of the noise in a window's mean of smoothed RSSI values, dB (table 3.1: 1 to 1.2 over single RSSI values).
const NOISE_DB: f32 = 1.2;
/// The time in which the RSSI values of scans one after the other count as much as one scan, seconds: shadows stay while a tag does.
const SHADOW_S: f64 = 5.0;

/// What a kernel with memory remembers.
#[derive(Clone, Copy, Debug)]
pub(super) enum Memory {
    /// The tag's engine.
    Engine,
    /// Particles.
    Particles,
}

/// A kernel with memory.
pub(super) struct Follower<'a> {
    solver: &'a Solver<'a>,
    beacons: Box<Beacons<f32, MOST_BEACONS>>,
    track: Track,
    /// What was learnt from capture to capture.
    pub(super) learnt: Learnt,
    /// The first time, in the files' time, seconds.
    first_s: Option<f64>,
}

/// What stays from capture to capture.
#[derive(Clone, Debug)]
pub(super) struct Learnt {
    /// What the receiver reads too loud, as particles learn it.
    receiver: ReceiverOffset<f32>,
    /// What the tag knows of receiver and beacons.
    surroundings: Box<BeaconMonitor<f32, MOST_BEACONS>>,
    /// What it came to believe of beacons, in order.
    pub(super) news: Vec<HealthChange>,
    /// When the next capture begins for the kernel, microseconds.
    begin_us: u64,
}

impl Learnt {
    fn nothing(offset_db: f32) -> Self {
        Self {
            receiver: ReceiverOffset::new(offset_db),
            surroundings: Box::new(BeaconMonitor::new(offset_db)),
            news: Vec::new(),
            begin_us: BEGIN_US,
        }
    }
}

enum Track {
    Engine(Box<Engine<f32>>),
    Particles(Box<ParticleFilter<f32, ON_HOST>>),
}

impl<'a> Follower<'a> {
    /// Nothing followed yet; what was learnt stays.
    pub(super) fn new(solver: &'a Solver<'a>, memory: Memory, learnt: Option<Learnt>) -> Self {
        let mut learnt = learnt.unwrap_or_else(|| Learnt::nothing(solver.setup.offset_db as f32));
        learnt.begin_us += BETWEEN_US;
        let window_us = (solver.setup.window_s * 1.0e6) as u64;
        let track = match memory {
            Memory::Engine => {
                let settings = Settings::track(Dimensions::Plane { height: 0.0 });
                Track::Engine(Box::new(Engine::new(settings)))
            }
            Memory::Particles => {
                let settings = particles::Settings::walking();
                Track::Particles(Box::new(ParticleFilter::new(settings, solver.setup.seed)))
            }
        };
        let beacons = Box::new(Beacons::new(Smoothing::default(), window_us));
        Self { solver, beacons, track, learnt, first_s: None }
    }

    /// Goes through a capture, window by window of those in which something was heard; its position is the last one.
    pub(super) fn follow(&mut self, capture: &Capture) -> Result<Position, NoPosition> {
        let mut samples: Vec<&Sample> = capture.samples.iter().collect();
        samples.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        let (Some(first), Some(last)) = (samples.first(), samples.last()) else {
            return Err(NoPosition::SolveError(SolveError::TooFewAnchors));
        };
        let (first_s, last_s, window_s) = (first.t_s, last.t_s, self.solver.setup.window_s);
        let window = |sample: &Sample| ((sample.t_s - first_s) / window_s).floor();
        let mut position = Err(NoPosition::SolveError(SolveError::TooFewAnchors));
        for samples in samples.chunk_by(|a, b| window(a) == window(b)) {
            for sample in samples {
                if let Some(beacon) = self.solver.beacons.iter().position(|beacon| beacon.name == sample.beacon) {
                    let now_us = self.microseconds(sample.t_s);
                    self.beacons.receive(now_us, beacon, sample.rssi_dbm as f32);
                }
            }
            let end_s = samples.last().map_or(last_s, |sample| first_s + (window(sample) + 1.0) * window_s);
            let now_us = self.microseconds(end_s.min(last_s));
            let scan = self.beacons.scan(now_us);
            let Learnt { receiver, surroundings, news, .. } = &mut self.learnt;
            position = match &mut self.track {
                Track::Engine(engine) => engine_step(self.solver, engine, surroundings, now_us, &scan),
                Track::Particles(filter) => particle_step(self.solver, filter, receiver, now_us, &scan),
            };
            news.extend(surroundings.take_news());
        }
        self.learnt.begin_us = self.microseconds(last_s);
        if let (Track::Particles(_), Ok(found), true) = (&self.track, &position, self.solver.setup.offset_db > 0.0) {
            self.learn(&capture.samples, found);
        }
        position
    }

    /// Learns the receiver's offset where particles have found a capture to be.
    fn learn(&mut self, samples: &[Sample], found: &Position) {
        let scan = means(self.solver.beacons, samples);
        let receiver = &mut self.learnt.receiver;
        let heard = corrected(self.solver, receiver, &scan);
        let belief = PosteriorSettings { offset_deviation: receiver.deviation(), ..PosteriorSettings::default() };
        let at = self.solver.local([found.place.x_m, found.place.y_m]);
        let (more, variance) = belief.of(&heard).through(self.solver.attenuating()).offset_at(at);
        receiver.learn(more, variance);
    }

    fn microseconds(&mut self, t_s: f64) -> u64 {
        let first_s = *self.first_s.get_or_insert(t_s);
        // A float too large or negative becomes the largest or least integer.
        self.learnt.begin_us.saturating_add_signed(((t_s - first_s) * 1.0e6) as i64)
    }
}

/// What is heard, as the calibration's receiver would have it, the loudest of it.
fn corrected(solver: &Solver, receiver: &ReceiverOffset<f32>, scan: &[Option<f32>]) -> Vec<Heard<f32, 2>> {
    let correct = |(_, heard): (usize, Heard<f32, 2>)| Heard { rssi: receiver.correct(heard.rssi), ..heard };
    let mut heard: Vec<Heard<f32, 2>> = solver.heard(scan).into_iter().map(correct).collect();
    loudest(&mut heard);
    heard
}

/// Lets where the RSSI values have the tag into the engine, as a tag does.
fn engine_step(
    solver: &Solver,
    engine: &mut Engine<f32>,
    surroundings: &mut BeaconMonitor<f32, MOST_BEACONS>,
    now_us: u64,
    scan: &[Option<f32>],
) -> Result<Position, NoPosition> {
    let rssi = |(beacon, heard): (usize, Heard<f32, 2>)| Level { beacon, heard, noise: NOISE_DB, is_torn: false };
    let mut rssis: Vec<Level<f32>> = solver.heard(scan).into_iter().map(rssi).collect();
    rssis.sort_by(|a, b| b.heard.rssi.total_cmp(&a.heard.rssi));
    let site = Site { area: solver.reach(), walls: solver.attenuating() };
    let located = surroundings.locate(now_us, &rssis, &site, None).map_err(NoPosition::SolveError)?;
    engine.step(now_us, &Measurement::BeaconPosition(located.position));
    let fix = engine.step(now_us, &Measurement::RoundEnd).fix.map_err(NoPosition::Missing)?;
    let [x, y, _] = fix.position;
    let covariance = [0, 1].map(|row: usize| [fix.covariance[row][0], fix.covariance[row][1]]);
    Ok(solver.global([x, y], &covariance, located.used.count_ones() as usize))
}

fn particle_step(
    solver: &Solver,
    filter: &mut ParticleFilter<f32, ON_HOST>,
    receiver: &ReceiverOffset<f32>,
    now_us: u64,
    scan: &[Option<f32>],
) -> Result<Position, NoPosition> {
    let heard = corrected(solver, receiver, scan);
    if heard.is_empty() {
        return Err(NoPosition::SolveError(SolveError::TooFewAnchors));
    }
    if !filter.is_started() {
        filter.start_in(&solver.reach());
    }
    let trust = (solver.setup.window_s / SHADOW_S).min(1.0) as f32;
    let rssis = Levels::of(&heard, receiver.deviation(), trust).through(solver.attenuating());
    let reach = solver.reach();
    let within = |at: [f32; 2]| (0..2).all(|axis| (reach.min[axis]..=reach.max[axis]).contains(&at[axis]));
    let likelihood = |at| if within(at) { rssis.ln_at(at) } else { f32::NAN };
    let estimate =
        filter.step(now_us, &solver.walls, &likelihood).ok_or(NoPosition::SolveError(SolveError::Diverged))?;
    Ok(solver.global(estimate.position, &estimate.covariance, heard.len()))
}
