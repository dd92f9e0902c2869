//! The height of a track in space, where ranges alone do not tell it.
//!
//! Anchors hang at about one height, as a rule. How far a tag is below them and how much too long all its ranges are then look
//! alike, and the errors of links decide between the two: a track would find a height, keep to it, and err by half a metre
//! (recorded). A round that is solved by itself is cautious: its solver leaves the common error near nothing unless ranges
//! insist. So x and y are tracked, and the height follows those of the solved rounds, as far as these know height much worse
//! than the rest. No number of rounds makes such a height surer than one round does.

use crate::measurement::Height;
use crate::{Fix, Real};

/// A solved height whose deviation is so many times that of x or y is not told by ranges.
const AMBIGUOUS: f64 = 3.0;
/// Deviation with which the track takes a solved height, metres: rounds scatter by about this.
const SCATTER_M: f64 = 0.15;

/// Where the height comes from.
#[derive(Clone, Copy, Debug)]
pub(super) enum HeightSource<T> {
    /// From ranges, or from whoever told it.
    Known,
    /// From solved rounds; this is the variance of the last one, m².
    Solved(T),
    /// Somebody tells it; solved rounds are not needed.
    Told,
}

impl<T: Real> HeightSource<T> {
    /// Until a round is solved, ranges are believed to tell it.
    pub(super) fn new() -> Self {
        Self::Known
    }

    /// Somebody has measured it.
    pub(super) fn set_external(&mut self) {
        *self = Self::Told;
    }

    /// Whether each round should be solved for it.
    pub(super) fn is_asked(&self) -> bool {
        matches!(self, Self::Solved(_))
    }

    /// The height that a track should take of a solved round.
    pub(super) fn of(&mut self, fix: &Fix<T, 3>) -> Option<Height<T>> {
        if matches!(self, Self::Told) {
            return None;
        }
        let variances: [T; 3] = core::array::from_fn(|axis| fix.covariance[axis][axis]);
        let ambiguous = variances[2] > T::of(AMBIGUOUS * AMBIGUOUS) * variances[0].at_least(variances[1]);
        *self = if ambiguous { Self::Solved(variances[2]) } else { Self::Known };
        ambiguous.then_some(Height { height_m: fix.position[2], deviation_m: T::of(SCATTER_M) })
    }

    /// A track's covariance, its height no surer than it can be.
    pub(super) fn admit(&self, mut covariance: [[T; 3]; 3]) -> [[T; 3]; 3] {
        if let Self::Solved(variance) = *self {
            covariance[2][2] = covariance[2][2].at_least(variance);
        }
        covariance
    }
}
