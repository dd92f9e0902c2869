//! The room estimate of a tag.
//!
//! Input: a scan (RSSI values in dBm in the beacons' order, `None` where a beacon is not received), or a position
//! with its covariance. A [`Classifier`] converts it to one probability per room: [`Svm`], the linear support vector
//! machine of the thesis (section 3.5), [`Nearest`], the k nearest fingerprints, or [`Outlines`], the walls about the
//! position. [`RoomHysteresis`] converts a sequence of probabilities to a room, or to *between* two rooms, without
//! flapping.
//!
//! Classifiers are trained on a desktop; a node reads them as a [`Model`], versioned and checksummed bytes in its
//! flash (feature `serde`).
//!
//! Section and table numbers are those of A. Linde Cerezo, *Desarrollo de un sistema de posicionamiento en interiores
//! mediante Bluetooth Low Energy* (Universitat Oberta de Catalunya, 2024), unless another source is named.

mod hysteresis;
mod nearest;
mod outline;
#[cfg(feature = "serde")]
mod room_model;
mod svm;

pub use hysteresis::{RoomEstimate, RoomHysteresis, Settings};
pub use nearest::{Nearest, UNHEARD, level_byte};
pub use outline::{Outlines, Spot};
#[cfg(feature = "serde")]
pub use room_model::{Kind, MODEL_VERSION, Model, NodeModel, StoredError};
pub use svm::{Svm, pairs};

use heapless::Vec;

/// The most rooms of a model.
pub const MAX_ROOMS: usize = 32;
/// The most beacons of a model.
pub const MAX_BEACONS: usize = 24;

/// One probability per room, in the model's order; they add up to 1.
pub type Probabilities = Vec<f32, MAX_ROOMS>;

/// A classifier of rooms.
pub trait Classifier {
    /// The input that it classifies.
    type Evidence: ?Sized;

    /// The number of rooms.
    fn rooms(&self) -> usize;

    /// One probability per room, with equal prior probabilities. `None` where the evidence has no information: no
    /// beacon of the model is received, or the position is outside all rooms or not a number.
    fn probabilities(&self, evidence: &Self::Evidence) -> Option<Probabilities>;
}

/// The most probable room, and its probability.
pub fn likeliest(probabilities: &Probabilities) -> Option<(usize, f32)> {
    let mut best: Option<(usize, f32)> = None;
    for (room, &p) in probabilities.iter().enumerate() {
        if best.is_none_or(|(_, most)| p > most) {
            best = Some((room, p));
        }
    }
    best
}

/// Divides by their sum; `None` where the sum is not positive or not finite.
fn normalised(mut shares: Probabilities) -> Option<Probabilities> {
    let sum: f32 = shares.iter().sum();
    if !(sum > 0.0 && sum.is_finite()) {
        return None;
    }
    shares.iter_mut().for_each(|share| *share /= sum);
    Some(shares)
}

/// The RSSI values of a scan, with fall-back RSSI values for beacons that are not received (table 5.3); `None` where
/// no beacon is received. An RSSI that is not a number counts as not received.
fn filled(scan: &[Option<f32>], fallback_dbm: impl Iterator<Item = f32>) -> Option<Vec<f32, MAX_BEACONS>> {
    let mut heard = false;
    let mut rssis = Vec::new();
    let mut scan = scan.iter();
    for fallback in fallback_dbm {
        let rssi = scan.next().copied().flatten().filter(|rssi| rssi.is_finite());
        heard |= rssi.is_some();
        rssis.push(rssi.unwrap_or(fallback)).ok()?;
    }
    heard.then_some(rssis)
}

#[cfg(test)]
mod tests {
    use super::{filled, likeliest, normalised};

    #[test]
    fn unheard_beacons_have_their_fall_back_and_a_scan_of_none_says_nothing() {
        let fallback = || [-90.0, -85.0, -80.0].into_iter();
        let rssis = filled(&[None, Some(-60.0)], fallback()).expect("one is heard");
        assert_eq!(rssis, [-90.0, -60.0, -80.0]);
        assert_eq!(filled(&[None, Some(f32::NAN), None], fallback()), None);
        assert_eq!(filled(&[], fallback()), None);
    }

    #[test]
    fn shares_become_probabilities_or_nothing() {
        let shares = |values: [f32; 3]| values.into_iter().collect();
        assert_eq!(normalised(shares([1.0, 2.0, 1.0])), Some(shares([0.25, 0.5, 0.25])));
        assert_eq!(normalised(shares([0.0; 3])), None);
        assert_eq!(normalised(shares([f32::NAN, 1.0, 1.0])), None);
        assert_eq!(likeliest(&shares([0.25, 0.5, 0.25])), Some((1, 0.5)));
    }
}
