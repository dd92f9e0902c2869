//! How hypotheses change between two steps, and how the values of a step weigh them (equations 1 to 4, 6 and 7).

use super::hypothesis::{Expected, Hypothesis, PEAK};
use super::node::Node;
use super::{Fusion, FusionSettings};
use positioning_core::Real;

/// The probability that values are outliers.
const STRAY: f64 = 0.01;
/// The width over which outliers are spread: decibels, metres.
const STRAYS_DB: f64 = 40.0;
const STRAYS_M: f64 = 10.0;
/// The share of blocked time of a link is at least this, and at most one minus this.
const LEAST_SHARE: f64 = 0.03;
const MOST_SHARE: f64 = 0.9;
/// Nearer than this a distance has no direction, metres.
const NEAREST_M: f64 = 0.1;

/// How an excess changes in a step: a Matérn process of smoothness 3⁄2, of the excess and its slope along the way.
#[derive(Clone, Copy)]
struct Drift<T> {
    turn: [[T; 2]; 2],
    noise: [T; 3],
}

impl<T: Real> Drift<T> {
    /// The change over `way` metres of such a process with this deviation and length, metres (C. E. Rasmussen and C.
    /// K. I. Williams, *Gaussian Processes for Machine Learning*, 2006, equation 4.17, as a differential equation).
    fn new(way: T, deviation: T, length: T) -> Self {
        let rate = T::of(1.732_050_8) / length;
        let (passed, kept) = (rate * way, (-rate * way).exp());
        let turn = [[kept * (T::ONE + passed), kept * way], [-kept * rate * passed, kept * (T::ONE - passed)]];
        let [[a, b], [c, d]] = turn;
        let variance = deviation.squared();
        let slope = variance * rate.squared();
        // The stationary covariance, minus the part of it that is left.
        let noise = [
            (variance - a * a * variance - b * b * slope).at_least(T::ZERO),
            -a * c * variance - b * d * slope,
            (slope - c * c * variance - d * d * slope).at_least(T::ZERO),
        ];
        Self { turn, noise }
    }
}

impl<T: Real, const N: usize, const S: usize> Hypothesis<T, N, S> {
    /// Makes a node's bias unknown but for the state of its link.
    pub(super) fn doubt(&mut self, node: &Node<T>, at: usize, settings: &FusionSettings<T>) {
        let errors = &settings.delay;
        match node.slope {
            None => self.reset(node.bias, T::ZERO, settings.power.bias.squared()),
            Some(slope) if self.is_blocked(at) => {
                self.reset(node.bias, errors.excess, errors.spread.squared());
                self.reset(slope, T::ZERO, T::of(3.0) * (errors.spread / errors.way).squared());
            }
            Some(slope) => {
                self.reset(node.bias, T::ZERO, errors.bias.squared());
                self.reset(slope, T::ZERO, T::ZERO);
            }
        }
    }
}

impl<T: Real, const D: usize, const H: usize, const N: usize, const S: usize> Fusion<T, D, H, N, S> {
    /// Advances by `dt` seconds (equation 6); biases decay with distance and time.
    #[inline(never)]
    pub(super) fn predict(&mut self, dt: T) {
        let speed = self.mean(D).iter().fold(T::ZERO, |sum, v| sum + v.squared()).sqrt();
        let Self { settings, nodes, bank, used, .. } = self;
        let (power, delay) = (&settings.power, &settings.delay);
        let kept = (-(speed / power.way + T::ONE / power.time) * dt).exp();
        let fresh = (T::ONE - kept.squared()) * power.bias.squared();
        let drift = Drift::new((speed + delay.way / delay.time) * dt, delay.spread, delay.way);
        let learnt = T::ONE - (-dt / delay.learning).exp();
        let q = settings.acceleration.squared() * dt;
        for hypothesis in bank {
            for axis in 0..D {
                hypothesis.shear(axis, D + axis, dt, *used);
                // The covariance of a white acceleration.
                hypothesis.add(axis, axis, q * dt.squared() * T::of(1.0 / 3.0));
                hypothesis.add(axis, D + axis, T::of(0.5) * q * dt);
                hypothesis.add(D + axis, D + axis, q);
            }
            for (at, node) in nodes.iter().enumerate() {
                let Some(slope) = node.slope else {
                    hypothesis.forget(node.bias, T::ZERO, kept, fresh, *used);
                    continue;
                };
                let blocked = hypothesis.is_blocked(at);
                let now = if blocked { T::ONE } else { T::ZERO };
                let share = hypothesis.share[at];
                hypothesis.share[at] =
                    (share + learnt * (now - share)).at_least(T::of(LEAST_SHARE)).at_most(T::of(MOST_SHARE));
                if blocked {
                    hypothesis.turn([node.bias, slope], delay.excess, &drift.turn, *used);
                    hypothesis.add(node.bias, node.bias, drift.noise[0]);
                    hypothesis.add(node.bias, slope, drift.noise[1]);
                    hypothesis.add(slope, slope, drift.noise[2]);
                }
            }
        }
    }

    /// Processes all fresh values of a step. Each node's mixture enters by its two moments, because the hypotheses
    /// are normal distributions.
    #[inline(never)]
    pub(super) fn weigh(&mut self) {
        let Self { settings, nodes, bank, used, .. } = self;
        for hypothesis in bank.iter_mut() {
            hypothesis.log = T::of(core::f64::consts::LN_2) * hypothesis.weight.log2_about();
        }
        for node in nodes.iter() {
            let power = node.channel.is_power();
            let Some(mixture) = node.window.mixture(settings.noise(power)) else { continue };
            let variance = mixture.variance_of_mean();
            let level = SmoothedValue {
                mean: mixture.mean,
                variance,
                peak: T::of(PEAK) / (variance + settings.bias(power).squared()).sqrt(),
            };
            for hypothesis in bank.iter_mut() {
                hypothesis.update(&expected::<T, D, N, S>(hypothesis, node, &level, settings.height), *used);
            }
        }
        for hypothesis in bank.iter_mut() {
            for (at, node) in nodes.iter().enumerate() {
                if hypothesis.is_blocked(at) && !node.channel.is_power() {
                    hypothesis.cut(node.bias, T::ZERO, T::ONE, *used);
                }
            }
            // A tag does not walk through the walls of the area.
            if let Some(area) = &settings.area {
                for axis in 0..D {
                    hypothesis.cut(axis, area.min[axis], T::ONE, *used);
                    hypothesis.cut(axis, area.max[axis], -T::ONE, *used);
                }
            }
        }
    }
}

/// A node's values together.
struct SmoothedValue<T> {
    mean: T,
    variance: T,
    /// Reference density, by which densities are divided.
    peak: T,
}

/// The value that a hypothesis expects of a node, to the second order in the position (A. H. Jazwinski, *Stochastic
/// Processes and Filtering Theory*, 1970, chapter 9.3): the mean of the curvature is subtracted, its variance is
/// added.
#[inline(always)]
fn expected<T: Real, const D: usize, const N: usize, const S: usize>(
    hypothesis: &Hypothesis<T, N, S>,
    node: &Node<T>,
    level: &SmoothedValue<T>,
    height: T,
) -> Expected<T, D> {
    let position = hypothesis.position::<D>();
    let squared = node.squared(&position, height).at_least(T::of(NEAREST_M * NEAREST_M));
    let inverse = T::ONE / squared.sqrt();
    let unit: [T; D] = core::array::from_fn(|axis| (position[axis] - node.place[axis]) * inverse);
    // d' = u and d'' = (1 − u uᵀ) ⁄ d; for k ln d: k u ⁄ d and k (1 − 2 u uᵀ) ⁄ d².
    let (slope, curvature, along) = match node.channel.per_neper() {
        None => (T::ONE, inverse, T::ONE),
        Some(per_neper) => (per_neper * inverse, per_neper * inverse.squared(), T::of(2.0)),
    };
    let covariance = hypothesis.position_covariance::<D>();
    let hesse: [[T; D]; D] = core::array::from_fn(|r| {
        core::array::from_fn(|c| {
            let one = if r == c { T::ONE } else { T::ZERO };
            curvature * (one - along * unit[r] * unit[c])
        })
    });
    let product: [[T; D]; D] = core::array::from_fn(|r| {
        core::array::from_fn(|c| (0..D).fold(T::ZERO, |sum, k| sum + hesse[r][k] * covariance[k][c]))
    });
    let (mut trace, mut squares) = (T::ZERO, T::ZERO);
    for (r, row) in product.iter().enumerate() {
        trace += row[r];
        for (c, &element) in row.iter().enumerate() {
            squares += element * product[c][r];
        }
    }
    let half = T::of(0.5);
    let spread = if node.channel.is_power() { STRAYS_DB } else { STRAYS_M };
    Expected {
        innovation: level.mean - node.channel.expected(squared) - half * trace - hypothesis.mean[node.bias],
        gradient: unit.map(|u| slope * u),
        bias: node.bias,
        variance: level.variance + half * squares,
        stray: T::of(STRAY / spread),
        peak: level.peak,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_excess_keeps_what_materns_covariance_says() {
        // k(r) = σ² (1 + √3 r ⁄ l) exp(−√3 r ⁄ l). The noise of half the way, carried on, plus the noise of the other
        // half is the noise of the whole.
        let (way, deviation, length) = (1.3_f64, 2.0_f64, 4.0_f64);
        let Drift { turn, noise } = Drift::new(way, deviation, length);
        let r = 3.0_f64.sqrt() * way / length;
        assert!((turn[0][0] - (1.0 + r) * (-r).exp()).abs() < 1e-6, "{turn:?}");
        // Half the way twice equals the whole way.
        let half = Drift::new(0.5 * way, deviation, length);
        let twice: [[f64; 2]; 2] =
            core::array::from_fn(|i| core::array::from_fn(|j| (0..2).map(|k| half.turn[i][k] * half.turn[k][j]).sum()));
        assert!(turn.iter().flatten().zip(twice.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-6), "{twice:?}");
        let [a, b] = half.turn[0];
        let carried = a * a * half.noise[0] + 2.0 * a * b * half.noise[1] + b * b * half.noise[2];
        assert!((noise[0] - half.noise[0] - carried).abs() < 1e-6, "{noise:?}");
    }
}
