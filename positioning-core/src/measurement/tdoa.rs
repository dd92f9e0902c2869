//! A difference of two arrivals: t = ‖p − a‖ − ‖p − a₁‖ + b − b₁ + n − n₁ (E. García et al., *A Robust UWB Indoor
//! Positioning System for Highly Complex Environments*, equation 8).
//!
//! All differences to the same reception of the reference anchor share its error n₁. With n₁ as a state of its own,
//! the differences have exactly the covariance of equation 6: σ₁² everywhere and σ₁² + σᵢ² on the diagonal, although
//! they come one by one.

use super::{Observation, known, line_of_sight, magnitude, sane, variance};
use crate::Real;
use crate::track::state::{REFERENCE, STATES};
use crate::track::{Filter, FilterSettings, GateOf, Linearised, Model, UpdateResult};

/// A difference of two arrivals.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tdoa<T> {
    /// The anchor's address.
    pub anchor: u16,
    /// The anchor's position, metres.
    pub position_m: [T; 3],
    /// The reference anchor's address. Differences to it that are given at the same time share its arrival, and so
    /// its error.
    pub reference: u16,
    /// The reference anchor's position, metres.
    pub reference_m: [T; 3],
    /// The tag's distance to the anchor minus that to the reference anchor, metres.
    pub difference_m: T,
    /// Standard deviations of the arrivals from the reference anchor and from the anchor, metres.
    pub deviations_m: [T; 2],
    /// Probabilities that their links are without line of sight.
    pub p_nlos: [Option<T>; 2],
}

/// A difference with the states that are the errors of its anchor's link and of the reference anchor's link.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TdoaModel<'a, T> {
    pub(crate) tdoa: &'a Tdoa<T>,
    pub(crate) link: usize,
    pub(crate) reference_link: usize,
}

impl<T: Real> Model<T> for TdoaModel<'_, T> {
    #[inline(always)]
    fn linearise(&self, mean: &[T; STATES]) -> Linearised<T> {
        let at = [mean[0], mean[1], mean[2]];
        let (far, towards) = line_of_sight(&at, &self.tdoa.position_m);
        let (near, from) = line_of_sight(&at, &self.tdoa.reference_m);
        let error = |link: usize| mean.get(link).copied().unwrap_or(T::ZERO);
        let expected = far - near + error(self.link) - error(self.reference_link) - mean[REFERENCE];
        Linearised {
            innovation: self.tdoa.difference_m - expected,
            position: core::array::from_fn(|axis| towards[axis] - from[axis]),
            others: [(self.link, T::ONE), (self.reference_link, -T::ONE), (REFERENCE, -T::ONE)],
            curvature: T::ONE / far + T::ONE / near,
        }
    }
}

impl<T: Real> Observation<T> for Tdoa<T> {
    fn is_sane(&self) -> bool {
        let positions = magnitude(&self.position_m) + magnitude(&self.reference_m);
        self.anchor != self.reference
            && sane(positions + self.difference_m.abs(), self.deviations_m[0])
            && sane(T::ZERO, self.deviations_m[1])
    }

    #[inline(never)]
    fn update(&self, filter: &mut Filter<T>, settings: &FilterSettings<T>) -> UpdateResult {
        let [of_reference, own] = self.deviations_m.map(variance);
        let [reference_p, p] = self.p_nlos.map(known);
        let link = filter.anchor_link(self.anchor, own, p, settings);
        let Some((reference, link)) = filter.anchor_link(self.reference, of_reference, reference_p, settings).zip(link)
        else {
            return UpdateResult::NoPlace;
        };
        filter.set_reference(self.reference, reference.white);
        let model = TdoaModel { tdoa: self, link: link.state, reference_link: reference.state };
        filter.observe(&model, link.white, GateOf::Link(link.place), settings)
    }
}
