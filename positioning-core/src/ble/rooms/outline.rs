//! The walls about a position: the share of the position's probability that lies within each room's outline.
//!
//! The Gaussian of the position is sampled at 25 points, five along each of its axes (Gauss-Hermite quadrature). For
//! each point, the walls on one side of it are counted to find whether it is within an outline. So a position near a
//! wall is in both rooms.

use super::{Classifier, MAX_ROOMS, Probabilities, normalised};
use crate::Real;

/// Nodes, in standard deviations, and weights of Gauss-Hermite quadrature of fifth order (Abramowitz and Stegun,
/// table 25.10, x √2 and w ⁄ √π).
const NODES: [(f32, f32); 5] = [
    (-2.856_97, 0.011_257_4),
    (-1.355_626_2, 0.222_075_9),
    (0.0, 0.533_333_3),
    (1.355_626_2, 0.222_075_9),
    (2.856_97, 0.011_257_4),
];

/// A position and its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// The position, metres.
    pub position_m: [f32; 2],
    /// The covariance xx, xy, yy, m².
    pub covariance_m2: [f32; 3],
}

/// The outlines of all rooms: corners in their order, metres. The last corner is joined to the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outlines<'a> {
    /// One outline per room.
    pub rooms: &'a [&'a [[f32; 2]]],
}

/// Whether a point is within an outline (the even-odd rule). A point on the wall is on one side or the other.
fn is_within(outline: &[[f32; 2]], [x, y]: [f32; 2]) -> bool {
    let mut within = false;
    let mut before = outline.last();
    for corner in outline {
        if let Some(&[x0, y0]) = before {
            let [x1, y1] = *corner;
            if (y0 > y) != (y1 > y) && x < x0 + (y - y0) / (y1 - y0) * (x1 - x0) {
                within = !within;
            }
        }
        before = Some(corner);
    }
    within
}

impl Classifier for Outlines<'_> {
    type Evidence = Spot;

    fn rooms(&self) -> usize {
        self.rooms.len().min(MAX_ROOMS)
    }

    fn probabilities(&self, spot: &Spot) -> Option<Probabilities> {
        let ([x, y], [xx, xy, yy]) = (spot.position_m, spot.covariance_m2);
        if ![x, y, xx, xy, yy].iter().all(|number| number.is_finite()) {
            return None;
        }
        // Cholesky; values that rounding makes negative become 0.
        let l_xx = Real::sqrt(xx.at_least(0.0));
        let l_xy = if l_xx > 0.0 { xy / l_xx } else { 0.0 };
        let l_yy = Real::sqrt((yy - l_xy * l_xy).at_least(0.0));
        let mut shares: Probabilities = core::iter::repeat_n(0.0, self.rooms()).collect();
        for (u, weight_u) in NODES {
            for (v, weight_v) in NODES {
                let place = [x + l_xx * u, y + l_xy * u + l_yy * v];
                for (share, outline) in shares.iter_mut().zip(self.rooms) {
                    if is_within(outline, place) {
                        *share += weight_u * weight_v;
                    }
                }
            }
        }
        normalised(shares)
    }
}

#[cfg(test)]
mod tests {
    use super::{NODES, Outlines, Spot};
    use crate::ble::rooms::Classifier;

    const LEFT: [[f32; 2]; 4] = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]];
    const RIGHT: [[f32; 2]; 4] = [[4.0, 0.0], [4.0, 3.0], [9.0, 3.0], [9.0, 0.0]];
    /// An L-shaped room about a corner.
    const ANGLE: [[f32; 2]; 6] = [[0.0, 3.0], [9.0, 3.0], [9.0, 5.0], [2.0, 5.0], [2.0, 8.0], [0.0, 8.0]];

    fn probabilities(position_m: [f32; 2], deviation_m: f32) -> Option<std::vec::Vec<f32>> {
        let outlines = Outlines { rooms: &[&LEFT, &RIGHT, &ANGLE] };
        let variance = deviation_m * deviation_m;
        let p = outlines.probabilities(&Spot { position_m, covariance_m2: [variance, 0.0, variance] });
        p.map(|p| p.to_vec())
    }

    #[test]
    fn a_certain_position_is_in_one_room_or_in_none() {
        assert_eq!(probabilities([2.0, 1.5], 0.0), Some(std::vec![1.0, 0.0, 0.0]));
        assert_eq!(probabilities([8.9, 0.1], 0.0), Some(std::vec![0.0, 1.0, 0.0]));
        assert_eq!(probabilities([1.0, 7.0], 0.0), Some(std::vec![0.0, 0.0, 1.0]));
        assert_eq!(probabilities([5.0, 7.0], 0.0), None, "within the angle's arms, but outside");
        assert_eq!(probabilities([f32::NAN, 1.0], 0.1), None);
    }

    #[test]
    fn an_uncertain_position_is_in_the_rooms_that_it_reaches() {
        // 0.5 m left of the wall, σ 0.5 m: the nodes at +1.356 σ and +2.857 σ are beyond it, 0.2220759 + 0.0112574.
        let p = probabilities([3.5, 1.5], 0.5).expect("within");
        assert!((p[1] - 0.233_333).abs() < 1e-4 && (p[0] + p[1] + p[2] - 1.0).abs() < 1e-5, "{p:?}");
    }

    #[test]
    fn the_nodes_have_the_moments_of_a_gaussian() {
        // 1, 0, 1 and 3: exact for polynomials up to the ninth degree.
        for (power, moment) in [(0, 1.0), (1, 0.0), (2, 1.0), (4, 3.0)] {
            let sum: f32 = NODES.iter().map(|(x, w)| w * x.powi(power)).sum();
            assert!((sum - moment).abs() < 1e-4, "{power}: {sum}");
        }
    }

    #[test]
    fn correlation_turns_the_ellipse() {
        // Along the diagonal through the corner (4, 3), half the mass lies beyond it to either side and nothing in
        // RIGHT.
        let outlines = Outlines { rooms: &[&LEFT, &RIGHT, &ANGLE] };
        let p = outlines
            .probabilities(&Spot { position_m: [3.9, 2.9], covariance_m2: [1.0, 0.9999, 1.0] })
            .expect("within");
        assert!(p[1] < 1e-3 && p[0] > 0.6 && p[2] > 0.2, "{p:?}");
    }
}
