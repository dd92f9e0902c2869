//! NOR flash: writing only clears bits, pages are erased as a whole, and the power may fail within any operation.

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};
use rand::Rng;
use rand_pcg::Pcg32;

/// Two erase units, written in words of `WORD` bytes.
#[derive(Clone, Debug)]
pub struct Flash<const WORD: usize, const PAGE: usize> {
    pub bytes: Vec<u8>,
    /// Operations (the erasing of a page, the writing of a word) until the power fails, within the last one.
    power: Option<usize>,
    pub operations: usize,
    random: Pcg32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failed {
    Asked(NorFlashErrorKind),
    WrittenTwice,
    NoPower,
}

impl NorFlashError for Failed {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Asked(kind) => *kind,
            Self::WrittenTwice | Self::NoPower => NorFlashErrorKind::Other,
        }
    }
}

impl<const WORD: usize, const PAGE: usize> Flash<WORD, PAGE> {
    pub const PAGES: [u32; 2] = [PAGE as u32, 3 * PAGE as u32];

    pub fn erased() -> Self {
        Self { bytes: vec![0xFF; 4 * PAGE], power: None, operations: 0, random: Pcg32::new(1, 1) }
    }

    /// The same, but the power fails within operation number `operation`, counted from 0.
    pub fn cut_at(&self, operation: usize, seed: u64) -> Self {
        Self { power: Some(operation), operations: 0, random: Pcg32::new(seed, 2), ..self.clone() }
    }

    pub fn powered(self) -> Self {
        Self { power: None, operations: 0, ..self }
    }

    pub fn page(&self, which: usize) -> &[u8] {
        &self.bytes[Self::PAGES[which] as usize..][..PAGE]
    }

    /// Counts an operation. Returns whether it is completed or done in part; an error if there is no power.
    fn operate(&mut self) -> Result<bool, Failed> {
        let whole = match self.power {
            Some(power) if self.operations > power => return Err(Failed::NoPower),
            Some(power) => self.operations < power,
            None => true,
        };
        self.operations += 1;
        Ok(whole)
    }
}

impl<const WORD: usize, const PAGE: usize> ErrorType for Flash<WORD, PAGE> {
    type Error = Failed;
}

impl<const WORD: usize, const PAGE: usize> ReadNorFlash for Flash<WORD, PAGE> {
    const READ_SIZE: usize = WORD;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Failed> {
        check_read(self, offset, bytes.len()).map_err(Failed::Asked)?;
        bytes.copy_from_slice(&self.bytes[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl<const WORD: usize, const PAGE: usize> NorFlash for Flash<WORD, PAGE> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Failed> {
        check_erase(self, from, to).map_err(Failed::Asked)?;
        for page in (from as usize..to as usize).step_by(PAGE) {
            let whole = self.operate()?;
            for byte in &mut self.bytes[page..page + PAGE] {
                // Half erased: some of the bits have become 1.
                *byte |= if whole { 0xFF } else { self.random.random::<u8>() | self.random.random::<u8>() };
            }
            if !whole {
                return Err(Failed::NoPower);
            }
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Failed> {
        check_write(self, offset, bytes.len()).map_err(Failed::Asked)?;
        for (index, word) in bytes.chunks(WORD).enumerate() {
            let whole = self.operate()?;
            let place = &mut self.bytes[offset as usize + index * WORD..][..WORD];
            if place.iter().any(|byte| *byte != 0xFF) {
                return Err(Failed::WrittenTwice);
            }
            for (byte, new) in place.iter_mut().zip(word) {
                // Half written: some of the bits have become 0.
                *byte &= if whole { *new } else { *new | self.random.random::<u8>() };
            }
            if !whole {
                return Err(Failed::NoPower);
            }
        }
        Ok(())
    }
}
