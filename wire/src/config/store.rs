//! Two pages of flash: the newer config record is in force, and the next one goes into the other page.
//!
//! The header of a record is written last. So if the power fails during writing, the other page still has the former
//! record.

use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};

use crate::config::page::{HEADER_BYTES, Header, MAX_BYTES, MODEL_AT, MODEL_BYTES, decode, encode, header_of};
use crate::config::{Invalid, LoadError, Record};

/// Number of bytes that are compared at a time after writing.
const CHUNK: usize = 64;

/// Why a record could not be stored.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StoreError<E> {
    /// A node would refuse the record.
    Invalid(Invalid),
    /// The flash's own error.
    Flash(E),
    /// The data read back differs from the data written.
    Verify,
}

/// The page for the next config record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Next {
    /// Its number, 0 or 1.
    pub page: usize,
    /// The record's sequence number.
    pub sequence: u32,
}

/// The config record in force: that of the later whole page, whatever its version.
///
/// # Errors
/// If neither page is whole, or the later one is of another version or invalid. A flash that cannot be read gives
/// [`LoadError::Corrupt`].
pub fn load(flash: &mut impl ReadNorFlash, pages: [u32; 2]) -> Result<Record, LoadError> {
    let mut buffer = [0; MAX_BYTES];
    let found = survey(flash, pages, &mut buffer);
    let which = later(found)?;
    flash.read(pages[which], &mut buffer).map_err(|_| LoadError::Corrupt)?;
    decode(&buffer).map(|(record, _)| record)
}

/// The bytes of a trained classifier beside the config record in force. Reads them into `model` and returns it; `None`
/// if they are erased. The classifier's own checksum shows whether they are valid.
///
/// # Errors
/// As [`load`], but the record's version and contents are not checked.
pub fn load_model<'b>(
    flash: &mut impl ReadNorFlash,
    pages: [u32; 2],
    model: &'b mut [u8; MODEL_BYTES],
) -> Result<Option<&'b [u8]>, LoadError> {
    let page = page_in_force(flash, pages)?;
    flash.read(page + MODEL_AT as u32, model).map_err(|_| LoadError::Corrupt)?;
    Ok(model.iter().any(|byte| *byte != 0xFF).then_some(model))
}

/// The page of the config record in force, whatever its version.
pub(super) fn page_in_force(flash: &mut impl ReadNorFlash, pages: [u32; 2]) -> Result<u32, LoadError> {
    let mut buffer = [0; MAX_BYTES];
    later(survey(flash, pages, &mut buffer)).map(|which| pages[which])
}

/// The same for a page in memory, or for the part of its beginning that was read.
pub fn model_of(page: &[u8]) -> Option<&[u8]> {
    let model = page.get(MODEL_AT..)?;
    let model = model.get(..MODEL_BYTES).unwrap_or(model);
    model.iter().any(|byte| *byte != 0xFF).then_some(model)
}

/// Writes a config record, without a classifier, into the page that is not in force, header last, and reads it back.
///
/// # Errors
/// If the record is invalid, or the flash fails, or the data read back differs. Then the former record stays in force.
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

/// The same choice as [`load`]'s, for two pages in memory: which page is in force, its record, its sequence number.
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
