//! The height of a tag in the plane: a state where it is not exact, with the prior N(height, σ²). The tag does not climb,
//! but the height's error changes slowly, as a Gauss-Markov process.

use super::filter::Filter;
use super::state::{POSITION, fading};
use crate::Real;

/// The time after which two thirds of the error of an assumed height have changed, seconds: people sit down.
const CHANGED_S: f64 = 10.0;

impl<T: Real> Filter<T> {
    /// Predicts the error of the assumed height by `dt` seconds.
    pub(super) fn advance_height(&mut self, dt: T) {
        if let Some(height) = self.height.filter(|height| height.variance > T::ZERO) {
            self.state.renew(POSITION + 2, fading(dt * T::of(1.0 / CHANGED_S)), height);
        }
    }

    /// Changes the assumed height. What ranges have shown of its error stays.
    pub(crate) fn set_height(&mut self, height: T) {
        if let Some(known) = &mut self.height {
            let z = &mut self.state.mean[POSITION + 2];
            *z = height + (*z - core::mem::replace(&mut known.mean, height));
        }
    }
}
