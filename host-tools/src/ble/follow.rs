//! Kernels with memory over captures: the tag's engine and the particle filter, window by window, and the receiver's offset, learnt on the
//! way.

use positioning_core::ble::multilateration::Heard;
use positioning_core::ble::offset::ReceiverOffset;
use positioning_core::ble::particles::{self, Levels, Likelihood, ON_HOST, ParticleFilter};
use positioning_core::ble::path_loss::attenuation;
use positioning_core::ble::signal::{Beacons, Smoothing};
use positioning_core::engine::{BleRange, Dimensions, Engine, Measurement, Settings};
use positioning_core::{Area, NoFix};

use super::files::{Beacon, Capture, Sample};
use super::solve::{MOST_BEACONS, Solver, loudest, means, path_loss};
use crate::{NoPosition, Position};

/// The engine's time at the start of a capture, seconds: times a little earlier are still times.
const BEGIN_S: f64 = 3600.0;
/// Shadows of several beacons at one place are one another's: two levels are worth one, √2.
const SHARED: f32 = std::f32::consts::SQRT_2;
/// What is left of the noise in a window's mean of smoothed levels, dB (table 3.1: 1 to 1.2 over single levels).
const NOISE_DB: f32 = 1.2;
/// The time in which the levels of scans one after the other count as much as one scan, seconds: shadows stay while a tag does.
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
    /// What the receiver reads too loud, learnt from capture to capture.
    pub(super) receiver: ReceiverOffset<f32>,
    /// The first time, which is [`BEGIN_S`] for the kernel, seconds.
    first_s: Option<f64>,
}

enum Track {
    Engine(Box<Engine<f32>>),
    Particles(Box<ParticleFilter<f32, ON_HOST>>),
}

impl<'a> Follower<'a> {
    /// Nothing followed yet; what is known of the receiver stays.
    pub(super) fn new(solver: &'a Solver<'a>, memory: Memory, receiver: Option<ReceiverOffset<f32>>) -> Self {
        let receiver = receiver.unwrap_or_else(|| ReceiverOffset::new(solver.setup.offset_db as f32));
        let window_us = (solver.setup.window_s * 1.0e6) as u64;
        let track = match memory {
            Memory::Engine => {
                let area = solver.constraints().area.map(|area| Area {
                    min: [area.min[0], area.min[1], f32::NEG_INFINITY],
                    max: [area.max[0], area.max[1], f32::INFINITY],
                });
                let settings = Settings { area, ..Settings::track(Dimensions::Plane { height: 0.0 }) };
                Track::Engine(Box::new(Engine::new(settings)))
            }
            Memory::Particles => {
                let settings = particles::Settings::walking();
                Track::Particles(Box::new(ParticleFilter::new(settings, solver.setup.seed)))
            }
        };
        let beacons = Box::new(Beacons::new(Smoothing::default(), window_us));
        Self { solver, beacons, track, receiver, first_s: None }
    }

    /// Goes through a capture, window by window of those in which something was heard; its position is the last one.
    pub(super) fn follow(&mut self, capture: &Capture) -> Result<Position, NoPosition> {
        let mut samples: Vec<&Sample> = capture.samples.iter().collect();
        samples.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        let (Some(first), Some(last)) = (samples.first(), samples.last()) else {
            return Err(NoPosition::NoFix(NoFix::TooFewAnchors));
        };
        let (first_s, last_s, window_s) = (first.t_s, last.t_s, self.solver.setup.window_s);
        let window = |sample: &Sample| ((sample.t_s - first_s) / window_s).floor();
        let mut position = Err(NoPosition::NoFix(NoFix::TooFewAnchors));
        for samples in samples.chunk_by(|a, b| window(a) == window(b)) {
            for sample in samples {
                if let Some(beacon) = self.solver.beacons.iter().position(|beacon| beacon.name == sample.beacon) {
                    let now_us = self.microseconds(sample.t_s);
                    self.beacons.hear(now_us, beacon, sample.rssi_dbm as f32);
                }
            }
            let end_s = samples.last().map_or(last_s, |sample| first_s + (window(sample) + 1.0) * window_s);
            let now_us = self.microseconds(end_s.min(last_s));
            let mut scan = self.beacons.scan(now_us);
            self.receiver.correct(&mut scan);
            let heard = self.solver.heard(&scan);
            position = match &mut self.track {
                Track::Engine(engine) => engine_step(self.solver, engine, now_us, &heard),
                Track::Particles(filter) => {
                    particle_step(self.solver, filter, now_us, &heard, self.receiver.deviation())
                }
            };
        }
        if let (Ok(found), true) = (&position, self.solver.setup.offset_db > 0.0) {
            self.learn(&capture.samples, found);
        }
        position
    }

    /// Learns the receiver's offset where a capture was found to be.
    fn learn(&mut self, samples: &[Sample], found: &Position) {
        let heard = means(self.solver.beacons, samples);
        let at = self.solver.local([found.place.x_m, found.place.y_m]);
        let expected = |beacon: &Beacon| {
            let place = self.solver.local(beacon.position_m);
            let (x, y) = (at[0] - place[0], at[1] - place[1]);
            Some(path_loss(beacon).level((x * x + y * y).sqrt()) - attenuation(self.solver.attenuating(), place, at))
        };
        let expected: Vec<Option<f32>> = self.solver.beacons.iter().map(expected).collect();
        let count = self.solver.beacons.len().max(1) as f32;
        let deviation = self.solver.beacons.iter().map(|beacon| path_loss(beacon).deviation).sum::<f32>() / count;
        self.receiver.learn(&heard, &expected, SHARED * deviation);
    }

    fn microseconds(&mut self, t_s: f64) -> u64 {
        let first_s = *self.first_s.get_or_insert(t_s);
        // A float too large or negative becomes the largest or least integer.
        ((t_s - first_s + BEGIN_S) * 1.0e6) as u64
    }
}

fn engine_step(
    solver: &Solver,
    engine: &mut Engine<f32>,
    now_us: u64,
    heard: &[(usize, Heard<f32, 2>)],
) -> Result<Position, NoPosition> {
    for (beacon, heard) in heard {
        let [x, y] = heard.place;
        let range = BleRange {
            beacon: *beacon as u16,
            place: [x, y, 0.0],
            distance: heard.distance(),
            relative_deviation: heard.path_loss.relative(NOISE_DB),
            lasting_deviation: SHARED * heard.path_loss.relative_deviation(),
        };
        engine.step(now_us, &Measurement::BleRange(range));
    }
    let fix = engine.step(now_us, &Measurement::RoundEnd).fix.map_err(NoPosition::Missing)?;
    let [x, y, _] = fix.position;
    let covariance = [0, 1].map(|row: usize| [fix.covariance[row][0], fix.covariance[row][1]]);
    Ok(solver.global([x, y], &covariance, heard.len()))
}

fn particle_step(
    solver: &Solver,
    filter: &mut ParticleFilter<f32, ON_HOST>,
    now_us: u64,
    heard: &[(usize, Heard<f32, 2>)],
    offset_deviation: f32,
) -> Result<Position, NoPosition> {
    let mut heard: Vec<Heard<f32, 2>> = heard.iter().map(|(_, heard)| *heard).collect();
    loudest(&mut heard);
    if heard.is_empty() {
        return Err(NoPosition::NoFix(NoFix::TooFewAnchors));
    }
    if !filter.is_started() {
        filter.start_in(&solver.reach());
    }
    let trust = (solver.setup.window_s / SHADOW_S).min(1.0) as f32;
    let levels = Levels::of(&heard, offset_deviation, trust).through(solver.attenuating());
    let reach = solver.reach();
    let within = |at: [f32; 2]| (0..2).all(|axis| (reach.min[axis]..=reach.max[axis]).contains(&at[axis]));
    let likelihood = |at| if within(at) { levels.ln_at(at) } else { f32::NAN };
    let estimate = filter.step(now_us, &solver.walls, &likelihood).ok_or(NoPosition::NoFix(NoFix::Diverged))?;
    Ok(solver.global(estimate.position, &estimate.covariance, heard.len()))
}
