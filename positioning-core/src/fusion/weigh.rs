//! What values are worth to every particle, and what every particle learns from them (equations 3 and 4).

use super::likelihood::Likelihood;
use super::{Fusion, OUTSIDE};
use crate::Real;

/// No link is believed to be blocked for a lesser or a greater share of the time.
const LEAST_SHARE: f64 = 0.03;
const MOST_SHARE: f64 = 0.9;
/// A bias learns from no more than so many deviations at once.
const MOST_DEVIATIONS: f64 = 3.0;

impl<T: Real, const D: usize, const P: usize, const N: usize> Fusion<T, D, P, N> {
    /// Adds so much of the logarithm of every particle's likelihood to its weight; lets the particles learn from the values.
    pub(super) fn weigh(&mut self, part: T, learn: bool) {
        for at in 0..self.nodes.len() {
            let Some(node) = self.nodes.get(at) else { break };
            if node.channel.is_power() { self.weigh_power(at, part, learn) } else { self.weigh_delay(at, part, learn) }
        }
    }

    #[inline(never)]
    fn weigh_power(&mut self, at: usize, part: T, learn: bool) {
        let Self { nodes, cloud, settings, .. } = self;
        let (Some(node), Some(memory)) = (nodes.get_mut(at), cloud.memory.get_mut(at)) else { return };
        let Some(mixture) = node.window.mixture(settings.power.noise) else { return };
        let kept = node.kept(settings.power.way, settings.power.time);
        let bias_variance = kept.squared() * node.variance + (T::ONE - kept.squared()) * settings.power.bias.squared();
        let likelihood = Likelihood::new(&mixture, bias_variance, None);
        let (norm, part) = (T::ONE / likelihood.peak(), part * T::of(core::f64::consts::LN_2));
        let gain = bias_variance / (bias_variance + likelihood.variance);
        let most = T::of(MOST_DEVIATIONS) * (bias_variance + likelihood.variance).sqrt();
        for ((position, memory), weight) in cloud.position.iter().zip(memory).zip(&mut cloud.weight) {
            let expected = node.channel.expected(node.squared(position, settings.height));
            let bias = kept * memory.bias;
            let x = mixture.mean - expected - bias;
            *weight += part * (likelihood.direct(x) * norm).log2_about();
            if learn {
                memory.bias = bias + gain * x.at_most(most).at_least(-most);
            }
        }
        if learn {
            node.variance = (T::ONE - gain) * bias_variance;
            node.learnt();
        }
    }

    #[inline(never)]
    fn weigh_delay(&mut self, at: usize, part: T, learn: bool) {
        let Self { nodes, cloud, settings, .. } = self;
        let (Some(node), Some(memory)) = (nodes.get_mut(at), cloud.memory.get_mut(at)) else { return };
        let errors = &settings.delay;
        let Some(mixture) = node.window.mixture(errors.noise) else { return };
        // The link is what it was, with its excess slowly changing; or it is another one.
        let same = node.sight_kept(errors.time);
        let kept = node.kept(errors.way, errors.time);
        let spread = kept.squared() * node.variance + (T::ONE - kept.squared()) * errors.excess.squared();
        let anew = Likelihood::new(&mixture, errors.bias.squared(), Some(errors.excess));
        let lasting = Likelihood::new(&mixture, spread, None);
        let gain = spread / (spread + lasting.variance);
        let (norm, part) = (T::ONE / anew.peak(), part * T::of(core::f64::consts::LN_2));
        for ((position, belief), weight) in cloud.position.iter().zip(memory).zip(&mut cloud.weight) {
            let x = mixture.mean - node.channel.expected(node.squared(position, settings.height));
            let excess = errors.excess + kept * (belief.bias - errors.excess);
            let stayed = same * belief.blocked;
            let became = (T::ONE - same) * node.share;
            let [direct, blocked] = anew.both(x);
            let direct = (T::ONE - stayed - became) * direct;
            let became = became * blocked;
            let stayed = stayed * lasting.direct(x - excess);
            let density = direct + became + stayed;
            *weight += part * (density * norm).log2_about();
            if learn {
                let blocked = became + stayed;
                belief.blocked = blocked / density;
                if blocked > T::ZERO {
                    let stayed = stayed / blocked;
                    let then = excess + gain * (x - excess);
                    belief.bias = (x + stayed * (then - x)).at_least(T::ZERO).at_most(settings.reach);
                }
            }
        }
        if learn {
            node.variance = (T::ONE - gain) * spread;
            node.learnt();
        }
    }

    /// Lets every link's share of blocked time follow what the particles believe.
    pub(super) fn learn_shares(&mut self, dt: T) {
        let step = T::ONE - (-dt / self.settings.delay.learning).exp();
        for (node, beliefs) in self.nodes.iter_mut().zip(&self.cloud.memory).filter(|(node, _)| node.known) {
            let blocked = beliefs.iter().zip(&self.cloud.weight).fold(T::ZERO, |sum, (b, &w)| sum + w * b.blocked);
            node.share =
                (node.share + step * (blocked - node.share)).at_least(T::of(LEAST_SHARE)).at_most(T::of(MOST_SHARE));
        }
    }

    /// Nobody walks through the walls of the area.
    pub(super) fn keep_inside(&mut self) {
        let Some(area) = self.settings.area else { return };
        for (position, weight) in self.cloud.position.iter().zip(&mut self.cloud.weight) {
            let inside = position.iter().enumerate().all(|(axis, &p)| p >= area.min[axis] && p <= area.max[axis]);
            if !inside {
                *weight -= T::of(OUTSIDE);
            }
        }
    }
}
