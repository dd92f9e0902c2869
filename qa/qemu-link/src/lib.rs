//! The messages between a node's image in QEMU and the simulated world around it.
//!
//! The image sends a request and the world an answer, one after the other. A request carries the number of instructions
//! that the image has executed since the last answer, so that the world can let the time of the image's processor pass
//! before it does the request. An answer carries the world's time. All numbers are little-endian. A message begins with
//! the number of bytes that follow, 16 bits.
//!
//! | request | byte 0 | bytes 1–4, 5–8 | body |
//! |---|---|---|---|
//! | all | kind | instructions of ranging, of the background | |
//! | [`Request::Start`] | 0 | | |
//! | [`Request::Transaction`] | 1 | | count (1); per operation its kind (1) and length or nanoseconds (4); bytes sent |
//! | [`Request::Clock`] | 2 | | 1 where the bus is fast (1) |
//! | [`Request::Reset`] | 3 | | 1 where the line is low (1) |
//! | [`Request::Wait`] | 4 | | until, nanoseconds (8); bit 0: or an interrupt, bit 1: or the background's end (1) |
//! | [`Request::Telemetry`] | 5 | | frames |
//!
//! An answer has the world's time in nanoseconds (8), [`WorldAnswer::IRQ_IS_HIGH`] and so on (1), and a body. The body of a
//! transaction is the bytes received; the body of a start is the time of an instruction in picoseconds (4) and the
//! node's config record.
#![no_std]
#![forbid(unsafe_code)]

mod answer;
mod request;

pub use answer::{NodeStart, WorldAnswer};
pub use request::{Asked, MAX_OPERATIONS, Operation, Request, Spent};

/// The maximum length of a message, with its length field.
pub const MAX_MESSAGE: usize = 2048;

/// A message: its length, then its bytes.
pub type LinkMessage = heapless::Vec<u8, MAX_MESSAGE>;

/// Why a message cannot be written or read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkError {
    /// It is longer than [`MAX_MESSAGE`], or has more than [`MAX_OPERATIONS`].
    TooLong,
    /// It is too short, or has an invalid value.
    Malformed,
}

impl core::fmt::Display for LinkError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::TooLong => "the message is too long",
            Self::Malformed => "the message is malformed",
        })
    }
}

impl core::error::Error for LinkError {}

/// Begins a message with room for the length, which [`seal`] fills in.
fn begin() -> LinkMessage {
    let mut message = LinkMessage::new();
    // There is room for two bytes: the capacity is more than a thousand bytes.
    let _ = message.extend_from_slice(&[0; 2]);
    message
}

fn put(message: &mut LinkMessage, bytes: &[u8]) -> Result<(), LinkError> {
    message.extend_from_slice(bytes).map_err(|_| LinkError::TooLong)
}

fn seal(mut message: LinkMessage) -> LinkMessage {
    let length = (message.len().saturating_sub(2) as u16).to_le_bytes();
    message.iter_mut().zip(length).for_each(|(byte, length)| *byte = length);
    message
}

/// Removes the first bytes and returns them.
fn take<const N: usize>(bytes: &mut &[u8]) -> Result<[u8; N], LinkError> {
    let (first, rest) = bytes.split_first_chunk().ok_or(LinkError::Malformed)?;
    *bytes = rest;
    Ok(*first)
}
