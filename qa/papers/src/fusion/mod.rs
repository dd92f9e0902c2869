//! Positions from received powers and delays together: patent ES 2 397 388 A2 ("Procedimiento para la determinación
//! de la posición fusionando la información de los niveles de potencia y el retardo temporal de propagación de las
//! señales recibidas").
//!
//! The input is [`Observation`]s, one a value. [`Fusion::step`] computes an [`FusionEstimate`] from all values since the
//! last step, or gives the reason for having none ([`Missing`]). Powers alone, delays alone and both use the same
//! call. A node counts with the values that it gives, and [`Sources`] can leave one kind out.
//!
//! The patent describes its method in text; the equations and their numbers are ours.
//!
//! 1. **Mixture of kernels.** The recent values of a node (8, with a fitted line subtracted) give the density of a
//!    value about its mean: f(e) = n⁻¹ Σₖ N(e − eₖ; h²), h = s (4 ⁄ 3n)^(1⁄5). The patent leaves kernel and width
//!    open ("for example" a Gaussian one). The width follows s², the variance of the recent values pooled with the
//!    expected one, so that it adapts. The mixture's variance is s².
//! 2. **All fresh values** are independent draws: p(r | u) = Πᵢ f(rᵢ − u), where u is the value without noise.
//! 3. **The bias is marginalised**: L(d) = ∫ p(r | m(d) + b) p(b) db. For powers, m(d) = p₁ − 10 n log₁₀ d, and b is
//!    Gaussian: the error of the channel's parameters, and shadowing. For delays, m(d) = d after the affine model. In
//!    line of sight b is only the residual error of calibration; else b is positive: exponential at first, then as
//!    estimated from the link's values.
//! 4. **Product over nodes**: VP(x) = Πⱼ Lⱼ(‖x − aⱼ‖).
//! 5. **First position**: argmax VP in the box maxⱼ (aⱼ − ρⱼ) ≤ x ≤ minⱼ (aⱼ + ρⱼ), and all positions that are nearly
//!    as likely. ρⱼ is the greatest distance from which the values can come.
//! 6. **Motion**, a Taylor series: x(t + Δ) = x + v Δ + …, with a white acceleration as its remainder.
//! 7. **Recursion**: p(xₜ | r₁…ₜ) ∝ VP(xₜ) ∫ p(xₜ | xₜ₋₁) p(xₜ₋₁ | r₁…ₜ₋₁) dxₜ₋₁, a mixture of normal distributions.
//!    Each hypothesis on position and blocked links has one of them. The mean, the mode and the covariance of the
//!    mixture are the estimate.
//!
//! The patent estimates the channel's parameters at every instant, and marginalises over their error. Here every
//! hypothesis does both: the biases of all nodes are states beside position and velocity (a mixture Kalman filter: R.
//! Chen and J. S. Liu, Journal of the Royal Statistical Society B 62(3), 2000). The mixtures of equation 1 enter it
//! by their two moments. Constant errors therefore count once, and a beacon near good anchors is calibrated as the
//! tag walks. `research/README.md` has the reasons.
mod bank;
pub mod bench;
mod hypothesis;
mod likelihood;
mod node;
mod output;
mod settings;
mod start;
#[cfg(test)]
mod tests;
mod values;
mod window;

pub use node::{ChannelModel, Observation};
pub use output::{FusionEstimate, FusionVerdict, Missing};
pub use settings::{DelayErrors, FusionSettings, PowerErrors, Sources};

use heapless::Vec;

use hypothesis::Hypothesis;
use node::Node;
use positioning_core::Real;
use positioning_core::ble::particles::Random;

/// Number of hypotheses on a node.
pub const ON_NODE: usize = 24;
/// Largest number of nodes.
const MOST_NODES: usize = 16;

/// Number of states for a plane (2) or for space (3), the nodes that give powers, and the nodes that give delays: the
/// last parameter of [`Fusion`].
pub const fn states(dimensions: usize, powers: usize, delays: usize) -> usize {
    2 * dimensions + powers + 2 * delays
}

/// A clock that goes back by more than this has restarted, microseconds.
const OVERTAKING_US: u64 = 1_000_000;
/// A node that was not received for this long may be replaced by another, microseconds.
const SILENT_US: u64 = 5_000_000;
/// Below this evidence a node, the values of a step count as unexplained.
const UNEXPLAINED: f64 = -4.0;
/// This number of unexplained steps in sequence ends a track.
const PATIENCE: u8 = 5;

/// The fusion: H hypotheses ([`ON_NODE`] on a tag) in D dimensions (2: at a known height; 3), at most N nodes, and S
/// [`states`].
#[derive(Clone, Debug)]
pub struct Fusion<T, const D: usize, const H: usize, const N: usize, const S: usize> {
    settings: FusionSettings<T>,
    nodes: Vec<Node<T>, N>,
    bank: Vec<Hypothesis<T, N, S>, H>,
    /// Number of states in use.
    used: usize,
    /// The delay whose link may change next.
    turn: usize,
    random: Random,
    tracking: bool,
    evidence: T,
    unexplained: u8,
    /// The time of the latest value, that of the last step, and that of the last step with values.
    now_us: u64,
    stepped_us: u64,
    used_us: u64,
}

impl<T: Real, const D: usize, const H: usize, const N: usize, const S: usize> Fusion<T, D, H, N, S> {
    /// A fusion without values.
    #[inline(always)]
    pub fn new(settings: FusionSettings<T>) -> Self {
        const { assert!(D == 2 || D == 3, "positions are in the plane or in space") };
        const { assert!(H > 0 && N <= MOST_NODES, "there are hypotheses, and 16 bits say which links are blocked") };
        const { assert!(S >= 2 * D, "there is room for position and velocity") };
        let random = Random::new(settings.seed);
        Self {
            settings,
            nodes: Vec::new(),
            bank: Vec::new(),
            used: 2 * D,
            turn: 0,
            random,
            tracking: false,
            evidence: T::ZERO,
            unexplained: 0,
            now_us: 0,
            stepped_us: 0,
            used_us: 0,
        }
    }

    /// Takes one value of the time `now_us`, microseconds. It is used at the next step.
    pub fn observe(&mut self, now_us: u64, observation: &Observation<T>) -> FusionVerdict {
        if !observation.is_sane() {
            return FusionVerdict::NotSane;
        }
        match (self.settings.sources, observation.channel.is_power()) {
            (Sources::Power, false) | (Sources::Delay, true) => return FusionVerdict::Ignored,
            (Sources::Power | Sources::Both, true) | (Sources::Delay | Sources::Both, false) => {}
        }
        self.watch_clock(now_us);
        let Some(at) = self.room(observation) else { return FusionVerdict::NoRoom };
        if let Some(node) = self.nodes.get_mut(at) {
            node.channel = observation.channel;
            node.heard_us = self.now_us;
            node.window.push(observation.channel.level(observation.value), self.now_us, self.settings.recent_us);
        }
        FusionVerdict::Held
    }

    /// Advances to `now_us` with all values since the last step.
    ///
    /// # Errors
    /// There is no position; [`Missing`] gives the reason.
    pub fn step(&mut self, now_us: u64) -> Result<FusionEstimate<T, D>, Missing> {
        self.watch_clock(now_us);
        let dt = self.now_us.saturating_sub(self.stepped_us);
        self.stepped_us = self.now_us;
        if self.tracking && self.now_us.saturating_sub(self.used_us) > self.settings.gap_us {
            self.tracking = false;
            return Err(Missing::Gap);
        }
        // At most a gap: far less than the 24 bits of an f32 in milliseconds.
        let dt = T::count((dt.min(self.settings.gap_us) / 1000) as usize) * T::of(1e-3);
        for node in &mut self.nodes {
            if self.now_us.saturating_sub(node.heard_us) > self.settings.recent_us {
                node.window.used();
            }
        }
        let fresh = self.nodes.iter().filter(|node| node.window.has_fresh()).count();
        let started = !self.tracking;
        if started {
            if fresh <= D {
                return Err(Missing::TooFewNodes);
            }
            self.nodes.iter_mut().for_each(|node| node.known = false);
            self.start();
        } else {
            self.go_on(dt);
        }
        if fresh > 0 {
            self.weigh();
            let evidence = self.normalise().filter(|_| self.is_finite());
            let Some(evidence) = evidence else {
                self.tracking = false;
                return Err(Missing::Diverged);
            };
            self.tracking = true;
            self.watch(evidence, fresh);
            self.used_us = self.now_us;
            self.nodes.iter_mut().filter(|node| node.window.has_fresh()).for_each(|node| node.known = true);
            self.nodes.iter_mut().for_each(|node| node.window.used());
            self.merge();
            self.narrow();
        }
        Ok(self.estimate(fresh, started))
    }

    fn watch_clock(&mut self, now_us: u64) {
        if now_us.saturating_add(OVERTAKING_US) < self.now_us {
            self.tracking = false;
            self.nodes.clear();
            self.used = 2 * D;
            (self.now_us, self.stepped_us, self.used_us) = (now_us, now_us, now_us);
        }
        self.now_us = self.now_us.max(now_us);
    }

    /// Ends a track that does not explain the measured values: the next step begins another.
    fn watch(&mut self, evidence: T, fresh: usize) {
        self.evidence = evidence;
        let explained = evidence >= T::of(UNEXPLAINED) * T::count(fresh);
        self.unexplained = if explained { 0 } else { self.unexplained + 1 };
        if self.unexplained >= PATIENCE {
            (self.tracking, self.unexplained) = (false, 0);
        }
    }

    /// The index of a value's node, old or new.
    fn room(&mut self, observation: &Observation<T>) -> Option<usize> {
        if let Some(at) = self.nodes.iter().position(|node| node.is(observation)) {
            if self.nodes.get(at).is_some_and(|node| node.place != observation.place) {
                self.replace(at, observation);
            }
            return Some(at);
        }
        let states = if observation.channel.is_power() { 1 } else { 2 };
        if !self.nodes.is_full() && self.used + states <= S {
            let slope = (states == 2).then_some(self.used + 1);
            let node = Node::new(observation, self.now_us, self.used, slope);
            self.used += states;
            let at = self.nodes.len();
            // There is room.
            let _ = self.nodes.push(node);
            self.replace(at, observation);
            return Some(at);
        }
        // The states of a replaced node are reused by a node of its kind.
        let alike = |node: &Node<T>| node.channel.is_power() == observation.channel.is_power();
        let nodes = self.nodes.iter().enumerate().filter(|(_, node)| alike(node));
        let (at, oldest) = nodes.min_by_key(|(_, node)| node.heard_us)?;
        if self.now_us.saturating_sub(oldest.heard_us) < SILENT_US {
            return None;
        }
        self.replace(at, observation);
        Some(at)
    }

    /// Enters a node with unknown bias.
    fn replace(&mut self, at: usize, observation: &Observation<T>) {
        let Self { nodes, bank, settings, now_us, .. } = self;
        let Some(node) = nodes.get_mut(at) else { return };
        *node = Node::new(observation, *now_us, node.bias, node.slope);
        for hypothesis in bank {
            hypothesis.blocked &= !(1 << at);
            hypothesis.share[at] = settings.delay.blocked;
            hypothesis.doubt(node, at, settings);
        }
    }

    /// The next step of a track.
    fn go_on(&mut self, dt: T) {
        self.predict(dt);
        let delays = self.nodes.iter().filter(|node| !node.channel.is_power()).count();
        // Links take turns in changing.
        for _ in 0..self.nodes.len() {
            self.turn = if self.turn + 1 < self.nodes.len() { self.turn + 1 } else { 0 };
            if self.nodes.get(self.turn).is_some_and(|node| !node.channel.is_power()) {
                let rate = T::ONE - (-dt * T::count(delays) / self.settings.delay.lasting).exp();
                self.branch(self.turn, rate);
                break;
            }
        }
        // A link that is received for the first time may be in either state.
        for at in 0..self.nodes.len() {
            let new = |node: &Node<T>| !node.known && !node.channel.is_power() && node.window.has_fresh();
            if self.nodes.get(at).is_some_and(new) {
                self.branch(at, T::ONE);
            }
        }
    }

    fn is_finite(&self) -> bool {
        self.bank.iter().flat_map(|hypothesis| &hypothesis.mean).fold(T::ZERO, |sum, m| sum + m.abs()).is_finite()
    }
}
