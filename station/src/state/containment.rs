//! The probability that a position is within an outline.
//!
//! The position is a Gaussian in the plane. By Green's theorem, the integral of its density over a polygon is one over
//! the polygon's edges: ∮ Φ(u) φ(v) dv, in coordinates u, v in which the Gaussian is the standard one (Φ is the normal
//! distribution, φ its density). The integral is exact but for rounding and a quadrature of 1e-7. So a probability near
//! a threshold does not jump, as it does with the few samples of `positioning_core::ble::rooms::Outlines`, which also
//! compares at most 32 rooms with each other, without the probability of being outside of all.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Beyond this number of standard deviations there is nothing: 1e-9.
const FAR: f64 = 6.0;
/// The least standard deviation, metres: nobody draws walls more exactly.
const LEAST_M: f64 = 1e-3;
/// The most pieces of an edge: the diagonal of the square of twelve standard deviations has 17.
const MOST_PIECES: f64 = 18.0;
/// Gauss-Legendre quadrature of four nodes on [-1, 1] (Abramowitz and Stegun, table 25.4): nodes and weights.
const NODES: [(f64, f64); 4] = [
    (-0.861_136_311_594_053, 0.347_854_845_137_454),
    (-0.339_981_043_584_856, 0.652_145_154_862_546),
    (0.339_981_043_584_856, 0.652_145_154_862_546),
    (0.861_136_311_594_053, 0.347_854_845_137_454),
];

/// A position in the plane with its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian {
    /// The mean, metres.
    pub mean_m: [f64; 2],
    /// The covariance xx, xy, yy, m².
    pub covariance_m2: [f64; 3],
}

/// An outline: corners in their order, metres. The last one is joined to the first.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Outline {
    corners_m: Vec<[f64; 2]>,
    /// Least and greatest x and y.
    around_m: [[f64; 2]; 2],
}

impl Outline {
    /// An outline of these corners. One that has fewer than three, or that are no numbers, contains nothing.
    pub(super) fn new(corners_m: Vec<[f64; 2]>) -> Self {
        let is_sane = corners_m.len() >= 3 && corners_m.iter().flatten().all(|number| number.abs() <= 1e9);
        let corners_m = if is_sane { corners_m } else { Vec::new() };
        let around_m = corners_m.iter().fold([[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]], |[least, most], at| {
            [[least[0].min(at[0]), least[1].min(at[1])], [most[0].max(at[0]), most[1].max(at[1])]]
        });
        Self { corners_m, around_m }
    }

    /// The probability that the position is within. It is 0 where a number of the position is none.
    pub(super) fn probability(&self, position: &Gaussian) -> f64 {
        let ([x, y], [xx, xy, yy]) = (position.mean_m, position.covariance_m2);
        let reach = [xx, yy].map(|variance| FAR * variance.max(LEAST_M * LEAST_M).sqrt());
        let is_near = |axis: usize, at: f64| {
            at + reach[axis] > self.around_m[0][axis] && at - reach[axis] < self.around_m[1][axis]
        };
        let Some(last) = self.corners_m.last() else { return 0.0 };
        let is_sane = [x, y, xx, xy, yy].iter().all(|number| number.is_finite());
        if !(is_sane && is_near(0, x) && is_near(1, y)) {
            return 0.0;
        }
        // Cholesky; what rounding makes too small gets the least deviation.
        let l_xx = xx.sqrt().max(LEAST_M);
        let l_yx = xy / l_xx;
        let l_yy = (yy - l_yx * l_yx).max(LEAST_M * LEAST_M).sqrt();
        let standard = |corner: &[f64; 2]| {
            let u = (corner[0] - x) / l_xx;
            [u, (corner[1] - y - l_yx * u) / l_yy]
        };
        let mut before = standard(last);
        let mut sum = 0.0;
        for corner in &self.corners_m {
            let here = standard(corner);
            sum += edge(before, here);
            before = here;
        }
        // Negative where the corners go clockwise.
        if sum.is_finite() { sum.abs().min(1.0) } else { 0.0 }
    }
}

/// Φ.
fn normal(x: f64) -> f64 {
    0.5 * libm::erfc(-x * FRAC_1_SQRT_2)
}

/// ∫ Φ(u) φ(v) dv along an edge.
fn edge([u0, v0]: [f64; 2], [u1, v1]: [f64; 2]) -> f64 {
    let (du, dv) = (u1 - u0, v1 - v0);
    // The part of the edge, from 0 to 1, in which a coordinate is near 0.
    let near = |from: f64, step: f64, [begin, end]: [f64; 2]| {
        if step == 0.0 {
            return if from.abs() <= FAR { [begin, end] } else { [begin, begin] };
        }
        let (a, b) = ((-FAR - from) / step, (FAR - from) / step);
        [a.min(b).clamp(begin, end), a.max(b).clamp(begin, end)]
    };
    let [begin, end] = near(v0, dv, [0.0, 1.0]);
    if dv == 0.0 || !(begin < end) {
        return 0.0;
    }
    let [enter, leave] = near(u0, du, [begin, end]);
    let mut sum = 0.0;
    // Where u is far: Φ is 0 or 1.
    for [from, to] in [[begin, enter], [leave, end]] {
        if from < to && u0 + 0.5 * (from + to) * du > 0.0 {
            sum += normal(v0 + to * dv) - normal(v0 + from * dv);
        }
    }
    // In pieces of one standard deviation.
    let pieces = ((leave - enter) * du.hypot(dv)).ceil().min(MOST_PIECES);
    let half = 0.5 * (leave - enter) / pieces.max(1.0);
    let mut integral = 0.0;
    for piece in 0..pieces as u32 {
        let middle = enter + (2.0 * f64::from(piece) + 1.0) * half;
        for (node, weight) in NODES {
            let t = middle + node * half;
            let v = v0 + t * dv;
            integral += weight * normal(u0 + t * du) * (-0.5 * v * v).exp();
        }
    }
    sum + integral * half * dv / (2.0 * PI).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn probability(corners_m: &[[f64; 2]], mean_m: [f64; 2], covariance_m2: [f64; 3]) -> f64 {
        Outline::new(corners_m.to_vec()).probability(&Gaussian { mean_m, covariance_m2 })
    }

    fn square(half: f64) -> [[f64; 2]; 4] {
        [[-half, -half], [half, -half], [half, half], [-half, half]]
    }

    /// An L about the point (2, 2), which is outside.
    const ANGLE: [[f64; 2]; 6] = [[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [1.0, 1.0], [1.0, 4.0], [0.0, 4.0]];

    #[test]
    fn half_of_a_position_on_a_long_wall_is_on_each_side() {
        let half_plane = [[0.0, -1e4], [1e4, -1e4], [1e4, 1e4], [0.0, 1e4]];
        for covariance in [[1.0, 0.0, 1.0], [4.0, 0.0, 0.01], [1.0, 0.9, 1.0], [1e-4, 0.0, 25.0]] {
            assert!((probability(&half_plane, [0.0, 3.0], covariance) - 0.5).abs() < 1e-6, "{covariance:?}");
        }
        // One standard deviation inside: 0.841345.
        assert!((probability(&half_plane, [2.0, 0.0], [4.0, 0.0, 1.0]) - 0.841_345).abs() < 1e-6);
    }

    #[test]
    fn a_square_of_1_96_standard_deviations_has_0_9025() {
        // 0.95 by 0.95; the corners' direction does not matter, nor does scale.
        let mut corners = square(1.96);
        assert!((probability(&corners, [0.0; 2], [1.0, 0.0, 1.0]) - 0.9025).abs() < 2e-5);
        corners.reverse();
        assert!((probability(&corners, [0.0; 2], [1.0, 0.0, 1.0]) - 0.9025).abs() < 2e-5);
        let rectangle = square(1.96).map(|[x, y]| [10.0 + 3.0 * x, 0.1 * y - 5.0]);
        assert!((probability(&rectangle, [10.0, -5.0], [9.0, 0.0, 0.01]) - 0.9025).abs() < 2e-5);
    }

    #[test]
    fn a_square_that_is_turned_has_the_same_probability() {
        // erf(1.96/√2)² = 0.950004210² and erf(0.5/√2)² = 0.382924923²; the corners cut the quadrature elsewhere each
        // time.
        for (half, expected) in [(1.96, 0.902_507_998), (0.5, 0.146_631_496)] {
            for degrees in 0..90 {
                let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
                let turned = square(half).map(|[x, y]| [cos * x - sin * y, sin * x + cos * y]);
                let found = probability(&turned, [0.0; 2], [1.0, 0.0, 1.0]);
                assert!((found - expected).abs() < 1e-7, "{degrees}: {found}");
            }
        }
    }

    #[test]
    fn a_quadrant_of_a_correlated_position_has_sheppards_probability() {
        // W. F. Sheppard 1899: 1/4 + arcsin ρ / 2π; for ρ = ½ that is 1/3.
        let quadrant = [[0.0, 0.0], [1e3, 0.0], [1e3, 1e3], [0.0, 1e3]];
        assert!((probability(&quadrant, [0.0; 2], [1.0, 0.5, 1.0]) - 1.0 / 3.0).abs() < 1e-6);
        assert!((probability(&quadrant, [0.0; 2], [4.0, -1.0, 1.0]) - 1.0 / 6.0).abs() < 1e-6);
    }

    #[test]
    fn a_concave_room_is_the_sum_of_its_parts() {
        // At the inner corner (1, 1), with a standard deviation of 0.1: three of four quadrants, the rest is far.
        assert!((probability(&ANGLE, [1.0, 1.0], [0.01, 0.0, 0.01]) - 0.75).abs() < 1e-6);
        // With 1 m: the arm along x is u -1 … 3, v -1 … 0; the rest of the other is u -1 … 0, v 0 … 3.
        // (Φ(3) - Φ(-1)) (Φ(0) - Φ(-1)) = 0.839995 · 0.341345, and 0.341345 · 0.498650: 0.456939 in all.
        assert!((probability(&ANGLE, [1.0, 1.0], [1.0, 0.0, 1.0]) - 0.456_939).abs() < 2e-6);
    }

    #[test]
    fn a_point_is_within_or_not() {
        for sigma_m in [0.0, 1e-9, 1e-3] {
            let covariance = [sigma_m * sigma_m, 0.0, sigma_m * sigma_m];
            assert!(probability(&ANGLE, [0.5, 3.5], covariance) > 1.0 - 1e-6);
            assert!(probability(&ANGLE, [2.0, 2.0], covariance) < 1e-6, "between the arms");
            assert!(probability(&ANGLE, [-0.1, 0.5], covariance) < 1e-6);
        }
    }

    #[test]
    fn what_is_no_number_is_nowhere() {
        for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(probability(&ANGLE, [wrong, 0.5], [1.0, 0.0, 1.0]), 0.0);
            assert_eq!(probability(&ANGLE, [0.5, wrong], [1.0, 0.0, 1.0]), 0.0);
            assert_eq!(probability(&ANGLE, [0.5, 0.5], [1.0, wrong, 1.0]), 0.0);
            assert_eq!(probability(&[[0.0, 0.0], [wrong, 0.0], [1.0, 1.0]], [0.5, 0.5], [1.0, 0.0, 1.0]), 0.0);
        }
        assert_eq!(probability(&[[0.0, 0.0], [1.0, 1.0]], [0.5, 0.5], [1.0, 0.0, 1.0]), 0.0);
        assert_eq!(probability(&[], [0.0; 2], [1.0, 0.0, 1.0]), 0.0);
        for wild in [[1e30, 0.0, 1e30], [1e-30, 0.0, 1e30], [1.0, 1e9, 1.0], [-1.0, 0.0, -1.0]] {
            assert!((0.0..=1.0).contains(&probability(&ANGLE, [0.5, 0.5], wild)), "{wild:?}");
        }
    }
}
