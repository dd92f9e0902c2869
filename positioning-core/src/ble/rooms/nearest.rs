//! The k nearest fingerprints vote for their rooms. Nearer ones have a greater weight (the weights of equation 7, 1 ⁄
//! distance).

use heapless::Vec;

use super::{Classifier, MAX_ROOMS, Probabilities, filled, normalised};
use crate::Real;

/// The most neighbours that vote.
const MAX_NEIGHBOURS: usize = 15;
/// Smaller distances count as this, dB, so that a fingerprint that is met exactly does not outvote all others.
const NEAREST_DB: f32 = 0.5;
/// The byte of a beacon that is not received.
pub const UNHEARD: u8 = 0;

/// The byte of an RSSI: half decibels above −128 dBm.
pub fn level_byte(rssi_dbm: Option<f32>) -> u8 {
    // The conversion saturates.
    rssi_dbm.map_or(UNHEARD, |rssi| (2.0 * (rssi + 128.0) + 0.5) as u8)
}

fn level_of(byte: u8) -> Option<f32> {
    (byte != UNHEARD).then(|| 0.5 * f32::from(byte) - 128.0)
}

/// Fingerprints with their rooms, read from flash without a copy.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Nearest<'a> {
    /// The number of rooms: 2 to [`MAX_ROOMS`].
    pub rooms: u8,
    /// k: the number of neighbours that vote, 1 to 15.
    pub neighbours: u8,
    /// One [`level_byte`] per beacon, for where the beacon is not received.
    pub fallback: &'a [u8],
    /// The fingerprints one after the other: the room, then one [`level_byte`] per beacon.
    pub fingerprints: &'a [u8],
}

impl Nearest<'_> {
    fn each(&self) -> impl Iterator<Item = (u8, &[u8])> {
        self.fingerprints.chunks_exact(self.fallback.len() + 1).filter_map(|bytes| {
            let (&room, rssis) = bytes.split_first()?;
            Some((room, rssis))
        })
    }

    #[cfg(feature = "serde")]
    pub(crate) fn is_sane(&self) -> bool {
        let count = self.fingerprints.len() / (self.fallback.len() + 1);
        (2..=MAX_ROOMS).contains(&usize::from(self.rooms))
            && (1..=super::MAX_BEACONS).contains(&self.fallback.len())
            && !self.fallback.contains(&UNHEARD)
            && self.fingerprints.len() == count * (self.fallback.len() + 1)
            && (1..=MAX_NEIGHBOURS.min(count)).contains(&usize::from(self.neighbours))
            && self.each().all(|(room, _)| room < self.rooms)
    }
}

impl Classifier for Nearest<'_> {
    type Evidence = [Option<f32>];

    fn rooms(&self) -> usize {
        usize::from(self.rooms)
    }

    fn probabilities(&self, scan: &[Option<f32>]) -> Option<Probabilities> {
        let rssis = filled(scan, self.fallback.iter().map(|&byte| level_of(byte).unwrap_or(-128.0)))?;
        let most = usize::from(self.neighbours).min(MAX_NEIGHBOURS);
        // Squared distance and room, the nearest first.
        let mut near: Vec<(f32, u8), MAX_NEIGHBOURS> = Vec::new();
        for (room, fingerprint) in self.each() {
            let place = fingerprint.iter().zip(self.fallback).zip(&rssis);
            let distance = place.fold(0.0, |sum, ((&byte, &fallback), rssi)| {
                let there = level_of(byte).or(level_of(fallback)).unwrap_or(-128.0);
                sum + (there - rssi).squared()
            });
            if near.len() == most {
                if near.last().is_none_or(|(farthest, _)| *farthest <= distance) {
                    continue;
                }
                near.pop();
            }
            let place = near.iter().position(|(other, _)| *other > distance).unwrap_or(near.len());
            // There is room: a full list has lost its last entry.
            let _ = near.insert(place, (distance, room));
        }
        let mut shares: Probabilities = core::iter::repeat_n(0.0, self.rooms().min(MAX_ROOMS)).collect();
        for (square, room) in &near {
            if let Some(share) = shares.get_mut(usize::from(*room)) {
                *share += 1.0 / Real::sqrt(*square).at_least(NEAREST_DB);
            }
        }
        normalised(shares)
    }
}

#[cfg(test)]
mod tests {
    use super::{Nearest, level_byte};
    use crate::ble::rooms::Classifier;

    fn bytes(rssis: [Option<f32>; 2]) -> [u8; 2] {
        rssis.map(level_byte)
    }

    #[test]
    fn votes_are_those_of_a_hand_calculation() {
        // From (−60, −70): room 0 at (−63, −74) is 5 dB away, room 1 at (−60, −68) 2 dB, room 0 at (−60, none = −90)
        // 20 dB. Three vote: 1/5 + 1/20 = 0.25 against 1/2: 1/3 and 2/3. Two vote: 0.2 against 0.5.
        let mut fingerprints = std::vec::Vec::new();
        for (room, rssis) in
            [(0, [Some(-63.0), Some(-74.0)]), (1, [Some(-60.0), Some(-68.0)]), (0, [Some(-60.0), None])]
        {
            fingerprints.push(room);
            fingerprints.extend(bytes(rssis));
        }
        let fallback = bytes([Some(-90.0); 2]);
        let mut nearest = Nearest { rooms: 2, neighbours: 3, fallback: &fallback, fingerprints: &fingerprints };
        let p = nearest.probabilities(&[Some(-60.0), Some(-70.0)]).expect("heard");
        assert!((p[0] - 1.0 / 3.0).abs() < 1e-6 && (p[1] - 2.0 / 3.0).abs() < 1e-6, "{p:?}");
        nearest.neighbours = 2;
        let p = nearest.probabilities(&[Some(-60.0), Some(-70.0)]).expect("heard");
        assert!((p[0] - 2.0 / 7.0).abs() < 1e-6, "{p:?}");
        // Exactly a fingerprint: it counts as half a decibel away, 1/0.5 against 1/√(9 + 36).
        let p = nearest.probabilities(&[Some(-60.0), Some(-68.0)]).expect("heard");
        assert!((p[1] - 2.0 / (2.0 + 1.0 / 45.0_f32.sqrt())).abs() < 1e-6, "{p:?}");
        assert_eq!(nearest.probabilities(&[None; 2]), None);
    }

    #[test]
    fn without_fingerprints_nothing_is_known() {
        let fallback = bytes([Some(-90.0); 2]);
        let nearest = Nearest { rooms: 2, neighbours: 3, fallback: &fallback, fingerprints: &[] };
        assert_eq!(nearest.probabilities(&[Some(-60.0); 2]), None);
    }
}
