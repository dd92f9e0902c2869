//! What a track is about: position, velocity, and the errors of ranges that outlast one range, with their joint covariance.
//!
//! The errors are states because they are what keeps a deviation honest: the multipath of one link stays for seconds, so
//! a thousand ranges to an anchor are worth little more than one, and only a covariance that knows the link's error as one thing
//! says so. A link's error changes the track of nothing else while nobody measures that link, so it is carried forward only
//! when it is measured ([`State::renew`]); that is exact, and saves most of the work.

use crate::{MAX_ANCHORS, Real};

/// Place of the position's first coordinate, metres.
pub(crate) const POSITION: usize = 0;
/// Place of the velocity's first coordinate, metres a second.
pub(crate) const VELOCITY: usize = 3;
/// The error common to all ranges, metres: what is left of the tag's antenna delay.
pub(crate) const COMMON: usize = 6;
/// The error of one reception of the reference anchor, which all differences to it share, metres.
pub(crate) const REFERENCE: usize = 7;
/// Place of the first link's error, metres.
pub(crate) const LINKS: usize = 8;
/// All states.
pub(crate) const STATES: usize = LINKS + MAX_ANCHORS;

const PACKED: usize = STATES * (STATES + 1) / 2;

/// Where row `row` of a packed lower triangle begins.
const fn row(row: usize) -> usize {
    row * (row + 1) / 2
}

/// Mean and covariance of all states.
#[derive(Clone, Debug)]
pub(crate) struct State<T> {
    /// By the places above.
    pub(crate) mean: [T; STATES],
    /// The covariance's lower triangle, row by row: symmetric because there is no other half.
    packed: [T; PACKED],
    /// States from here on have never been used: their variance is zero.
    live: usize,
}

impl<T: Real> State<T> {
    /// Everything known to be zero.
    pub(crate) fn new() -> Self {
        Self { mean: [T::ZERO; STATES], packed: [T::ZERO; PACKED], live: LINKS }
    }

    /// Covariance of two states.
    pub(crate) fn covariance(&self, one: usize, other: usize) -> T {
        let (low, high) = if one < other { (one, other) } else { (other, one) };
        self.packed.get(row(high) + low).copied().unwrap_or(T::ZERO)
    }

    /// The position, metres.
    pub(crate) fn position(&self) -> [T; 3] {
        [self.mean[POSITION], self.mean[POSITION + 1], self.mean[POSITION + 2]]
    }

    /// The velocity, metres a second.
    pub(crate) fn velocity(&self) -> [T; 3] {
        [self.mean[VELOCITY], self.mean[VELOCITY + 1], self.mean[VELOCITY + 2]]
    }

    /// The position's covariance, m².
    pub(crate) fn position_covariance(&self) -> [[T; 3]; 3] {
        core::array::from_fn(|r| core::array::from_fn(|c| self.covariance(POSITION + r, POSITION + c)))
    }

    /// Sets the covariance of two states.
    pub(crate) fn set_covariance(&mut self, one: usize, other: usize, value: T) {
        let (low, high) = if one < other { (one, other) } else { (other, one) };
        if let Some(element) = self.packed.get_mut(row(high) + low) {
            *element = value;
        }
    }

    /// Adds to the variance of a state.
    pub(crate) fn widen(&mut self, state: usize, variance: T) {
        if let Some(element) = self.packed.get_mut(row(state) + state) {
            *element += variance;
        }
    }

    /// Forgets all about a state but its mean and its variance.
    pub(crate) fn reset(&mut self, state: usize, mean: T, variance: T) {
        if state >= STATES {
            return;
        }
        self.live = self.live.max(state + 1);
        self.scale(state, T::ZERO);
        self.mean[state] = mean;
        self.widen(state, variance);
    }

    /// Multiplies a state by a factor.
    fn scale(&mut self, state: usize, factor: T) {
        self.mean[state] = self.mean[state] * factor;
        for element in &mut self.packed[row(state)..=row(state) + state] {
            *element *= factor;
        }
        let mut place = row(state) + state;
        self.packed[place] *= factor;
        for below in state + 1..self.live {
            place += below;
            self.packed[place] *= factor;
        }
    }

    /// Carries a state that forgets itself forward: `kept` of it remains, and its variance goes to `variance` as `kept` goes to
    /// zero (a Gauss-Markov process).
    pub(crate) fn renew(&mut self, state: usize, kept: T, variance: T) {
        if state < STATES {
            self.scale(state, kept);
            self.widen(state, variance * (T::ONE - kept.squared()));
        }
    }

    /// Moves the position on by the velocity for `dt` seconds, with an acceleration that is white noise of the given density
    /// for each axis, m²/s³.
    pub(crate) fn advance(&mut self, dt: T, density: [T; 3]) {
        for axis in 0..3 {
            self.mean[POSITION + axis] += dt * self.mean[VELOCITY + axis];
        }
        for r in 0..3 {
            for c in 0..=r {
                let crossed = self.covariance(VELOCITY + r, POSITION + c) + self.covariance(POSITION + r, VELOCITY + c);
                let moved = dt * (crossed + dt * self.covariance(VELOCITY + r, VELOCITY + c));
                self.packed[row(POSITION + r) + POSITION + c] += moved;
            }
        }
        for r in 0..3 {
            for c in 0..3 {
                let moved = dt * self.covariance(VELOCITY + r, VELOCITY + c);
                self.packed[row(VELOCITY + r) + POSITION + c] += moved;
            }
        }
        let mut start = row(COMMON);
        for below in COMMON..self.live {
            for axis in 0..3 {
                self.packed[start + POSITION + axis] += dt * self.packed[start + VELOCITY + axis];
            }
            start += below + 1;
        }
        let (third, half) = (T::of(1.0 / 3.0), T::of(0.5));
        for (axis, density) in density.into_iter().enumerate() {
            let velocity = density * dt;
            let both = half * velocity * dt;
            self.packed[row(POSITION + axis) + POSITION + axis] += third * velocity * dt.squared();
            self.packed[row(VELOCITY + axis) + POSITION + axis] += both;
            self.packed[row(VELOCITY + axis) + VELOCITY + axis] += velocity;
        }
    }

    /// Adds `scale` times the covariance with one state to `sum`.
    #[inline(always)]
    pub(crate) fn add_column(&self, sum: &mut [T; STATES], state: usize, scale: T) {
        let start = row(state);
        for (sum, element) in sum.iter_mut().zip(&self.packed[start..=start + state]) {
            *sum += scale * *element;
        }
        let mut place = start + state;
        for (below, sum) in sum.iter_mut().enumerate().take(self.live).skip(state + 1) {
            place += below;
            *sum += scale * self.packed[place];
        }
    }

    /// Adds `scale` times the gain to the mean.
    pub(crate) fn shift(&mut self, gain: &[T; STATES], scale: T) {
        for (mean, gain) in self.mean.iter_mut().zip(gain).take(self.live) {
            *mean += scale * *gain;
        }
    }

    /// P − K gᵀ − g Kᵀ + s K Kᵀ, where g = P hᵀ and s = h P hᵀ + r: Joseph's form (I − K h) P (I − K h)ᵀ + r K Kᵀ for one
    /// measurement, multiplied out. See the module `update` for why.
    pub(crate) fn absorb(&mut self, gain: &[T; STATES], across: &[T; STATES], s: T) {
        // What the gain misses by rounding: zero in exact arithmetic.
        let missed: [T; STATES] = core::array::from_fn(|i| across[i] - s * gain[i]);
        let mut start = 0;
        for r in 0..self.live {
            let (gain_r, across_r) = (gain[r], across[r]);
            let elements = &mut self.packed[start..=start + r];
            for ((element, gain_c), missed_c) in elements.iter_mut().zip(gain).zip(&missed) {
                *element -= gain_r * *missed_c + across_r * *gain_c;
            }
            start += r + 1;
            if !(self.packed[start - 1] >= T::ZERO) {
                self.repair(r);
            }
        }
    }

    /// A variance that rounding took below zero: the state is known as well as numbers can tell, and nothing more can be
    /// learnt of it by way of others.
    #[inline(never)]
    fn repair(&mut self, state: usize) {
        for element in &mut self.packed[row(state)..=row(state) + state] {
            *element = T::ZERO;
        }
        for below in state + 1..self.live {
            self.packed[row(below) + state] = T::ZERO;
        }
    }

    /// Whether mean and variances are finite.
    pub(crate) fn is_finite(&self) -> bool {
        let mut sum = T::ZERO;
        for state in 0..self.live {
            sum += self.mean[state].abs() + self.packed[row(state) + state];
        }
        sum.is_finite()
    }
}
