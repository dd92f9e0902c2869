//! A difference of two arrivals: t = ‖p − a‖ − ‖p − a₁‖ + b − b₁ + n − n₁ (E. García et al., *A Robust UWB Indoor Positioning System
//! for Highly Complex Environments*, equation 8).
//!
//! All differences to the same reception of the reference anchor share its error n₁. As a state of its own it gives them
//! exactly the covariance of equation 6, σ₁² everywhere and σ₁² + σᵢ² on the diagonal, though they come in one by one.

use super::sight;
use crate::Real;
use crate::track::state::{REFERENCE, STATES};
use crate::track::update::{Linearised, Model};

/// The distance of an anchor less that of the reference anchor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TdoaModel<T> {
    /// Where the anchor is, metres.
    pub(crate) anchor: [T; 3],
    /// Where the reference anchor is, metres.
    pub(crate) reference: [T; 3],
    /// Metres.
    pub(crate) difference: T,
    /// The state that is the link's error.
    pub(crate) link: usize,
    /// The state that is the error of the reference anchor's link.
    pub(crate) reference_link: usize,
}

impl<T: Real> Model<T> for TdoaModel<T> {
    #[inline(always)]
    fn linearise(&self, mean: &[T; STATES]) -> Linearised<T> {
        let at = [mean[0], mean[1], mean[2]];
        let (far, towards) = sight(&at, &self.anchor);
        let (near, from) = sight(&at, &self.reference);
        let error = |link: usize| mean.get(link).copied().unwrap_or(T::ZERO);
        let expected = far - near + error(self.link) - error(self.reference_link) - mean[REFERENCE];
        Linearised {
            innovation: self.difference - expected,
            position: core::array::from_fn(|axis| towards[axis] - from[axis]),
            others: [(self.link, T::ONE), (self.reference_link, -T::ONE), (REFERENCE, -T::ONE)],
            curvature: T::ONE / far + T::ONE / near,
        }
    }
}
