//! How a tag moves between measurements.

use super::state::State;
use crate::Real;

/// A model of motion. Densities are those of white noise: an acceleration of density √q leaves a velocity with the variance
/// q Δt, and a position with q Δt³ ⁄ 3.
///
/// V. Barral et al. (2019, equation 12) take an acceleration constant between two measurements instead, which makes the track
/// depend on how often somebody measures.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Motion<T> {
    /// It lies still but for a slow wandering.
    Static {
        /// Metres in a second.
        wander: T,
    },
    /// It goes on as it goes.
    ConstantVelocity {
        /// Root of the acceleration's density, m/s² in √Hz.
        acceleration: T,
    },
    /// It goes on as it goes; the acceleration is `calm` while measurements are where they are expected, and grows to `brisk` as
    /// they are not.
    Adaptive {
        /// Least root of the acceleration's density, m/s² in √Hz.
        calm: T,
        /// Greatest root of the acceleration's density, m/s² in √Hz.
        brisk: T,
    },
}

/// The mean normalised squared innovation at which an adaptive motion begins to grow, and at which it has grown.
const SURPRISE: (f64, f64) = (0.8, 2.0);
/// How much of the mean an innovation is.
const FRESH: f64 = 0.05;

/// How well the motion explains the measurements.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surprise<T>(T);

impl<T: Real> Surprise<T> {
    /// Nothing seen.
    pub(crate) fn none() -> Self {
        Self(T::ZERO)
    }

    /// One squared innovation over its variance.
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

    /// Moves the track on by `dt` seconds; without a height (`flat`) along x and y alone.
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
