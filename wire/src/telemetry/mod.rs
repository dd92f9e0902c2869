//! Messages from nodes to the host: the schema, its frames on a wire, the queue before the wire and the decoder after
//! it.
//!
//! A [`Message`] becomes a frame: the [`SCHEMA`] byte, the message in postcard and a CRC-16, all COBS-encoded and ended
//! by a zero byte. `docs/reference/wire-format.md` describes it byte by byte. On a node a [`Queue`] holds frames until
//! the channel takes them. On the host a [`Decoder`] decodes them into messages.
//!
//! Each message has one file in `messages/`. The file contains its fields, the conversions to SI units, its line for a
//! person (the same in a node's log, but for the `0x` of addresses, and on the host's screen) and, with the feature
//! `host`, its JSON object and the row of its table. The list in `messages/mod.rs` contains all of them.

mod address;
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

pub use address::Address;
pub use decoder::{Counts, Decoder};
pub(crate) use framing::CRC;
pub use framing::{DecodeError, LONGEST_FRAME, MAX_FRAME, decode, encode};
#[cfg(feature = "host")]
pub use host::{Table, metres};
pub use message::{Body, Severity, Tone};
pub(crate) use messages::is_definite;
pub use messages::*;
pub use quantised::UNKNOWN_POWER;
pub use queue::Queue;

/// The schema's number, the first byte of each frame before COBS.
pub const SCHEMA: u8 = 1;
