//! Advertisements of Bluetooth beacons, and of tags, from and to the bytes on the air.
//!
//! Advertising data is parsed in three steps. [`Structures`] yields one AD structure after the other. [`Payload`] or
//! [`UidPayload`] is a view over the structure of an iBeacon or an Eddystone-UID. [`IBeacon`] or [`EddystoneUid`] is
//! the representation that the other modules use, either as [`Advertised`]. [`IBeacon::emit`] and
//! [`EddystoneUid::emit`] go back to bytes. A [`RotatingId`] hides an iBeacon's identity from everybody without its
//! key. A [`TagPosition`] is what a tag advertises.

mod advertised;
mod eddystone;
mod ibeacon;
mod rotating_id;
mod structure;
mod tag_position;

pub use advertised::{Advertised, Identity, NoBeacon};
pub use eddystone::{EDDYSTONE_LENGTH, EddystoneError, EddystoneUid, UidPayload};
pub use ibeacon::{IBeacon, IBeaconError, LENGTH, Payload};
pub use rotating_id::{Fresh, Revealed, RotatingId};
pub use structure::{Structure, Structures, Truncated};
pub use tag_position::TagPosition;
