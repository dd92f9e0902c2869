//! The linear support vector machine (section 3.5): one plane for each pair of rooms, and the combination of the
//! planes.
//!
//! A sigmoid converts a plane's margin to the probability of one room against the other (Platt, *Probabilistic
//! outputs for support vector machines*, 1999, without offset). The probabilities of all pairs are combined to the
//! probabilities of the rooms by the rule of Price, Knerr, Personnaz and Dreyfus (*Pairwise neural network
//! classifiers with probabilistic outputs*, 1994): p_i ∝ 1 ⁄ (Σ_j 1 ⁄ r_ij − (K − 2)).

use heapless::Vec;

use super::{Classifier, MAX_BEACONS, MAX_ROOMS, Probabilities, filled, normalised};
use crate::Real;

/// The limit of a sigmoid's argument, so that one plane alone does not exclude a room for ever.
const CERTAIN: f32 = 12.0;

/// A support vector machine. Numbers are little-endian `f32`, read from flash without a copy.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Svm<'a> {
    /// K, the number of rooms: 2 to [`MAX_ROOMS`].
    pub rooms: u8,
    /// The steepness of the sigmoid of a margin; above 0.
    pub slope: f32,
    /// One RSSI per beacon, dBm, for where the beacon is not received; 1 to [`MAX_BEACONS`].
    pub fallback_dbm: &'a [u8],
    /// For each pair of rooms, in the order of [`pairs`]: the constant, then one weight per beacon, 1 ⁄ dBm. A
    /// positive margin is for the first room.
    pub planes: &'a [u8],
}

/// The pairs of rooms in the order of the planes: 0 and 1, 0 and 2 …, 1 and 2 ….
pub fn pairs(rooms: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..rooms).flat_map(move |first| (first + 1..rooms).map(move |second| (first, second)))
}

fn numbers(bytes: &[u8]) -> impl Iterator<Item = f32> + '_ {
    bytes.as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes))
}

impl Svm<'_> {
    /// The margin of each pair of rooms; `None` where no beacon is received.
    fn margins<'s>(&'s self, scan: &[Option<f32>]) -> Option<impl Iterator<Item = f32> + 's> {
        let rssis: Vec<f32, MAX_BEACONS> = filled(scan, numbers(self.fallback_dbm))?;
        let planes = self.planes.chunks_exact(4 * (rssis.len() + 1));
        Some(planes.map(move |plane| {
            let mut plane = numbers(plane);
            let offset = plane.next().unwrap_or(0.0);
            plane.zip(&rssis).fold(offset, |sum, (weight, rssi)| sum + weight * rssi)
        }))
    }

    #[cfg(feature = "serde")]
    pub(crate) fn is_sane(&self) -> bool {
        let (rooms, beacons) = (usize::from(self.rooms), self.fallback_dbm.len() / 4);
        (2..=MAX_ROOMS).contains(&rooms)
            && (1..=MAX_BEACONS).contains(&beacons)
            && self.fallback_dbm.len() == 4 * beacons
            && self.planes.len() == 4 * (beacons + 1) * pairs(rooms).count()
            && numbers(self.fallback_dbm).chain(numbers(self.planes)).all(f32::is_finite)
            && self.slope > 0.0
            && self.slope.is_finite()
    }
}

impl Classifier for Svm<'_> {
    type Evidence = [Option<f32>];

    fn rooms(&self) -> usize {
        usize::from(self.rooms)
    }

    fn probabilities(&self, scan: &[Option<f32>]) -> Option<Probabilities> {
        let rooms = self.rooms().min(MAX_ROOMS);
        // Σ 1 ⁄ r − (K − 2), with 1 ⁄ r = 1 + e⁻ˣ, is 1 + Σ e⁻ˣ: a sum without cancellation.
        let mut doubts = [1.0_f32; MAX_ROOMS];
        for ((first, second), margin) in pairs(rooms).zip(self.margins(scan)?) {
            let x = (self.slope * margin).at_least(-CERTAIN).at_most(CERTAIN);
            let against = Real::exp(-x);
            if let Some(doubt) = doubts.get_mut(first) {
                *doubt += against;
            }
            if let Some(doubt) = doubts.get_mut(second) {
                *doubt += 1.0 / against;
            }
        }
        normalised(doubts.iter().take(rooms).map(|doubt| 1.0 / doubt).collect())
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::{Svm, pairs};
    use crate::ble::rooms::Classifier;

    fn bytes(numbers: &[f32]) -> Vec<u8> {
        numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
    }

    #[test]
    fn three_rooms_and_two_beacons_by_hand() {
        // Planes of rooms 0|1, 0|2, 1|2 at the scan −60, (−90):
        // 1 + 0.1 · −60 − 0.05 · −90 = −0.5; 4 − 6 + 1.8 = −0.2; 0.4.
        // Slope 2: x = −1, −0.4, 0.8.
        // Sums 1 + Σ e⁻ˣ: 1 + e¹ + e^0.4 = 5.210107; 1 + e⁻¹ + e^−0.8 = 1.817208; 1 + e^−0.4 + e^0.8 = 3.895861.
        // Their inverses 0.191935, 0.550295, 0.256683 add up to 0.998913.
        let (fallback, planes) = (bytes(&[-80.0, -90.0]), bytes(&[1.0, 0.1, -0.05, 4.0, 0.1, -0.02, 0.4, 0.0, 0.0]));
        let svm = Svm { rooms: 3, slope: 2.0, fallback_dbm: &fallback, planes: &planes };
        let p = svm.probabilities(&[Some(-60.0), None]).expect("a beacon is heard");
        for (p, expected) in p.iter().zip([0.192_144, 0.550_894, 0.256_962]) {
            assert!((p - expected).abs() < 2e-5, "{p} {expected}");
        }
        assert_eq!(svm.probabilities(&[None, None]), None);
    }

    #[test]
    fn two_rooms_are_a_sigmoid() {
        // x = 3 · (−58 + 60) ⁄ 4 = 1.5; σ(1.5) = 0.817574. The sums 1 + e⁻ˣ and 1 + eˣ are the inverses of σ(x) and
        // σ(−x).
        let (fallback, planes) = (bytes(&[-80.0]), bytes(&[15.0, 0.25]));
        let svm = Svm { rooms: 2, slope: 3.0, fallback_dbm: &fallback, planes: &planes };
        let p = svm.probabilities(&[Some(-58.0)]).expect("a beacon is heard");
        assert!((p[0] - 0.817_574).abs() < 1e-5 && (p[0] + p[1] - 1.0).abs() < 1e-6, "{p:?}");
    }

    #[test]
    fn levels_beyond_all_measure_leave_probabilities() {
        let (fallback, planes) = (bytes(&[-80.0]), bytes(&[15.0, 0.25]));
        let svm = Svm { rooms: 2, slope: 3.0, fallback_dbm: &fallback, planes: &planes };
        for rssi in [f32::MAX, f32::MIN, 0.0, -1e30] {
            let p = svm.probabilities(&[Some(rssi)]).expect("a beacon is heard");
            assert!(p.iter().all(|p| (0.0..=1.0).contains(p)), "{p:?}");
        }
        assert_eq!(svm.probabilities(&[Some(f32::INFINITY)]), None);
    }

    #[test]
    fn pairs_are_those_of_the_planes() {
        assert_eq!(pairs(3).collect::<Vec<_>>(), [(0, 1), (0, 2), (1, 2)]);
    }
}
