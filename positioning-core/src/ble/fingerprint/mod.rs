//! Positions by comparing a scan with a map of RSSI values (section 2.2.3).
//!
//! A [`Map`] lies as bytes in flash and is read there. It has points, and the RSSI of each beacon at each point.
//!
//! - [`Nearest`] compares a scan with surveyed points (7).
//! - [`locate`] takes a map whose RSSI values have deviations: a Gaussian process that the host has evaluated on a
//!   lattice. It computes the likelihood of the scan at each point. Output: the posterior's mean and covariance, and
//!   the estimate of the receiver's own offset.
//! - [`Walk`] does the same from scan to scan.
//! - [`OffsetFilter`] learns the receiver's offset from scan to scan.
//!
//! A scan is a slice of RSSI values in dBm in the map's order of beacons, with `None` for a beacon that is not
//! received. A value that is no RSSI ([`signal::rssi`](super::signal::rssi)) counts as not received.

mod encode;
mod lattice;
mod map;
mod nearest;
mod offset;
mod walk;

pub use encode::{Point, encode};
pub use lattice::{Posterior, Receiver, locate, locate_on_node};
pub use map::{DEVIATIONS_DB, MAX_BEACONS, MAX_NODE_POINTS, Map, MapError, VERSION};
pub use nearest::{MAX_NEIGHBOURS, Nearest, NeighbourError, Vicinity};
pub use offset::OffsetFilter;
pub use walk::{Motion, Walk};

use super::signal::rssi;
use crate::Real;

/// Why there is no position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum NoPosition {
    /// No beacon of the map is received.
    Unheard,
    /// The map's RSSI values have no deviations: it is a map of surveyed points.
    NoDeviations,
    /// The map has more points than there is room for.
    TooManyPoints,
}

impl NoPosition {
    /// The reason as it is written in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Unheard => "no-beacon-heard",
            Self::NoDeviations => "map-without-deviations",
            Self::TooManyPoints => "map-too-large",
        }
    }
}

impl core::fmt::Display for NoPosition {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.as_str())
    }
}

impl core::error::Error for NoPosition {}

/// The scan's RSSI values by the map's beacons in the map's own unit, half decibels below 0 dBm.
struct Codes<T> {
    codes: [T; MAX_BEACONS],
    heard: [bool; MAX_BEACONS],
    count: usize,
}

impl<T: Real> Codes<T> {
    /// A beacon that is not received has the code 0 here.
    fn of(scan: &[Option<T>], beacons: usize) -> Result<Self, NoPosition> {
        let mut codes = Self { codes: [T::ZERO; MAX_BEACONS], heard: [false; MAX_BEACONS], count: 0 };
        for ((code, heard), scanned) in codes.codes.iter_mut().zip(&mut codes.heard).zip(scan).take(beacons) {
            if let Some(Ok(rssi)) = scanned.map(rssi) {
                *code = -(rssi + rssi);
                *heard = true;
                codes.count += 1;
            }
        }
        if codes.count == 0 { Err(NoPosition::Unheard) } else { Ok(codes) }
    }
}
