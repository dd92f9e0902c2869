//! A position in the plane by the RSSI of beacons: z = p + b + n. The error b stays while the tag does not move,
//! since walls and people shadow the signals that it receives. Its two numbers are made independent first. With
//! R = L D Lᵀ the components of L⁻¹ z have the variances D, and depend on the position by the rows of L⁻¹.

use super::{LEAST_SIGMA_M, Observation, sane};
use crate::track::state::STATES;
use crate::track::{Filter, FilterSettings, GateOf, Linearised, Model, UpdateResult};
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

/// One independent component of a position.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PositionModel<T> {
    row: [T; 2],
    value: T,
    /// The index of the state that is its lasting error.
    link: Option<usize>,
}

impl<T> PositionModel<T> {
    /// The same component with a lasting error.
    pub(crate) fn with_link(self, link: usize) -> Self {
        Self { link: Some(link), ..self }
    }
}

impl<T: Real> Model<T> for PositionModel<T> {
    #[inline(always)]
    fn linearise(&self, mean: &[T; STATES]) -> Linearised<T> {
        let expected = self.row[0] * mean[0] + self.row[1] * mean[1];
        let (link, slope) = self.link.map_or((0, T::ZERO), |link| (link, T::ONE));
        let lasting = slope * mean.get(link).copied().unwrap_or(T::ZERO);
        Linearised {
            innovation: self.value - expected - lasting,
            position: [self.row[0], self.row[1], T::ZERO],
            others: [(link, slope), (0, T::ZERO), (0, T::ZERO)],
            curvature: T::ZERO,
        }
    }
}

/// The independent components of a position, and their variances, none less than `least`. The covariance is xx, xy, yy.
pub(crate) fn components<T: Real>(position: [T; 2], [xx, xy, yy]: [T; 3], least: T) -> [(PositionModel<T>, T); 2] {
    let [x, y] = position;
    let d0 = xx.at_least(least);
    let l10 = xy / d0;
    let d1 = (yy - l10 * xy).at_least(least);
    // The rows of L⁻¹.
    [
        (PositionModel { row: [T::ONE, T::ZERO], value: x, link: None }, d0),
        (PositionModel { row: [-l10, T::ONE], value: y - l10 * x, link: None }, d1),
    ]
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
        let [xx, xy, yy] = self.covariance_m2;
        let sum = self.position_m.iter().chain(&self.covariance_m2).fold(T::ZERO, |sum, number| sum + number.abs());
        // No eigenvalue of the covariance is negative, apart from rounding.
        let slack = T::of(8.0) * T::EPSILON;
        sane(sum, T::ONE)
            && xx > T::ZERO
            && yy > T::ZERO
            && xy.squared() <= xx * yy * (T::ONE + slack)
            && (T::ZERO..=T::ONE).contains(&self.lasting)
    }

    #[inline(never)]
    fn update(&self, filter: &mut Filter<T>, settings: &FilterSettings<T>) -> UpdateResult {
        let least = T::of(LEAST_SIGMA_M * LEAST_SIGMA_M);
        let mut result = UpdateResult::Accepted;
        for (axis, (model, variance)) in (0_u8..2).zip(components(self.position_m, self.covariance_m2, least)) {
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
