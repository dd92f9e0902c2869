//! A record over a debug probe: into the flash of a board, and out of it.
//!
//! Both pages are read, the one that does not count is written, as the node itself would do it; then it is read back
//! and compared, and the node starts anew. An ESP's flash is not in the chip's memory, so that probes write it without
//! reading it: there the record goes into both pages, one after the other, and the chip compares it.

use std::time::Duration;

use anyhow::{Context, Result, bail};
use node_record::{Board, Fault, Next, Record, next};
use probe_rs::flashing::DownloadOptions;
use probe_rs::{MemoryInterface, Session};

use super::image::{self, Held, page};

/// A chip's flash, by whole pages.
pub trait Flash {
    /// Reads from an address on.
    ///
    /// # Errors
    /// The probe's.
    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<()>;

    /// Erases a page and writes it; the flash's own check finds what did not hold.
    ///
    /// # Errors
    /// The probe's.
    fn write_page(&mut self, address: u32, page: &[u8]) -> Result<()>;

    /// Starts the node anew.
    ///
    /// # Errors
    /// The probe's.
    fn restart(&mut self) -> Result<()>;
}

impl Flash for Session {
    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<()> {
        self.core(0)?.read(address.into(), bytes)?;
        Ok(())
    }

    fn write_page(&mut self, address: u32, page: &[u8]) -> Result<()> {
        let mut loader = self.target().flash_loader();
        loader.add_data(address.into(), page)?;
        let mut options = DownloadOptions::default();
        options.verify = true;
        loader.commit(self, options)?;
        Ok(())
    }

    fn restart(&mut self) -> Result<()> {
        let mut core = self.core(0)?;
        // What writes the flash left the core halted in it.
        core.reset_and_halt(Duration::from_millis(500))?;
        core.run()?;
        Ok(())
    }
}

/// The chip of a board, in probe-rs's words.
pub const fn chip(board: Board) -> &'static str {
    match board {
        Board::Dwm1001 => "nRF52832_xxAA",
        Board::Evk1000 => "STM32F105RC",
        Board::Esp32C3 => "esp32c3",
        Board::Esp32C6 => "esp32c6",
        Board::Esp32 => "esp32",
    }
}

/// Whether a probe reads the flash that the record is in.
pub const fn is_readable(board: Board) -> bool {
    match board {
        Board::Dwm1001 | Board::Evk1000 => true,
        Board::Esp32C3 | Board::Esp32C6 | Board::Esp32 => false,
    }
}

/// Writes a record, and the classifier beside it, and restarts the node; answers with the addresses of the pages that were written, and the record's
/// sequence number.
///
/// # Errors
/// The probe's; or the flash does not keep what was written.
pub fn write(flash: &mut impl Flash, board: Board, record: &Record, model: Option<&[u8]>) -> Result<(Vec<u32>, u32)> {
    let addresses = board.pages().addresses();
    let (written, sequence) = if is_readable(board) {
        let pages = read_pages(flash, board)?;
        let Next { page: which, sequence } = next([&pages[0], &pages[1]]);
        let image = page(board, record, model, sequence);
        flash
            .write_page(addresses[which], &image)
            .context("cannot write the flash; the record before is still there")?;
        let back = read_pages(flash, board)?;
        if back[which] != image {
            bail!(
                "the flash does not keep what was written at 0x{:08X}; the record before is still there",
                addresses[which]
            );
        }
        (vec![addresses[which]], sequence)
    } else {
        let sequence = 1;
        for address in addresses {
            let image = page(board, record, model, sequence);
            flash.write_page(address, &image).with_context(|| format!("cannot write the flash at 0x{address:X}"))?;
        }
        (addresses.to_vec(), sequence)
    };
    flash.restart().context("the record is written, but the node could not be started anew: reset it by hand")?;
    Ok((written, sequence))
}

/// Reads the record that counts.
///
/// # Errors
/// The probe's.
pub fn read(flash: &mut impl Flash, board: Board) -> Result<Result<Held, Fault>> {
    let pages = read_pages(flash, board)?;
    Ok(image::held([&pages[0], &pages[1]]))
}

fn read_pages(flash: &mut impl Flash, board: Board) -> Result<[Vec<u8>; 2]> {
    let size = board.pages().size as usize;
    let mut pages = [vec![0; size], vec![0; size]];
    for (address, page) in board.pages().addresses().into_iter().zip(&mut pages) {
        flash.read(address, page).with_context(|| format!("cannot read the flash at 0x{address:08X}"))?;
    }
    Ok(pages)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::probe::knows;
    use crate::provision::{EXAMPLE, Site};
    use std::collections::BTreeMap;

    #[derive(Default)]
    struct Memory {
        pages: BTreeMap<u32, Vec<u8>>,
        writes: Vec<u32>,
        restarts: usize,
        /// Forgets a bit of what it is given.
        worn: bool,
    }

    impl Flash for Memory {
        fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<()> {
            bytes.fill(0xFF);
            if let Some(page) = self.pages.get(&address) {
                bytes.copy_from_slice(page);
            }
            Ok(())
        }

        fn write_page(&mut self, address: u32, page: &[u8]) -> Result<()> {
            let mut page = page.to_vec();
            page[40] ^= u8::from(self.worn);
            self.pages.insert(address, page);
            self.writes.push(address);
            Ok(())
        }

        fn restart(&mut self) -> Result<()> {
            self.restarts += 1;
            Ok(())
        }
    }

    fn records() -> Vec<Record> {
        let site = Site::parse("site.toml".as_ref(), EXAMPLE).expect("the example is right");
        site.nodes.iter().map(|node| node.record.clone()).collect()
    }

    #[test]
    fn pages_take_turns() {
        let (mut memory, records) = (Memory::default(), records());
        let missing = read(&mut memory, Board::Dwm1001).unwrap();
        assert_eq!(missing, Err(Fault::Missing));
        for (sequence, record) in (1..).zip(&records[..3]) {
            let written = write(&mut memory, Board::Dwm1001, record, None).unwrap();
            assert_eq!(written, (vec![[0x7F000, 0x7E000][sequence as usize % 2]], sequence));
            let held = read(&mut memory, Board::Dwm1001).unwrap();
            assert_eq!(held, Ok(Held { record: record.clone(), sequence, model: None }));
        }
        assert_eq!((memory.writes, memory.restarts), (vec![0x7E000, 0x7F000, 0x7E000], 3));
    }

    #[test]
    fn an_esp_gets_the_record_into_both_pages() {
        let (mut memory, records) = (Memory::default(), records());
        assert_eq!(write(&mut memory, Board::Esp32C3, &records[0], Some(&[1, 2])).unwrap(), (vec![0x9000, 0xA000], 1));
        assert_eq!(memory.pages[&0x9000], memory.pages[&0xA000]);
        assert_eq!(memory.pages[&0x9000][node_record::MODEL_AT..][..3], [1, 2, 0xFF]);
        assert_eq!(memory.restarts, 1);
    }

    #[test]
    fn flash_that_does_not_hold_is_said_and_the_old_record_stays() {
        let (mut memory, records) = (Memory::default(), records());
        write(&mut memory, Board::Evk1000, &records[0], None).unwrap();
        memory.worn = true;
        let error = write(&mut memory, Board::Evk1000, &records[1], None).expect_err("a bit is wrong");
        assert!(error.to_string().starts_with("the flash does not keep what was written at 0x0803F800"), "{error}");
        assert_eq!(read(&mut memory, Board::Evk1000).unwrap().unwrap().record, records[0]);
        assert_eq!(memory.restarts, 1);
    }

    #[test]
    fn probe_rs_knows_the_boards_chips() {
        for board in Board::ALL {
            assert!(knows(chip(board)), "{board:?}");
        }
    }
}
