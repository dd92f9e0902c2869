//! The engine. Input: measurements of all kinds with their times. Output: the tag's position. The tag, the replays
//! and the simulation run this engine.
//!
//! [`Engine::step`] has no clock: microseconds are an argument. With [`Mode::Solve`] every round is solved by itself
//! when it ends. With [`Mode::Track`] the first round (and the first after a track was given up) is solved. From then
//! on every measurement changes the track as it comes. A round that contradicts the track makes a second hypothesis
//! (`hypotheses`). The covariance grows during a time without measurements. After
//! too long a time the track ends.

mod height;
mod hypotheses;
mod output;
mod round;
mod settings;
mod snapshot;
mod track_management;
mod update;

use crate::measurement::Height;
pub use crate::measurement::{BeaconPosition, Measurement, Range, Tdoa};
pub use crate::track::FilterSettings;
pub use output::{Missing, Output, Start, TrackFix, Verdict};
pub use settings::{Dimensions, Mode, NodeMethod, Settings, Solvers};
pub use snapshot::{Hypothesis, LinkState};

use crate::measurement::Observation as _;
use crate::track::Filter;
use crate::{Alternative, Flag, Real};
use height::HeightSource;
use hypotheses::Rival;
use round::Round;

/// A clock that goes back by more than this has been reset, microseconds. By less, frames have overtaken each other.
const OVERTAKING_US: u64 = 1_000_000;
/// The engine.
#[derive(Clone, Debug)]
pub struct Engine<T> {
    settings: Settings<T>,
    filter: Filter<T>,
    rival: Rival<T>,
    round: Round<T>,
    /// The source of the height of a track in space.
    height: HeightSource<T>,
    /// Whether there is a track, and if not, why.
    track: Result<(), Missing>,
    /// Why the next track will be started.
    next_start: Start,
    /// What made the track's position doubtful at the end of the last round.
    flag: Option<Flag>,
    /// The other place of the last round, where every round is solved by itself.
    alternative: Option<Alternative<T, 3>>,
    /// The latest time of a measurement.
    now_us: u64,
    /// The time of the last measurement that was used.
    used_us: u64,
}

impl Engine<f32> {
    /// [`step`](Self::step), compiled in this crate so that it has the optimisation level of this crate and not that
    /// of the image.
    #[inline(never)]
    pub fn step_on_node(&mut self, now_us: u64, measurement: &Measurement<f32>) -> Output<f32> {
        self.step(now_us, measurement)
    }
}

impl<T: Real> Engine<T> {
    /// An engine without measurements.
    pub fn new(settings: Settings<T>) -> Self {
        Self {
            settings,
            filter: Filter::new(),
            rival: Rival::none(),
            round: Round::new(),
            height: HeightSource::new(),
            track: Err(Missing::RoundOpen),
            next_start: Start::First,
            flag: None,
            alternative: None,
            now_us: 0,
            used_us: 0,
        }
    }

    /// The engine's settings.
    pub fn settings(&self) -> &Settings<T> {
        &self.settings
    }

    /// Changes the height of a tag in the plane, metres. In space, or if the height is not a number, nothing happens.
    pub fn set_height(&mut self, height: T) {
        if let (Dimensions::Plane { height: known }, true) =
            (&mut self.settings.dimensions, Height { height_m: height, deviation_m: T::ONE }.is_sane())
        {
            *known = height;
            self.filter.set_height(height);
        }
    }

    /// Takes one measurement of the time `now_us`, microseconds. It does not panic on any input.
    pub fn step(&mut self, now_us: u64, measurement: &Measurement<T>) -> Output<T> {
        self.watch_clock(now_us);
        if !measurement.is_sane() {
            return Output { verdict: Verdict::NotSane, fix: self.fix() };
        }
        let verdict = match measurement {
            Measurement::Range(range) => self.range(range),
            Measurement::RoundEnd => return self.end_round(),
            Measurement::Tdoa(tdoa) => self.tdoa(tdoa),
            Measurement::BeaconPosition(position) => self.beacon_position(position),
        };
        Output { verdict, fix: self.fix() }
    }

    /// Moves on to `now_us`. Ends a track after too long a gap, or when it has become too uncertain.
    fn watch_clock(&mut self, now_us: u64) {
        if now_us.saturating_add(OVERTAKING_US) < self.now_us {
            self.reset(Start::Clock);
            self.round.clear();
            (self.now_us, self.used_us) = (now_us, now_us);
            return;
        }
        self.now_us = self.now_us.max(now_us);
        if self.track.is_ok() {
            if self.now_us.saturating_sub(self.used_us) > self.settings.gap_us {
                self.reset(Start::Gap);
                self.round.clear();
                return;
            }
            self.filter.advance(self.now_us, &self.settings.filter);
            if let Some(rival) = self.rival.filter() {
                rival.advance(self.now_us, &self.settings.filter);
            }
            if !(self.filter.state.spread() <= self.settings.lost.squared()) || !self.filter.state.is_finite() {
                self.reset(Start::Lost);
            }
        }
    }

    fn reset(&mut self, reason: Start) {
        if self.track.is_ok() {
            self.track = Err(Missing::Lost(reason));
            self.next_start = reason;
            self.rival.end();
        }
    }

    /// The track's current position.
    fn fix(&self) -> Result<TrackFix<T>, Missing> {
        self.track?;
        let (position, covariance) = self.likelier();
        Ok(TrackFix {
            position,
            velocity: self.filter.state.velocity(),
            covariance: self.height.admit(covariance),
            used: crate::AnchorSet(self.round.used),
            quality: self.round.quality(),
            age_us: self.now_us.saturating_sub(self.used_us),
            flag: self.flag,
        })
    }
}
