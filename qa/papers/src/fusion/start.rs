//! The first position: the maximum of the likelihood in the box that the nodes' ranges allow (equation 5), and all
//! positions of nearly that likelihood.

use super::hypothesis::Hypothesis;
use super::likelihood::Likelihood;
use super::node::Node;
use super::{Fusion, FusionSettings};
use positioning_core::Real;
use positioning_core::ble::particles::Random;

/// Number of positions in the box that are tried.
const PLACES: usize = 2048;
/// Hypotheses are drawn by this power of their likelihood, and the rest of it is their weight, so that improbable
/// ones are drawn too.
const POWER: f64 = 0.4;
/// Least width of a hypothesis at the start, metres.
const NARROWEST_M: f64 = 0.25;
/// Steps of the sequence that fills squares and cubes evenly (M. Roberts, 2018: powers of 1 ⁄ g, g³ = g + 1 and g⁴ = g
/// + 1).
const EVEN: [[f64; 3]; 2] = [[0.754_877_67, 0.569_840_29, 0.0], [0.819_172_51, 0.671_043_61, 0.549_700_48]];
/// A likelihood below this counts as zero.
const NOTHING: f64 = 1e-30;

/// A node's likelihood, as the tried positions use it.
struct Seen<'a, T> {
    node: &'a Node<T>,
    mean: T,
    likelihood: Likelihood<T>,
}

/// A position and a state of all links: the logarithm of the density that it is drawn by, and of the rest, which is
/// its weight.
struct Draw<T> {
    blocked: u16,
    drawn: T,
    weight: T,
}

impl<T: Real, const D: usize, const H: usize, const N: usize, const S: usize> Fusion<T, D, H, N, S> {
    /// Tries an even sequence of positions, and draws H hypotheses from them.
    #[inline(never)]
    pub(super) fn start(&mut self) {
        let (low, high) = self.ranges_box();
        let offset: [T; D] = core::array::from_fn(|_| self.random.uniform());
        let steps = EVEN[D - 2];
        let place = |number: usize| -> [T; D] {
            core::array::from_fn(|axis| {
                let turns = offset[axis].to_f64() + steps[axis] * (number + 1) as f64;
                low[axis] + T::of(turns - f64::from(T::of(turns).truncated())) * (high[axis] - low[axis])
            })
        };
        // The volume between neighbours.
        let volume = (0..D).fold(T::ONE, |volume, axis| volume * (high[axis] - low[axis]).at_least(T::of(NARROWEST_M)));
        let room = volume / T::count(PLACES);
        let width =
            if D == 2 { room.sqrt() } else { (room.ln() * T::of(1.0 / 3.0)).exp() }.at_least(T::of(NARROWEST_M));

        let Self { nodes, settings, random, bank, .. } = self;
        let mut seen = heapless::Vec::<Seen<'_, T>, N>::new();
        seen.extend(nodes.iter().filter_map(|node| Seen::new(node, settings, width)));
        let again = random.clone();
        let (mut greatest, mut sum) = (T::of(-1e30), T::ZERO);
        for number in 0..PLACES {
            let draw = draw(&place(number), &seen, nodes, settings, random);
            if draw.drawn > greatest {
                sum *= (greatest - draw.drawn).exp();
                greatest = draw.drawn;
            }
            sum += (draw.drawn - greatest).exp();
        }
        // The same draws once more; every one that passes a mark is kept.
        *random = again;
        bank.clear();
        let scale = T::count(H) / sum;
        let (mut reached, mut mark) = (T::ZERO, T::of(0.5));
        let mut most = T::of(-1e30);
        for number in 0..PLACES {
            let at = place(number);
            let draw = draw(&at, &seen, nodes, settings, random);
            reached += scale * (draw.drawn - greatest).exp();
            let mut times = T::ZERO;
            while mark < reached {
                (times, mark) = (times + T::ONE, mark + T::ONE);
            }
            if times > T::ZERO {
                let mut hypothesis = Hypothesis::new(settings.delay.blocked);
                (hypothesis.blocked, hypothesis.log) = (draw.blocked, draw.weight + times.ln());
                most = most.at_least(hypothesis.log);
                for axis in 0..D {
                    hypothesis.reset(axis, at[axis], width.squared());
                    hypothesis.reset(D + axis, T::ZERO, settings.speed.squared());
                }
                for (number, node) in nodes.iter().enumerate() {
                    hypothesis.doubt(node, number, settings);
                }
                // At most H of them pass a mark.
                let _ = bank.push(hypothesis);
            }
        }
        bank.iter_mut().for_each(|hypothesis| hypothesis.weight = (hypothesis.log - most).exp());
    }

    /// No coordinate can be farther from a node than the greatest distance from which these values can be received.
    fn ranges_box(&self) -> ([T; D], [T; D]) {
        let reach = self.settings.reach;
        let (mut low, mut high) = ([T::of(-1e6); D], [T::of(1e6); D]);
        for node in &self.nodes {
            let power = node.channel.is_power();
            let Some(mixture) = node.window.mixture(self.settings.noise(power)) else { continue };
            let far = if power {
                let doubt = T::of(2.0) * (mixture.variance_of_mean() + self.settings.power.bias.squared()).sqrt();
                node.channel.distance(mixture.mean - doubt).at_most(reach)
            } else {
                // A blocked delay is too long, never too short.
                (mixture.mean + T::of(4.0) * mixture.variance.sqrt()).at_least(T::ONE).at_most(reach)
            };
            for axis in 0..D {
                low[axis] = low[axis].at_least(node.place[axis] - far);
                high[axis] = high[axis].at_most(node.place[axis] + far);
            }
        }
        if let Some(area) = &self.settings.area {
            for axis in 0..D {
                low[axis] = low[axis].at_least(area.min[axis]);
                high[axis] = high[axis].at_most(area.max[axis]);
            }
        }
        for axis in 0..D {
            if !(low[axis] < high[axis]) {
                // The nodes contradict each other: the box is between the two bounds.
                (low[axis], high[axis]) = (high[axis] - T::ONE, low[axis] + T::ONE);
            }
        }
        (low, high)
    }
}

impl<'a, T: Real> Seen<'a, T> {
    /// The expected value is accurate to the width of a tried position.
    fn new(node: &'a Node<T>, settings: &FusionSettings<T>, width: T) -> Option<Self> {
        let power = node.channel.is_power();
        let mixture = node.window.mixture(settings.noise(power))?;
        let likelihood = if power {
            Likelihood::new(&mixture, settings.power.bias.squared(), None)
        } else {
            let bias = settings.delay.bias.squared() + width.squared();
            Likelihood::new(&mixture, bias, Some(settings.delay.excess))
        };
        Some(Self { node, mean: mixture.mean, likelihood })
    }
}

/// The product over the nodes at a position (equation 4), with a state drawn for every link.
fn draw<T: Real, const D: usize>(
    place: &[T; D],
    seen: &[Seen<'_, T>],
    nodes: &[Node<T>],
    settings: &FusionSettings<T>,
    random: &mut Random,
) -> Draw<T> {
    let mut draw = Draw { blocked: 0, drawn: T::ZERO, weight: T::ZERO };
    let (power, rest) = (T::of(POWER), T::of(1.0 - POWER));
    for Seen { node, mean, likelihood } in seen {
        let x = *mean - node.channel.expected(node.squared(place, settings.height));
        let log = |density: T| density.at_least(T::of(NOTHING)).ln();
        if node.channel.is_power() {
            let direct = log(likelihood.direct(x));
            draw.drawn += power * direct;
            draw.weight += rest * direct;
            continue;
        }
        let [direct, blocked] = likelihood.both(x);
        let share = settings.delay.blocked;
        let [direct, blocked] = [log((T::ONE - share) * direct), log(share * blocked)];
        let [by_direct, by_blocked] = [direct, blocked].map(|log| (power * log).exp());
        let both = by_direct + by_blocked;
        draw.drawn += both.ln();
        if random.uniform::<T>() * both < by_blocked {
            draw.weight += rest * blocked;
            let at = nodes.iter().position(|other| core::ptr::eq(other, *node)).unwrap_or(0);
            draw.blocked |= 1 << at;
        } else {
            draw.weight += rest * direct;
        }
    }
    draw
}
