//! From advertisements to scans: each RSSI is judged, and smoothed by a Kalman filter of its beacon.
//!
//! Reported RSSI values flow in with their times; out flows a scan, the RSSI of every beacon now, `None` where it is not heard. What no
//! receiver can have measured is refused with its reason, and changes nothing.

mod beacons;
mod kalman;

pub use beacons::{BeaconList, BeaconSignals, ListedBeacon, NEAREST, Scan, WINDOW_US};
pub use kalman::{Kalman, Smoothing, Step};

use crate::Real;

/// What a controller reports where it does not know the RSSI (Bluetooth Core, HCI LE Advertising Report).
const UNAVAILABLE_DBM: f64 = 127.0;
/// The least RSSI that a controller can report, dBm (the same).
const LEAST_DBM: f64 = -127.0;

/// Why an RSSI is no measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RssiError {
    /// 127: the controller says that it does not know.
    Unavailable,
    /// 0 dBm or more: no beacon is that loud, and drivers report 0 for what they did not measure.
    NotNegative,
    /// Below −127 dBm: less than a report can say.
    TooWeak,
    /// NaN or infinite.
    NotFinite,
}

/// The RSSI, where a receiver can have measured it, dBm.
///
/// # Errors
/// See [`RssiError`].
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
