//! A position in the plane by the RSSI of beacons: z = p + b + n. The error b stays while the tag does not move,
//! since walls and people shadow the signals that it receives.

use super::position::components;
use super::{ExternalPosition, LEAST_SIGMA_M, Observation};
use crate::track::{Filter, FilterSettings, GateOf, UpdateResult};
use crate::{AnchorSet, Fix, Real};

/// A lasting error of more deviations than this is unusual.
const UNUSUAL: f64 = 3.0;

/// A position in the plane by beacons.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BeaconPosition<T> {
    /// The position, metres.
    pub position_m: [T; 2],
    /// Covariance, m²: xx, xy, yy.
    pub covariance_m2: [T; 3],
    /// The share of the covariance that stays while the tag does not move, 0 to 1.
    pub lasting: T,
}

impl<T: Real> BeaconPosition<T> {
    /// The same position for a tag at this height, metres. Its quality is not computed here: the beacons were tested
    /// when the tag was located.
    pub(crate) fn at(&self, height_m: T) -> Fix<T, 3> {
        let ([x, y], [xx, xy, yy], zero) = (self.position_m, self.covariance_m2, T::ZERO);
        Fix {
            position: [x, y, height_m],
            covariance: [[xx, xy, zero], [xy, yy, zero], [zero; 3]],
            dilution_of_precision: [zero; 3],
            used: AnchorSet(0),
            quality: T::ONE,
            alternative: None,
        }
    }
}

impl<T: Real> Observation<T> for BeaconPosition<T> {
    fn is_sane(&self) -> bool {
        let ([xx, _, yy], Fix { position, covariance, .. }) = (self.covariance_m2, self.at(T::ZERO));
        xx > T::ZERO
            && yy > T::ZERO
            && ExternalPosition { position_m: position, covariance_m2: covariance }.is_sane()
            && (T::ZERO..=T::ONE).contains(&self.lasting)
    }

    #[inline(never)]
    fn update(&self, filter: &mut Filter<T>, settings: &FilterSettings<T>) -> UpdateResult {
        let Fix { position, covariance, .. } = self.at(T::ZERO);
        let least = T::of(LEAST_SIGMA_M * LEAST_SIGMA_M);
        let mut result = UpdateResult::Accepted;
        for (axis, (model, variance)) in (0_u8..2).zip(components(position, &covariance, least)) {
            let shadow = self.lasting * variance;
            let usual = T::of(UNUSUAL * UNUSUAL) * shadow;
            let Some(link) = filter.beacon_link(axis, [shadow, usual], settings) else { return UpdateResult::NoPlace };
            let white = (variance - shadow).at_least(least);
            let taken = filter.observe(&model.with_link(link.state), white, GateOf::Beacons(link.place), settings);
            if taken != UpdateResult::Accepted {
                result = taken;
            }
        }
        result
    }
}
