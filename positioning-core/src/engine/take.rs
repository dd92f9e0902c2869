//! One measurement at a time: whether it is one, and into the track or the round with it.

use super::measurement::{BeaconPosition, Range, Tdoa, height_is_sane, known, position_is_sane, probability};
use super::round::length;
use super::{Engine, Mode, Verdict};
use crate::Real;
use crate::track::{Blocked, UpdateResult};

impl<T: Real> Engine<T> {
    pub(super) fn range(&mut self, range: &Range<T>) -> Verdict {
        if !range.is_sane() {
            return Verdict::NotSane;
        }
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
        match self.settings.blocked {
            Blocked::Ignore { threshold, .. } if probability(range.blocked) >= threshold => Verdict::Ignored,
            Blocked::Ignore { .. } | Blocked::Alike | Blocked::TwoVariances { .. } | Blocked::Weigh => {
                self.track_range(range, place)
            }
        }
    }

    /// Takes a range into the track.
    pub(super) fn track_range(&mut self, range: &Range<T>, place: Option<usize>) -> Verdict {
        let shortened = Range { distance: length(range, &self.settings), ..*range };
        let fate = self.filter.range(&shortened, known(range.blocked), &self.settings);
        self.verdict(fate, place)
    }

    pub(super) fn tdoa(&mut self, tdoa: &Tdoa<T>) -> Verdict {
        if !tdoa.is_sane() {
            return Verdict::NotSane;
        }
        self.round.given = self.round.given.saturating_add(1);
        if self.track.is_err() {
            return if self.round.tdoas.push(*tdoa).is_ok() { Verdict::Held } else { Verdict::NoTrack };
        }
        self.check_tdoa(tdoa)
    }

    /// Takes a difference into the track, unless it is to be ignored.
    pub(super) fn check_tdoa(&mut self, tdoa: &Tdoa<T>) -> Verdict {
        if let Blocked::Ignore { threshold, .. } = self.settings.blocked
            && tdoa.blocked.iter().any(|&blocked| probability(blocked) >= threshold)
        {
            return Verdict::Ignored;
        }
        let fate = self.filter.tdoa(tdoa, tdoa.blocked.map(known), &self.settings);
        self.verdict(fate, None)
    }

    /// Keeps a position by beacons for the round's end; of several the last. In space it tells no height, and too little.
    pub(super) fn beacon_position(&mut self, position: &BeaconPosition<T>) -> Verdict {
        if !position.is_sane() {
            return Verdict::NotSane;
        }
        if self.settings.dimensions.height().is_none() {
            return Verdict::Ignored;
        }
        self.round.given = self.round.given.saturating_add(1);
        self.round.by_beacons = Some(*position);
        Verdict::Held
    }

    pub(super) fn height(&mut self, height: T, deviation: T) -> Verdict {
        if !height_is_sane(height, deviation) {
            return Verdict::NotSane;
        }
        if self.track.is_err() {
            return Verdict::NoTrack;
        }
        self.height_source.set_external();
        let fate = self.filter.height(height, deviation, &self.settings);
        self.verdict(fate, None)
    }

    pub(super) fn position(&mut self, position: &[T; 3], covariance: &[[T; 3]; 3]) -> Verdict {
        if !position_is_sane(position, covariance) {
            return Verdict::NotSane;
        }
        if self.track.is_ok() {
            self.height_source.set_external();
            let fate = self.filter.position(*position, covariance, &self.settings);
            return self.verdict(fate, None);
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

    pub(super) fn verdict(&mut self, fate: UpdateResult, place: Option<usize>) -> Verdict {
        self.supervisor.count(fate == UpdateResult::Rejected);
        match fate {
            UpdateResult::Rejected => Verdict::Refused,
            UpdateResult::Accepted | UpdateResult::Readmitted => {
                self.used_us = self.now_us;
                self.round.count(place);
                if fate == UpdateResult::Accepted { Verdict::Used } else { Verdict::Readmitted }
            }
        }
    }
}
