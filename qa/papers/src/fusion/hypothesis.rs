//! One hypothesis: the state of all links, and, given that state, a normal distribution over position, velocity and
//! the biases of all nodes.
//!
//! States are numbered: positions first, then velocities, then the states of the nodes. Only the covariance's lower
//! triangle is stored.

use positioning_core::Real;
use positioning_core::linalg::{Ldl, dot, symmetric_eigen};

/// A bound farther out than this number of deviations cuts nothing.
const FAR_INSIDE: f64 = -3.0;
/// A mean farther outside the bound than this number of deviations is cut as if it were here.
const FAR_OUTSIDE: f64 = 8.0;
/// ln √2π.
const LN_ROOT_TAU: f64 = 0.918_938_533_204_672_7;
/// 1 ⁄ √2π: the greatest density of a standard normal number.
pub(super) const PEAK: f64 = 0.398_942_28;

/// A normal distribution over S states, with the assumed state of the links.
#[derive(Clone, Debug)]
pub(super) struct Hypothesis<T, const N: usize, const S: usize> {
    /// Bit n: the link to node n is blocked.
    pub(super) blocked: u16,
    /// Natural logarithm of its weight while values are processed.
    pub(super) log: T,
    /// Its probability.
    pub(super) weight: T,
    pub(super) mean: [T; S],
    covariance: [[T; S]; S],
    /// For each link, the share of time in which it has been blocked.
    pub(super) share: [T; N],
}

/// The expected value under a hypothesis: linear in the position and one bias.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expected<T, const D: usize> {
    /// Value minus expectation.
    pub(super) innovation: T,
    /// Derivative of the expectation by the position.
    pub(super) gradient: [T; D],
    /// The state that adds to it.
    pub(super) bias: usize,
    /// Variance of the value, and of the non-linear part.
    pub(super) variance: T,
    /// Density of outliers.
    pub(super) stray: T,
    /// Reference density, by which densities are divided.
    pub(super) peak: T,
}

impl<T: Real, const N: usize, const S: usize> Hypothesis<T, N, S> {
    pub(super) fn new(share: T) -> Self {
        Self {
            blocked: 0,
            log: T::ZERO,
            weight: T::ONE,
            mean: [T::ZERO; S],
            covariance: [[T::ZERO; S]; S],
            share: [share; N],
        }
    }

    pub(super) fn is_blocked(&self, node: usize) -> bool {
        self.blocked >> node & 1 == 1
    }

    #[inline(always)]
    pub(super) fn covariance(&self, a: usize, b: usize) -> T {
        if a >= b { self.covariance[a][b] } else { self.covariance[b][a] }
    }

    #[inline(always)]
    fn set(&mut self, a: usize, b: usize, value: T) {
        if a >= b { self.covariance[a][b] = value } else { self.covariance[b][a] = value }
    }

    /// Makes a state independent of the others, with this mean and variance.
    pub(super) fn reset(&mut self, state: usize, mean: T, variance: T) {
        (0..S).for_each(|other| self.set(state, other, T::ZERO));
        self.set(state, state, variance);
        self.mean[state] = mean;
    }

    /// x[to] += `by` · x[from].
    pub(super) fn shear(&mut self, to: usize, from: usize, by: T, used: usize) {
        self.mean[to] += by * self.mean[from];
        let (across, variance) = (self.covariance(to, from), self.covariance(from, from));
        let own = self.covariance(to, to) + by * (across + across + by * variance);
        for other in 0..used {
            self.set(to, other, self.covariance(to, other) + by * self.covariance(from, other));
        }
        self.set(to, to, own);
    }

    /// x[state] = mean + `kept` · (x[state] − mean), and noise of this variance.
    pub(super) fn forget(&mut self, state: usize, mean: T, kept: T, variance: T, used: usize) {
        self.mean[state] = mean + kept * (self.mean[state] - mean);
        let own = self.covariance(state, state);
        for other in 0..used {
            self.set(state, other, kept * self.covariance(state, other));
        }
        self.set(state, state, kept.squared() * own + variance);
    }

    pub(super) fn add(&mut self, a: usize, b: usize, covariance: T) {
        self.set(a, b, self.covariance(a, b) + covariance);
    }

    /// Multiplies (x[a] − mean, x[b]) by the matrix `by`.
    pub(super) fn turn(&mut self, [a, b]: [usize; 2], mean: T, by: &[[T; 2]; 2], used: usize) {
        let (x, y) = (self.mean[a] - mean, self.mean[b]);
        self.mean[a] = mean + by[0][0] * x + by[0][1] * y;
        self.mean[b] = by[1][0] * x + by[1][1] * y;
        let (aa, ab, bb) = (self.covariance(a, a), self.covariance(a, b), self.covariance(b, b));
        for other in 0..used {
            let (x, y) = (self.covariance(a, other), self.covariance(b, other));
            self.set(a, other, by[0][0] * x + by[0][1] * y);
            self.set(b, other, by[1][0] * x + by[1][1] * y);
        }
        let of = |r: &[T; 2], s: &[T; 2]| r[0] * s[0] * aa + (r[0] * s[1] + r[1] * s[0]) * ab + r[1] * s[1] * bb;
        self.set(a, a, of(&by[0], &by[0]));
        self.set(a, b, of(&by[0], &by[1]));
        self.set(b, b, of(&by[1], &by[1]));
    }

    /// Processes a value: Kalman's update, weighted by the probability that the value is no outlier; the two outcomes
    /// are merged by their moments.
    pub(super) fn update<const D: usize>(&mut self, value: &Expected<T, D>, used: usize) {
        let mut gain = [T::ZERO; S];
        let mut variance = value.variance;
        for (state, gain) in gain.iter_mut().enumerate().take(used) {
            *gain = self.covariance(state, value.bias);
            for (axis, &gradient) in value.gradient.iter().enumerate() {
                *gain += gradient * self.covariance(state, axis);
            }
        }
        for (&gradient, &gain) in value.gradient.iter().zip(&gain) {
            variance += gradient * gain;
        }
        variance += gain[value.bias];
        let inverse = T::ONE / variance;
        let squared = value.innovation.squared() * inverse;
        let density = T::of(PEAK) * inverse.sqrt() * (T::of(-0.5) * squared).exp();
        let total = density + value.stray;
        let sane = density / total;
        self.log += T::of(core::f64::consts::LN_2) * (total / value.peak).log2_about();
        // The factor of the gain's outer product: less by the information of the value, more by the uncertainty
        // whether it is an outlier.
        let less = sane * inverse * (T::ONE - (T::ONE - sane) * squared);
        let more = sane * inverse * value.innovation;
        self.spread(&gain, -less, used);
        for (mean, &gain) in self.mean.iter_mut().zip(&gain) {
            *mean += more * gain;
        }
    }

    /// Adds `by` · v vᵀ to the covariance.
    fn spread(&mut self, v: &[T; S], by: T, used: usize) {
        for (r, row) in self.covariance.iter_mut().enumerate().take(used) {
            let scaled = by * v[r];
            row.iter_mut().zip(v).take(r + 1).for_each(|(c, &v)| *c += scaled * v);
        }
    }

    /// Makes x[state] lie on the positive side of `bound` (on the negative one with the sign −1): the moments of a
    /// truncated normal distribution (N. L. Johnson and S. Kotz, *Continuous Univariate Distributions 1*, 1970,
    /// chapter 13.7).
    pub(super) fn cut(&mut self, state: usize, bound: T, sign: T, used: usize) {
        let deviation = self.covariance(state, state).sqrt();
        if !(deviation > T::ZERO) {
            return;
        }
        let at = sign * (bound - self.mean[state]) / deviation;
        if at < T::of(FAR_INSIDE) {
            return;
        }
        let at = at.at_most(T::of(FAR_OUTSIDE));
        let (hazard, log_tail) = tail(at);
        let v: [T; S] =
            core::array::from_fn(|r| if r < used { self.covariance(r, state) / deviation } else { T::ZERO });
        self.spread(&v, -hazard * (hazard - at), used);
        self.mean.iter_mut().zip(&v).for_each(|(m, &v)| *m += sign * hazard * v);
        self.log += log_tail;
    }

    /// The widest direction of the position, and the variance along it.
    pub(super) fn widest<const D: usize>(&self) -> ([T; D], T) {
        let (values, vectors) = symmetric_eigen(&self.position_covariance::<D>());
        let wider = |a: ([T; D], T), (vector, value): (&[T; D], &T)| if *value > a.1 { (*vector, *value) } else { a };
        vectors.iter().zip(&values).fold(([T::ZERO; D], T::ZERO), wider)
    }

    fn along<const D: usize>(&self, along: &[T; D]) -> [T; S] {
        core::array::from_fn(|r| (0..D).fold(T::ZERO, |sum, c| sum + self.covariance(r, c) * along[c]))
    }

    /// Fixes a part of the variance `widest` along a direction of the position: the distribution that is left if that
    /// part is `by` of its deviations off the mean.
    pub(super) fn fix<const D: usize>(&mut self, along: &[T; D], widest: T, part: T, by: T, used: usize) {
        let v = self.along(along);
        let scale = (part / widest).sqrt();
        self.spread(&v, -part / widest, used);
        self.mean.iter_mut().zip(&v).for_each(|(m, &v)| *m += by * scale * v);
    }

    /// The sum of the position's covariance and that of another hypothesis.
    fn sum<const D: usize>(&self, other: &Self) -> [[T; D]; D] {
        core::array::from_fn(|r| core::array::from_fn(|c| self.covariance(r, c) + other.covariance(r, c)))
    }

    pub(super) fn position<const D: usize>(&self) -> [T; D] {
        core::array::from_fn(|axis| self.mean[axis])
    }

    pub(super) fn position_covariance<const D: usize>(&self) -> [[T; D]; D] {
        core::array::from_fn(|r| core::array::from_fn(|c| self.covariance(r, c)))
    }

    /// The squared distance between the positions of two hypotheses, over both covariances.
    pub(super) fn apart<const D: usize>(&self, other: &Self) -> T {
        let off: [T; D] = core::array::from_fn(|axis| self.mean[axis] - other.mean[axis]);
        squared_over(&self.sum(other), &off)
    }

    /// Merges another hypothesis into this one, by the moments of both.
    pub(super) fn merge(&mut self, other: &Self, used: usize) {
        let total = self.weight + other.weight;
        let part = if total > T::ZERO { other.weight / total } else { T::ZERO };
        let off: [T; S] = core::array::from_fn(|state| other.mean[state] - self.mean[state]);
        for (mine, its) in self.covariance.iter_mut().zip(&other.covariance).take(used) {
            mine.iter_mut().zip(its).for_each(|(m, &i)| *m += part * (i - *m));
        }
        self.spread(&off, part * (T::ONE - part), used);
        self.mean.iter_mut().zip(&off).for_each(|(m, &o)| *m += part * o);
        self.share.iter_mut().zip(&other.share).for_each(|(m, &i)| *m += part * (i - *m));
        self.weight = total;
    }
}

/// dᵀ C⁻¹ d; `None` where C is singular.
pub(super) fn squared_over<T: Real, const D: usize>(covariance: &[[T; D]; D], d: &[T; D]) -> T {
    Ldl::new(*covariance).map_or(T::ZERO, |ldl| dot(&ldl.solve(*d), d))
}

/// For a standard normal number: density over probability beyond `at`, and the logarithm of that probability.
fn tail<T: Real>(at: T) -> (T, T) {
    let log_density = T::of(-0.5) * at.squared() - T::of(LN_ROOT_TAU);
    // M. Abramowitz and I. A. Stegun, *Handbook of Mathematical Functions*, 26.2.17 and, far out, 26.2.14.
    let far = |x: T| {
        let t = T::ONE / (T::ONE + T::of(0.231_641_9) * x);
        let five = [1.330_274_429, -1.821_255_978, 1.781_477_937, -0.356_563_782, 0.319_381_53];
        five.iter().fold(T::ZERO, |sum, &b| (sum + T::of(b)) * t)
    };
    if at > T::of(3.0) {
        let hazard = (1..=6).rev().fold(at, |sum, k| at + T::count(k) / sum);
        return (hazard, log_density - hazard.ln());
    }
    let beyond = log_density.exp() * far(at.abs());
    let beyond = if at < T::ZERO { T::ONE - beyond } else { beyond };
    (log_density.exp() / beyond, beyond.ln())
}

#[cfg(test)]
mod tests {
    use nalgebra::{SMatrix, SVector};

    use super::*;

    type Four = Hypothesis<f64, 1, 4>;

    /// Position, velocity and a bias in the plane's first axis, with given covariances.
    fn some() -> (Four, SVector<f64, 4>, SMatrix<f64, 4, 4>) {
        let root = SMatrix::<f64, 4, 4>::from_fn(|r, c| if r >= c { 1.0 + (r * 3 + c * 2) as f64 * 0.1 } else { 0.0 });
        let (covariance, mean) = (root * root.transpose(), SVector::from([1.0, 2.0, -0.5, 0.3]));
        let mut hypothesis = Four::new(0.3);
        for r in 0..4 {
            hypothesis.mean[r] = mean[r];
            (0..=r).for_each(|c| hypothesis.covariance[r][c] = covariance[(r, c)]);
        }
        (hypothesis, mean, covariance)
    }

    fn same(hypothesis: &Four, mean: &SVector<f64, 4>, covariance: &SMatrix<f64, 4, 4>) {
        for r in 0..4 {
            assert!((hypothesis.mean[r] - mean[r]).abs() < 1e-12, "{r}: {:?} {mean}", hypothesis.mean);
            for c in 0..4 {
                assert!((hypothesis.covariance(r, c) - covariance[(r, c)]).abs() < 1e-12, "{r} {c}");
            }
        }
    }

    #[test]
    fn moving_is_a_product_of_matrices() {
        let (mut hypothesis, mean, covariance) = some();
        hypothesis.shear(0, 2, 0.2, 4);
        hypothesis.turn([1, 3], 0.7, &[[0.9, 0.4], [-0.3, 0.8]], 4);
        hypothesis.forget(2, 0.1, 0.6, 0.05, 4);
        let shear = SMatrix::from_row_slice(&[1., 0., 0.2, 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.]);
        let turn = SMatrix::from_row_slice(&[1., 0., 0., 0., 0., 0.9, 0., 0.4, 0., 0., 1., 0., 0., -0.3, 0., 0.8]);
        let forget = SMatrix::<f64, 4, 4>::from_diagonal(&SVector::from([1., 1., 0.6, 1.]));
        let about = SVector::from([0., 0.7, 0., 0.]);
        let mean = turn * (shear * mean - about) + about;
        let mean = forget * mean + SVector::from([0., 0., 0.4 * 0.1, 0.]);
        let all = forget * turn * shear;
        let mut covariance = all * covariance * all.transpose();
        covariance[(2, 2)] += 0.05;
        same(&hypothesis, &mean, &covariance);
    }

    #[test]
    fn a_value_without_strays_is_the_textbooks_update() {
        let (mut hypothesis, mean, covariance) = some();
        let value = Expected { innovation: 0.8, gradient: [0.6, -0.8], bias: 3, variance: 0.5, stray: 0.0, peak: 1.0 };
        hypothesis.update(&value, 4);
        let h = SVector::from([0.6, -0.8, 0.0, 1.0]);
        let variance = (h.transpose() * covariance * h)[0] + 0.5;
        let gain = covariance * h / variance;
        let left = SMatrix::identity() - gain * h.transpose();
        same(&hypothesis, &(mean + gain * 0.8), &(left * covariance));
        let log = -0.5 * 0.8 * 0.8 / variance - 0.5 * (std::f64::consts::TAU * variance).ln();
        assert!((hypothesis.log - log).abs() < 1e-6, "{} {log}", hypothesis.log);
    }

    #[test]
    fn what_is_a_stray_changes_nothing() {
        let (mut hypothesis, mean, covariance) = some();
        // Fifty deviations off the expectation.
        let value =
            Expected { innovation: 400.0, gradient: [0.6, -0.8], bias: 3, variance: 0.5, stray: 1e-3, peak: 1.0 };
        hypothesis.update(&value, 4);
        same(&hypothesis, &mean, &covariance);
        assert!((hypothesis.log - 1e-3_f64.ln()).abs() < 1e-3);
    }

    #[test]
    fn a_normal_distribution_cut_in_the_middle_is_the_half_normal_one() {
        // Mean √(2 ⁄ π) σ, variance (1 − 2 ⁄ π) σ²; half of the probability is left.
        let mut hypothesis = Four::new(0.3);
        hypothesis.reset(1, 3.0, 4.0);
        hypothesis.cut(1, 3.0, 1.0, 4);
        let pi = std::f64::consts::PI;
        assert!((hypothesis.mean[1] - 3.0 - 2.0 * (2.0 / pi).sqrt()).abs() < 1e-5, "{}", hypothesis.mean[1]);
        assert!((hypothesis.covariance(1, 1) - 4.0 * (1.0 - 2.0 / pi)).abs() < 1e-5);
        assert!((hypothesis.log - 0.5_f64.ln()).abs() < 1e-6);
        // The same with the sign −1.
        hypothesis.reset(1, 3.0, 4.0);
        hypothesis.cut(1, 3.0, -1.0, 4);
        assert!((hypothesis.mean[1] - 3.0 + 2.0 * (2.0 / pi).sqrt()).abs() < 1e-5);
    }

    #[test]
    fn tails_are_those_of_the_error_function() {
        for at in [-3.0_f64, -1.0, -0.2, 0.0, 0.7, 2.0, 2.99, 3.01, 5.0, 8.0] {
            let probability = 0.5 * libm::erfc(at / 2.0_f64.sqrt());
            let density = (-0.5 * at * at).exp() / std::f64::consts::TAU.sqrt();
            let (hazard, log) = tail(at);
            assert!((hazard * probability / density - 1.0).abs() < 1e-4, "{at}: {hazard}");
            assert!((log - probability.ln()).abs() < 1e-4, "{at}: {log}");
        }
    }

    #[test]
    fn two_that_are_merged_keep_the_moments_of_both() {
        // 0.25 at 1 with variance 1, 0.75 at 5 with variance 4: mean 4, variance 3.25 + 0.25 · 0.75 · 16 = 6.25.
        let (mut a, mut b) = (Four::new(0.2), Four::new(0.6));
        a.reset(0, 1.0, 1.0);
        b.reset(0, 5.0, 4.0);
        (a.weight, b.weight) = (0.1, 0.3);
        a.merge(&b, 4);
        assert!((a.mean[0] - 4.0).abs() < 1e-12 && (a.covariance(0, 0) - 6.25).abs() < 1e-12);
        assert!((a.share[0] - 0.5).abs() < 1e-12 && (a.weight - 0.4).abs() < 1e-12);
    }

    #[test]
    fn a_part_that_is_fixed_both_ways_is_all_that_was() {
        // Halves at ± their share of the deviation have together the mean and the covariance of the whole.
        let (hypothesis, mean, covariance) = some();
        let (along, variance) = hypothesis.widest::<2>();
        let [mut a, mut b] = [hypothesis.clone(), hypothesis];
        a.fix(&along, variance, 0.64 * variance, 1.0, 4);
        b.fix(&along, variance, 0.64 * variance, -1.0, 4);
        (a.weight, b.weight) = (0.5, 0.5);
        a.merge(&b, 4);
        same(&a, &mean, &covariance);
    }
}
