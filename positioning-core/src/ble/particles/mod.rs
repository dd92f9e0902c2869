//! The particle filter (15): tracks from any likelihood of positions.
//!
//! Input: likelihoods of positions, one per window of integration. Output: position and covariance. The caller
//! chooses the likelihood: a position that a kernel found ([`Towards`], as in the thesis), RSSI values through their
//! path loss ([`RssiLikelihood`]), a map of fingerprints, a room, or any [`Likelihood`]. The filter has `N` particles
//! of five numbers each, and needs no more memory. Its random numbers come from a seed.

mod random;
mod resample;

pub use random::Random;

use super::path_loss::Wall;
use super::rssi::RssiLikelihood;
use crate::{Area, Real};

/// The number of particles of a filter on a node.
pub const ON_NODE: usize = 256;
/// The number of particles in the thesis (section 3.4.1.1).
pub const ON_HOST: usize = 500;

/// The longest step, seconds. After a longer time a particle's velocity is out of date.
const LONGEST_S: f64 = 2.0;
/// Steps shorter than this do not change velocities, seconds.
const SHORTEST_S: f64 = 0.001;

/// The likelihood of positions.
pub trait Likelihood<T> {
    /// The natural logarithm of the likelihood of a position, up to a constant. A result that is not a number makes
    /// the position impossible.
    fn ln_at(&self, position: [T; 2]) -> T;

    /// The same for a particle with this offset of the receiver, dB, which is updated. The offset's variance does not
    /// depend on the particle (Rao-Blackwellised filter). A likelihood without an offset leaves it as it is.
    #[inline(always)]
    fn update(&self, position: [T; 2], offset: &mut T) -> T {
        let _ = offset;
        self.ln_at(position)
    }
}

impl<T, F: Fn([T; 2]) -> T> Likelihood<T> for F {
    #[inline(always)]
    fn ln_at(&self, position: [T; 2]) -> T {
        self(position)
    }
}

impl<T: Real> Likelihood<T> for RssiLikelihood<'_, T> {
    #[inline]
    fn ln_at(&self, position: [T; 2]) -> T {
        self.seen_from(position).0
    }

    #[inline]
    fn update(&self, position: [T; 2], offset: &mut T) -> T {
        let (ln, after) = self.seen_with(position, *offset);
        *offset = after;
        ln
    }
}

/// The likelihood around a position that a kernel found, the same in all directions (11, 15).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Towards<T> {
    /// The position, metres.
    pub position: [T; 2],
    /// Its standard deviation, metres per axis; in the thesis that of the position's noise.
    pub deviation: T,
}

impl<T: Real> Likelihood<T> for Towards<T> {
    #[inline(always)]
    fn ln_at(&self, position: [T; 2]) -> T {
        let (x, y) = (position[0] - self.position[0], position[1] - self.position[1]);
        T::of(-0.5) * (x.squared() + y.squared()) / self.deviation.squared()
    }
}

/// How particles move and are replaced.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Settings<T> {
    /// σₚ, noise of the position, metres per step and axis.
    pub position: T,
    /// Noise of the position that grows with the time, metres per √s and axis.
    pub wander: T,
    /// σᵥ, noise of the speed, metres per second.
    pub speed: T,
    /// σₐ, noise of the direction, radians, less than 0.75.
    pub heading: T,
    /// The share of its way to the estimate that a particle covers in a step: ½ in (15).
    pub approach: T,
    /// Particles are resampled when the effective share of them is below this: 1 resamples at every step, which is
    /// the thesis' SIR.
    pub resample_below: T,
    /// Copies are moved apart by this share of the cloud's deviation (roughening, N. Gordon et al., IEE Proceedings F
    /// 140(2), 1993).
    pub roughening: T,
}

impl<T: Real> Settings<T> {
    /// The values of the thesis (section 3.4.1.1): 2.5 m, 0.2 m/s, π ⁄ 4, resampled at every step. The noise of the
    /// direction is limited to 0.75.
    pub fn thesis() -> Self {
        Self {
            position: T::of(2.5),
            wander: T::ZERO,
            speed: T::of(0.2),
            heading: T::of(0.75),
            approach: T::of(0.5),
            resample_below: T::ONE,
            roughening: T::ZERO,
        }
    }

    /// A receiver that stays where it is: only copies are moved apart.
    pub fn staying() -> Self {
        let zero = T::ZERO;
        Self { wander: zero, speed: zero, heading: zero, approach: zero, ..Self::walking() }
    }

    /// A person who walks, and keeps a direction for about a second. The likelihood is that of the measurements
    /// themselves, without a kernel that smooths before. Particles do not approach the estimate: they are its
    /// distribution, and would lose the positions that a later scan finds.
    pub fn walking() -> Self {
        Self {
            position: T::ZERO,
            wander: T::ONE,
            speed: T::of(0.2),
            heading: T::of(0.75),
            approach: T::ZERO,
            resample_below: T::of(0.5),
            roughening: T::of(0.1),
        }
    }
}

/// One hypothesis of the tag's position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Particle<T> {
    at: [T; 2],
    velocity: [T; 2],
    weight: T,
    /// The receiver's offset if it is there, dB.
    offset: T,
}

/// The distribution of the particles.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Estimate<T> {
    /// Their weighted mean, metres (13).
    pub position: [T; 2],
    /// Their covariance, m².
    pub covariance: [[T; 2]; 2],
    /// The effective share of the particles: 1 where all weigh the same, 1 ⁄ N where one has all the weight.
    pub effective: T,
    /// Mean and variance of the receiver's offset over the particles, dB and dB².
    pub offset: [T; 2],
    /// The logarithm of the greatest likelihood. If no particle meets the likelihood, the filter is lost and must be
    /// started again.
    pub best: T,
}

/// The filter.
#[derive(Clone, Debug)]
pub struct ParticleFilter<T, const N: usize> {
    settings: Settings<T>,
    particles: [Particle<T>; N],
    random: Random,
    /// The time of the latest step; `None` before the first.
    at_us: Option<u64>,
    started: bool,
}

impl<T: Real, const N: usize> ParticleFilter<T, N> {
    /// A filter without particles. The same seed and the same inputs give the same track.
    pub fn new(settings: Settings<T>, seed: u64) -> Self {
        let particles = [Particle::default(); N];
        Self { settings, particles, random: Random::new(seed), at_us: None, started: false }
    }

    /// Whether there are particles.
    pub fn is_started(&self) -> bool {
        self.started
    }

    /// Puts the particles around a position, with a normal distribution, metres.
    pub fn start_at(&mut self, position: [T; 2], deviation: [T; 2]) {
        self.start(|random| core::array::from_fn(|axis| position[axis] + deviation[axis] * random.normal::<T>()));
    }

    /// Puts the particles in a box, with a uniform distribution, metres: what the tag receives is in reach (ES
    /// 2397388).
    pub fn start_in(&mut self, area: &Area<T, 2>) {
        let side = |axis: usize| area.max[axis] - area.min[axis];
        self.start(|random| core::array::from_fn(|axis| area.min[axis] + side(axis) * random.uniform::<T>()));
    }

    fn start(&mut self, mut place: impl FnMut(&mut Random) -> [T; 2]) {
        let weight = T::ONE / T::count(N.max(1));
        for particle in &mut self.particles {
            *particle = Particle { at: place(&mut self.random), velocity: [T::ZERO; 2], weight, offset: T::ZERO };
        }
        self.at_us = None;
        self.started = self.particles.iter().all(|particle| (particle.at[0] + particle.at[1]).is_finite());
    }

    /// Gives all particles this offset of the receiver, dB. After a start it is 0.
    pub fn set_offset(&mut self, offset: T) {
        for particle in &mut self.particles {
            particle.offset = offset;
        }
    }

    /// Moves the particles on to `now_us`, weighs them by the likelihood, and replaces the unlikely ones. Walls are
    /// barriers: a particle that would pass through one stays. Returns `None` where there are no particles, or where
    /// all are impossible. Then only the positions of the particles have changed.
    pub fn step(&mut self, now_us: u64, walls: &[Wall<T>], likelihood: &impl Likelihood<T>) -> Option<Estimate<T>> {
        if !self.started {
            return None;
        }
        let elapsed_us = self.at_us.map_or(0, |at_us| now_us.saturating_sub(at_us).min(10_000_000));
        self.at_us = Some(now_us);
        let dt = (T::count(elapsed_us as usize) * T::of(1.0e-6)).at_most(T::of(LONGEST_S));
        let best = self.predict(dt, walls, likelihood)?;
        self.weigh(best);
        let estimate = self.estimate(best)?;
        self.turn(dt, estimate.position);
        if estimate.effective <= self.settings.resample_below {
            self.resample(&estimate, walls);
        }
        Some(estimate)
    }

    /// Moves every particle, and adds the log-likelihood of its position to the logarithm of its weight, which the
    /// weight field holds until [`Self::weigh`]. Returns the greatest.
    fn predict(&mut self, dt: T, walls: &[Wall<T>], likelihood: &impl Likelihood<T>) -> Option<T> {
        let noise = (self.settings.position.squared() + self.settings.wander.squared() * dt).sqrt();
        let even = T::ONE / T::count(N.max(1));
        let mut best: Option<T> = None;
        for particle in &mut self.particles {
            let next = core::array::from_fn(|axis| {
                particle.at[axis] + dt * particle.velocity[axis] + noise * self.random.normal::<T>()
            });
            if walls.iter().any(|wall| wall.is_crossed(particle.at, next)) {
                particle.velocity = [T::ZERO; 2];
            } else {
                particle.at = next;
            }
            let ln = likelihood.update(particle.at, &mut particle.offset);
            let earlier = if particle.weight == even { T::ZERO } else { (particle.weight / even).ln() };
            let ln = if ln.is_finite() { ln + earlier } else { T::of(IMPOSSIBLE) };
            particle.weight = ln;
            if ln > T::of(IMPOSSIBLE) && best.is_none_or(|best| ln > best) {
                best = Some(ln);
            }
        }
        if best.is_none() {
            for particle in &mut self.particles {
                particle.weight = even;
            }
        }
        best
    }

    /// Converts logarithms to weights that add up to 1 (12).
    fn weigh(&mut self, best: T) {
        let mut sum = T::ZERO;
        for particle in &mut self.particles {
            let below = particle.weight - best;
            // A particle with less than e⁻²⁰ of the best weight gets none, which saves an exponential.
            particle.weight = if below > T::of(-20.0) { below.exp() } else { T::ZERO };
            sum += particle.weight;
        }
        let scale = T::ONE / sum;
        for particle in &mut self.particles {
            particle.weight *= scale;
        }
    }

    fn estimate(&self, best: T) -> Option<Estimate<T>> {
        // Relative to one of the particles: a site grid with a distant origin then costs no digits.
        let origin = self.particles.first()?.at;
        let (mut mean, mut squares, mut offset, mut offsets) = ([T::ZERO; 2], T::ZERO, T::ZERO, T::ZERO);
        for particle in &self.particles {
            let weighted = particle.weight * particle.offset;
            offset += weighted;
            offsets += weighted * particle.offset;
            mean[0] += particle.weight * (particle.at[0] - origin[0]);
            mean[1] += particle.weight * (particle.at[1] - origin[1]);
            squares += particle.weight.squared();
        }
        let position = [origin[0] + mean[0], origin[1] + mean[1]];
        let (mut xx, mut xy, mut yy) = (T::ZERO, T::ZERO, T::ZERO);
        for particle in &self.particles {
            let (x, y) = (particle.at[0] - position[0], particle.at[1] - position[1]);
            xx += particle.weight * x * x;
            xy += particle.weight * x * y;
            yy += particle.weight * y * y;
        }
        let effective = T::ONE / (squares * T::count(N));
        let offset = [offset, (offsets - offset * offset).at_least(T::ZERO)];
        let estimate = Estimate { position, covariance: [[xx, xy], [xy, yy]], effective, offset, best };
        (position[0] + position[1] + xx + yy).is_finite().then_some(estimate)
    }

    /// Turns every particle towards the estimate (15), at the speed that covers its share of the way in one step.
    fn turn(&mut self, dt: T, estimate: [T; 2]) {
        if dt < T::of(SHORTEST_S) {
            return;
        }
        let rate = self.settings.approach / dt;
        for particle in &mut self.particles {
            let across = [estimate[0] - particle.at[0], estimate[1] - particle.at[1]];
            let distance = (across[0].squared() + across[1].squared()).sqrt();
            let unit = if distance > T::EPSILON { across.map(|component| component / distance) } else { [T::ZERO; 2] };
            let speed = rate * distance + self.settings.speed * self.random.normal::<T>();
            let [cosine, sine] = turned(self.settings.heading * self.random.normal::<T>());
            particle.velocity =
                [speed * (cosine * unit[0] - sine * unit[1]), speed * (sine * unit[0] + cosine * unit[1])];
        }
    }

    /// Copies the likely particles over the others, and moves the copies apart, as far as walls allow.
    fn resample(&mut self, estimate: &Estimate<T>, walls: &[Wall<T>]) {
        let spread: [T; 2] =
            core::array::from_fn(|axis| self.settings.roughening * estimate.covariance[axis][axis].sqrt());
        let start = self.random.uniform::<T>();
        let rough = spread[0] + spread[1] > T::ZERO;
        let random = &mut self.random;
        resample::systematic(
            &mut self.particles,
            start,
            |particle| particle.weight,
            |copy| {
                if rough {
                    let next = core::array::from_fn(|axis| copy.at[axis] + spread[axis] * random.normal::<T>());
                    if !walls.iter().any(|wall| wall.is_crossed(copy.at, next)) {
                        copy.at = next;
                    }
                }
            },
        );
        let weight = T::ONE / T::count(N.max(1));
        for particle in &mut self.particles {
            particle.weight = weight;
        }
    }
}

/// The logarithm that represents a weight of zero: it is finite, so that no arithmetic with it makes a NaN.
const IMPOSSIBLE: f64 = -1.0e30;

/// Cosine and sine of an angle up to 2.6 radians, always of unit length. They are computed from the tangent of the
/// half angle, by a continued fraction, whose error at 2.6 turns the result by 0.8 %. Directions of particles are
/// noise, so this is enough.
fn turned<T: Real>(angle: T) -> [T; 2] {
    let half = T::of(0.5) * angle;
    let square = half.squared();
    let tangent = half * (T::of(15.0) - square) / (T::of(15.0) - T::of(6.0) * square);
    let scale = T::ONE / (T::ONE + tangent.squared());
    [(T::ONE - tangent.squared()) * scale, T::of(2.0) * tangent * scale]
}

#[cfg(test)]
mod tests;
