//! Errors of UWB ranges indoors, as Alavi and Pahlavan modelled them (IEEE Communications Letters 10(4), 2006), and the
//! simulated room in which P. M. de Rojas Malpartida compared positioning methods (*Evaluación de un sistema UWB frente
//! a medidas sin línea de visión directa*, Universidad de Sevilla, 2021, equations 7-1 to 7-5, section 8.1, annexes A
//! and G).
//!
//! The functions take a true distance and a random stream, and return a measured range. Where the thesis' text and its
//! annexed code differ, this module follows the code:
//! - the mean of the multipath error is added outside of the logarithm (equation 7-3 multiplies it by the logarithm),
//!   and the logarithm is decimal;
//! - a path is undetected (UDP) with probability ½ at every distance (the 0.064 and 0.620 of 7-4 cancel in the code);
//! - the error of an undetected path may be negative (the text forbids it).

use rand::Rng;

use crate::random::gauss;

/// Mean of the multipath error, metres.
const MULTIPATH_MEAN_M: f64 = 0.09;
/// Standard deviation of the multipath error at the distance where log10(1 + d) = 1, metres.
const MULTIPATH_SIGMA_M: f64 = 0.136;
/// Mean of the error that an undetected direct path adds, metres.
const UNDETECTED_MEAN_M: f64 = 0.96;
/// Standard deviation of the error that an undetected direct path adds, metres.
const UNDETECTED_SIGMA_M: f64 = 0.604;

/// The room's sides, metres.
pub const ROOM_M: [f64; 2] = [9.5, 7.5];
/// The number of anchors on the room's perimeter.
pub const ANCHORS: usize = 12;
/// The box in which points are drawn, metres: least and greatest x and y.
pub const POINTS_M: [[f64; 2]; 2] = [[0.5, 0.5], [9.0, 7.0]];

/// The measured range for a true distance, both in metres. The direct path is detected or not (equations 7-1, 7-2).
pub fn measured_m(distance_m: f64, detected: bool, random: &mut impl Rng) -> f64 {
    // The logarithm is libm's, so that equal seeds give equal ranges on every machine.
    let multipath = MULTIPATH_MEAN_M + MULTIPATH_SIGMA_M * gauss(random) * libm::log10(1.0 + distance_m);
    let undetected = if detected { 0.0 } else { UNDETECTED_MEAN_M + UNDETECTED_SIGMA_M * gauss(random) };
    distance_m + multipath + undetected
}

/// One range of a simulated point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// The measured range, metres.
    pub range_m: f64,
    /// Whether the direct path was detected (DDP).
    pub detected: bool,
}

/// A point of the room with its range to every anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Where the tag is, metres.
    pub position_m: [f64; 2],
    /// The measured ranges, in the order of [`anchors_m`].
    pub ranges: [Range; ANCHORS],
}

/// The anchors, metres. They are evenly spaced on the perimeter of the room, counter-clockwise from the corner (0, 0).
///
/// The thesis says only that they are evenly spaced; it does not print their positions.
pub fn anchors_m() -> [[f64; 2]; ANCHORS] {
    let [width, depth] = ROOM_M;
    let spacing = 2.0 * (width + depth) / ANCHORS as f64;
    std::array::from_fn(|i| match i as f64 * spacing {
        along if along < width => [along, 0.0],
        along if along < width + depth => [width, along - width],
        along if along < 2.0 * width + depth => [2.0 * width + depth - along, depth],
        along => [0.0, 2.0 * (width + depth) - along],
    })
}

/// A point at a random position within [`POINTS_M`]. Each direct path is detected with probability ½.
pub fn point(random: &mut impl Rng) -> Point {
    let [least, greatest] = POINTS_M;
    let position_m: [f64; 2] = std::array::from_fn(|axis| random.random_range(least[axis]..=greatest[axis]));
    let ranges = anchors_m().map(|anchor_m| {
        let distance_m = ((position_m[0] - anchor_m[0]).powi(2) + (position_m[1] - anchor_m[1]).powi(2)).sqrt();
        let detected = random.random_bool(0.5);
        Range { range_m: measured_m(distance_m, detected, random), detected }
    });
    Point { position_m, ranges }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    /// Mean and standard deviation of the error over 200,000 ranges.
    fn error_at(distance_m: f64, detected: bool) -> (f64, f64) {
        const DRAWS: usize = 200_000;
        let mut random = Pcg64Mcg::seed_from_u64(7);
        let errors: Vec<f64> = (0..DRAWS).map(|_| measured_m(distance_m, detected, &mut random) - distance_m).collect();
        let mean = errors.iter().sum::<f64>() / DRAWS as f64;
        let variance = errors.iter().map(|error| (error - mean).powi(2)).sum::<f64>() / DRAWS as f64;
        (mean, variance.sqrt())
    }

    #[test]
    fn a_detected_path_errs_by_the_multipath_model() {
        // log10(1 + 9) = 1, log10(1 + 99) = 2. The mean of 200,000 draws has the standard deviation σ ⁄ 447.
        let (mean, sigma) = error_at(9.0, true);
        assert!((mean - 0.09).abs() < 0.002 && (sigma - 0.136).abs() < 0.002, "{mean} {sigma}");
        let (mean, sigma) = error_at(99.0, true);
        assert!((mean - 0.09).abs() < 0.004 && (sigma - 0.272).abs() < 0.004, "{mean} {sigma}");
    }

    #[test]
    fn an_undetected_path_adds_its_own_error() {
        // 0.09 + 0.96 = 1.05; √(0.136² + 0.604²) = 0.6191.
        let (mean, sigma) = error_at(9.0, false);
        assert!((mean - 1.05).abs() < 0.006 && (sigma - 0.6191).abs() < 0.006, "{mean} {sigma}");
    }

    #[test]
    fn anchors_are_evenly_on_the_perimeter() {
        // The spacing is 34 ⁄ 12 = 2.8333 m. Three more anchors fit on the side of 9.5 m (up to 8.5 m); the next two
        // are beyond the corner, on the side of 7.5 m …
        let anchors = anchors_m();
        let expected = [
            [0.0, 0.0],
            [2.8333, 0.0],
            [5.6667, 0.0],
            [8.5, 0.0],
            [9.5, 1.8333],
            [9.5, 4.6667],
            [9.5, 7.5],
            [6.6667, 7.5],
            [3.8333, 7.5],
            [1.0, 7.5],
            [0.0, 5.6667],
            [0.0, 2.8333],
        ];
        for (anchor, expected) in anchors.iter().zip(expected) {
            assert!((anchor[0] - expected[0]).abs() < 1e-4 && (anchor[1] - expected[1]).abs() < 1e-4, "{anchors:?}");
        }
    }

    #[test]
    fn half_of_the_paths_are_detected_and_points_fill_their_box() {
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let points: Vec<Point> = (0..5_000).map(|_| point(&mut random)).collect();
        let detected = points.iter().flat_map(|point| point.ranges).filter(|range| range.detected).count();
        // 60,000 fair coins: 30,000 ± 4 · √15,000.
        assert!((29_510..=30_490).contains(&detected), "{detected}");
        let mean_x = points.iter().map(|point| point.position_m[0]).sum::<f64>() / 5_000.0;
        // Uniform on [0.5, 9]: the mean is 4.75, σ is 8.5 ⁄ √12 = 2.454, and σ of the mean is 0.035.
        assert!((mean_x - 4.75).abs() < 0.14, "{mean_x}");
        assert!(points.iter().all(|point| (0.5..=9.0).contains(&point.position_m[0])));
        assert!(points.iter().all(|point| (0.5..=7.0).contains(&point.position_m[1])));
    }
}
