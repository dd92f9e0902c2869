//! Whether the track can be right at all: where its own gates refuse much of a round, and from time to time anyway, the round is solved
//! without the track, and a track that goes on contradicting such positions is given up.

use crate::{Fix, Real};

/// A round of which at least this share is refused is looked into: a third.
const REFUSED_THIRDS: u32 = 3;
/// Every so many rounds one is looked into in any case.
const AUDIT: u8 = 64;
/// So many contradictions in a row end a track.
const STRIKES: u8 = 3;
/// A position that is off by so many joint deviations contradicts.
const CONTRADICTION: f64 = 4.0;
/// No distance under this is a contradiction, metres.
const AGREEMENT_M: f64 = 0.5;

/// The watch over one track.
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

    /// At the end of a round: whether it should be solved without the track.
    pub(crate) fn doubts(&mut self) -> bool {
        let (taken, refused) = (core::mem::take(&mut self.taken), core::mem::take(&mut self.refused));
        self.rounds = self.rounds.wrapping_add(1);
        let much = refused > 0 && refused.saturating_mul(REFUSED_THIRDS) >= taken.saturating_add(refused);
        if !much && self.strikes == 0 {
            return self.rounds.is_multiple_of(AUDIT);
        }
        true
    }

    /// Compares the track with a round's own position; whether the track is to be given up.
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
