//! Two pages of flash: the newer record counts, and the next one goes into the other page.
//!
//! A record is written with its header last. Whenever the power fails meanwhile, the page that was not touched still
//! has the record before.

use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};

use crate::config::page::{HEADER_BYTES, Header, MAX_BYTES, MODEL_AT, MODEL_BYTES, decode, encode, header_of};
use crate::config::{Invalid, LoadError, Record};

/// Bytes that are compared at once after writing.
const CHUNK: usize = 64;

/// Why a record could not be stored.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StoreError<E> {
    /// It would be refused by the node that reads it.
    Invalid(Invalid),
    /// The flash's own error.
    Flash(E),
    /// What was written is not what is read.
    Verify,
}

/// The page that a record goes into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Next {
    /// Which of the two, 0 or 1.
    pub page: usize,
    /// The record's sequence number.
    pub sequence: u32,
}

/// The record that counts: that of the later page of those that are whole, whatever version that is.
///
/// # Errors
/// Neither page is whole, or the later one is of another version or invalid. A flash that cannot be read is
/// [`LoadError::Corrupt`].
pub fn load(flash: &mut impl ReadNorFlash, pages: [u32; 2]) -> Result<Record, LoadError> {
    let mut buffer = [0; MAX_BYTES];
    let found = survey(flash, pages, &mut buffer);
    let which = later(found)?;
    flash.read(pages[which], &mut buffer).map_err(|_| LoadError::Corrupt)?;
    decode(&buffer).map(|(record, _)| record)
}

/// What stands beside the record that counts, for a trained classifier: `model` is filled and given back, `None` where it is
/// erased. Whether it is a classifier, its own checksum says.
///
/// # Errors
/// As [`load`], but for the record's version and content, which are not looked at.
pub fn load_model<'b>(
    flash: &mut impl ReadNorFlash,
    pages: [u32; 2],
    model: &'b mut [u8; MODEL_BYTES],
) -> Result<Option<&'b [u8]>, LoadError> {
    let mut buffer = [0; MAX_BYTES];
    let which = later(survey(flash, pages, &mut buffer))?;
    flash.read(pages[which] + MODEL_AT as u32, model).map_err(|_| LoadError::Corrupt)?;
    Ok(model.iter().any(|byte| *byte != 0xFF).then_some(model))
}

/// The same of a page in memory, or of as much of its beginning as was read.
pub fn model_of(page: &[u8]) -> Option<&[u8]> {
    let model = page.get(MODEL_AT..)?;
    let model = model.get(..MODEL_BYTES).unwrap_or(model);
    model.iter().any(|byte| *byte != 0xFF).then_some(model)
}

/// Writes a record, without a classifier, into the page that does not count, header last, and reads it back.
///
/// # Errors
/// The record is invalid, the flash refuses, or does not keep what was written. The record before counts then.
pub fn store<F: NorFlash>(flash: &mut F, pages: [u32; 2], record: &Record) -> Result<(), StoreError<F::Error>> {
    const {
        assert!(HEADER_BYTES.is_multiple_of(F::WRITE_SIZE) && MAX_BYTES.is_multiple_of(F::WRITE_SIZE));
        assert!(CHUNK.is_multiple_of(F::READ_SIZE) && MAX_BYTES.is_multiple_of(CHUNK));
    }
    record.validate().map_err(StoreError::Invalid)?;
    let mut buffer = [0; MAX_BYTES];
    let next = next_of(survey(flash, pages, &mut buffer));
    let page = pages[next.page];

    let length = encode(record, next.sequence, &mut buffer).len().next_multiple_of(F::WRITE_SIZE);
    let erased = page + MAX_BYTES.next_multiple_of(F::ERASE_SIZE) as u32;
    flash.erase(page, erased).map_err(StoreError::Flash)?;
    let (header, body) = buffer[..length].split_at(HEADER_BYTES);
    flash.write(page + HEADER_BYTES as u32, body).map_err(StoreError::Flash)?;
    flash.write(page, header).map_err(StoreError::Flash)?;

    let mut read = [0; CHUNK];
    for (index, written) in buffer.chunks(CHUNK).enumerate() {
        flash.read(page + (index * CHUNK) as u32, &mut read).map_err(StoreError::Flash)?;
        if read != written {
            return Err(StoreError::Verify);
        }
    }
    Ok(())
}

/// The same choice as [`load`]'s, of two pages in memory: which page counts, its record, its sequence number.
///
/// # Errors
/// As [`load`].
pub fn newest(pages: [&[u8]; 2]) -> Result<(usize, Record, u32), LoadError> {
    let which = later(pages.map(header_of))?;
    decode(pages[which]).map(|(record, sequence)| (which, record, sequence))
}

/// The same choice as [`store`]'s, for two pages in memory.
pub fn next(pages: [&[u8]; 2]) -> Next {
    next_of(pages.map(header_of))
}

fn survey(
    flash: &mut impl ReadNorFlash,
    pages: [u32; 2],
    buffer: &mut [u8; MAX_BYTES],
) -> [Result<Header, LoadError>; 2] {
    pages.map(|page| match flash.read(page, buffer) {
        Ok(()) => header_of(buffer),
        Err(_) => Err(LoadError::Corrupt),
    })
}

fn later(found: [Result<Header, LoadError>; 2]) -> Result<usize, LoadError> {
    match found {
        [Ok(first), Ok(second)] => Ok(usize::from(second.is_later_than(first))),
        [Ok(_), Err(_)] => Ok(0),
        [Err(_), Ok(_)] => Ok(1),
        [Err(LoadError::Missing), Err(fault)] | [Err(fault), Err(_)] => Err(fault),
    }
}

fn next_of(found: [Result<Header, LoadError>; 2]) -> Next {
    match later(found) {
        Ok(which) => {
            let sequence = found[which].map_or(0, |header| header.sequence);
            Next { page: 1 - which, sequence: sequence.wrapping_add(1) }
        }
        Err(_) => Next { page: 0, sequence: 1 },
    }
}
