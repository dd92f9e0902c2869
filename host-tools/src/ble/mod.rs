//! Bluetooth beacons on the host: files in; positions, maps and models out.
//!
//! The mathematics is `positioning_core::ble`, that of the tag; here are the files, the runs over them and their figures.

pub mod calibration;
pub mod coverage;
pub mod files;
pub mod fingerprint;
mod follow;
pub mod rooms;
pub mod solve;
pub mod survey;
