//! A range from the strength of a Bluetooth beacon: ln d = ln ‖p − a‖ + b + n. Fading multiplies a power and so a distance; the
//! logarithm has the same error near and far. Shadowing stays with the place, and is the error b of the link.

use super::sight;
use crate::Real;
use crate::track::state::STATES;
use crate::track::update::{Linearised, Model};

/// A range to a beacon.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BleRangeModel<T> {
    /// Where the beacon is, metres.
    pub(crate) beacon: [T; 3],
    /// ln of the distance in metres.
    pub(crate) log_distance: T,
    /// The state that is the link's error.
    pub(crate) link: usize,
}

/// Nearer than this the strength says nothing more, metres.
pub(crate) const NEAREST_M: f64 = 0.1;

impl<T: Real> Model<T> for BleRangeModel<T> {
    fn linearise(&self, mean: &[T; STATES]) -> Linearised<T> {
        let (distance, unit) = sight(&[mean[0], mean[1], mean[2]], &self.beacon);
        let distance = distance.at_least(T::of(NEAREST_M));
        let inverse = T::ONE / distance;
        let link = mean.get(self.link).copied().unwrap_or(T::ZERO);
        Linearised {
            innovation: self.log_distance - distance.ln() - link,
            position: unit.map(|component| component * inverse),
            others: [(self.link, T::ONE), (0, T::ZERO), (0, T::ZERO)],
            curvature: inverse.squared(),
        }
    }
}
