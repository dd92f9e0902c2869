//! The iBeacon as a generic app: what it advertises, how often, under which identity.
#![no_std]
#![forbid(unsafe_code)]
