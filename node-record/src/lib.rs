//! What a node is told once: its configuration in flash.
//!
//! A [`Record`] is written by the host (`baliza provision`) as postcard with a header and a checksum, into one of two flash pages
//! in turn: a power cut during writing leaves the other page's record.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

mod record;

pub use record::*;

/// The record's version.
pub const VERSION: u8 = 1;
