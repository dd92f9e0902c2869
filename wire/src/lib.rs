//! Every byte format of Baliza, from bytes to validated representations and back. `docs/reference/wire-format.md`
//! describes them byte by byte.
//!
//! | module | between | format |
//! |---|---|---|
//! | [`uwb`] | nodes, by ultra-wideband | IEEE 802.15.4 data frames: native mode and DecaRanging |
//! | [`ble`] | beacons and tags, by Bluetooth | advertisements: iBeacon, Eddystone-UID, identifiers that rotate |
//! | [`telemetry`] | a node and the host | postcard, CRC-16, COBS |
//! | [`to_node`] | the host and a gateway | messages to tags, in frames as those of telemetry |
//! | [`datagram`] | a gateway and a station | telemetry in UDP, with receipts |
//! | [`config`] | the host and a node's flash | config records: header, postcard, CRC-32 |
#![no_std]
#![forbid(unsafe_code)]

#[cfg(any(test, feature = "host"))]
extern crate std;

pub mod ble;
pub mod config;
pub mod datagram;
pub mod serial_number;
pub mod telemetry;
pub mod to_node;
pub mod uwb;
