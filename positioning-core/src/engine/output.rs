//! The outputs of the engine.

use crate::{AnchorSet, Flag, Real, SolveError};

/// The result of a measurement: its verdict, and the tag's current position.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Output<T> {
    /// The verdict on the measurement.
    pub verdict: Verdict,
    /// The position at the time of the step, or why there is none.
    pub fix: Result<TrackFix<T>, Missing>,
}

/// The verdict on a measurement. A refused measurement is not an error: its source is uncertain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Verdict {
    /// It changed the position.
    Used,
    /// It changed the position after its source had been refused for a while. That source's error is assumed to have
    /// changed.
    Readmitted,
    /// It cannot belong to the track.
    Refused,
    /// It is kept until the end of the round.
    Held,
    /// It is probably without line of sight, and the settings ignore such measurements.
    Ignored,
    /// It is not a valid measurement: a number is not finite or is absurdly large, or a deviation is not positive.
    NotSane,
    /// There is no track to change.
    NoTrack,
    /// The end of the round made a position, or none.
    Concluded,
    /// The end of the round started a track.
    Started(Start),
}

/// Why a track was started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Start {
    /// It is the first track.
    First,
    /// The last track contradicted the ranges.
    Contradicted,
    /// The last track had become too uncertain, or its numbers were no longer finite.
    Lost,
    /// Nothing had been measured for too long.
    Gap,
    /// The clock had been reset.
    Clock,
}

/// A position of the track.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TrackFix<T> {
    /// The position, metres, in the anchors' frame.
    pub position: [T; 3],
    /// The velocity, metres per second; zero where every round is solved by itself.
    pub velocity: [T; 3],
    /// The position's covariance, m²; zero in the row and column of a known height.
    pub covariance: [[T; 3]; 3],
    /// The ranges of this round that have been used so far: bit i is the i-th range given.
    pub used: AnchorSet,
    /// How far the round agrees with the position, 0 to 1: the solver's quality, or the share of the given
    /// measurements that was used.
    pub quality: T,
    /// The time since the last measurement that was used, microseconds.
    pub age_us: u64,
    /// What makes the position doubtful beyond its covariance.
    pub flag: Option<Flag>,
}

impl<T: Real> TrackFix<T> {
    /// Standard deviation along each axis, metres.
    pub fn sigma(&self) -> [T; 3] {
        core::array::from_fn(|axis| self.covariance[axis][axis].sqrt())
    }
}

/// Why there is no position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Missing {
    /// The round has not ended, and there is no track.
    RoundOpen,
    /// The round could not be solved.
    SolveError(SolveError),
    /// The track was given up, and no round has ended since.
    Lost(Start),
}

impl Missing {
    /// The reason as it is written in files and telemetry.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::RoundOpen => "round-open",
            Self::SolveError(reason) => reason.as_str(),
            Self::Lost(Start::First) => "no-track",
            Self::Lost(Start::Contradicted) => "contradicted",
            Self::Lost(Start::Lost) => "track-lost",
            Self::Lost(Start::Gap) => "gap",
            Self::Lost(Start::Clock) => "clock-restarted",
        }
    }
}
