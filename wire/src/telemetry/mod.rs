//! What nodes tell the host: the one schema, its frames on a wire, the queue before it and the decoder behind it.
//!
//! A [`Message`] becomes a frame: the [`SCHEMA`] byte, the message as postcard writes it, a CRC-16, all COBS-encoded and ended by
//! a zero byte. `docs/wire-format.md` has it byte by byte. On a node a [`Queue`] holds frames until the channel takes them; on the
//! host a [`Decoder`] makes messages of them again.

mod decoder;
mod framing;
mod message;
mod names;
mod queue;
pub mod units;

pub use decoder::{Counts, Decoder};
pub use framing::{DecodeError, LONGEST_FRAME, MAX_FRAME, decode, encode};
pub use message::*;
pub use names::Severity;
pub use queue::Queue;

/// The schema's number, the first byte of each frame before COBS.
pub const SCHEMA: u8 = 1;
