//! The planes of a linear support vector machine, one for each pair of rooms.
//!
//! Each point gives three samples: the mean RSSI values, and all of them a standard deviation higher and lower
//! (section 5.3.4 of A. Linde Cerezo's thesis), so that a receiver with another sensitivity than the surveyor's is
//! still in the room. C = 0.001 (the same section). Rooms count alike, however many points each of them has: the cost
//! of a sample is C N / (K n), with n of the N points in its room.

use positioning_core::ble::rooms::pairs;

/// C of section 5.3.4 of the thesis.
const COST: f64 = 0.001;
/// Tolerance of the margins.
const TOLERANCE: f64 = 1e-5;
/// Largest number of steps of a training; a recorded floor takes some hundred.
const MOST_STEPS: usize = 200_000;

/// A training point: its room, and for each beacon the mean RSSI and the deviation, dB.
pub(super) struct Example {
    pub(super) room: usize,
    pub(super) rssis: Vec<(f64, f64)>,
}

/// For each pair of rooms, by [`pairs`], the offset and one weight a beacon. Each room has examples.
pub(super) fn planes(rooms: usize, examples: &[Example]) -> Vec<Vec<f64>> {
    let beacons = examples.first().map_or(0, |example| example.rssis.len());
    let points = examples.len() as f64;
    // RSSI values are centred, because the offset of a plane far from zero is badly determined.
    let mean = |beacon: usize| examples.iter().map(|example| example.rssis[beacon].0).sum::<f64>() / points;
    let centre: Vec<f64> = (0..beacons).map(mean).collect();
    pairs(rooms)
        .map(|(first, second)| {
            let mut samples = Vec::new();
            for (room, side) in [(first, 1.0), (second, -1.0)] {
                let in_room = || examples.iter().filter(move |example| example.room == room);
                let cost = COST * points / (rooms * in_room().count()) as f64;
                for example in in_room() {
                    for sign in [0.0, 1.0, -1.0] {
                        let rssis = example.rssis.iter().zip(&centre);
                        let rssis = rssis.map(|((mean, sigma), centre)| mean + sign * sigma - centre).collect();
                        samples.push(Sample { rssis, side, cost, multiplier: 0.0, projection: 0.0 });
                    }
                }
            }
            let (offset, weights) = plane(samples);
            let offset = offset - weights.iter().zip(&centre).map(|(weight, centre)| weight * centre).sum::<f64>();
            std::iter::once(offset).chain(weights).collect()
        })
        .collect()
}

/// A sample of one side, 1 or −1.
struct Sample {
    rssis: Vec<f64>,
    side: f64,
    cost: f64,
    /// Lagrange's multiplier, 0 to the cost.
    multiplier: f64,
    /// The projection on the weights.
    projection: f64,
}

impl Sample {
    /// How far the multiplier may move towards the sign of its side, and how far the other way.
    fn ways(&self) -> (f64, f64) {
        let (grow, shrink) = (self.cost - self.multiplier, self.multiplier);
        if self.side > 0.0 { (grow, shrink) } else { (shrink, grow) }
    }

    /// The offset of the plane if the sample were on its margin.
    fn offset(&self) -> f64 {
        self.side - self.projection
    }
}

/// The offset and the weights of the plane between both sides: sequential minimal optimisation by the pair that
/// violates the conditions most (Keerthi et al., *Improvements to Platt's SMO algorithm for SVM classifier design*,
/// 2001), with one cost a sample.
fn plane(mut samples: Vec<Sample>) -> (f64, Vec<f64>) {
    let mut weights = vec![0.0; samples.first().map_or(0, |sample| sample.rssis.len())];
    let mut offset = 0.0;
    for _ in 0..MOST_STEPS {
        let up = (0..samples.len()).filter(|&at| samples[at].ways().0 > 0.0);
        let down = (0..samples.len()).filter(|&at| samples[at].ways().1 > 0.0);
        let by_offset = |a: &usize, b: &usize| samples[*a].offset().total_cmp(&samples[*b].offset());
        let (Some(up), Some(down)) = (up.max_by(by_offset), down.min_by(by_offset)) else { break };
        let violation = samples[up].offset() - samples[down].offset();
        offset = 0.5 * (samples[up].offset() + samples[down].offset());
        if violation < TOLERANCE {
            break;
        }
        let difference: Vec<f64> =
            samples[up].rssis.iter().zip(&samples[down].rssis).map(|(up, down)| up - down).collect();
        let square: f64 = difference.iter().map(|d| d * d).sum();
        // Samples of both sides with the same values move as far as they may.
        let step = (violation / square.max(1e-12)).min(samples[up].ways().0).min(samples[down].ways().1);
        for (at, sign) in [(up, 1.0), (down, -1.0)] {
            let sample = &mut samples[at];
            sample.multiplier = (sample.multiplier + sign * sample.side * step).clamp(0.0, sample.cost);
        }
        weights.iter_mut().zip(&difference).for_each(|(weight, d)| *weight += step * d);
        for sample in &mut samples {
            sample.projection += step * sample.rssis.iter().zip(&difference).map(|(rssi, d)| rssi * d).sum::<f64>();
        }
    }
    (offset, weights)
}

#[cfg(test)]
mod tests {
    use super::{Example, planes};

    #[test]
    fn planes_are_those_of_libsvm() {
        // scikit-learn 1.9.1 (LIBSVM), SVC(kernel="linear", C=0.001, tol=1e-9) with sample_weight 7/(3 n) on these
        // points and their means ± σ.
        let example = |room, a, b| Example { room, rssis: vec![a, b] };
        let examples = [
            example(0, (-60.0, 3.0), (-80.0, 2.0)),
            example(0, (-64.0, 2.0), (-74.0, 4.0)),
            example(0, (-58.0, 5.0), (-90.0, 0.0)),
            example(0, (-70.0, 1.0), (-77.0, 2.0)),
            example(1, (-75.0, 2.0), (-62.0, 3.0)),
            example(1, (-69.0, 4.0), (-66.0, 2.0)),
            example(2, (-82.0, 1.0), (-84.0, 2.0)),
        ];
        let expected = [[-2.12875, 0.03558, -0.06125], [7.28099, 0.08264, 0.01653], [8.63914, 0.03623, 0.07938]];
        let planes = planes(3, &examples);
        for (plane, expected) in planes.iter().zip(expected) {
            // An error of 0.0001 in a weight is 0.01 in the offset, 80 dBm away.
            assert!((plane[0] - expected[0]).abs() < 1e-2, "{plane:?}");
            assert!((plane[1] - expected[1]).abs() < 1e-4 && (plane[2] - expected[2]).abs() < 1e-4, "{plane:?}");
        }
    }

    #[test]
    fn a_room_on_top_of_another_is_no_endless_search() {
        let example = |room| Example { room, rssis: vec![(-60.0, 0.0)] };
        let planes = planes(2, &[example(0), example(1), example(1)]);
        assert_eq!(planes.len(), 1);
        assert!(planes[0].iter().all(|number| number.is_finite()), "{planes:?}");
    }
}
