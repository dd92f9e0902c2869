//! The engine: whatever is measured goes in with its time, the tag's position comes out. The tag, the replays and the
//! simulation run this one.
//!
//! [`Engine::step`] has no clock: microseconds are an argument. With [`Mode::Solve`] every round is solved by itself when it ends;
//! with [`Mode::Track`] the first round (and the first after a track was given up) is solved, and from then on every
//! measurement changes the track as it comes. Time without measurements makes the covariance grow; too much of it ends the track.

mod beacons;
mod level;
mod measurement;
mod output;
mod round;
mod settings;

pub use beacons::Beacons;
pub use measurement::{BeaconPosition, BleRange, Measurement, Range, Tdoa};
pub use output::{Missing, Output, Start, TrackFix, Verdict};
pub use settings::{Dimensions, Mode, Settings, Solvers};

use crate::track::{Blocked, Fate, Filter, Supervisor};
use crate::{Fix, Real};
use beacons::ByBeacons;
use level::Level;
use measurement::{height_is_sane, known, position_is_sane, probability};
use round::{Round, length};

/// A clock that goes back by more than this has begun anew, microseconds; by less, frames have overtaken each other.
const OVERTAKING_US: u64 = 1_000_000;
/// A track's first position is taken to be so many times as uncertain as the solver says: the same ranges are about to enter
/// the track, and must not count twice.
const START_DOUBT: f64 = 9.0;
/// And by this more, metres.
const START_SIGMA_M: f64 = 0.3;
/// But no axis by more than about this, metres.
const START_GREATEST_M: f64 = 1.0;

/// The orchestrator.
#[derive(Clone, Debug)]
pub struct Engine<T> {
    settings: Settings<T>,
    filter: Filter<T>,
    supervisor: Supervisor,
    round: Round<T>,
    /// Where a track in space has its height from.
    level: Level<T>,
    /// Whether there is a track, and why not.
    track: Result<(), Missing>,
    /// Why the next track will be started.
    next_start: Start,
    /// The latest time seen.
    now_us: u64,
    /// When a measurement was used last.
    used_us: u64,
}

impl Engine<f32> {
    /// [`step`](Self::step), compiled in this crate and so optimised as it is, whatever the image is optimised for.
    #[inline(never)]
    pub fn step_on_node(&mut self, now_us: u64, measurement: &Measurement<f32>) -> Output<f32> {
        self.step(now_us, measurement)
    }
}

impl<T: Real> Engine<T> {
    /// An engine that has seen nothing.
    pub fn new(settings: Settings<T>) -> Self {
        Self {
            settings,
            filter: Filter::new(),
            supervisor: Supervisor::default(),
            round: Round::new(),
            level: Level::new(),
            track: Err(Missing::RoundOpen),
            next_start: Start::First,
            now_us: 0,
            used_us: 0,
        }
    }

    /// How it works.
    pub fn settings(&self) -> &Settings<T> {
        &self.settings
    }

    /// Changes the height of a tag in the plane, metres; in space, and where it is no number, nothing happens.
    pub fn set_height(&mut self, height: T) {
        if let (Dimensions::Plane { height: known }, true) =
            (&mut self.settings.dimensions, height_is_sane(height, T::ONE))
        {
            *known = height;
            self.filter.set_height(height);
        }
    }

    /// Takes one measurement of the time `now_us`, microseconds. No input panics.
    pub fn step(&mut self, now_us: u64, measurement: &Measurement<T>) -> Output<T> {
        self.watch_clock(now_us);
        let verdict = match measurement {
            Measurement::Range(range) => self.range(range),
            Measurement::RoundEnd => return self.end_round(),
            Measurement::Tdoa(tdoa) => self.tdoa(tdoa),
            Measurement::BleRange(range) => self.ble_range(range),
            Measurement::BeaconPosition(position) => self.beacon_position(position),
            Measurement::Height { height, deviation } => self.height(*height, *deviation),
            Measurement::Position { position, covariance } => self.position(position, covariance),
        };
        Output { verdict, fix: self.fix() }
    }

    /// Moves on to `now_us`; ends a track that did not outlive the time since.
    fn watch_clock(&mut self, now_us: u64) {
        if now_us.saturating_add(OVERTAKING_US) < self.now_us {
            self.give_up(Start::Clock);
            self.round.clear();
            (self.now_us, self.used_us) = (now_us, now_us);
            return;
        }
        self.now_us = self.now_us.max(now_us);
        if self.track.is_ok() {
            if self.now_us.saturating_sub(self.used_us) > self.settings.gap_us {
                self.give_up(Start::Gap);
                self.round.clear();
                return;
            }
            self.filter.advance(self.now_us, &self.settings);
            if !(self.filter.state.spread() <= self.settings.lost.squared()) || !self.filter.state.is_finite() {
                self.give_up(Start::Lost);
            }
        }
    }

    fn give_up(&mut self, reason: Start) {
        if self.track.is_ok() {
            self.track = Err(Missing::Lost(reason));
            self.next_start = reason;
            self.supervisor = Supervisor::default();
        }
    }

    fn range(&mut self, range: &Range<T>) -> Verdict {
        if !range.is_sane() {
            return Verdict::NotSane;
        }
        let place = self.round.keep(range);
        self.round.given = self.round.given.saturating_add(1);
        if self.track.is_err() {
            return Verdict::Held;
        }
        self.admit_range(range, place)
    }

    /// Takes a range into the track, unless it is to be ignored.
    fn admit_range(&mut self, range: &Range<T>, place: Option<usize>) -> Verdict {
        match self.settings.blocked {
            Blocked::Ignore { threshold, .. } if probability(range.blocked) >= threshold => Verdict::Ignored,
            Blocked::Ignore { .. } | Blocked::Alike | Blocked::TwoVariances { .. } | Blocked::Weigh => {
                self.track_range(range, place)
            }
        }
    }

    /// Takes a range into the track.
    fn track_range(&mut self, range: &Range<T>, place: Option<usize>) -> Verdict {
        let shortened = Range { distance: length(range, &self.settings), ..*range };
        let fate = self.filter.range(&shortened, known(range.blocked), &self.settings);
        self.judge(fate, place)
    }

    fn tdoa(&mut self, tdoa: &Tdoa<T>) -> Verdict {
        if !tdoa.is_sane() {
            return Verdict::NotSane;
        }
        self.round.given = self.round.given.saturating_add(1);
        if self.track.is_err() {
            return if self.round.tdoas.push(*tdoa).is_ok() { Verdict::Held } else { Verdict::NoTrack };
        }
        self.admit_tdoa(tdoa)
    }

    /// Takes a difference into the track, unless it is to be ignored.
    fn admit_tdoa(&mut self, tdoa: &Tdoa<T>) -> Verdict {
        if let Blocked::Ignore { threshold, .. } = self.settings.blocked
            && tdoa.blocked.iter().any(|&blocked| probability(blocked) >= threshold)
        {
            return Verdict::Ignored;
        }
        let fate = self.filter.tdoa(tdoa, tdoa.blocked.map(known), &self.settings);
        self.judge(fate, None)
    }

    fn ble_range(&mut self, range: &BleRange<T>) -> Verdict {
        if !range.is_sane() {
            return Verdict::NotSane;
        }
        if self.settings.solvers.beacons.is_none() {
            return Verdict::Ignored;
        }
        self.round.given = self.round.given.saturating_add(1);
        if self.round.beacons.push(*range).is_ok() { Verdict::Held } else { Verdict::NoTrack }
    }

    /// Keeps a position by beacons for the round's end; of several the last. In space it tells no height, and too little.
    fn beacon_position(&mut self, position: &BeaconPosition<T>) -> Verdict {
        if !position.is_sane() {
            return Verdict::NotSane;
        }
        if self.settings.solvers.beacons.is_none() || self.settings.dimensions.height().is_none() {
            return Verdict::Ignored;
        }
        self.round.given = self.round.given.saturating_add(1);
        self.round.by_beacons = Some(*position);
        Verdict::Held
    }

    /// Lets what a round heard of beacons into the track, where that is wanted.
    fn heed_beacons(&mut self) {
        let nothing = self.round.beacons.is_empty() && self.round.by_beacons.is_none();
        if let (Some(beacons), false) = (self.settings.solvers.beacons, nothing) {
            (beacons.admit)(self);
        }
    }

    /// Lets what a round heard of beacons into the track.
    #[inline(never)]
    fn admit_beacons(&mut self) {
        let solved = match self.settings.dimensions {
            Dimensions::Plane { .. } => self.round.solve_beacons(&self.settings).ok(),
            Dimensions::Space { .. } => None,
        };
        if let Some(ByBeacons { fix, lasting }) = solved {
            let fate = self.filter.by_beacons(fix.position, &fix.covariance, lasting, &self.settings);
            self.judge(fate, None);
            return;
        }
        // Too few of them for a position, or in space: what they say of the track, one by one.
        for place in 0..self.round.beacons.len() {
            if let Some(range) = self.round.beacons.get(place).copied() {
                let fate = self.filter.ble_range(&range, &self.settings);
                self.judge(fate, None);
            }
        }
    }

    fn height(&mut self, height: T, deviation: T) -> Verdict {
        if !height_is_sane(height, deviation) {
            return Verdict::NotSane;
        }
        if self.track.is_err() {
            return Verdict::NoTrack;
        }
        self.level.is_told();
        let fate = self.filter.height(height, deviation, &self.settings);
        self.judge(fate, None)
    }

    fn position(&mut self, position: &[T; 3], covariance: &[[T; 3]; 3]) -> Verdict {
        if !position_is_sane(position, covariance) {
            return Verdict::NotSane;
        }
        if self.track.is_ok() {
            self.level.is_told();
            let fate = self.filter.position(*position, covariance, &self.settings);
            return self.judge(fate, None);
        }
        match self.settings.mode {
            Mode::Solve => Verdict::NoTrack,
            Mode::Track => {
                let height = self.settings.dimensions.height();
                let start = core::array::from_fn(|axis| match height {
                    Some(height) if axis == 2 => height,
                    Some(_) | None => position[axis],
                });
                Verdict::Started(self.start(start, covariance))
            }
        }
    }

    fn judge(&mut self, fate: Fate, place: Option<usize>) -> Verdict {
        self.supervisor.count(fate == Fate::Refused);
        match fate {
            Fate::Refused => Verdict::Refused,
            Fate::Taken | Fate::Readmitted => {
                self.used_us = self.now_us;
                self.round.count(place);
                if fate == Fate::Taken { Verdict::Used } else { Verdict::Readmitted }
            }
        }
    }

    /// Starts a track.
    fn start(&mut self, position: [T; 3], covariance: &[[T; 3]; 3]) -> Start {
        self.filter.start(self.now_us, position, covariance, &self.settings);
        self.level = Level::new();
        self.supervisor = Supervisor::default();
        self.track = Ok(());
        self.used_us = self.now_us;
        self.next_start
    }

    #[inline(never)]
    fn end_round(&mut self) -> Output<T> {
        let output = match self.settings.mode {
            Mode::Solve => Output { verdict: Verdict::Concluded, fix: self.solved() },
            Mode::Track if self.track.is_err() => self.begin(),
            Mode::Track => self.go_on(),
        };
        self.round.clear();
        output
    }

    /// The round's own position.
    fn solved(&self) -> Result<TrackFix<T>, Missing> {
        let fix = self.round.solve(&self.settings).map_err(Missing::NoFix)?;
        let Fix { position, covariance, used, quality, .. } = fix;
        Ok(TrackFix { position, velocity: [T::ZERO; 3], covariance, used, quality, age_us: 0 })
    }

    /// Starts a track from the round.
    #[inline(never)]
    fn begin(&mut self) -> Output<T> {
        match self.round.solve(&self.settings) {
            Ok(fix) => {
                let start = self.begin_at(&fix);
                Output { verdict: Verdict::Started(start), fix: self.fix() }
            }
            Err(reason) => Output { verdict: Verdict::Concluded, fix: Err(Missing::NoFix(reason)) },
        }
    }

    /// Starts a track near a solved position, and lets the round's measurements into it.
    fn begin_at(&mut self, fix: &Fix<T, 3>) -> Start {
        // Where the solver did not know on which side of the anchors the tag is, its covariance reaches to the other one. The track
        // is on this side, and a doubt of metres would lead its first linearisations astray.
        let greatest = (0..3).fold(T::ZERO, |greatest, axis| greatest.at_least(fix.covariance[axis][axis]));
        let doubt = T::of(START_DOUBT).at_most(T::of(START_GREATEST_M * START_GREATEST_M) / greatest);
        let covariance: [[T; 3]; 3] = core::array::from_fn(|r| {
            core::array::from_fn(|c| {
                let on_diagonal = if r == c { T::ONE } else { T::ZERO };
                match self.settings.start_variance {
                    Some(variance) => variance * on_diagonal,
                    None => doubt * fix.covariance[r][c] + T::of(START_SIGMA_M * START_SIGMA_M) * on_diagonal,
                }
            })
        });
        let start = self.start(fix.position, &covariance);
        self.take_height(fix);
        (self.round.used, self.round.taken) = (0, 0);
        for place in 0..self.round.ranges.len() {
            if let Some(range) = self.round.ranges.get(place).copied() {
                self.admit_range(&range, Some(place));
            }
        }
        for place in 0..self.round.tdoas.len() {
            if let Some(tdoa) = self.round.tdoas.get(place).copied() {
                self.admit_tdoa(&tdoa);
            }
        }
        self.heed_beacons();
        self.keep_enough();
        self.supervisor = Supervisor::default();
        self.used_us = self.now_us;
        start
    }

    /// Lets the least blocked of the ignored ranges into the track, where the settings want a round to keep some.
    fn keep_enough(&mut self) {
        let Blocked::Ignore { threshold, at_least } = self.settings.blocked else { return };
        let mut kept = 0_u16;
        for (place, range) in self.round.ranges.iter().enumerate() {
            if probability(range.blocked) < threshold {
                kept |= 1 << place;
            }
        }
        let more = self.round.with_least_blocked(kept, at_least.into()) & !kept;
        for place in 0..self.round.ranges.len() {
            if more >> place & 1 == 1
                && let Some(range) = self.round.ranges.get(place).copied()
            {
                self.track_range(&range, Some(place));
            }
        }
    }

    /// Ends a round of a track.
    #[inline(never)]
    fn go_on(&mut self) -> Output<T> {
        self.keep_enough();
        self.heed_beacons();
        let doubts = self.settings.supervised && self.supervisor.doubts();
        if (doubts || self.level.is_asked())
            && let Ok(fix) = self.round.solve(&self.settings)
        {
            let covariance = self.filter.state.position_covariance();
            if doubts && self.supervisor.condemns(self.filter.state.position(), &covariance, &fix) {
                self.give_up(Start::Contradicted);
                let start = self.begin_at(&fix);
                return Output { verdict: Verdict::Started(start), fix: self.fix() };
            }
            self.take_height(&fix);
        }
        Output { verdict: Verdict::Concluded, fix: self.fix() }
    }

    /// Lets the track have the height of a solved round, where ranges alone do not tell it.
    fn take_height(&mut self, fix: &Fix<T, 3>) {
        if self.settings.dimensions.height().is_none()
            && !self.round.ranges.is_empty()
            && let Some((height, deviation)) = self.level.of(fix)
        {
            self.filter.height(height, deviation, &self.settings);
        }
    }

    /// The track's position now.
    fn fix(&self) -> Result<TrackFix<T>, Missing> {
        self.track?;
        Ok(TrackFix {
            position: self.filter.state.position(),
            velocity: self.filter.state.velocity(),
            covariance: self.level.admit(self.filter.state.position_covariance()),
            used: crate::AnchorSet(self.round.used),
            quality: self.round.quality(),
            age_us: self.now_us.saturating_sub(self.used_us),
        })
    }
}
