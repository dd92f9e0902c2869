//! What nodes tell the host: the one schema, its frames on a wire, the queue before it and the decoder behind it.
//!
//! A [`Message`] becomes a frame: the [`SCHEMA`] byte, the message as postcard writes it, a CRC-16, all COBS-encoded and ended by
//! a zero byte. `docs/wire-format.md` has it byte by byte. On a node a [`Queue`] holds frames until the channel takes them; on the
//! host a [`Decoder`] makes messages of them again.
//!
//! Each message is one file in `messages/`: its fields, the conversions to SI units, its line for a person (the same on a node's log and
//! on the host's screen) and, with the feature `host`, its JSON object and the row of its table. The list in `messages/mod.rs` names them all.

mod decoder;
mod framing;
#[cfg(feature = "host")]
mod host;
pub mod log;
mod message;
mod messages;
pub mod quantised;
mod queue;
mod text;

pub use decoder::{Counts, Decoder};
pub use framing::{DecodeError, LONGEST_FRAME, MAX_FRAME, decode, encode};
#[cfg(feature = "host")]
pub use host::{Table, metres};
pub use message::{Body, Severity, Tone};
pub use messages::*;
pub use quantised::UNKNOWN_POWER;
pub use queue::Queue;

/// The schema's number, the first byte of each frame before COBS.
pub const SCHEMA: u8 = 1;
