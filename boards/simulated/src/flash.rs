//! Two pages of NOR flash in memory. Erasing sets bits, and writing clears them, four bytes at a time.

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

/// The size of a page, bytes.
const PAGE_BYTES: usize = crate::BOARD.pages().size as usize;
const WORD: usize = 4;
const BYTES: usize = 2 * PAGE_BYTES;

/// The pages.
pub struct Flash([u8; BYTES]);

/// The error of an access beyond the pages, or not at their boundaries.
#[derive(Clone, Copy, Debug)]
pub struct Refused;

impl NorFlashError for Refused {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl Flash {
    /// Flash in its state from the factory.
    pub const fn erased() -> Self {
        Self([0xFF; BYTES])
    }

    fn at(&mut self, offset: u32, length: usize, step: usize) -> Result<&mut [u8], Refused> {
        let from = offset as usize;
        let aligned = from.is_multiple_of(step) && length.is_multiple_of(step);
        let part = from.checked_add(length).and_then(|to| self.0.get_mut(from..to));
        part.filter(|_| aligned).ok_or(Refused)
    }
}

impl ErrorType for Flash {
    type Error = Refused;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Refused> {
        bytes.copy_from_slice(self.at(offset, bytes.len(), Self::READ_SIZE)?);
        Ok(())
    }

    fn capacity(&self) -> usize {
        BYTES
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Refused> {
        let length = to.checked_sub(from).ok_or(Refused)? as usize;
        self.at(from, length, Self::ERASE_SIZE)?.fill(0xFF);
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Refused> {
        for (cell, byte) in self.at(offset, bytes.len(), Self::WRITE_SIZE)?.iter_mut().zip(bytes) {
            *cell &= byte;
        }
        Ok(())
    }
}
