//! The one way in which a measurement changes the track: the update of an (iterated) extended Kalman filter, one
//! number at a time (V. Barral et al., Sensors 19, 2019, equation 15, for one range; measurements that share an error
//! share a state).
//!
//! The covariance uses Joseph's form (I − K h) P (I − K h)ᵀ + r K Kᵀ. The short form (I − K h) P is right for the
//! optimal gain only: a gain with a rounding error δ makes it wrong by δ. After thousands of ranges in `f32` it is no
//! longer a covariance. Joseph's form is wrong by s δ δᵀ, which is second order and never negative.
//!
//! For one number, with g = P hᵀ, s = h g + r and the gain K = κ g, where κ is 1 ⁄ s apart from rounding, it
//! multiplies out to P − κ (2 − s κ) g gᵀ. This is symmetric, of rank one, and costs one product per element.
//!
//! A factored form (U D Uᵀ) would keep more digits. But its prediction, and the forgetting of a link, cost a third
//! power of the number of states. The digits are not needed, since no measurement counts as better than a centimetre.

use super::state::{POSITION, STATES, State};
use crate::Real;

/// The dependence of a measurement on the states, linearised at a mean.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Linearised<T> {
    /// The measured number minus the expected one, in the measurement's unit.
    pub(crate) innovation: T,
    /// Its derivative by the position.
    pub(crate) position: [T; 3],
    /// Derivatives by other states: the state's index, and the derivative. Zero means no dependence.
    pub(crate) others: [(usize, T); 3],
    /// The approximate change of the derivative by the position over a metre.
    pub(crate) curvature: T,
}

/// The model of one measured number.
pub(crate) trait Model<T> {
    /// Linearises the model at `mean`.
    fn linearise(&self, mean: &[T; STATES]) -> Linearised<T>;
}

/// A measurement compared with the track, before the track changes.
#[derive(Clone, Debug)]
pub(crate) struct Innovation<T> {
    /// The measured number minus the expected one.
    pub(crate) value: T,
    /// Its variance by the track's own uncertainty.
    pub(crate) predicted: T,
    linearised: Linearised<T>,
    /// P hᵀ.
    across: [T; STATES],
}

impl<T: Real> Innovation<T> {
    /// Compares a measurement with the track.
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

    /// The covariance of a state with the expected number.
    pub(crate) fn across(&self, state: usize) -> T {
        self.across.get(state).copied().unwrap_or(T::ZERO)
    }

    /// Subtracts this measurement's information from the covariance; `s` is the innovation's variance, and `inverse`
    /// 1 ⁄ s.
    fn absorb(&self, state: &mut State<T>, s: T, inverse: T) {
        state.absorb(&self.across, inverse * (T::of(2.0) - s * inverse));
    }

    /// Whether a step of `scale` times [`across`](Self::across) is so long that the measurement is not linear along
    /// it.
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

/// A step is not repeated if its neglected curvature is less than this part of the measurement's deviation.
const NEGLIGIBLE: f64 = 0.1;

/// Takes a measurement of the given variance into the track. With `iterations` above one it is the iterated filter:
/// the measurement is linearised again at the result of the last step, as long as that makes a difference.
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

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::*;
    use crate::track::state::{COMMON, LINKS, VELOCITY};

    /// The distance to a point, metres, with the error of a link.
    struct Distance<T> {
        to: [T; 3],
        metres: T,
        link: usize,
    }

    impl<T: Real> Model<T> for Distance<T> {
        fn linearise(&self, mean: &[T; STATES]) -> Linearised<T> {
            let across: [T; 3] = core::array::from_fn(|axis| mean[axis] - self.to[axis]);
            let far = (across[0].squared() + across[1].squared() + across[2].squared()).sqrt();
            Linearised {
                innovation: self.metres - far - mean[COMMON] - mean[self.link],
                position: across.map(|component| component / far),
                others: [(COMMON, T::ONE), (self.link, T::ONE), (0, T::ZERO)],
                curvature: T::ONE / far,
            }
        }
    }

    #[test]
    fn the_iterated_update_ends_at_the_likeliest_state_and_a_single_one_does_not() {
        // A range of 1 m to an anchor 0.5 m away; the tag is known to 0.5 m. The step is as long as the distance.
        let model = Distance { to: [0.0, 0.0, 0.0], metres: 1.0, link: LINKS };
        let variance = 0.0025;
        let start = || {
            let mut state = State::<f64>::new();
            state.reset(0, 0.3, 0.25);
            state.reset(1, 0.4, 0.04);
            state
        };
        // Half of the negative log posterior, minimised with a grid that shrinks.
        let cost = |x: f64, y: f64| {
            (x - 0.3).powi(2) / 0.25 + (y - 0.4).powi(2) / 0.04 + (1.0 - x.hypot(y)).powi(2) / variance
        };
        let (mut best, mut width) = ((0.3, 0.4), 1.0);
        while width > 1e-6 {
            let around = (-10..=10).flat_map(|i| (-10..=10).map(move |j| (f64::from(i), f64::from(j))));
            let points = around.map(|(i, j)| (best.0 + 0.1 * width * i, best.1 + 0.1 * width * j));
            best = points.min_by(|a, b| cost(a.0, a.1).total_cmp(&cost(b.0, b.1))).expect("441 points");
            width *= 0.5;
        }
        let run = |iterations| {
            let mut state = start();
            let innovation = Innovation::of(&state, &model);
            update(&mut state, &model, &innovation, variance, iterations);
            (state.mean[0] - best.0).hypot(state.mean[1] - best.1)
        };
        assert!(run(30) < 0.01, "{}", run(30));
        assert!(run(1) > 0.03, "{}", run(1));
    }

    #[test]
    fn a_million_to_one_between_prior_and_measurement_leaves_a_covariance_in_single_precision() {
        let mut state = State::<f32>::new();
        for place in 0..3 {
            state.reset(place, 0.5 * place as f32, 100.0);
            state.reset(VELOCITY + place, 0.0, 1.0);
        }
        state.reset(COMMON, 0.0, 0.0144);
        for link in 0..16 {
            state.reset(LINKS + link, 0.0, 0.01);
        }
        for k in 0..5000_u32 {
            let angle = 0.7 * f64::from(k);
            let anchor = [10.0 * angle.cos() as f32, 10.0 * angle.sin() as f32, (k % 3) as f32];
            let model = Distance { to: anchor, metres: 10.0, link: LINKS + k as usize % 16 };
            let innovation = Innovation::of(&state, &model);
            update(&mut state, &model, &innovation, 1e-4, 3);
            if k % 10 == 0 {
                state.advance(0.02, [0.1; 3]);
            }
            if k % 500 == 0 {
                let covariance = DMatrix::from_fn(STATES, STATES, |r, c| f64::from(state.covariance(r, c)));
                let least = covariance.clone().symmetric_eigenvalues().min();
                assert!(least > -1e-7 * covariance.trace(), "step {k}: {least}");
            }
        }
    }
}
