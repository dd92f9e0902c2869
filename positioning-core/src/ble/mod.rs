//! Positions from the RSSI values of Bluetooth beacons.
//!
//! Adverts flow in, one RSSI each: [`signal`] refuses what no receiver can have measured, smooths and averages it, and gives a
//! *scan*, a slice of RSSI values in dBm by the beacons' order, `None` where a beacon is not heard. [`path_loss`] makes distances of
//! RSSI values, [`multilateration`] and [`posterior`] positions of RSSI values, [`particles`] ways of positions; [`offset`] learns what is
//! the receiver's own.
//! [`fingerprint`] compares a scan with a map; [`rooms`] says in which room a scan or a position is.
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
