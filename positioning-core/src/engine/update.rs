//! The update by one measurement: it goes into the track, or it is kept for the end of the round.

use super::{Engine, Verdict};
use crate::Real;
use crate::measurement::{BeaconPosition, Observation, Range, Tdoa};
use crate::track::UpdateResult;

impl<T: Real> Engine<T> {
    /// Takes a measurement that changes a track by itself, without a round.
    pub(super) fn observe(&mut self, observation: &impl Observation<T>) -> Verdict {
        if self.track.is_err() {
            return Verdict::NoTrack;
        }
        let result = self.apply(observation);
        self.conclude(result, None)
    }

    /// Takes a measurement into both hypotheses; the result is that of the track.
    pub(super) fn apply(&mut self, observation: &impl Observation<T>) -> UpdateResult {
        if let Some(rival) = self.rival.filter() {
            observation.update(rival, &self.settings.filter);
        }
        observation.update(&mut self.filter, &self.settings.filter)
    }

    pub(super) fn range(&mut self, range: &Range<T>) -> Verdict {
        let excess = if self.settings.mitigate { range.excess_m.unwrap_or(T::ZERO) } else { T::ZERO };
        let range = Range { distance_m: range.distance_m - excess, ..*range };
        let place = self.round.keep(&range, self.now_us);
        self.round.given = self.round.given.saturating_add(1);
        if self.track.is_err() {
            return Verdict::Held;
        }
        if self.is_vague() {
            self.round.waits = true;
            return Verdict::Held;
        }
        self.check_range(&range, place)
    }

    /// Takes a range into the track, unless it is to be ignored.
    pub(super) fn check_range(&mut self, range: &Range<T>, place: usize) -> Verdict {
        if self.settings.admits(range.p_nlos) { self.track_range(range, place) } else { Verdict::Ignored }
    }

    /// Takes a range into the track.
    pub(super) fn track_range(&mut self, range: &Range<T>, place: usize) -> Verdict {
        let result = self.apply(range);
        self.conclude(result, Some(place))
    }

    pub(super) fn tdoa(&mut self, tdoa: &Tdoa<T>) -> Verdict {
        self.round.given = self.round.given.saturating_add(1);
        self.round.unjudged = self.round.unjudged.saturating_add(1);
        let held = self.round.tdoas.push(*tdoa).is_ok();
        if self.track.is_err() {
            return if held { Verdict::Held } else { Verdict::NoTrack };
        }
        if self.settings.admits_difference(tdoa) { self.observe(tdoa) } else { Verdict::Ignored }
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

    /// Counts the result of a measurement; `place` is the index of a range in its round.
    pub(super) fn conclude(&mut self, result: UpdateResult, place: Option<usize>) -> Verdict {
        match result {
            UpdateResult::Rejected => Verdict::Refused,
            UpdateResult::NoPlace => Verdict::Ignored,
            UpdateResult::Accepted | UpdateResult::Readmitted => {
                self.used_us = self.now_us;
                self.round.count(place);
                if result == UpdateResult::Accepted { Verdict::Used } else { Verdict::Readmitted }
            }
        }
    }
}
