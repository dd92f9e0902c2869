//! Advertisements of Bluetooth beacons, from and to the bytes on the air.
//!
//! Advertising data → [`Structures`], one AD structure after the other → [`Payload`], a view over those of an iBeacon →
//! [`IBeacon`], the representation that goes inward; and back with [`IBeacon::emit`]. A [`Disguise`] hides an identity from
//! whoever has not its key.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

mod disguise;
mod ibeacon;
mod structure;

pub use disguise::{Disguise, Fresh, Revealed};
pub use ibeacon::{IBeacon, LENGTH, Payload, Refusal};
pub use structure::{Structure, Structures, Truncated};
