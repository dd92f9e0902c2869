//! Writes a record to a board's flash over a debug probe, and reads it back.
//!
//! Both pages are read, and the page that is not in use is written, as the node itself does it. Then the page is read
//! back and compared, and the node is restarted. The flash of an ESP is not in the chip's memory, so that probes write
//! it without reading it. There the record is written to both pages, one after the other, and the chip compares it. A
//! tag's RSSI models are written before its record. Where the file has no models, the models in flash are removed.

use anyhow::{Context, Result, bail};
use wire::config::{Board, LoadError, MODELS_BYTES, Next, Role, next};

use super::firmware::Firmware;
use super::image::{self, Contents, Held};

/// A chip's flash, in complete pages.
pub trait Flash {
    /// Reads bytes from an address on.
    ///
    /// # Errors
    /// The probe returns an error.
    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<()>;

    /// Erases a page and writes it. The flash's own check finds bytes that were not written correctly.
    ///
    /// # Errors
    /// The probe returns an error.
    fn write_page(&mut self, address: u32, page: &[u8]) -> Result<()>;

    /// Writes an image and verifies it. Calls `progress` with the work that is done and all of it, bytes.
    ///
    /// # Errors
    /// The image is not for the chip, the probe returns an error, or the flash does not keep the written bytes.
    fn write_image(&mut self, image: &Firmware, progress: &mut dyn FnMut(u64, u64)) -> Result<()>;

    /// Restarts the node.
    ///
    /// # Errors
    /// The probe returns an error.
    fn restart(&mut self) -> Result<()>;
}

/// Writes the content of a node's flash, and restarts the node. Returns the addresses of the record's pages that were
/// written, and the record's sequence number.
///
/// # Errors
/// The probe returns an error, or the flash does not keep the written bytes.
pub fn write(flash: &mut (impl Flash + ?Sized), board: Board, contents: &Contents<'_>) -> Result<(Vec<u32>, u32)> {
    write_site_models(flash, board, contents)?;
    let addresses = board.pages().addresses();
    let (written, sequence) = if board.spec().flasher.is_readable() {
        let pages = read_pages(flash, board)?;
        let Next { page: which, sequence } = next([&pages[0], &pages[1]]);
        let image = contents.page(board, sequence);
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
            let image = contents.page(board, sequence);
            flash.write_page(address, &image).with_context(|| format!("cannot write the flash at 0x{address:X}"))?;
        }
        (addresses.to_vec(), sequence)
    };
    flash.restart().context("the record is written, but the node could not be restarted: reset it by hand")?;
    Ok((written, sequence))
}

/// Writes a tag's RSSI models, page by page. Without models, only the first page is erased, which makes the stored
/// models invalid. A page that is correct already is not written.
fn write_site_models(flash: &mut (impl Flash + ?Sized), board: Board, contents: &Contents<'_>) -> Result<()> {
    let (Some(address), Role::Tag(_)) = (board.pages().models_address(), &contents.record.role) else { return Ok(()) };
    let size = board.pages().size as usize;
    let mut region = contents.site_models.unwrap_or_default().to_vec();
    // The region is invalid without its first page.
    region.resize(if region.is_empty() { size } else { MODELS_BYTES }, 0xFF);
    let before = if board.spec().flasher.is_readable() { read_site_models(flash, board)? } else { Vec::new() };
    let mut wrote = false;
    for (index, page) in region.chunks(size).enumerate() {
        if before.chunks(size).nth(index) != Some(page) {
            let at = address + (index * size) as u32;
            flash.write_page(at, page).with_context(|| format!("cannot write the flash at 0x{at:08X}"))?;
            wrote = true;
        }
    }
    if wrote && board.spec().flasher.is_readable() && !read_site_models(flash, board)?.starts_with(&region) {
        bail!("the flash does not keep what was written at 0x{address:08X}: the map and the rooms of before are gone");
    }
    Ok(())
}

/// Reads the newest valid record.
///
/// # Errors
/// The probe returns an error.
pub fn read(flash: &mut (impl Flash + ?Sized), board: Board) -> Result<Result<Held, LoadError>> {
    let (pages, site_models) = (read_pages(flash, board)?, read_site_models(flash, board)?);
    Ok(image::held([&pages[0], &pages[1]], &site_models))
}

/// The region of the RSSI models; empty where the board has none.
fn read_site_models(flash: &mut (impl Flash + ?Sized), board: Board) -> Result<Vec<u8>> {
    let Some(address) = board.pages().models_address() else { return Ok(Vec::new()) };
    let mut region = vec![0; MODELS_BYTES];
    flash.read(address, &mut region).with_context(|| format!("cannot read the flash at 0x{address:08X}"))?;
    Ok(region)
}

fn read_pages(flash: &mut (impl Flash + ?Sized), board: Board) -> Result<[Vec<u8>; 2]> {
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
    use crate::provision::{EXAMPLE, Site};
    use std::collections::BTreeMap;
    use wire::config::{BeaconModel, Record, StoredSiteModels, decode_models, encode_models};

    #[derive(Clone, Default)]
    struct Memory {
        pages: BTreeMap<u32, Vec<u8>>,
        writes: Vec<u32>,
        restarts: usize,
        /// The flash changes a bit of each written page.
        worn: bool,
        /// After this number of pages the power fails, within the next page.
        power: Option<usize>,
    }

    impl Flash for Memory {
        fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<()> {
            bytes.fill(0xFF);
            for (at, page) in self.pages.range(address..address + bytes.len() as u32) {
                let from = (at - address) as usize;
                bytes[from..from + page.len()].copy_from_slice(page);
            }
            Ok(())
        }

        fn write_page(&mut self, address: u32, page: &[u8]) -> Result<()> {
            if self.power == Some(self.writes.len()) {
                // The page is erased, and half of it is written.
                self.pages.insert(address, [&page[..page.len() / 2], &vec![0xFF; page.len() / 2]].concat());
                bail!("no power");
            }
            let mut page = page.to_vec();
            page[40] ^= u8::from(self.worn);
            self.pages.insert(address, page);
            self.writes.push(address);
            Ok(())
        }

        fn write_image(&mut self, _: &Firmware, _: &mut dyn FnMut(u64, u64)) -> Result<()> {
            bail!("these tests write records")
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

    fn of(record: &Record) -> Contents<'_> {
        Contents { record, model: None, site_models: None, wifi: None }
    }

    /// Models that fill more than a page with this byte.
    fn site_models(byte: u8) -> Vec<u8> {
        let map = Some(BeaconModel { beacons: &[], model: &[byte; 5000] });
        let models = StoredSiteModels { map, ..StoredSiteModels::default() };
        encode_models(&models, &mut [0; MODELS_BYTES]).expect("they fit").to_vec()
    }

    /// The byte of the models that a node would read from its flash.
    fn taken(memory: &mut Memory, board: Board) -> Result<u8, LoadError> {
        let mut region = vec![0; MODELS_BYTES];
        memory.read(board.pages().models_address().expect("it has Bluetooth"), &mut region).unwrap();
        decode_models(&region).map(|models| models.map.map_or(0, |map| map.model[0]))
    }

    #[test]
    fn a_tags_models_go_with_its_record_and_go_when_it_has_none() {
        let records = records();
        let (anchor, tag) = (&records[0], &records[4]);
        let site_models = site_models(7);
        for (board, at) in [(Board::Dwm1001, 0x7C000), (Board::Esp32C6, 0xB000)] {
            let mut memory = Memory::default();
            write(&mut memory, board, &Contents { site_models: Some(&site_models), ..of(tag) }).unwrap();
            assert_eq!((taken(&mut memory, board), &memory.writes[..2]), (Ok(7), &[at, at + 0x1000][..]));
            if board.spec().flasher.is_readable() {
                let held = read(&mut memory, board).unwrap().unwrap();
                assert!(held.site_models.is_some_and(|region| region.starts_with(&site_models)));
                // Content that is correct already is not written again.
                memory.writes.clear();
                write(&mut memory, board, &Contents { site_models: Some(&site_models), ..of(tag) }).unwrap();
                assert_eq!(memory.writes, [0x7F000]);
            }
            write(&mut memory, board, &of(tag)).unwrap();
            assert_eq!(taken(&mut memory, board), Err(LoadError::Missing));
            // An anchor has no Bluetooth, so its region is not changed.
            memory.writes.clear();
            write(&mut memory, board, &of(anchor)).unwrap();
            assert!(memory.writes.iter().all(|address| board.pages().addresses().contains(address)));
        }
    }

    #[test]
    fn a_power_cut_at_any_page_leaves_the_models_of_before_or_the_new_ones_or_none() {
        let records = records();
        let (tag, old, new) = (&records[4], site_models(1), site_models(2));
        for board in [Board::Dwm1001, Board::Esp32C3] {
            let mut memory = Memory::default();
            write(&mut memory, board, &Contents { site_models: Some(&old), ..of(tag) }).unwrap();
            for site_models in [Some(new.as_slice()), None] {
                let mut pages = 0;
                loop {
                    let mut cut = memory.clone();
                    cut.power = Some(memory.writes.len() + pages);
                    if write(&mut cut, board, &Contents { site_models, ..of(tag) }).is_ok() {
                        break;
                    }
                    let found = taken(&mut cut, board);
                    let fine = matches!(found, Ok(1 | 2) | Err(LoadError::Missing | LoadError::Corrupt));
                    assert!(fine, "{board:?}, after {pages} pages: {found:?}");
                    pages += 1;
                }
                assert!(pages >= 2, "{board:?}: {pages} pages");
            }
        }
    }

    #[test]
    fn pages_take_turns() {
        let (mut memory, records) = (Memory::default(), records());
        let missing = read(&mut memory, Board::Dwm1001).unwrap();
        assert_eq!(missing, Err(LoadError::Missing));
        for (sequence, record) in (1..).zip(&records[..3]) {
            let written = write(&mut memory, Board::Dwm1001, &of(record)).unwrap();
            assert_eq!(written, (vec![[0x7F000, 0x7E000][sequence as usize % 2]], sequence));
            let held = read(&mut memory, Board::Dwm1001).unwrap();
            let held = held.expect("a record");
            assert_eq!((&held.record, held.version, held.sequence, held.model), (record, 2, sequence, None));
        }
        assert_eq!((memory.writes, memory.restarts), (vec![0x7E000, 0x7F000, 0x7E000], 3));
    }

    #[test]
    fn an_esp_gets_the_record_into_both_pages() {
        let (mut memory, records) = (Memory::default(), records());
        assert_eq!(
            write(&mut memory, Board::Esp32C3, &Contents { model: Some(&[1, 2]), ..of(&records[0]) }).unwrap(),
            (vec![0x9000, 0xA000], 1)
        );
        assert_eq!(memory.pages[&0x9000], memory.pages[&0xA000]);
        assert_eq!(memory.pages[&0x9000][wire::config::MODEL_AT..][..3], [1, 2, 0xFF]);
        assert_eq!(memory.restarts, 1);
    }

    #[test]
    fn flash_that_does_not_keep_what_is_written_is_an_error_and_the_old_record_stays() {
        let (mut memory, records) = (Memory::default(), records());
        write(&mut memory, Board::Evk1000, &of(&records[0])).unwrap();
        memory.worn = true;
        let error = write(&mut memory, Board::Evk1000, &of(&records[1])).expect_err("a bit is wrong");
        assert!(error.to_string().starts_with("the flash does not keep what was written at 0x0803F800"), "{error}");
        assert_eq!(read(&mut memory, Board::Evk1000).unwrap().unwrap().record, records[0]);
        assert_eq!(memory.restarts, 1);
    }
}
