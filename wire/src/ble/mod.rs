//! Advertisements of Bluetooth beacons, from and to the bytes on the air.
//!
//! Advertising data is parsed in three steps. [`Structures`] yields one AD structure after the other. [`Payload`] or
//! [`UidPayload`] is a view over the structure of an iBeacon or an Eddystone-UID. [`IBeacon`] or [`EddystoneUid`] is
//! the representation that the other modules use, either as [`Advertised`]. [`IBeacon::emit`] and
//! [`EddystoneUid::emit`] go back to bytes. A [`RotatingId`] hides an iBeacon's identity from everybody without its
//! key.

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
