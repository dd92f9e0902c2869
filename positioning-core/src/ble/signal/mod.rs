//! From advertisements to scans: each RSSI is checked, and smoothed by a Kalman filter of its beacon.
//!
//! Input: reported RSSI values with their times. Output: a scan, the current RSSI of every beacon, with `None` for a
//! beacon that is not received. A value that no receiver can have measured is refused with its reason, and changes
//! nothing.

mod beacons;
mod kalman;

pub use beacons::{BeaconList, BeaconSignals, ListedBeacon, NEAREST, Scan, WINDOW_US};
pub use kalman::{Kalman, Smoothing, Step};

use crate::Real;

/// The value that a controller reports where it does not know the RSSI (Bluetooth Core, HCI LE Advertising Report).
const UNAVAILABLE_DBM: f64 = 127.0;
/// The least RSSI that a controller can report, dBm (same source).
const LEAST_DBM: f64 = -127.0;

/// Why a value is not an RSSI.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RssiError {
    /// 127: the controller reports that it does not know the RSSI.
    Unavailable,
    /// 0 dBm or more: no beacon is that strong, and drivers report 0 for an RSSI that they did not measure.
    NotNegative,
    /// Below −127 dBm: less than the least value of a report.
    TooWeak,
    /// NaN or infinite.
    NotFinite,
}

/// Returns the RSSI, dBm, if a receiver can have measured it.
///
/// # Errors
/// The value is not an RSSI; [`RssiError`] has the reason.
pub fn rssi<T: Real>(rssi_dbm: T) -> Result<T, RssiError> {
    if !rssi_dbm.is_finite() {
        Err(RssiError::NotFinite)
    } else if rssi_dbm == T::of(UNAVAILABLE_DBM) {
        Err(RssiError::Unavailable)
    } else if rssi_dbm >= T::ZERO {
        Err(RssiError::NotNegative)
    } else if rssi_dbm < T::of(LEAST_DBM) {
        Err(RssiError::TooWeak)
    } else {
        Ok(rssi_dbm)
    }
}

#[cfg(test)]
mod tests {
    use super::{RssiError, rssi};

    #[test]
    fn what_no_receiver_measures_is_refused_with_its_reason() {
        assert_eq!(rssi(127.0_f32), Err(RssiError::Unavailable));
        assert_eq!(rssi(0.0_f32), Err(RssiError::NotNegative));
        assert_eq!(rssi(-0.0_f32), Err(RssiError::NotNegative));
        assert_eq!(rssi(20.0_f32), Err(RssiError::NotNegative));
        assert_eq!(rssi(-128.0_f32), Err(RssiError::TooWeak));
        assert_eq!(rssi(f32::NAN), Err(RssiError::NotFinite));
        assert_eq!(rssi(f32::NEG_INFINITY), Err(RssiError::NotFinite));
        assert_eq!((rssi(-1.0_f32), rssi(-127.0_f32)), (Ok(-1.0), Ok(-127.0)));
    }
}
