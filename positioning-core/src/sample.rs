//! The input of a solver: ranges to anchors at known positions.

use crate::Real;
use crate::link_error::{DIRECT_SIGMA_M, prior_blocked};
use crate::measurement::known;

/// The most ranges of one fix.
pub const MAX_ANCHORS: usize = 16;

/// One number per sample.
pub(crate) type PerSample<T> = [T; MAX_ANCHORS];

/// The largest valid sum of a sample's coordinates and range, metres. A DW1000 cannot be received at a greater
/// distance, and squares of an `f32` keep no centimetres.
const FARTHEST_M: f64 = 1.0e5;
/// The least valid standard deviation, metres; squares of smaller ones vanish in `f32`.
const LEAST_SIGMA_M: f64 = 1.0e-4;

/// One range to one anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RangeSample<T, const D: usize> {
    /// The anchor's position, metres.
    pub anchor: [T; D],
    /// The measured range, metres. Slightly negative values happen at arm's length.
    pub range: T,
    /// Standard deviation of the range in line of sight, metres, as far as it is known from the diagnostics. Only its
    /// ratio to the other ranges of one fix and to [`DEFAULT_SIGMA_M`](Self::DEFAULT_SIGMA_M) matters.
    pub sigma: T,
    /// Prior probability, 0 to 1, that the link is blocked; only `robust` reads it.
    pub p_blocked: T,
    /// Ground truth of the line of sight. It is known in simulations and surveys only, and only the oracle method
    /// reads it.
    pub los: Option<bool>,
}

impl<T: Real, const D: usize> RangeSample<T, D> {
    /// Standard deviation of a DW1000 range in line of sight, metres.
    pub const DEFAULT_SIGMA_M: f64 = DIRECT_SIGMA_M;

    /// A range of which nothing else is known.
    pub fn new(anchor: [T; D], range: T) -> Self {
        Self { anchor, range, sigma: T::of(DIRECT_SIGMA_M), p_blocked: prior_blocked(None), los: None }
    }

    /// The same range, whose diagnostics give this probability, 0 to 1, of being without line of sight; `None`: they
    /// are not known.
    pub fn with_p_nlos(self, p_nlos: Option<T>) -> Self {
        Self { p_blocked: prior_blocked(known(p_nlos)), ..self }
    }

    /// The same range, flattened from an anchor that is `dz` metres higher than the tag, ± `height_sigma`. The flat range is
    /// ρ = √(d² − dz²), so that an error δ of the height is one of ρ by δ dz ⁄ ρ.
    #[inline(never)]
    pub fn flattened(self, dz: T, height_sigma: T) -> Self {
        let range = flatten(self.range, dz);
        let sigma = (self.sigma.squared() + (height_sigma * dz / range).squared()).sqrt();
        Self { range, sigma, ..self }
    }

    /// Whether every number is finite and plausible.
    pub(crate) fn is_sane(&self) -> bool {
        // One comparison for all: NaN and infinity stay in a sum of magnitudes, so the comparison fails.
        let sum = self
            .anchor
            .iter()
            .fold(self.range.abs() + self.sigma + self.p_blocked, |sum, component| sum + component.abs());
        sum <= T::of(FARTHEST_M) && self.sigma >= T::of(LEAST_SIGMA_M)
    }
}

/// The range in the plane at the tag's height: √(d² − Δz²), at least 0.1 m, where `dz` is the anchor's height above
/// the tag, metres. NaN stays NaN.
pub fn flatten<T: Real>(range: T, dz: T) -> T {
    let least = T::of(0.1);
    let square = range.squared() - dz.squared();
    if square < least.squared() { least } else { square.sqrt() }
}
