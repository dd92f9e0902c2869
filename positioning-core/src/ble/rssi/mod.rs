//! What a receiver measures of Bluetooth beacons: the RSSI of each with the data of its beacon, and the likelihood of
//! a position by these RSSI values. All solvers by path loss, and the beacon monitor, use this observation and this
//! likelihood.

mod likelihood;

pub use likelihood::RssiLikelihood;
pub(crate) use likelihood::Term;

use super::path_loss::PathLoss;
use crate::{Real, flatten};

/// The RSSI of one beacon, with the data of the beacon.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RssiObservation<T, const D: usize> {
    /// The beacon's position, metres.
    pub beacon_m: [T; D],
    /// The height difference between beacon and tag, metres, in the plane; 0 where it is not known, and in space.
    pub above_m: T,
    /// The RSSI, dBm.
    pub rssi_dbm: T,
    /// The beacon's path loss.
    pub path_loss: PathLoss<T>,
}

impl<T: Real, const D: usize> RssiObservation<T, D> {
    /// The distance along the plane (or in space) that corresponds to the RSSI, metres.
    pub fn distance_m(&self) -> T {
        flatten(self.path_loss.distance(self.rssi_dbm), self.above_m)
    }

    /// Whether every number is finite and plausible.
    #[inline(never)]
    pub(crate) fn is_sane(&self) -> bool {
        let sum =
            self.beacon_m.iter().fold(self.above_m.abs() + self.rssi_dbm.abs(), |sum, component| sum + component.abs());
        sum <= T::of(1.0e5) && self.path_loss.is_sane()
    }
}

/// The smoothed RSSI of a listed beacon at the end of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BeaconRssi {
    /// The beacon's index in the list.
    pub beacon: u16,
    /// The RSSI. The deviation of its path loss is that of the error that stays while the tag does not move.
    pub observation: RssiObservation<f32, 2>,
    /// The deviation of the RSSI by noise, dB.
    pub noise_db: f32,
    /// Whether single values jump as much as those of two senders.
    pub is_torn: bool,
}
