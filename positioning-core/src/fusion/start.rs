//! The first position: the maximum of the likelihood in the box that the nodes' ranges allow (equation 5).

use super::Fusion;
use super::likelihood::Likelihood;
use crate::Real;

/// Parts of the likelihood's logarithm that come in one after the other; together 1.
const PARTS: [f64; 6] = [1.0 / 32.0, 1.0 / 32.0, 1.0 / 16.0, 1.0 / 8.0, 1.0 / 4.0, 1.0 / 2.0];
/// From stage to stage the particles are scattered so much less.
const FINER: f64 = 0.5;
/// Steps of the sequence that fills squares and cubes evenly (M. Roberts, 2018: powers of 1 ⁄ g, g³ = g + 1 and g⁴ = g + 1).
const EVEN: [[f64; 3]; 2] = [[0.754_877_67, 0.569_840_29, 0.0], [0.819_172_51, 0.671_043_61, 0.549_700_48]];

impl<T: Real, const D: usize, const P: usize, const N: usize> Fusion<T, D, P, N> {
    /// Fills the box, then closes in on what is likely.
    #[inline(never)]
    pub(super) fn start(&mut self) {
        let (low, high) = self.ranges_box();
        let steps = EVEN[D - 2];
        let mut widest = T::ZERO;
        for axis in 0..D {
            let width = high[axis] - low[axis];
            widest = widest.at_least(width);
            let step = T::of(steps[axis]);
            let mut part = self.random.uniform::<T>();
            for position in &mut self.cloud.position {
                position[axis] = low[axis] + part * width;
                part += step;
                if part >= T::ONE {
                    part -= T::ONE;
                }
            }
        }
        self.cloud.velocity = [[T::ZERO; D]; P];
        self.cloud.variance = self.settings.speed.squared();
        for (node, memory) in self.nodes.iter_mut().zip(&mut self.cloud.memory) {
            (node.known, node.way, node.time) = (false, T::ZERO, T::ZERO);
            node.variance = self.settings.bias_variance(node.channel.is_power());
            *memory = [self.settings.belief(); P];
        }
        // About the distance between neighbours: P = n² ⇒ width ⁄ n in the plane.
        let mut scatter = T::of(0.5) * widest / if D == 2 { T::count(P).sqrt() } else { T::count(P).sqrt().sqrt() };
        for (stage, &part) in PARTS.iter().enumerate() {
            let last = stage + 1 == PARTS.len();
            self.cloud.weight = [T::ZERO; P];
            self.weigh(T::of(part), last);
            if !last {
                self.cloud.normalise();
                self.cloud.resample(self.nodes.len(), &mut self.random);
                self.cloud.scatter(scatter, &mut self.random);
                scatter *= T::of(FINER);
            }
        }
    }

    /// No coordinate can be beyond that of a node and the farthest from which it is heard with these values.
    fn ranges_box(&self) -> ([T; D], [T; D]) {
        let reach = self.settings.reach;
        let (mut low, mut high) = ([T::of(-1e6); D], [T::of(1e6); D]);
        for node in &self.nodes {
            let errors = if node.channel.is_power() { self.settings.power.noise } else { self.settings.delay.noise };
            let Some(mixture) = node.window.mixture(errors) else { continue };
            let far = if node.channel.is_power() {
                let likelihood = Likelihood::new(&mixture, node.variance, None);
                let doubt = T::of(2.0) * (likelihood.variance + node.variance).sqrt();
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
                // Nodes that contradict each other: somewhere between the two bounds.
                (low[axis], high[axis]) = (high[axis] - T::ONE, low[axis] + T::ONE);
            }
        }
        (low, high)
    }
}
