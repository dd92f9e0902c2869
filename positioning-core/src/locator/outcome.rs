//! The output of a locator at the end of a round or window.

use heapless::Vec;

use crate::engine::{Missing, Output, TrackFix, Verdict};
use crate::{Alternative, Flag, MAX_ANCHORS, Real, SolveError};

/// The end of a round, or of a window of beacons.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TagUpdate {
    /// The engine's current position of the tag, or why there is none.
    pub fix: Result<TrackFix<f32>, Missing>,
    /// The other of two places that explain the ranges.
    pub alternative: Option<Alternative<f32, 3>>,
    /// The measurements that were used: bit i is the i-th range, difference or RSSI.
    pub used: u16,
    /// The number of measurements.
    pub measured: usize,
}

/// A position in space. A tag at a known height has that height, and no variance in z.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Position {
    /// The position, metres, in the anchors' frame.
    pub position_m: [f32; 3],
    /// Covariance, m²; zero in the row and column of a known height.
    pub covariance_m2: [[f32; 3]; 3],
    /// The measurements of the round that were used: bit i is the i-th range, difference or RSSI.
    pub used: u16,
    /// How far the round agrees with the position, 0 to 1.
    pub quality: f32,
    /// What makes the position doubtful beyond its covariance.
    pub flag: Option<Flag>,
    /// The other of two places that explain the ranges, metres.
    pub alternative_m: Option<[f32; 3]>,
}

impl TagUpdate {
    /// The position that this round or window has made. A track that is only predicted is not a position.
    ///
    /// # Errors
    /// There is no position; the error has the reason. It is [`SolveError::RangesDisjoint`] if no measurement could
    /// belong to the track.
    pub fn position(&self) -> Result<Position, SolveError> {
        match self.fix {
            Ok(fix) if fix.age_us == 0 => Ok(Position {
                position_m: fix.position,
                covariance_m2: fix.covariance,
                used: self.used,
                quality: fix.quality,
                flag: fix.flag,
                alternative_m: self
                    .alternative
                    .map(|of| core::array::from_fn(|axis| fix.position[axis] + of.apart[axis])),
            }),
            Ok(_) if self.measured > 0 => Err(SolveError::RangesDisjoint),
            // A round that has ended has a position, or a solver's error.
            Ok(_) | Err(Missing::RoundOpen | Missing::Lost(_)) => Err(SolveError::TooFewAnchors),
            Err(Missing::SolveError(reason)) => Err(reason),
        }
    }
}

impl Position {
    /// Standard deviation along each axis, metres.
    pub fn deviation_m(&self) -> [f32; 3] {
        core::array::from_fn(|axis| Real::sqrt(self.covariance_m2[axis][axis]))
    }

    /// Whether the height was given and not computed.
    pub fn height_is_given(&self) -> bool {
        self.covariance_m2[2][2] == 0.0
    }
}

/// The measurements of a round that the engine has used.
#[derive(Clone, Default)]
pub(super) struct Used {
    /// The index in the round of each range that the engine counts.
    ranges: Vec<u8, MAX_ANCHORS>,
    /// The differences or RSSI values that were used, or that wait for the round's end: bit i is the round's i-th.
    others: u16,
}

impl Used {
    /// Counts the range of this index.
    pub(super) fn range(&mut self, index: usize, verdict: Verdict) {
        if verdict != Verdict::NotSane {
            // The engine keeps no more ranges of a round.
            let _ = self.ranges.push(index as u8);
        }
    }

    /// Counts differences or RSSI values, by the bits of their indices.
    pub(super) fn count(&mut self, indices: u16, verdict: Verdict) {
        match verdict {
            Verdict::Used | Verdict::Readmitted | Verdict::Held => self.others |= indices,
            Verdict::Refused
            | Verdict::Ignored
            | Verdict::NotSane
            | Verdict::NoTrack
            | Verdict::Concluded
            | Verdict::Started(_) => {}
        }
    }

    /// All measurements that were used, by indices, at the end of the round.
    pub(super) fn of(self, end: &Output<f32>) -> u16 {
        let Ok(fix) = &end.fix else { return 0 };
        let ranges = self.ranges.iter().enumerate().filter(|(place, _)| fix.used.contains(*place));
        ranges.fold(self.others, |set, (_, index)| set | 1_u16.checked_shl((*index).into()).unwrap_or(0))
    }
}
