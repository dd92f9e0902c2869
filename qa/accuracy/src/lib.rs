//! The statistics of the accuracy protocol (`qa/accuracy/README.md`): the figures of a recording, the ratio
//! of two errors with its standard error, the verdict over sites, and the choice of settings that leaves a site out.
//!
//! Successive errors are alike, so an error's uncertainty comes from [`Block`]s of successive epochs and not from
//! single ones. [`prior`] has recordings that are drawn from broad distributions, on which no setting was chosen.

#![forbid(unsafe_code)]

mod blocks;
pub mod draw;
pub mod field;
mod figures;
pub mod honesty;
mod left_out;
pub mod mistakes;
pub mod prior;
mod verdict;

pub use blocks::{Block, LogRatio, Measure, blocks, over_recordings, ratio};
pub use figures::{Excursion, Figures};
pub use left_out::{Choice, choices};
pub use verdict::{ChangeVerdict, LEAST_ANSWERED, SiteOutcome, outcome, verdict};

/// A silence of this length begins a new block, and whoever follows the tag begins anew, seconds.
const SILENCE_S: f64 = 10.0;

/// The result of an epoch whose true position is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScoredEpoch {
    /// The epoch's time, seconds.
    pub t_s: Option<f64>,
    /// The horizontal error, metres; `None` without a position.
    pub error_m: Option<f64>,
    /// The squared horizontal error in units of its covariance; `None` without a position or a covariance.
    pub normalised_square: Option<f64>,
}

/// Two methods' results of the same epochs, where both have a position.
pub fn both_fixed(one: &[ScoredEpoch], other: &[ScoredEpoch]) -> [Vec<ScoredEpoch>; 2] {
    let both = one.iter().zip(other).filter(|(one, other)| one.error_m.is_some() && other.error_m.is_some());
    let (one, other) = both.map(|(one, other)| (*one, *other)).unzip();
    [one, other]
}

/// Whether an epoch does not follow the one before: after a silence, or where the time does not advance.
fn begins_anew(before_s: Option<f64>, t_s: Option<f64>) -> bool {
    before_s.zip(t_s).is_some_and(|(before_s, t_s)| t_s > before_s + SILENCE_S || t_s <= before_s)
}
