//! Operations on all hypotheses together: links change state, wide hypotheses are divided, those that have become
//! alike are merged.

use super::hypothesis::{Hypothesis, squared_over};
use super::{Fusion, FusionEstimate};
use positioning_core::Real;
use positioning_core::linalg::Ldl;

/// Two hypotheses with a smaller squared distance than this, over both covariances, count as one position.
const NEAR: f64 = 2.0;
/// Two hypotheses with a smaller squared distance than this, m², always count as one position.
const SAME: f64 = 0.01;
/// Greatest width of a hypothesis in any direction, metres: the expected values are linearised over its width.
const WIDTH_M: f64 = 0.7;
/// A hypothesis is divided only if its variance is greater than the allowed one by this factor.
const SLACK: f64 = 1.2;
/// The greatest share of the variance that lies between the two halves of a divided hypothesis.
const BETWEEN: f64 = 0.64;
/// A hypothesis is replaced by half of a wide one that is more probable by this factor.
const GIVES_WAY: f64 = 50.0;
/// Hypotheses of a lower probability than this are dropped.
const NOTHING: f64 = 1e-20;
/// A share below this does not change the hypothesis that it is merged into.
const NEGLIGIBLE: f64 = 1e-6;

impl<T: Real, const D: usize, const H: usize, const N: usize, const S: usize> Fusion<T, D, H, N, S> {
    /// The link to a node changes with the probability `rate` times the share of the state that it changes to. Where
    /// a hypothesis with the other state of the link exists at that position, probability moves over to it; else a
    /// new hypothesis takes it.
    pub(super) fn branch(&mut self, at: usize, rate: T) {
        let bit = 1 << at;
        let mut moved = [T::ZERO; H];
        let count = self.bank.len();
        for one in 0..count {
            let Some(hypothesis) = self.bank.get(one) else { break };
            let share = hypothesis.share[at];
            let part = rate * if hypothesis.is_blocked(at) { T::ONE - share } else { share };
            let twin =
                self.bank.iter().enumerate().take(count).filter(|(_, other)| other.blocked ^ hypothesis.blocked == bit);
            let twin = twin.map(|(index, other)| (index, hypothesis.apart::<D>(other)));
            let nearest = twin.reduce(|best, other| if other.1 < best.1 { other } else { best });
            let weight = hypothesis.weight;
            match nearest {
                Some((twin, apart)) if apart < T::of(NEAR) => {
                    moved[twin] += part * weight;
                    moved[one] -= part * weight;
                }
                Some(_) | None => {
                    let mut child = hypothesis.clone();
                    child.blocked ^= bit;
                    child.weight = part * weight;
                    if let Some(node) = self.nodes.get(at) {
                        child.doubt(node, at, &self.settings);
                    }
                    self.bring(child);
                }
            }
        }
        for (hypothesis, &moved) in self.bank.iter_mut().zip(&moved) {
            hypothesis.weight = (hypothesis.weight + moved).at_least(T::of(NOTHING));
        }
    }

    /// Stores a hypothesis in a free entry, or in place of a less probable one.
    fn bring(&mut self, child: Hypothesis<T, N, S>) {
        if self.bank.is_full() {
            if let Some(least) = self.least().and_then(|least| self.bank.get_mut(least))
                && least.weight < child.weight
            {
                *least = child;
            }
        } else {
            // There is room.
            let _ = self.bank.push(child);
        }
    }

    fn least(&self) -> Option<usize> {
        let weights = self.bank.iter().map(|hypothesis| hypothesis.weight).enumerate();
        weights.reduce(|least, other| if other.1 < least.1 { other } else { least }).map(|(index, _)| index)
    }

    /// Merges hypotheses at one position with the same state of all links, unless the result would be too wide; drops
    /// the negligible ones.
    pub(super) fn merge(&mut self) {
        let widest = T::of(WIDTH_M * WIDTH_M);
        let mut one = 0;
        while one < self.bank.len() {
            let mut other = one + 1;
            while let (Some(a), Some(b)) = (self.bank.get(one), self.bank.get(other)) {
                if a.blocked == b.blocked && (b.weight < T::of(NOTHING) || alike::<T, D, N, S>(a, b, widest)) {
                    // The order of the others does not matter.
                    let gone = self.bank.swap_remove(other);
                    if let Some(a) = self.bank.get_mut(one) {
                        a.merge(&gone, self.used);
                    }
                } else {
                    other += 1;
                }
            }
            one += 1;
        }
        self.bank.retain(|hypothesis| hypothesis.weight > T::of(NOTHING));
    }

    /// Divides wide hypotheses, the most probable first, as long as there is room; the others draw a position within
    /// their own.
    pub(super) fn narrow(&mut self) {
        let limit = T::of(WIDTH_M * WIDTH_M);
        for _ in 0..H {
            let (mut heaviest, mut place) = (T::ZERO, None);
            for (index, hypothesis) in self.bank.iter().enumerate() {
                if hypothesis.weight > heaviest && is_wide::<T, D, N, S>(hypothesis, limit) {
                    (heaviest, place) = (hypothesis.weight, Some(index));
                }
            }
            let Some(place) = place else { return };
            let full = self.bank.is_full();
            let least = self.least().filter(|_| full);
            let least_weight = least.and_then(|least| self.bank.get(least)).map_or(T::ZERO, |least| least.weight);
            if full && least_weight * T::of(GIVES_WAY) > heaviest {
                break;
            }
            let Some(first) = self.bank.get_mut(place) else { return };
            let (along, variance) = first.widest::<D>();
            let part = (variance - limit).at_most(T::of(BETWEEN) * variance);
            first.weight *= T::of(0.5);
            let mut second = first.clone();
            first.fix(&along, variance, part, T::ONE, self.used);
            second.fix(&along, variance, part, -T::ONE, self.used);
            match least.and_then(|least| self.bank.get_mut(least)) {
                Some(least) => *least = second,
                None => {
                    let _ = self.bank.push(second);
                }
            }
        }
        for hypothesis in &mut self.bank {
            for _ in 0..D {
                if !is_wide::<T, D, N, S>(hypothesis, limit) {
                    break;
                }
                let (along, variance) = hypothesis.widest::<D>();
                hypothesis.fix(&along, variance, variance - limit, self.random.normal(), self.used);
            }
        }
    }

    /// Turns logarithms into probabilities; returns the logarithm of their sum, or `None` where none of them is a
    /// number.
    pub(super) fn normalise(&mut self) -> Option<T> {
        let first = self.bank.first()?.log;
        let greatest = self.bank.iter().fold(first, |greatest, hypothesis| greatest.at_least(hypothesis.log));
        let mut sum = T::ZERO;
        for hypothesis in &mut self.bank {
            hypothesis.weight = (hypothesis.log - greatest).exp();
            sum += hypothesis.weight;
        }
        if !(sum >= T::ONE) || !greatest.is_finite() || !sum.is_finite() {
            return None;
        }
        let scale = T::ONE / sum;
        self.bank.iter_mut().for_each(|hypothesis| hypothesis.weight *= scale);
        Some(greatest + sum.ln())
    }

    pub(super) fn mean(&self, first: usize) -> [T; D] {
        let add = |sum: [T; D], hypothesis: &Hypothesis<T, N, S>| {
            core::array::from_fn(|axis| sum[axis] + hypothesis.weight * hypothesis.mean[first + axis])
        };
        self.bank.iter().fold([T::ZERO; D], add)
    }

    /// Mean, mode and covariance of the mixture.
    pub(super) fn estimate(&self, nodes: usize, started: bool) -> FusionEstimate<T, D> {
        let mean = self.mean(0);
        let mut covariance = [[T::ZERO; D]; D];
        for hypothesis in &self.bank {
            let own = hypothesis.position_covariance::<D>();
            let off: [T; D] = core::array::from_fn(|axis| hypothesis.mean[axis] - mean[axis]);
            for (r, (row, own)) in covariance.iter_mut().zip(&own).enumerate() {
                let columns = row.iter_mut().zip(own).zip(&off);
                columns.for_each(|((c, &own), &o)| *c += hypothesis.weight * (own + off[r] * o));
            }
        }
        FusionEstimate {
            mean,
            mode: self.mode(),
            covariance,
            velocity: self.mean(D),
            evidence: self.evidence,
            nodes,
            started,
        }
    }

    /// The position of the greatest density, among the means of the hypotheses.
    fn mode(&self) -> [T; D] {
        let heaviest = self.bank.iter().fold(T::ZERO, |most, hypothesis| most.at_least(hypothesis.weight));
        let (mut mode, mut densest) = ([T::ZERO; D], T::ZERO);
        for candidate in self.bank.iter().filter(|candidate| candidate.weight >= T::of(0.1) * heaviest) {
            let mut density = T::ZERO;
            for other in self.bank.iter().filter(|other| other.weight >= T::of(1e-3) * heaviest) {
                let own = other.position_covariance::<D>();
                let determinant = Ldl::new(own).map_or(T::ZERO, |ldl| ldl.determinant());
                if determinant > T::ZERO {
                    let off: [T; D] = core::array::from_fn(|axis| candidate.mean[axis] - other.mean[axis]);
                    density += other.weight * (T::of(-0.5) * squared_over(&own, &off)).exp() / determinant.sqrt();
                }
            }
            if density > densest {
                (mode, densest) = (candidate.position(), density);
            }
        }
        mode
    }
}

fn is_wide<T: Real, const D: usize, const N: usize, const S: usize>(
    hypothesis: &Hypothesis<T, N, S>,
    limit: T,
) -> bool {
    let trace = (0..D).fold(T::ZERO, |sum, axis| sum + hypothesis.covariance(axis, axis));
    trace > T::of(SLACK) * limit && hypothesis.widest::<D>().1 > T::of(SLACK) * limit
}

/// Whether the less probable one of two may be merged into the other.
fn alike<T: Real, const D: usize, const N: usize, const S: usize>(
    a: &Hypothesis<T, N, S>,
    b: &Hypothesis<T, N, S>,
    widest: T,
) -> bool {
    let off: [T; D] = core::array::from_fn(|axis| a.mean[axis] - b.mean[axis]);
    let squared = off.iter().fold(T::ZERO, |sum, o| sum + o.squared());
    if squared > T::of(4.0 * NEAR) * widest || a.apart::<D>(b) > T::of(NEAR) {
        return false;
    }
    let part = b.weight / (a.weight + b.weight);
    let own = |axis: usize| {
        let (mine, its) = (a.covariance(axis, axis), b.covariance(axis, axis));
        mine + part * (its - mine) + part * (T::ONE - part) * off[axis].squared()
    };
    let negligible = part < T::of(NEGLIGIBLE) || part > T::of(1.0 - NEGLIGIBLE);
    squared < T::of(SAME) || negligible || (0..D).all(|axis| own(axis) < widest)
}
