//! Advertisements of Bluetooth beacons, from and to the bytes on the air.
//!
//! Advertising data → [`Structures`], one AD structure after the other → [`Payload`] or [`UidPayload`], a view over those of an
//! iBeacon or an Eddystone-UID → [`IBeacon`] or [`EddystoneUid`], the representations that go inward, either as [`Advertised`]; and
//! back with [`IBeacon::emit`] and [`EddystoneUid::emit`]. A [`RotatingId`] hides an iBeacon's identity from everybody without its key.

mod advertised;
mod eddystone;
mod ibeacon;
mod rotating_id;
mod structure;

pub use advertised::{Advertised, Identity, NoBeacon};
pub use eddystone::{EDDYSTONE_LENGTH, EddystoneError, EddystoneUid, UidPayload};
pub use ibeacon::{IBeacon, IBeaconError, LENGTH, Payload};
pub use rotating_id::{Fresh, Revealed, RotatingId};
pub use structure::{Structure, Structures, Truncated};
