//! The frame of what a desktop trains and a node reads from its flash: a classifier, a model of rooms.
//!
//! Layout: two letters that say what it is, the version, the length of the rest as three bytes (little-endian), the value in
//! postcard, and a CRC-16 (IBM-3740) of all before it. Several frames may follow each other without gap. Weights stay where they
//! are: a value borrows the bytes it was read from.

use core::fmt;

use serde::{Deserialize, Serialize};

/// Bytes before the value.
pub(crate) const HEADER: usize = 6;
pub(crate) const CHECKSUM: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

/// What a frame holds: its letters and its version; a reader takes no other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Content {
    pub(crate) magic: [u8; 2],
    pub(crate) version: u8,
}

/// What can be framed.
pub(crate) trait Stored: Serialize {
    /// Its frame's letters and version.
    const CONTENT: Content;

    /// Whether its numbers make a classifier.
    fn is_sane(&self) -> bool;
}

/// Why bytes are no model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StoredError {
    /// They do not begin like one, or there are none.
    Missing,
    /// Of a version that is not read.
    Version {
        /// That of the bytes.
        found: u8,
        /// That which is read.
        read: u8,
    },
    /// They end early, or the checksum is wrong.
    Corrupt,
    /// Well-formed, but its numbers make no classifier.
    Invalid,
    /// The buffer is too small to hold it.
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

/// Reads a value from the beginning of `bytes`; returns it and what follows.
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
