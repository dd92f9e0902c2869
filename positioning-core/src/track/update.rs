//! The one way in which a measurement changes the track: the update of an (iterated) extended Kalman filter, one number at a
//! time (V. Barral et al., Sensors 19, 2019, equation 15, for one range; measurements that share an error share a state).
//!
//! The covariance follows Joseph's form (I − K h) P (I − K h)ᵀ + r K Kᵀ. Its short brother (I − K h) P is right for the best gain only: a
//! gain that is off by a rounding error δ makes it wrong by δ, and after thousands of ranges in `f32` it is no covariance any
//! more; Joseph's form is wrong by s δ δᵀ, which is second order and never negative. For one number, with g = P hᵀ, s = h g + r and
//! the gain K = κ g, where κ is 1 ⁄ s as far as numbers go, it multiplies out to P − κ (2 − s κ) g gᵀ: symmetric, of rank one, and one
//! product an element. A factored form (U D Uᵀ) would keep more digits, but its prediction, and the forgetting of a link, cost a
//! third power of the number of states; the digits are not needed, since no measurement counts as better than a centimetre.

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
        let value = linearised.innovation;
        let mut innovation = Self { value, predicted: T::ZERO, linearised, across: [T::ZERO; STATES] };
        state.along_position(&mut innovation.across, &innovation.linearised.position);
        for (other, slope) in innovation.linearised.others {
            if slope != T::ZERO {
                state.add_column(&mut innovation.across, other, slope);
            }
        }
        innovation.predicted = innovation.linearised.along(&innovation.across);
        innovation
    }

    /// Takes this out of the covariance; `s` is the innovation's variance, and `inverse` 1 ⁄ s.
    fn absorb(&self, state: &mut State<T>, s: T, inverse: T) {
        state.absorb(&self.across, inverse * (T::of(2.0) - s * inverse));
    }

    /// Whether a step of `scale` times [`across`](Self::across) goes so far that the measurement is no longer straight along it.
    fn bends(&self, scale: T, variance: T) -> bool {
        let [x, y, z, ..] = self.across;
        self.is_bent((x.squared() + y.squared() + z.squared()) * scale.squared(), variance)
    }

    /// The same for a step whose square is known.
    fn is_bent(&self, square: T, variance: T) -> bool {
        (self.linearised.curvature * square).squared() > T::of(4.0 * NEGLIGIBLE * NEGLIGIBLE) * variance
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
#[inline(always)]
pub(crate) fn update<T: Real>(
    state: &mut State<T>,
    model: &impl Model<T>,
    innovation: &Innovation<T>,
    variance: T,
    iterations: u8,
) {
    let s = innovation.predicted + variance;
    if !(s > T::ZERO) {
        return;
    }
    let inverse = T::ONE / s;
    let scale = inverse * innovation.value;
    if iterations > 1 && innovation.bends(scale, variance) {
        return iterate(state, model, innovation, variance, iterations);
    }
    state.shift(&innovation.across, scale);
    innovation.absorb(state, s, inverse);
}

/// The same with more than one linearisation.
#[inline(never)]
fn iterate<T: Real>(state: &mut State<T>, model: &dyn Model<T>, first: &Innovation<T>, variance: T, iterations: u8) {
    let before = state.mean;
    let mut innovation = first.clone();
    let mut residual = innovation.value;
    for left in (0..iterations).rev() {
        let s = innovation.predicted + variance;
        let inverse = T::ONE / s;
        let last = state.position();
        state.mean = before;
        state.shift(&innovation.across, inverse * residual);
        let now = state.position();
        let square = (now[0] - last[0]).squared() + (now[1] - last[1]).squared() + (now[2] - last[2]).squared();
        if left == 0 || !innovation.is_bent(square, variance) {
            return innovation.absorb(state, s, inverse);
        }
        innovation = Innovation::at(state, model.linearise(&state.mean));
        let gone: [T; STATES] = core::array::from_fn(|i| before[i] - state.mean[i]);
        residual = innovation.value - innovation.linearised.along(&gone);
    }
}
