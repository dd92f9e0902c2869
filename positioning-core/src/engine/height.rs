//! The height of a track in space, where ranges alone do not determine it.
//!
//! Anchors usually hang at about one height. A lower tag and a common error that makes all ranges longer then look
//! alike, and the errors of links decide between the two. In recordings, a track found a height, kept it, and erred
//! by half a metre. A round that is solved by itself is cautious: its solver leaves the common error near zero unless
//! the ranges contradict that. So x and y are tracked. The height follows that of the solved rounds, while these know
//! the height much worse than x and y. Any number of rounds makes such a height no more certain than one round does.

use crate::measurement::Height;
use crate::{Fix, Real};

/// A solved height whose deviation is this many times that of x or y is not determined by the ranges.
const AMBIGUOUS: f64 = 3.0;
/// The deviation with which the track takes a solved height, metres: the heights of rounds scatter by about this.
const SCATTER_M: f64 = 0.15;

/// The source of the height.
#[derive(Clone, Copy, Debug)]
pub(super) enum HeightSource<T> {
    /// From ranges.
    Known,
    /// From solved rounds; the value is the variance of the last one, m².
    Solved(T),
}

impl<T: Real> HeightSource<T> {
    /// Until a round is solved, the ranges are assumed to determine the height.
    pub(super) fn new() -> Self {
        Self::Known
    }

    /// Whether each round should be solved for its height.
    pub(super) fn is_asked(&self) -> bool {
        matches!(self, Self::Solved(_))
    }

    /// The height that a track should take from a solved round.
    pub(super) fn of(&mut self, fix: &Fix<T, 3>) -> Option<Height<T>> {
        let variances: [T; 3] = core::array::from_fn(|axis| fix.covariance[axis][axis]);
        let ambiguous = variances[2] > T::of(AMBIGUOUS * AMBIGUOUS) * variances[0].at_least(variances[1]);
        *self = if ambiguous { Self::Solved(variances[2]) } else { Self::Known };
        ambiguous.then_some(Height { height_m: fix.position[2], deviation_m: T::of(SCATTER_M) })
    }

    /// A track's covariance, with a height that is no more certain than its source.
    pub(super) fn admit(&self, mut covariance: [[T; 3]; 3]) -> [[T; 3]; 3] {
        if let Self::Solved(variance) = *self {
            covariance[2][2] = covariance[2][2].at_least(variance);
        }
        covariance
    }
}
