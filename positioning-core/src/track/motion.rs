//! The motion of a tag between measurements.

use super::state::State;
use crate::Real;

/// A model of motion. Densities are those of white noise: an acceleration of density √q gives a velocity with the
/// variance q Δt, and a position with q Δt³ ⁄ 3.
///
/// V. Barral et al. (2019, equation 12) take an acceleration that is constant between two measurements instead. The
/// track then depends on the rate of the measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Motion<T> {
    /// The tag is at rest, except for a slow drift.
    Static {
        /// The drift, metres in one second (standard deviation; it grows with the square root of time).
        wander: T,
    },
    /// The tag keeps its velocity.
    ConstantVelocity {
        /// Root of the acceleration's density, m/s² per √Hz.
        acceleration: T,
    },
    /// The tag keeps its velocity. The acceleration is `calm` while measurements agree with the prediction, and grows
    /// to `brisk` if they do not.
    Adaptive {
        /// Least root of the acceleration's density, m/s² per √Hz.
        calm: T,
        /// Greatest root of the acceleration's density, m/s² per √Hz.
        brisk: T,
    },
}

/// The mean normalised squared innovation at which the acceleration of an adaptive motion begins to grow, and at
/// which it is greatest.
const SURPRISE: (f64, f64) = (0.8, 2.0);
/// The weight of a new innovation in the mean.
const FRESH: f64 = 0.05;

/// How well the motion explains the measurements.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surprise<T>(T);

impl<T: Real> Surprise<T> {
    /// No innovation yet.
    pub(crate) fn none() -> Self {
        Self(T::ZERO)
    }

    /// Adds one squared innovation, divided by its variance.
    pub(crate) fn add(&mut self, normalised: T) {
        self.0 += T::of(FRESH) * (normalised.at_most(T::of(9.0)) - self.0);
    }
}

impl<T: Real> Motion<T> {
    /// Whether the velocity is a state.
    pub(crate) fn moves(&self) -> bool {
        match self {
            Self::Static { .. } => false,
            Self::ConstantVelocity { .. } | Self::Adaptive { .. } => true,
        }
    }

    /// Predicts the track by `dt` seconds; without a height (`flat`) along x and y alone.
    pub(crate) fn advance(&self, state: &mut State<T>, dt: T, surprise: Surprise<T>, flat: bool) {
        let upright = |density: T| [density, density, if flat { T::ZERO } else { density }];
        match *self {
            Self::Static { wander } => {
                let variance = wander.squared() * dt;
                for (axis, variance) in upright(variance).into_iter().enumerate() {
                    state.widen(super::state::POSITION + axis, variance);
                }
            }
            Self::ConstantVelocity { acceleration } => state.advance(dt, upright(acceleration.squared())),
            Self::Adaptive { calm, brisk } => {
                let (low, high) = (T::of(SURPRISE.0), T::of(SURPRISE.1));
                let part = ((surprise.0 - low) / (high - low)).at_least(T::ZERO).at_most(T::ONE);
                let density = calm.squared() + part * (brisk.squared() - calm.squared());
                state.advance(dt, upright(density));
            }
        }
    }
}
