//! What comes out of the fusion.

use positioning_core::Real;

/// What became of a value. None is an error: values come from the air.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It is kept until the next step.
    Held,
    /// It is no value: not finite, absurdly large, a power that is not negative, or its node has no place or no channel.
    NotSane,
    /// The settings ask for the other kind alone.
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
    /// The numbers ran out.
    Diverged,
}

/// A position with what is known of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate<T, const D: usize> {
    /// Mean of the posterior, metres: the least square error.
    pub mean: [T; D],
    /// Its mode, metres: the maximum a posteriori.
    pub mode: [T; D],
    /// Covariance of the posterior, m².
    pub covariance: [[T; D]; D],
    /// Mean velocity, metres a second.
    pub velocity: [T; D],
    /// Natural logarithm of how probable the step's values were, over the greatest density of each node's; 0 without values.
    pub evidence: T,
    /// Nodes that had fresh values.
    pub nodes: usize,
    /// Whether this is the first position of a track.
    pub started: bool,
}

impl<T: Real, const D: usize> Estimate<T, D> {
    /// Standard deviation, all axes together, metres.
    pub fn spread(&self) -> T {
        (0..D).fold(T::ZERO, |sum, axis| sum + self.covariance[axis][axis]).sqrt()
    }
}
