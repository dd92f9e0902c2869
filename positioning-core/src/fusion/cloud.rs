//! The particles: samples of the tag's position, and what each of them believes of velocity, biases and lines of sight.

use crate::Real;
use crate::ble::particles::{Random, systematic};

/// P particles in D dimensions with what they remember of N nodes.
#[derive(Clone, Debug)]
pub(super) struct Cloud<T, const D: usize, const P: usize, const N: usize> {
    pub(super) position: [[T; D]; P],
    /// Mean velocity, given the particle's way.
    pub(super) velocity: [[T; D]; P],
    /// Variance of the velocity about its mean, given the way: the same for all particles and axes.
    pub(super) variance: T,
    /// What it believes of each node.
    pub(super) memory: [[Belief<T>; P]; N],
    /// Natural logarithm of the weight; then, by [`normalise`](Self::normalise), the weight itself.
    pub(super) weight: [T; P],
}

/// What a particle believes of a node, given its way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Belief<T> {
    /// Mean of the bias: of powers, dB; of delays, metres, should the link be blocked.
    pub(super) bias: T,
    /// Probability that the link is blocked; of delays only.
    pub(super) blocked: T,
}

/// What the weights say.
#[derive(Clone, Copy, Debug)]
pub(super) struct Balance<T> {
    /// Logarithm of the sum of what were the weights: the evidence.
    pub(super) evidence: T,
    /// 1 ⁄ Σ w²: how many particles count.
    pub(super) effective: T,
}

impl<T: Real, const D: usize, const P: usize, const N: usize> Cloud<T, D, P, N> {
    /// Inlined, so that it is made where it stays.
    #[inline(always)]
    pub(super) fn new() -> Self {
        Self {
            position: [[T::ZERO; D]; P],
            velocity: [[T::ZERO; D]; P],
            variance: T::ZERO,
            memory: [[Belief { bias: T::ZERO, blocked: T::ZERO }; P]; N],
            weight: [T::ZERO; P],
        }
    }

    /// Moves on by `dt` seconds with a white acceleration of density `density`, m² ⁄ s³.
    pub(super) fn predict(&mut self, dt: T, density: T, random: &mut Random) {
        // Of p' = p + v Δt + …, v' = v + …: variances and covariance, given p.
        let q = density * dt;
        let half_dt = T::of(0.5) * dt;
        let position = (self.variance + q * T::of(1.0 / 3.0)) * dt.squared();
        let across = self.variance * dt + q * half_dt;
        let deviation = position.sqrt();
        if !(deviation > T::ZERO) {
            return;
        }
        let gain = across / deviation;
        self.variance = (self.variance + q - gain.squared()).at_least(T::ZERO);
        for (position, velocity) in self.position.iter_mut().zip(&mut self.velocity) {
            for (p, v) in position.iter_mut().zip(velocity) {
                let draw: T = random.normal();
                *p += *v * dt + deviation * draw;
                *v += gain * draw;
            }
        }
    }

    /// Makes weights of their logarithms; `None` where there is no number among them.
    pub(super) fn normalise(&mut self) -> Option<Balance<T>> {
        let first = self.weight.first().copied().unwrap_or(T::ZERO);
        let greatest = self.weight.iter().fold(first, |greatest, &w| greatest.at_least(w));
        let mut sum = T::ZERO;
        for weight in &mut self.weight {
            *weight = (*weight - greatest).exp();
            sum += *weight;
        }
        if !(sum >= T::ONE) || !greatest.is_finite() {
            return None;
        }
        let scale = T::ONE / sum;
        let mut squares = T::ZERO;
        for weight in &mut self.weight {
            *weight *= scale;
            squares += weight.squared();
        }
        Some(Balance { evidence: greatest + sum.ln(), effective: T::ONE / squares })
    }

    pub(super) fn is_finite(&self) -> bool {
        let magnitude = |sum: T, c: &T| sum + c.abs();
        self.position.iter().flatten().chain(self.velocity.iter().flatten()).fold(T::ZERO, magnitude).is_finite()
    }

    /// Back to logarithms.
    pub(super) fn unlog(&mut self) {
        self.weight.iter_mut().for_each(|w| *w = w.at_least(T::of(1e-30)).ln());
    }

    /// Resampling in place: heavy particles take the places of light ones. The memories of `nodes` nodes go with them.
    pub(super) fn resample(&mut self, nodes: usize, random: &mut Random) {
        let mut sources: [u16; P] = core::array::from_fn(|place| place as u16);
        let weight = |&place: &u16| self.weight.get(usize::from(place)).copied().unwrap_or(T::ZERO);
        systematic(&mut sources, random.uniform(), weight, |_| ());
        for (to, &from) in sources.iter().enumerate() {
            if usize::from(from) != to {
                self.copy(from.into(), to, nodes);
            }
        }
        self.weight = [T::ONE / T::count(P); P];
    }

    fn copy(&mut self, from: usize, to: usize, nodes: usize) {
        if from < P && to < P {
            self.position[to] = self.position[from];
            self.velocity[to] = self.velocity[from];
            self.memory.iter_mut().take(nodes).for_each(|memory| memory[to] = memory[from]);
        }
    }

    /// Moves every particle by a random step of this deviation, metres.
    pub(super) fn scatter(&mut self, deviation: T, random: &mut Random) {
        self.position.iter_mut().flatten().for_each(|p| *p += deviation * random.normal());
    }

    /// Mean of positions or velocities.
    fn mean(&self, of: &[[T; D]; P]) -> [T; D] {
        let mut mean = [T::ZERO; D];
        for (vector, &weight) in of.iter().zip(&self.weight) {
            mean.iter_mut().zip(vector).for_each(|(m, &v)| *m += weight * v);
        }
        mean
    }

    pub(super) fn mean_position(&self) -> [T; D] {
        self.mean(&self.position)
    }

    pub(super) fn mean_velocity(&self) -> [T; D] {
        self.mean(&self.velocity)
    }

    pub(super) fn covariance(&self, mean: &[T; D]) -> [[T; D]; D] {
        let mut covariance = [[T::ZERO; D]; D];
        for (position, &weight) in self.position.iter().zip(&self.weight) {
            let off: [T; D] = core::array::from_fn(|axis| position[axis] - mean[axis]);
            for (r, row) in covariance.iter_mut().enumerate() {
                row.iter_mut().zip(&off).for_each(|(c, &o)| *c += weight * off[r] * o);
            }
        }
        covariance
    }

    /// The mode of the particles' density, by mean shift with a flat kernel of this radius, from the heaviest neighbourhood of
    /// `from`.
    pub(super) fn mode(&self, from: [T; D], radius: T) -> [T; D] {
        let near = radius.squared();
        let mut mode = from;
        for _ in 0..SHIFTS {
            let (mut sum, mut mean) = (T::ZERO, [T::ZERO; D]);
            for (position, &weight) in self.position.iter().zip(&self.weight) {
                let squared = position.iter().zip(&mode).fold(T::ZERO, |sum, (p, m)| sum + (*p - *m).squared());
                if squared <= near {
                    sum += weight;
                    mean.iter_mut().zip(position).for_each(|(m, &p)| *m += weight * p);
                }
            }
            if !(sum > T::ZERO) {
                break;
            }
            let scale = T::ONE / sum;
            mode = mean.map(|m| m * scale);
        }
        mode
    }
}

/// Steps of the mean shift.
const SHIFTS: usize = 6;
