//! The supervisor checks whether the track can be right at all. If the track's gates refuse much of a round, and from
//! time to time in any case, the round is solved without the track. A track that repeatedly contradicts such
//! positions is given up.

use crate::{Fix, Real};

/// A round is checked if at least this share of it is refused: a third.
const REFUSED_THIRDS: u32 = 3;
/// One round in this number is checked in any case.
const AUDIT: u8 = 64;
/// The number of contradictions in a row that end a track.
const STRIKES: u8 = 3;
/// The distance of a position, in joint deviations, that is a contradiction.
const CONTRADICTION: f64 = 4.0;
/// A smaller distance is never a contradiction, metres.
const AGREEMENT_M: f64 = 0.5;

/// The supervisor of one track.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Supervisor {
    taken: u32,
    refused: u32,
    rounds: u8,
    strikes: u8,
}

impl Supervisor {
    /// Counts a measurement of the round.
    pub(crate) fn count(&mut self, refused: bool) {
        if refused {
            self.refused = self.refused.saturating_add(1);
        } else {
            self.taken = self.taken.saturating_add(1);
        }
    }

    /// Ends a round. Returns whether the round should be solved without the track.
    pub(crate) fn doubts(&mut self) -> bool {
        let (taken, refused) = (core::mem::take(&mut self.taken), core::mem::take(&mut self.refused));
        self.rounds = self.rounds.wrapping_add(1);
        let much = refused > 0 && refused.saturating_mul(REFUSED_THIRDS) >= taken.saturating_add(refused);
        if !much && self.strikes == 0 {
            return self.rounds.is_multiple_of(AUDIT);
        }
        true
    }

    /// Compares the track with a round's own position. Returns whether the track is to be given up.
    pub(crate) fn rejects<T: Real>(&mut self, position: [T; 3], covariance: &[[T; 3]; 3], fix: &Fix<T, 3>) -> bool {
        let (mut square, mut variance) = (T::ZERO, T::ZERO);
        for axis in 0..3 {
            square += (position[axis] - fix.position[axis]).squared();
            variance += covariance[axis][axis] + fix.covariance[axis][axis];
        }
        let bound = T::of(CONTRADICTION * CONTRADICTION) * variance;
        if square <= bound.at_least(T::of(AGREEMENT_M * AGREEMENT_M)) {
            self.strikes = 0;
            return false;
        }
        self.strikes = self.strikes.saturating_add(1);
        self.strikes >= STRIKES
    }
}
