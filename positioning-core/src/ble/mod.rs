//! Positions from the RSSI values of Bluetooth beacons.
//!
//! Input: adverts, one RSSI each.
//!
//! - [`signal`] refuses values that no receiver can have measured, smooths and averages the others, and gives a
//!   *scan*: a slice of RSSI values in dBm in the beacons' order, with `None` for a beacon that is not received.
//! - [`path_loss`] converts RSSI values to distances.
//! - [`multilateration`] and [`posterior`] compute positions from RSSI values.
//! - [`particles`] computes tracks from positions.
//! - [`offset`] learns the receiver's own offset.
//! - [`fingerprint`] compares a scan with a map.
//! - [`rooms`] finds the room of a scan or of a position.
//!
//! Equation and table numbers are those of A. Linde Cerezo, *Desarrollo de un sistema de posicionamiento en interiores
//! mediante Bluetooth Low Energy* (Universitat Oberta de Catalunya, 2024), unless another source is named.

pub mod beacon_monitor;
pub mod fingerprint;
pub mod multilateration;
pub mod offset;
pub mod particles;
pub mod path_loss;
pub mod posterior;
pub mod rooms;
pub mod rssi;
pub mod signal;
