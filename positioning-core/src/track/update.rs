//! The one way in which a measurement changes the track: the update of an (iterated) extended Kalman filter, one number at a
//! time (V. Barral et al., Sensors 19, 2019, equation 15, for one range; measurements that share an error share a state).
//!
//! The covariance follows Joseph's form. Its short brother (I − K h) P is right for the best gain only: a gain that is off by a
//! rounding error δ makes it wrong by δ, and after thousands of ranges in `f32` it is no covariance any more. Joseph's form is
//! wrong by s δ δᵀ, which is second order and never negative. For one number it costs two products an element more; a
//! factored form (U D Uᵀ) costs the same here, but a factored prediction and the forgetting of a link cost a third power of the
//! number of states.

use super::state::{POSITION, STATES, State};
use crate::Real;

/// How a measurement depends on the states, near one of them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Linearised<T> {
    /// The measured number less the expected one, in the measurement's unit.
    pub(crate) innovation: T,
    /// Its derivative by the position.
    pub(crate) position: [T; 3],
    /// Derivatives by other states: which, and how much. A zero is no dependence.
    pub(crate) others: [(usize, T); 3],
    /// About how much the derivative by the position changes over a metre.
    pub(crate) curvature: T,
}

/// One number that was measured.
pub(crate) trait Model<T> {
    /// How it depends on the states at `mean`.
    fn linearise(&self, mean: &[T; STATES]) -> Linearised<T>;
}

/// A measurement against the track, before the track changes.
#[derive(Clone, Debug)]
pub(crate) struct Innovation<T> {
    /// The measured number less the expected one.
    pub(crate) value: T,
    /// The variance that the track's own uncertainty gives it.
    pub(crate) predicted: T,
    linearised: Linearised<T>,
    /// P hᵀ.
    across: [T; STATES],
}

impl<T: Real> Innovation<T> {
    /// Compares.
    #[inline(always)]
    pub(crate) fn of(state: &State<T>, model: &impl Model<T>) -> Self {
        Self::at(state, model.linearise(&state.mean))
    }

    #[inline(never)]
    fn at(state: &State<T>, linearised: Linearised<T>) -> Self {
        let mut across = [T::ZERO; STATES];
        for (axis, &slope) in linearised.position.iter().enumerate() {
            state.add_column(&mut across, POSITION + axis, slope);
        }
        for (other, slope) in linearised.others {
            if slope != T::ZERO {
                state.add_column(&mut across, other, slope);
            }
        }
        let predicted = linearised.along(&across);
        Self { value: linearised.innovation, predicted, linearised, across }
    }
}

impl<T: Real> Linearised<T> {
    /// h v.
    fn along(&self, v: &[T; STATES]) -> T {
        let mut sum = T::ZERO;
        for (axis, &slope) in self.position.iter().enumerate() {
            sum += slope * v[POSITION + axis];
        }
        for (other, slope) in self.others {
            sum += slope * v.get(other).copied().unwrap_or(T::ZERO);
        }
        sum
    }
}

/// A step whose neglected curvature is less than this part of the measurement's deviation is not repeated.
const NEGLIGIBLE: f64 = 0.1;

/// Takes a measurement of the given variance into the track. `iterations` over one make it the iterated filter: the measurement
/// is linearised again where the last step arrived, as long as that matters.
pub(crate) fn update<T: Real>(
    state: &mut State<T>,
    model: &impl Model<T>,
    mut innovation: Innovation<T>,
    variance: T,
    iterations: u8,
) {
    let before = state.mean;
    let mut residual = innovation.value;
    for left in (0..iterations.max(1)).rev() {
        let s = innovation.predicted + variance;
        if !(s > T::ZERO) {
            return;
        }
        let share = T::ONE / s;
        let gain = innovation.across.map(|element| element * share);
        state.mean = before;
        state.shift(&gain, residual);
        let step = gain[POSITION].squared() + gain[POSITION + 1].squared() + gain[POSITION + 2].squared();
        let bent = innovation.linearised.curvature * step * residual.squared();
        if left == 0 || bent.squared() <= T::of(4.0 * NEGLIGIBLE * NEGLIGIBLE) * variance {
            state.absorb(&gain, &innovation.across, s);
            return;
        }
        innovation = Innovation::of(state, model);
        let gone: [T; STATES] = core::array::from_fn(|i| before[i] - state.mean[i]);
        residual = innovation.value - innovation.linearised.along(&gone);
    }
}
