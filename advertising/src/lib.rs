//! Advertisements of Bluetooth beacons: iBeacon as a view over bytes and as a representation, identities that rotate.
#![no_std]
#![forbid(unsafe_code)]
