//! A range: r = ‖p − a‖ + c + b + n, with the error c common to all ranges and the error b of the link (Barral et al. 2019,
//! equations 13 and 14, with the errors that last taken out of n).

use super::sight;
use crate::Real;
use crate::track::state::{COMMON, STATES};
use crate::track::update::{Linearised, Model};

/// A range to an anchor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RangeModel<T> {
    /// Where the anchor is, metres.
    pub(crate) anchor: [T; 3],
    /// Metres.
    pub(crate) range: T,
    /// The state that is the link's error.
    pub(crate) link: usize,
}

impl<T: Real> Model<T> for RangeModel<T> {
    #[inline(always)]
    fn linearise(&self, mean: &[T; STATES]) -> Linearised<T> {
        let (distance, unit) = sight(&[mean[0], mean[1], mean[2]], &self.anchor);
        let link = mean.get(self.link).copied().unwrap_or(T::ZERO);
        Linearised {
            innovation: self.range - distance - mean[COMMON] - link,
            position: unit,
            others: [(COMMON, T::ONE), (self.link, T::ONE), (0, T::ZERO)],
            curvature: T::ONE / distance,
        }
    }
}
