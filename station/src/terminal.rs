//! A terminal's RSSI values to its position: phones and ESP32s that cannot solve themselves.

use std::collections::BTreeMap;

use crate::model::Sample;

/// A position of a terminal in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TerminalPosition {
    /// Metres.
    pub position_m: [f64; 2],
    /// Standard deviations, metres.
    pub sigma_m: [f64; 2],
    /// m².
    pub cov_xy_m2: f64,
    /// The number of beacons that were used.
    pub used: u8,
}

/// A beacon at a known place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownBeacon {
    /// Metres.
    pub position_m: [f64; 3],
    /// RSSI at one metre, dBm; None: that of most beacons.
    pub rssi_1m_dbm: Option<f64>,
    /// None: that of rooms.
    pub path_loss_exponent: Option<f64>,
}

/// The position of a terminal from the samples of one request.
///
/// # Errors
/// Why there is none.
pub fn locate(beacons: &BTreeMap<String, KnownBeacon>, samples: &[Sample]) -> Result<TerminalPosition, &'static str> {
    let _ = (beacons, samples);
    todo!()
}
