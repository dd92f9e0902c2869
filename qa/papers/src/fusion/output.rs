//! The output of the fusion.

use positioning_core::Real;

/// What was done with a value. None of these is an error, because values come from the radio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FusionVerdict {
    /// It is kept until the next step.
    Held,
    /// It is not a valid value: not finite, absurdly large, a power that is not negative, or its node has no position
    /// or no channel.
    NotSane,
    /// The settings allow only the other kind.
    Ignored,
    /// There is no room for another node.
    NoRoom,
}

/// Why there is no position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Missing {
    /// Values of at least three nodes (four in space) are needed to begin, or to begin again.
    TooFewNodes,
    /// No value for longer than the settings allow.
    Gap,
    /// The numbers overflowed or are not finite.
    Diverged,
}

/// A position with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FusionEstimate<T, const D: usize> {
    /// Mean of the posterior, metres: the estimate of the least square error.
    pub mean: [T; D],
    /// Its mode, metres: the maximum a posteriori estimate.
    pub mode: [T; D],
    /// Covariance of the posterior, m².
    pub covariance: [[T; D]; D],
    /// Mean velocity, metres a second.
    pub velocity: [T; D],
    /// Natural logarithm of the probability of the step's values, over the greatest density of each node's values; 0
    /// without values.
    pub evidence: T,
    /// Number of nodes that had fresh values.
    pub nodes: usize,
    /// Whether this is the first position of a track.
    pub started: bool,
}

impl<T: Real, const D: usize> FusionEstimate<T, D> {
    /// Standard deviation, all axes together, metres.
    pub fn spread(&self) -> T {
        (0..D).fold(T::ZERO, |sum, axis| sum + self.covariance[axis][axis]).sqrt()
    }
}
