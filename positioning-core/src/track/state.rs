//! The states of a track: position, velocity, and the errors of ranges that last longer than one range, with their
//! joint covariance.
//!
//! The lasting errors are states because otherwise the deviation would be too small. The multipath of one link stays
//! for seconds, so a thousand ranges to an anchor contain little more information than one. Only a covariance with
//! the link's error as a state shows that. A link's error changes no other part of the track while that link is not
//! measured. It is therefore predicted only when it is measured ([`State::renew`]). That is exact, and saves most of
//! the work.

use crate::linalg::{add_scaled, dot};
use crate::link_error::Gaussian;
use crate::{MAX_ANCHORS, Real};

/// Index of the position's first coordinate, metres.
pub(crate) const POSITION: usize = 0;
/// Index of the velocity's first coordinate, metres per second.
pub(crate) const VELOCITY: usize = 3;
/// The error common to all ranges, metres: the remaining error of the tag's antenna delay.
pub(crate) const COMMON: usize = 6;
/// Index of the first link's error, metres.
pub(crate) const LINKS: usize = 7;
/// The error of one reception of the reference anchor, which all differences to it share, metres. It is last, so that
/// a track without differences does not process it.
pub(crate) const REFERENCE: usize = LINKS + MAX_ANCHORS;
/// The number of states.
pub(crate) const STATES: usize = REFERENCE + 1;

/// The greatest speed that counts for the forgetting of a link's error, metres per second: people indoors are not
/// faster.
const FASTEST: f64 = 10.0;

/// Each row is padded to the next multiple of this, so that loops over a row have no remainder. Elements beyond the
/// diagonal have no meaning.
const CHUNK: usize = 4;
const PACKED: usize = row(STATES);

/// The start of row `row` of the packed lower triangle: four rows of one chunk, four of two, and so on.
const fn row(row: usize) -> usize {
    let whole = row / CHUNK;
    CHUNK * (whole + 1) * (CHUNK * whole / 2 + row % CHUNK)
}

/// [`row`] for every row.
static ROWS: [usize; STATES] = {
    let mut rows = [0; STATES];
    let mut r = 0;
    while r < STATES {
        rows[r] = row(r);
        r += 1;
    }
    rows
};

/// Mean and covariance of all states.
#[derive(Clone, Debug)]
pub(crate) struct State<T> {
    /// The means, by the indices above.
    pub(crate) mean: [T; STATES],
    /// The covariance's lower triangle, row by row. It is symmetric because there is no other half.
    packed: [T; PACKED],
    /// States from this index on are not in use.
    live: usize,
}

impl<T: Real> State<T> {
    /// All states are zero without uncertainty.
    pub(crate) fn new() -> Self {
        // Constants are not made on the stack first.
        Self { mean: const { [T::ZERO; STATES] }, packed: const { [T::ZERO; PACKED] }, live: LINKS }
    }

    /// The number of states in use, without the error of a reception of the reference anchor.
    pub(crate) fn lasting(&self) -> usize {
        self.live.min(REFERENCE)
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

    /// The velocity, metres per second.
    pub(crate) fn velocity(&self) -> [T; 3] {
        [self.mean[VELOCITY], self.mean[VELOCITY + 1], self.mean[VELOCITY + 2]]
    }

    /// The position's covariance, m².
    pub(crate) fn position_covariance(&self) -> [[T; 3]; 3] {
        let p = |r: usize, c: usize| self.packed[row(POSITION + r) + POSITION + c];
        let (yx, zx, zy) = (p(1, 0), p(2, 0), p(2, 1));
        [[p(0, 0), yx, zx], [yx, p(1, 1), zy], [zx, zy, p(2, 2)]]
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

    /// The part of a link's error that is left after some seconds of the present motion. `after` is the time in seconds
    /// and the distance in metres after which the error is a different one.
    #[inline(always)]
    pub(crate) fn kept(&self, age: T, after: [T; 2]) -> T {
        let velocity = self.velocity();
        let square = velocity[0].squared() + velocity[1].squared() + velocity[2].squared();
        let speed = square.at_most(T::of(FASTEST * FASTEST)).sqrt();
        fading(age * (T::ONE / after[0] + speed / after[1]))
    }

    /// Resets a state to this mean and variance, without covariance with other states.
    pub(crate) fn reset(&mut self, state: usize, mean: T, variance: T) {
        if state >= STATES {
            return;
        }
        if state >= self.live {
            // These elements are from an earlier track.
            self.packed[row(self.live)..row(state + 1)].fill(T::ZERO);
            self.mean[self.live..=state].fill(T::ZERO);
            self.live = state + 1;
        }
        self.scale(state, T::ZERO);
        self.mean[state] = mean;
        self.widen(state, variance);
    }

    /// Resets all links, and the common error of differences.
    pub(crate) fn forget_links(&mut self) {
        self.live = LINKS;
    }

    /// Multiplies a state by a factor.
    fn scale(&mut self, state: usize, factor: T) {
        self.mean[state] *= factor;
        for element in &mut self.packed[row(state)..=row(state) + state] {
            *element *= factor;
        }
        for below in state..self.live {
            self.packed[ROWS[below] + state] *= factor;
        }
    }

    /// Predicts a state that forgets itself: the share `kept` of it remains, and mean and variance go to those of
    /// `prior` as `kept` goes to zero (a Gauss-Markov process).
    #[inline(never)]
    pub(crate) fn renew(&mut self, state: usize, kept: T, prior: Gaussian<T>) {
        if state < STATES {
            self.scale(state, kept);
            self.mean[state] += (T::ONE - kept) * prior.mean;
            self.widen(state, prior.variance * (T::ONE - kept.squared()));
        }
    }

    /// Multiplies the density by that of a Gaussian of one state, with this precision and precision times mean. A
    /// negative precision takes information away; where it would take all, nothing changes, and the result is false.
    #[inline(never)]
    pub(crate) fn inform(&mut self, state: usize, precision: T, weight: T) -> bool {
        let mut across = [T::ZERO; STATES];
        self.add_column(&mut across, state, T::ONE);
        let denominator = T::ONE + precision * across[state];
        if !(denominator > T::of(0.05)) {
            return false;
        }
        let inverse = T::ONE / denominator;
        self.shift(&across, inverse * (weight - precision * self.mean[state]));
        self.absorb(&across, inverse * precision);
        true
    }

    /// Becomes a copy of another state, in place: states are large.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.mean.copy_from_slice(&other.mean);
        self.packed.copy_from_slice(&other.packed);
        self.live = other.live;
    }

    /// Reflects position and velocity across the plane through `centre` with this unit normal: the mean x becomes
    /// x − 2 n nᵀ (x − c), and the covariance P becomes H P Hᵀ with H = I − 2 n nᵀ.
    pub(crate) fn reflect(&mut self, centre: &[T; 3], normal: &[T; 3]) {
        for (block, centre) in [(POSITION, *centre), (VELOCITY, [T::ZERO; 3])] {
            let own = block..block + 3;
            let mean = core::array::from_fn(|axis| self.mean[block + axis] - centre[axis]);
            self.mean[own.clone()].copy_from_slice(&add_scaled(&reflected(&mean, normal), T::ONE, &centre));
            for other in (0..self.live).filter(|other| !own.contains(other)) {
                let column = reflected(&core::array::from_fn(|axis| self.covariance(block + axis, other)), normal);
                (0..3).for_each(|axis| self.set_covariance(block + axis, other, column[axis]));
            }
            let rows: [[T; 3]; 3] = core::array::from_fn(|r| {
                reflected(&core::array::from_fn(|c| self.covariance(block + r, block + c)), normal)
            });
            for r in 0..3 {
                let column = reflected(&rows.map(|row| row[r]), normal);
                (0..=r).for_each(|c| self.set_covariance(block + r, block + c, column[c]));
            }
        }
    }

    /// Moves the position by the velocity for `dt` seconds, with an acceleration that is white noise of the given
    /// density for each axis, m²/s³.
    pub(crate) fn advance(&mut self, dt: T, density: [T; 3]) {
        for axis in 0..3 {
            self.mean[POSITION + axis] += dt * self.mean[VELOCITY + axis];
        }
        for r in 0..3 {
            for c in 0..=r {
                let crossed =
                    self.packed[row(VELOCITY + r) + POSITION + c] + self.packed[row(VELOCITY + c) + POSITION + r];
                let moved = dt * (crossed + dt * self.packed[row(VELOCITY + r) + VELOCITY + c]);
                self.packed[row(POSITION + r) + POSITION + c] += moved;
            }
        }
        for r in 0..3 {
            for c in 0..3 {
                let moved = dt * self.covariance(VELOCITY + r, VELOCITY + c);
                self.packed[row(VELOCITY + r) + POSITION + c] += moved;
            }
        }
        for below in COMMON..self.live {
            let [x, y, z, vx, vy, vz, ..] = &mut self.packed[ROWS[below]..] else { break };
            *x += dt * *vx;
            *y += dt * *vy;
            *z += dt * *vz;
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

    /// Writes to `sum` the covariance of all states with a point's distance along `slopes`.
    #[inline(always)]
    pub(crate) fn along_position(&self, sum: &mut [T; STATES], slopes: &[T; 3]) {
        let block = self.position_covariance();
        for axis in 0..3 {
            sum[POSITION + axis] = slopes[0] * block[axis][0] + slopes[1] * block[axis][1] + slopes[2] * block[axis][2];
        }
        for (below, sum) in sum.iter_mut().enumerate().take(self.live).skip(VELOCITY) {
            let [x, y, z, ..] = &self.packed[ROWS[below]..] else { break };
            *sum = slopes[0] * *x + slopes[1] * *y + slopes[2] * *z;
        }
    }

    /// Adds `scale` times the covariance with one state to `sum`.
    #[inline(always)]
    pub(crate) fn add_column(&self, sum: &mut [T; STATES], state: usize, scale: T) {
        let start = row(state);
        for (sum, element) in sum.iter_mut().zip(&self.packed[start..=start + state]) {
            *sum += scale * *element;
        }
        for (below, sum) in sum.iter_mut().enumerate().take(self.live).skip(state + 1) {
            *sum += scale * self.packed[ROWS[below] + state];
        }
    }

    /// Adds `scale` times a vector to the mean.
    pub(crate) fn shift(&mut self, vector: &[T; STATES], scale: T) {
        for (mean, element) in self.mean.iter_mut().zip(vector).take(self.live) {
            *mean += scale * *element;
        }
    }

    /// Subtracts `share` times a rank-one matrix from the covariance: P − c g gᵀ, where g is P hᵀ.
    #[inline(never)]
    pub(crate) fn absorb(&mut self, across: &[T; STATES], share: T) {
        let (chunks, _) = across.as_chunks::<CHUNK>();
        let mut rest = self.packed.as_mut_slice();
        let mut doubtful = false;
        for (r, across_r) in across.iter().enumerate().take(self.live) {
            let Some((elements, below)) = rest.split_at_mut_checked(CHUNK * (r / CHUNK + 1)) else { break };
            rest = below;
            let scaled = share * *across_r;
            for (element, across_c) in elements.as_chunks_mut::<CHUNK>().0.iter_mut().zip(chunks) {
                for k in 0..CHUNK {
                    element[k] -= scaled * across_c[k];
                }
            }
            doubtful |= elements.get(r).is_none_or(|variance| !(*variance >= T::ZERO));
        }
        if doubtful {
            self.repair();
        }
    }

    /// Repairs variances that rounding took below zero. Such a state is known as well as the precision allows, and
    /// measurements of other states cannot change it any more.
    #[inline(never)]
    fn repair(&mut self) {
        for state in 0..self.live {
            if !(self.packed[row(state) + state] >= T::ZERO) {
                let mean = self.mean[state];
                self.scale(state, T::ZERO);
                // Not by scaling: an element that is not finite would stay so.
                self.packed[row(state)..=row(state) + state].fill(T::ZERO);
                self.mean[state] = mean;
            }
        }
    }

    /// Whether position and velocity are finite: any other state that is not finite has reached them.
    pub(crate) fn is_finite(&self) -> bool {
        self.mean.iter().take(COMMON).fold(T::ZERO, |sum, mean| sum + mean.abs()).is_finite()
    }

    /// The sum of the position's variances, m².
    pub(crate) fn spread(&self) -> T {
        self.packed[row(POSITION)] + self.packed[row(POSITION + 1) + 1] + self.packed[row(POSITION + 2) + 2]
    }
}

// Chunks cover the whole of a vector of states.
const _: () = assert!(STATES.is_multiple_of(CHUNK));

/// A vector with its part along a unit vector turned round.
#[inline(never)]
fn reflected<T: Real>(vector: &[T; 3], normal: &[T; 3]) -> [T; 3] {
    add_scaled(vector, T::of(-2.0) * dot(vector, normal), normal)
}

/// e⁻ˣ for x ≥ 0, approximately, by (1 + x ⁄ 8)⁻⁸. It is 1 for 0, falls, stays above 0, and is within 1 % up to x =
/// 0.4. It needs no table and no branch.
pub(crate) fn fading<T: Real>(x: T) -> T {
    (T::ONE / (T::ONE + T::of(0.125) * x)).squared().squared().squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_the_triangle_follow_each_other_in_whole_chunks() {
        // Four rows of 4, four of 8, then rows of 12.
        assert_eq!([0, 1, 4, 5, 8, 9].map(row), [0, 4, 16, 24, 48, 60]);
        assert!((0..STATES).all(|r| row(r + 1) - row(r) > r));
    }

    #[test]
    fn time_alone_spreads_position_and_velocity_as_white_acceleration_does() {
        let mut state = State::<f64>::new();
        state.reset(POSITION, 1.0, 0.04);
        state.reset(VELOCITY, 0.5, 0.09);
        state.advance(2.0, [0.3, 0.0, 0.0]);
        // Mean 1 + 2 · 0.5. Position 0.04 + 2² · 0.09 + 0.3 · 2³ ⁄ 3 = 1.2; both 2 · 0.09 + 0.3 · 2² ⁄ 2 = 0.78;
        // velocity 0.09 + 0.6.
        assert!((state.mean[POSITION] - 2.0).abs() < 1e-12);
        for (one, other, expected) in [(0, 0, 1.2), (0, 3, 0.78), (3, 3, 0.69)] {
            assert!((state.covariance(one, other) - expected).abs() < 1e-12, "{one} {other}");
        }
    }

    #[test]
    fn a_link_forgets_itself_and_what_it_had_in_common_with_others() {
        let mut state = State::<f64>::new();
        state.reset(LINKS, 0.4, 0.01);
        state.reset(POSITION, 0.0, 1.0);
        state.set_covariance(POSITION, LINKS, 0.05);
        // Half is kept: mean 0.5 · 0.4 + 0.5 · 0.1, variance 0.25 · 0.01 + 0.75 · 0.09.
        state.renew(LINKS, 0.5, Gaussian { mean: 0.1, variance: 0.09 });
        assert!((state.mean[LINKS] - 0.25).abs() < 1e-12);
        assert!((state.covariance(LINKS, LINKS) - 0.07).abs() < 1e-12);
        assert!((state.covariance(POSITION, LINKS) - 0.025).abs() < 1e-12);
    }

    #[test]
    fn information_about_one_state_is_given_and_taken_away() {
        let mut state = State::<f64>::new();
        state.reset(LINKS, 0.4, 0.01);
        state.reset(POSITION, 1.0, 1.0);
        state.set_covariance(POSITION, LINKS, 0.05);
        // Precision 100 at 0.6: variance 1 ⁄ (100 + 100), mean 0.5; the position moves by 0.05 ⁄ 0.01 · 0.1, and keeps
        // 1 − 0.05² · 0.5 ⁄ 0.01.
        assert!(state.inform(LINKS, 100.0, 60.0));
        let found = [state.mean[LINKS], state.covariance(LINKS, LINKS), state.mean[POSITION], state.covariance(0, 0)];
        let expected = [0.5, 0.005, 1.5, 0.875];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        assert!(state.inform(LINKS, -100.0, -60.0));
        assert!((state.mean[POSITION] - 1.0).abs() < 1e-12 && (state.covariance(0, 0) - 1.0).abs() < 1e-12);
        // More than there is cannot be taken.
        assert!(!state.inform(LINKS, -100.0, -60.0));
    }

    #[test]
    fn a_new_track_finds_nothing_of_the_links_of_the_last_one() {
        let mut state = State::<f64>::new();
        state.reset(LINKS, 0.4, 0.01);
        state.reset(LINKS + 1, 0.4, 0.01);
        state.set_covariance(LINKS, LINKS + 1, 0.007);
        state.forget_links();
        state.reset(LINKS + 1, 0.0, 0.02);
        state.reset(LINKS, 0.0, 0.02);
        assert_eq!((state.covariance(LINKS, LINKS + 1), state.covariance(LINKS, LINKS)), (0.0, 0.02));
    }
}
