//! A height: z = p₃ + n. It comes from rounds that are solved by themselves ([`HeightSource`](crate::engine)).

use super::{HEIGHT_GATE, Observation, sane, variance};
use crate::Real;
use crate::track::state::{POSITION, STATES};
use crate::track::{Filter, FilterSettings, Linearised, Model, UpdateResult};

/// A height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Height<T> {
    /// The height, metres.
    pub(crate) height_m: T,
    /// Standard deviation, metres.
    pub(crate) deviation_m: T,
}

/// The model of a height.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HeightModel<T> {
    pub(crate) height_m: T,
}

impl<T: Real> Model<T> for HeightModel<T> {
    #[inline(always)]
    fn linearise(&self, mean: &[T; STATES]) -> Linearised<T> {
        Linearised {
            innovation: self.height_m - mean[POSITION + 2],
            position: [T::ZERO, T::ZERO, T::ONE],
            others: [(0, T::ZERO); 3],
            curvature: T::ZERO,
        }
    }
}

impl<T: Real> Observation<T> for Height<T> {
    fn is_sane(&self) -> bool {
        sane(self.height_m.abs(), self.deviation_m)
    }

    #[inline(never)]
    fn update(&self, filter: &mut Filter<T>, settings: &FilterSettings<T>) -> UpdateResult {
        let model = HeightModel { height_m: self.height_m };
        filter.observe(&model, variance(self.deviation_m), HEIGHT_GATE, settings)
    }
}
