//! The update by one measurement: it goes into the track, or it is kept for the end of the round.

use super::round::length;
use super::{Engine, Mode, Verdict};
use crate::Real;
use crate::measurement::{BeaconPosition, ExternalPosition, Height, Observation, Range, Tdoa, probability};
use crate::track::{Blocked, UpdateResult};

impl<T: Real> Engine<T> {
    /// Takes a measurement that changes a track by itself, without a round.
    pub(super) fn observe(&mut self, observation: &impl Observation<T>) -> Verdict {
        if self.track.is_err() {
            return Verdict::NoTrack;
        }
        let result = observation.update(&mut self.filter, &self.settings.filter);
        self.conclude(result, None)
    }

    pub(super) fn range(&mut self, range: &Range<T>) -> Verdict {
        let place = self.round.keep(range);
        self.round.given = self.round.given.saturating_add(1);
        if self.track.is_err() {
            return Verdict::Held;
        }
        if place.is_some() && self.is_vague() {
            self.round.waits = true;
            return Verdict::Held;
        }
        self.check_range(range, place)
    }

    /// Takes a range into the track, unless it is to be ignored.
    pub(super) fn check_range(&mut self, range: &Range<T>, place: Option<usize>) -> Verdict {
        match self.settings.filter.blocked {
            Blocked::Ignore { threshold, .. } if probability(range.p_nlos) >= threshold => Verdict::Ignored,
            Blocked::Ignore { .. } | Blocked::Alike | Blocked::TwoVariances { .. } | Blocked::Weigh => {
                self.track_range(range, place)
            }
        }
    }

    /// Takes a range into the track.
    pub(super) fn track_range(&mut self, range: &Range<T>, place: Option<usize>) -> Verdict {
        let shortened = Range { distance_m: length(range, &self.settings), ..*range };
        let result = shortened.update(&mut self.filter, &self.settings.filter);
        self.conclude(result, place)
    }

    pub(super) fn tdoa(&mut self, tdoa: &Tdoa<T>) -> Verdict {
        self.round.given = self.round.given.saturating_add(1);
        if self.track.is_err() {
            return if self.round.tdoas.push(*tdoa).is_ok() { Verdict::Held } else { Verdict::NoTrack };
        }
        self.check_tdoa(tdoa)
    }

    /// Takes a difference into the track, unless it is to be ignored.
    pub(super) fn check_tdoa(&mut self, tdoa: &Tdoa<T>) -> Verdict {
        if let Blocked::Ignore { threshold, .. } = self.settings.filter.blocked
            && tdoa.p_nlos.iter().any(|&p_nlos| probability(p_nlos) >= threshold)
        {
            return Verdict::Ignored;
        }
        let result = tdoa.update(&mut self.filter, &self.settings.filter);
        self.conclude(result, None)
    }

    /// Keeps a position by beacons for the round's end. If there are several, the last one counts. In space it is
    /// ignored: it has no height, and too little information.
    pub(super) fn beacon_position(&mut self, position: &BeaconPosition<T>) -> Verdict {
        if self.settings.dimensions.height().is_none() {
            return Verdict::Ignored;
        }
        self.round.given = self.round.given.saturating_add(1);
        self.round.by_beacons = Some(*position);
        Verdict::Held
    }

    pub(super) fn external_height(&mut self, height: &Height<T>) -> Verdict {
        if self.track.is_ok() {
            self.height.set_external();
        }
        self.observe(height)
    }

    pub(super) fn external_position(&mut self, position: &ExternalPosition<T>) -> Verdict {
        if self.track.is_ok() {
            self.height.set_external();
            return self.observe(position);
        }
        match self.settings.mode {
            Mode::Solve => Verdict::NoTrack,
            Mode::Track => {
                let height = self.settings.dimensions.height();
                let start = core::array::from_fn(|axis| match height {
                    Some(height) if axis == 2 => height,
                    Some(_) | None => position.position_m[axis],
                });
                Verdict::Started(self.start(start, &position.covariance_m2))
            }
        }
    }

    /// Counts the result of a measurement; `place` is the index of a range in its round.
    pub(super) fn conclude(&mut self, result: UpdateResult, place: Option<usize>) -> Verdict {
        self.supervisor.count(result == UpdateResult::Rejected);
        match result {
            UpdateResult::Rejected => Verdict::Refused,
            UpdateResult::Accepted | UpdateResult::Readmitted => {
                self.used_us = self.now_us;
                self.round.count(place);
                if result == UpdateResult::Accepted { Verdict::Used } else { Verdict::Readmitted }
            }
        }
    }
}
