//! What comes out of the engine.

use crate::{AnchorSet, Real, SolveError};

/// After a measurement: what became of it, and where the tag is now.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Output<T> {
    /// What became of the measurement.
    pub verdict: Verdict,
    /// The position at the time of the step, or why there is none.
    pub fix: Result<TrackFix<T>, Missing>,
}

/// What became of a measurement. A refused one is no error: it is how doubt about a source is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Verdict {
    /// It changed the position.
    Used,
    /// It changed the position, after its source had been refused for a while: that source's error is believed to be another now.
    Readmitted,
    /// It cannot belong to the track.
    Refused,
    /// It is kept until the end of the round.
    Held,
    /// It is rather without line of sight, and the settings ignore such.
    Ignored,
    /// It is no measurement: a number is not finite, absurdly large, or a deviation not positive.
    NotSane,
    /// There is no track that it could change.
    NoTrack,
    /// The round's end made a position, or none.
    Concluded,
    /// The round's end started a track.
    Started(Start),
}

/// Why a track was started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Start {
    /// It is the first.
    First,
    /// The last one contradicted the ranges.
    Contradicted,
    /// The last one had become too uncertain, or numbers had run out of it.
    Lost,
    /// Nothing had been measured for too long.
    Gap,
    /// The clock had begun anew.
    Clock,
}

/// A position at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TrackFix<T> {
    /// Metres, in the anchors' frame.
    pub position: [T; 3],
    /// Metres a second; zero where every round is solved by itself.
    pub velocity: [T; 3],
    /// The position's covariance, m²; zero in the row and column of a height that was given.
    pub covariance: [[T; 3]; 3],
    /// The ranges of this round that have made it so far: bit i is the i-th that was given.
    pub used: AnchorSet,
    /// How far the round agrees with it, 0 to 1: its solver's word, or the share of what was given that was used.
    pub quality: T,
    /// The time since the last measurement that was used, microseconds.
    pub age_us: u64,
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
    /// The reason as files and telemetry spell it.
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
