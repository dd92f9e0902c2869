//! What nodes tell the host: the one schema, its frames on a wire, the queue before it and the decoder behind it.
//!
//! A [`Message`] becomes a frame: the [`SCHEMA`] byte, the message as postcard writes it, a CRC-16, all COBS-encoded and ended by
//! a zero byte. `docs/wire-format.md` has it byte by byte.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

mod message;

pub use message::*;

/// The schema's number, the first byte of each frame before COBS.
pub const SCHEMA: u8 = 1;
