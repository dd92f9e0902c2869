//! Track management at the end of a round: a track is started, checked or given up, or the round is solved by itself.

use super::{Engine, HeightSource, Missing, Mode, Output, Start, TrackFix, Verdict};
use crate::measurement::{Observation as _, probability};
use crate::track::{Blocked, Supervisor};
use crate::{Fix, Real};

/// The factor on the variance of a track's first position, relative to the solver's. The same ranges will enter the
/// track, and must not count twice.
const START_DOUBT: f64 = 9.0;
/// A further deviation of the first position, metres.
const START_SIGMA_M: f64 = 0.3;
/// The multiplied deviation of an axis is limited to about this, metres.
const START_GREATEST_M: f64 = 1.0;

/// A track that is more uncertain than this, metres, all axes together, is vague.
const VAGUE_M: f64 = 1.5;
/// The greatest distance, in joint deviations, at which the track and a position may be the same.
const AGREES: f64 = 4.0;

impl<T: Real> Engine<T> {
    #[inline(never)]
    pub(super) fn end_round(&mut self) -> Output<T> {
        let output = match self.settings.mode {
            Mode::Solve => Output { verdict: Verdict::Concluded, fix: self.solved() },
            Mode::Track if self.track.is_err() => self.begin(),
            Mode::Track => self.update_track(),
        };
        self.round.clear();
        output
    }

    /// The position of the round by itself.
    fn solved(&self) -> Result<TrackFix<T>, Missing> {
        let fix = self.round.solve(&self.settings).map_err(Missing::SolveError)?;
        let Fix { position, covariance, used, quality, .. } = fix;
        Ok(TrackFix { position, velocity: [T::ZERO; 3], covariance, used, quality, age_us: 0 })
    }

    /// Starts a track from the round.
    #[inline(never)]
    fn begin(&mut self) -> Output<T> {
        match self.round.solve(&self.settings) {
            Ok(fix) => {
                let start = self.start_track(&fix);
                Output { verdict: Verdict::Started(start), fix: self.fix() }
            }
            Err(reason) => Output { verdict: Verdict::Concluded, fix: Err(Missing::SolveError(reason)) },
        }
    }

    /// Starts a track near a solved position, and gives it the round's measurements.
    fn start_track(&mut self, fix: &Fix<T, 3>) -> Start {
        // Where the solver did not know on which side of the anchors the tag is, its covariance reaches to the other
        // side. The track is on this side. An uncertainty of metres would make its first linearisations wrong.
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
        self.check_ranges();
        for place in 0..self.round.tdoas.len() {
            if let Some(tdoa) = self.round.tdoas.get(place).copied() {
                self.check_tdoa(&tdoa);
            }
        }
        self.apply_beacon_position();
        self.apply_min_anchors();
        self.supervisor = Supervisor::default();
        self.used_us = self.now_us;
        start
    }

    /// Whether the track is too uncertain to linearise ranges about it one by one. This is the case among beacons:
    /// the first range would move the track away from the position where the ranges meet. Such a round is solved
    /// first.
    pub(super) fn is_vague(&self) -> bool {
        self.filter.state.spread() > T::of(VAGUE_M * VAGUE_M)
    }

    /// Whether the round's own position is more certain than the track, and may be the same.
    fn agrees(&self, fix: &Fix<T, 3>) -> bool {
        let (mut square, mut variance) = (T::ZERO, T::ZERO);
        for (axis, at) in self.filter.state.position().into_iter().enumerate() {
            square += (at - fix.position[axis]).squared();
            variance += fix.covariance[axis][axis];
        }
        let spread = self.filter.state.spread();
        variance < spread && square <= T::of(AGREES * AGREES) * (spread + variance)
    }

    /// Gives the round's ranges to the track.
    fn check_ranges(&mut self) {
        for place in 0..self.round.ranges.len() {
            if let Some(range) = self.round.ranges.get(place).copied() {
                self.check_range(&range, Some(place));
            }
        }
    }

    /// Gives the position by beacons to the track, if the round has one.
    fn apply_beacon_position(&mut self) {
        if let (Some(position), Some(_)) = (self.round.by_beacons, self.settings.dimensions.height()) {
            let result = position.update(&mut self.filter, &self.settings.filter);
            self.conclude(result, None);
        }
    }

    /// Gives the least blocked of the ignored ranges to the track, if the settings keep some per round.
    fn apply_min_anchors(&mut self) {
        let Blocked::Ignore { threshold, at_least } = self.settings.filter.blocked else { return };
        let mut kept = 0_u16;
        for (place, range) in self.round.ranges.iter().enumerate() {
            if probability(range.p_nlos) < threshold {
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

    /// Ends a round with a track.
    #[inline(never)]
    fn update_track(&mut self) -> Output<T> {
        if core::mem::take(&mut self.round.waits) {
            if let Ok(fix) = self.round.solve(&self.settings)
                && self.agrees(&fix)
            {
                self.start_track(&fix);
                return Output { verdict: Verdict::Concluded, fix: self.fix() };
            }
            self.check_ranges();
        }
        self.apply_min_anchors();
        self.apply_beacon_position();
        let doubts = self.settings.supervised && self.supervisor.doubts();
        if (doubts || self.height.is_asked())
            && let Ok(fix) = self.round.solve(&self.settings)
        {
            let covariance = self.filter.state.position_covariance();
            if doubts && self.supervisor.rejects(self.filter.state.position(), &covariance, &fix) {
                self.reset(Start::Contradicted);
                let start = self.start_track(&fix);
                return Output { verdict: Verdict::Started(start), fix: self.fix() };
            }
            self.take_height(&fix);
        }
        Output { verdict: Verdict::Concluded, fix: self.fix() }
    }

    /// Gives the height of a solved round to the track, where ranges alone do not determine it.
    fn take_height(&mut self, fix: &Fix<T, 3>) {
        if self.settings.dimensions.height().is_none()
            && !self.round.ranges.is_empty()
            && let Some(height) = self.height.of(fix)
        {
            height.update(&mut self.filter, &self.settings.filter);
        }
    }

    /// Starts a track.
    pub(super) fn start(&mut self, position: [T; 3], covariance: &[[T; 3]; 3]) -> Start {
        let flat = self.settings.dimensions.height().is_some();
        self.filter.start(self.now_us, position, covariance, flat, &self.settings.filter);
        self.height = HeightSource::new();
        self.supervisor = Supervisor::default();
        self.track = Ok(());
        self.used_us = self.now_us;
        self.next_start
    }
}
