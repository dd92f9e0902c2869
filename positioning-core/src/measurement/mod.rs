//! The measurements, one file each: the data, whether they are sane, the expected number h(x) with its derivatives,
//! and how the filter takes the measurement.
//!
//! To add a kind of measurement, add a file here that implements [`Model`] and [`Observation`], a variant of
//! [`Measurement`], and an arm in [`Engine::step`](crate::engine::Engine::step).

mod beacon_position;
mod height;
mod range;
mod tdoa;

pub use beacon_position::BeaconPosition;
pub(crate) use height::Height;
pub use range::Range;
pub use tdoa::Tdoa;
pub(crate) use tdoa::TdoaModel;

use crate::Real;
use crate::track::{Filter, FilterSettings, GateOf, UpdateResult};

/// A sum of magnitudes beyond this is not a valid measurement, metres.
const FARTHEST_M: f64 = 1.0e5;
/// The least deviation of a measurement, metres: `f32` keeps the covariance of ten metres beside it.
const LEAST_SIGMA_M: f64 = 0.01;

/// The gate of heights.
const HEIGHT_GATE: GateOf = GateOf::Own(0);

/// One measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Measurement<T> {
    /// A range to an anchor.
    Range(Range<T>),
    /// The end of a round: all its ranges, or differences, have been given, and the round's position is computed.
    RoundEnd,
    /// A difference of two arrivals.
    Tdoa(Tdoa<T>),
    /// A position that the RSSI values of beacons give together, by their path losses or by a map of them.
    BeaconPosition(BeaconPosition<T>),
}

impl<T: Real> Measurement<T> {
    /// Whether it is a valid measurement.
    pub(crate) fn is_sane(&self) -> bool {
        match self {
            Self::Range(range) => range.is_sane(),
            Self::RoundEnd => true,
            Self::Tdoa(tdoa) => tdoa.is_sane(),
            Self::BeaconPosition(position) => position.is_sane(),
        }
    }
}

/// A measurement that changes a track by itself.
pub(crate) trait Observation<T> {
    /// Whether every number is finite and plausible, and every deviation positive.
    fn is_sane(&self) -> bool;

    /// Takes the measurement into the track.
    fn update(&self, filter: &mut Filter<T>, settings: &FilterSettings<T>) -> UpdateResult;
}

/// A probability, limited to 0 to 1; one that is not finite counts as unknown.
pub(crate) fn known<T: Real>(p_nlos: Option<T>) -> Option<T> {
    p_nlos.filter(|p| p.is_finite()).map(|p| p.at_least(T::ZERO).at_most(T::ONE))
}

/// The same, but an unknown probability counts as line of sight.
pub(crate) fn probability<T: Real>(p_nlos: Option<T>) -> T {
    known(p_nlos).unwrap_or(T::ZERO)
}

/// The variance of a deviation, m².
fn variance<T: Real>(deviation_m: T) -> T {
    deviation_m.at_least(T::of(LEAST_SIGMA_M)).squared()
}

/// Whether all magnitudes are plausible. NaN and infinity stay in a sum, so the comparison fails.
fn sane<T: Real>(magnitudes: T, deviation: T) -> bool {
    magnitudes <= T::of(FARTHEST_M) && deviation > T::ZERO && deviation <= T::of(FARTHEST_M)
}

fn magnitude<T: Real>(point: &[T; 3]) -> T {
    point[0].abs() + point[1].abs() + point[2].abs()
}

/// The distance between two points, metres, and the unit vector from the second to the first. If the points are
/// equal, the vector is finite.
#[inline(always)]
fn line_of_sight<T: Real>(from: &[T; 3], to: &[T; 3]) -> (T, [T; 3]) {
    let across: [T; 3] = core::array::from_fn(|axis| from[axis] - to[axis]);
    let square = across[0].squared() + across[1].squared() + across[2].squared();
    let distance = (square + T::of(1.0e-6)).sqrt();
    let inverse = T::ONE / distance;
    (distance, across.map(|component| component * inverse))
}

#[cfg(test)]
mod tests {
    use std::boxed::Box;
    use std::vec::Vec;

    use nalgebra::{DMatrix, DVector};

    use super::beacon_position::components;
    use super::height::HeightModel;
    use super::range::RangeModel;
    use super::tdoa::TdoaModel;
    use super::*;
    use crate::derivatives::assert_derivatives;
    use crate::track::state::{COMMON, LINKS, REFERENCE, STATES, State};
    use crate::track::update::{Innovation, Model, update};

    impl Model<f64> for Box<dyn Model<f64>> {
        fn linearise(&self, mean: &[f64; STATES]) -> crate::track::Linearised<f64> {
            (**self).linearise(mean)
        }
    }

    /// A track with uncertain states that all depend on each other.
    fn doubtful() -> State<f64> {
        let mut state = State::new();
        let means =
            [(0, 1.0), (1, -2.0), (2, 0.5), (3, 0.3), (4, -0.1), (COMMON, 0.05), (LINKS, 0.1), (LINKS + 1, -0.04)];
        for place in [0, 1, 2, 3, 4, 5, COMMON, LINKS, LINKS + 1, REFERENCE] {
            let mean = means.iter().find(|(at, _)| *at == place).map_or(0.0, |(_, mean)| *mean);
            state.reset(place, mean, 0.5 + 0.1 * place as f64);
        }
        for (one, other, both) in
            [(0, 1, 0.2), (0, 3, 0.15), (1, LINKS, -0.1), (2, COMMON, 0.1), (LINKS, LINKS + 1, 0.2)]
        {
            state.set_covariance(one, other, both);
        }
        state
    }

    fn dense(state: &State<f64>) -> (DVector<f64>, DMatrix<f64>) {
        let mean = DVector::from_fn(STATES, |i, _| state.mean[i]);
        (mean, DMatrix::from_fn(STATES, STATES, |r, c| state.covariance(r, c)))
    }

    const RANGE: Range<f64> = Range {
        anchor: 1,
        position_m: [4.0, 1.0, 2.5],
        distance_m: 4.7,
        deviation_m: 0.1,
        p_nlos: None,
        excess_m: None,
    };
    const TDOA: Tdoa<f64> = Tdoa {
        anchor: 1,
        position_m: [4.0, 1.0, 2.5],
        reference: 2,
        reference_m: [-3.0, 2.0, 2.0],
        difference_m: -0.4,
        deviations_m: [0.1; 2],
        p_nlos: [None; 2],
    };

    fn models() -> Vec<(&'static str, Box<dyn Model<f64>>)> {
        let [x, y] = components([1.1, -2.1], [0.04, 0.01, 0.09], 1e-6).map(|(model, _)| model);
        std::vec![
            ("range", Box::new(RangeModel { range: &RANGE, link: LINKS })),
            ("tdoa", Box::new(TdoaModel { tdoa: &TDOA, link: LINKS, reference_link: LINKS + 1 })),
            ("height", Box::new(HeightModel { height_m: 0.7 })),
            ("lasting", Box::new(x.with_link(LINKS + 1))),
            ("x", Box::new(x)),
            ("y", Box::new(y)),
        ]
    }

    /// The innovation's negative, and the derivative of the expected number by every state.
    fn expected(model: &dyn Model<f64>, mean: &[f64; STATES]) -> (f64, [f64; STATES]) {
        let linearised = model.linearise(mean);
        let mut slopes = [0.0; STATES];
        slopes[..3].copy_from_slice(&linearised.position);
        for (other, slope) in linearised.others {
            slopes[other] += slope;
        }
        (-linearised.innovation, slopes)
    }

    #[test]
    fn derivatives_are_those_of_the_expected_number() {
        for (name, model) in models() {
            // Positions within ten metres, and errors within one, of which the anchors are a part.
            let spread = core::array::from_fn(|state| if state < 3 { 10.0 } else { 1.0 });
            assert_derivatives(name, [0.0; STATES], spread, |mean| expected(&*model, mean));
        }
    }

    #[test]
    fn one_update_is_the_textbooks_with_full_matrices() {
        for (name, model) in models() {
            let mut state = doubtful();
            let (mean, covariance) = dense(&state);
            let h = DVector::from_column_slice(&expected(&*model, &state.mean).1);
            let variance = 0.02;
            let s = (h.transpose() * &covariance * &h)[0] + variance;
            let gain = &covariance * &h / s;
            let expected_mean = mean + &gain * model.linearise(&state.mean).innovation;
            let expected_covariance = (DMatrix::identity(STATES, STATES) - &gain * h.transpose()) * covariance;

            let innovation = Innovation::of(&state, &model);
            assert!((innovation.predicted + variance - s).abs() < 1e-6, "{name}");
            update(&mut state, &model, &innovation, variance, 1);
            let (mean, covariance) = dense(&state);
            assert!((mean - expected_mean).amax() < 1e-5, "{name}");
            assert!((covariance - expected_covariance).amax() < 1e-5, "{name}");
        }
    }
}
