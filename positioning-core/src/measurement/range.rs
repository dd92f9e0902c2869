//! A range: r = ‖p − a‖ + c + b + n, with the error c common to all ranges and the error b of the link (V. Barral et
//! al., Sensors 19, 2019, equations 13 and 14; here the lasting errors are separate from n).

use super::{Observation, known, line_of_sight, magnitude, sane, variance};
use crate::Real;
use crate::track::state::{COMMON, STATES};
use crate::track::{Blocked, Filter, FilterSettings, Linearised, Model, UpdateResult};

/// A range to an anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Range<T> {
    /// The anchor's address.
    pub anchor: u16,
    /// The anchor's position, metres.
    pub position_m: [T; 3],
    /// The measured distance, metres.
    pub distance_m: T,
    /// Standard deviation of the range's noise in line of sight, metres.
    pub deviation_m: T,
    /// Probability, 0 to 1, that the link is without line of sight; `None`: unknown.
    pub p_nlos: Option<T>,
    /// The estimated excess of the range, metres; it is used only where the settings say so.
    pub excess_m: Option<T>,
}

/// A range with the state that is its link's error.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RangeModel<'a, T> {
    pub(crate) range: &'a Range<T>,
    pub(crate) link: usize,
}

impl<T: Real> Model<T> for RangeModel<'_, T> {
    #[inline(always)]
    fn linearise(&self, mean: &[T; STATES]) -> Linearised<T> {
        let (distance, unit) = line_of_sight(&[mean[0], mean[1], mean[2]], &self.range.position_m);
        let link = mean.get(self.link).copied().unwrap_or(T::ZERO);
        Linearised {
            innovation: self.range.distance_m - distance - mean[COMMON] - link,
            position: unit,
            others: [(COMMON, T::ONE), (self.link, T::ONE), (0, T::ZERO)],
            curvature: T::ONE / distance,
        }
    }
}

impl<T: Real> Observation<T> for Range<T> {
    fn is_sane(&self) -> bool {
        let excess = self.excess_m.unwrap_or(T::ZERO);
        sane(magnitude(&self.position_m) + self.distance_m.abs() + excess.abs(), self.deviation_m)
    }

    #[inline(never)]
    fn update(&self, filter: &mut Filter<T>, settings: &FilterSettings<T>) -> UpdateResult {
        filter.observe_range(self, settings)
    }
}

impl<T: Real> Range<T> {
    /// Its model with this state as its link's error.
    pub(crate) fn model(&self, link: usize) -> RangeModel<'_, T> {
        RangeModel { range: self, link }
    }

    /// The variance of its noise in line of sight, m².
    pub(crate) fn own_m2(&self) -> T {
        variance(self.deviation_m)
    }

    /// The probability that it is without line of sight, if it is known and has an effect.
    pub(crate) fn p_nlos_for(&self, settings: &FilterSettings<T>) -> Option<T> {
        known(self.p_nlos).filter(|_| !matches!(settings.blocked, Blocked::Alike))
    }
}
