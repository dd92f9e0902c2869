//! The frame of data that a desktop trains and a node reads from its flash: a classifier, a model of rooms.
//!
//! Layout: two letters for the content, the version, the length of the value as three bytes (little-endian), the
//! value in postcard, and a CRC-16 (IBM-3740) of everything before it. Several frames may follow each other without a
//! gap. A value borrows the bytes from which it was read, so weights are not copied.

use core::fmt;

use serde::{Deserialize, Serialize};

/// The number of bytes before the value.
pub(crate) const HEADER: usize = 6;
pub(crate) const CHECKSUM: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

/// The content of a frame: its letters and its version. A reader accepts no other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Content {
    pub(crate) magic: [u8; 2],
    pub(crate) version: u8,
}

/// A type that can be stored in a frame.
pub(crate) trait Stored: Serialize {
    /// Its frame's letters and version.
    const CONTENT: Content;

    /// Whether its numbers are valid.
    fn is_sane(&self) -> bool;
}

/// Why bytes are not a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StoredError {
    /// The bytes do not begin like a model, or there are none.
    Missing,
    /// The model has a version that is not supported.
    Version {
        /// The version of the bytes.
        found: u8,
        /// The version that is supported.
        read: u8,
    },
    /// The bytes end early, or the checksum is wrong.
    Corrupt,
    /// The model is well-formed, but its numbers are not valid.
    Invalid,
    /// The buffer is too small to hold the model.
    TooLong,
}

impl fmt::Display for StoredError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing => write!(f, "not a model"),
            Self::Version { found, read } => write!(f, "a model of version {found}, where {read} is read"),
            Self::Corrupt => write!(f, "a damaged model"),
            Self::Invalid => write!(f, "a model whose numbers make no classifier"),
            Self::TooLong => write!(f, "a model that is too long"),
        }
    }
}

impl core::error::Error for StoredError {}

/// Writes a value to the beginning of `buffer` and returns those bytes.
pub(crate) fn encode<'b, T: Stored>(value: &T, buffer: &'b mut [u8]) -> Result<&'b [u8], StoredError> {
    if !value.is_sane() {
        return Err(StoredError::Invalid);
    }
    let room = buffer.get_mut(HEADER..).ok_or(StoredError::TooLong)?;
    let length = postcard::to_slice(value, room).map_err(|_| StoredError::TooLong)?.len();
    let [l0, l1, l2, 0] = u32::try_from(length).unwrap_or(u32::MAX).to_le_bytes() else {
        return Err(StoredError::TooLong);
    };
    let Content { magic: [m0, m1], version } = T::CONTENT;
    buffer.get_mut(..HEADER).ok_or(StoredError::TooLong)?.copy_from_slice(&[m0, m1, version, l0, l1, l2]);
    let end = HEADER + length;
    let checksum = CHECKSUM.checksum(buffer.get(..end).ok_or(StoredError::TooLong)?);
    buffer.get_mut(end..end + 2).ok_or(StoredError::TooLong)?.copy_from_slice(&checksum.to_le_bytes());
    buffer.get(..end + 2).ok_or(StoredError::TooLong)
}

/// Reads a value from the beginning of `bytes`. Returns the value and the bytes after it.
pub(crate) fn decode<'a, T: Stored + Deserialize<'a>>(bytes: &'a [u8]) -> Result<(T, &'a [u8]), StoredError> {
    let content = T::CONTENT;
    let Some((&[m0, m1, version, l0, l1, l2], _)) = bytes.split_first_chunk::<HEADER>() else {
        return Err(StoredError::Missing);
    };
    if [m0, m1] != content.magic {
        return Err(StoredError::Missing);
    }
    if version != content.version {
        return Err(StoredError::Version { found: version, read: content.version });
    }
    let end = HEADER + u32::from_le_bytes([l0, l1, l2, 0]) as usize;
    let (covered, rest) = bytes.split_at_checked(end).ok_or(StoredError::Corrupt)?;
    let (checksum, rest) = rest.split_first_chunk::<2>().ok_or(StoredError::Corrupt)?;
    if CHECKSUM.checksum(covered) != u16::from_le_bytes(*checksum) {
        return Err(StoredError::Corrupt);
    }
    let payload = covered.get(HEADER..).ok_or(StoredError::Corrupt)?;
    match postcard::take_from_bytes::<T>(payload) {
        Ok((value, [])) if value.is_sane() => Ok((value, rest)),
        Ok(_) | Err(_) => Err(StoredError::Invalid),
    }
}
