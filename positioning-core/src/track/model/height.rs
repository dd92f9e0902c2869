//! A height: z = p₃ + n. From a barometer, or from knowing how a tag is carried.

use crate::Real;
use crate::track::state::{POSITION, STATES};
use crate::track::update::{Linearised, Model};

/// A height, metres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HeightModel<T> {
    /// Metres.
    pub(crate) height: T,
}

impl<T: Real> Model<T> for HeightModel<T> {
    #[inline(always)]
    fn linearise(&self, mean: &[T; STATES]) -> Linearised<T> {
        Linearised {
            innovation: self.height - mean[POSITION + 2],
            position: [T::ZERO, T::ZERO, T::ONE],
            others: [(0, T::ZERO); 3],
            curvature: T::ZERO,
        }
    }
}
