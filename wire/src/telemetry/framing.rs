//! Encodes a message as a frame on the wire, and decodes a frame into a message.
//!
//! A frame consists of the [`SCHEMA`] byte, the message in postcard and a CRC-16 of both (CRC-16/IBM-3740, low byte
//! first). All of it is encoded by COBS (S. Cheshire and M. Baker, IEEE/ACM Transactions on Networking 7, 1999), so
//! that the only zero is the one that ends the frame.

use core::fmt;

use crc::{CRC_16_IBM_3740, Crc};
use postcard::experimental::max_size::MaxSize;

use crate::telemetry::{Message, SCHEMA};

/// The check of frames, in both directions.
// One table, for all who use it.
pub(crate) static CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_IBM_3740);
const CRC_BYTES: usize = 2;
/// Schema, body and checksum of the longest message of this build.
const MAX_PLAIN: usize = 1 + Message::POSTCARD_MAX_SIZE + CRC_BYTES;

/// The longest frame that this build makes, with COBS and the final zero, bytes.
pub const MAX_FRAME: usize = cobs::max_encoding_length(MAX_PLAIN) + 1;

/// The longest frame of any build, with COBS and the final zero, bytes: a reader keeps no more bytes.
pub const LONGEST_FRAME: usize = 256;

const _: () = assert!(MAX_FRAME <= LONGEST_FRAME);

/// Why a frame cannot be decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum DecodeError {
    /// Without a zero for more bytes than a frame can have.
    TooLong,
    /// Violates COBS, or has no room for schema and checksum.
    Cobs,
    /// The checksum is wrong.
    Checksum,
    /// Whole, but of this other schema: from a newer or older node.
    Schema(u8),
    /// Whole, but with a message, or a value in one, that this build does not know: from a newer node.
    Unknown,
    /// Whole, but its body does not match the schema.
    Body,
}

impl fmt::Display for DecodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooLong => f.write_str("too long to be a frame"),
            Self::Cobs => f.write_str("COBS is violated"),
            Self::Checksum => f.write_str("the checksum is wrong"),
            Self::Schema(schema) => write!(f, "schema {schema}, not {SCHEMA}"),
            Self::Unknown => f.write_str("a message of a newer build"),
            Self::Body => f.write_str("the body is not what the schema says"),
        }
    }
}

impl core::error::Error for DecodeError {}

/// Writes a message as a frame with its final zero, and returns it.
// Inlined where speed counts more than size, it would take three kilobytes more.
#[inline(never)]
pub fn encode<'a>(message: &Message, frame: &'a mut [u8; MAX_FRAME]) -> &'a [u8] {
    let mut plain = [0; MAX_PLAIN];
    let [schema, rest @ ..] = &mut plain;
    *schema = SCHEMA;
    // MAX_PLAIN has room for every message: postcard derives its greatest size from the types.
    let body = postcard::to_slice(message, rest).map_or(0, |body| body.len());
    let (checked, check) = plain.split_at_mut(1 + body);
    for (place, byte) in check.iter_mut().zip(CRC.checksum(checked).to_le_bytes()) {
        *place = byte;
    }
    let plain = plain.get(..1 + body + CRC_BYTES).unwrap_or(&[]);
    let encoded = cobs::encode(plain, frame);
    // COBS leaves no zero. The array's byte after it may belong to an earlier frame.
    if let Some(end) = frame.get_mut(encoded) {
        *end = 0;
    }
    frame.get(..=encoded).unwrap_or(&[])
}

/// Decodes a frame, with its final zero or without.
///
/// Bytes of the body after the known ones are fields of a newer build. They are ignored.
///
/// # Errors
/// If the frame is not whole, or its message is not known.
pub fn decode(frame: &[u8]) -> Result<Message, DecodeError> {
    if frame.len() > LONGEST_FRAME {
        return Err(DecodeError::TooLong);
    }
    let mut plain = [0; LONGEST_FRAME];
    let length = cobs::decode(frame, &mut plain).map_err(|_| DecodeError::Cobs)?;
    let plain = plain.get(..length).ok_or(DecodeError::Cobs)?;
    let (checked, check) = plain.split_last_chunk::<CRC_BYTES>().ok_or(DecodeError::Cobs)?;
    let (schema, body) = checked.split_first().ok_or(DecodeError::Cobs)?;
    if CRC.checksum(checked) != u16::from_le_bytes(*check) {
        return Err(DecodeError::Checksum);
    }
    if *schema != SCHEMA {
        return Err(DecodeError::Schema(*schema));
    }
    match postcard::take_from_bytes(body) {
        Ok((message, _newer)) => Ok(message),
        // serde's own error: no variant has this number. All others are postcard's.
        Err(postcard::Error::SerdeDeCustom) => Err(DecodeError::Unknown),
        Err(_) => Err(DecodeError::Body),
    }
}
