//! Which page is in force, and which is written next.

use baliza_wire::config::{
    LoadError, MAX_BYTES, MODEL_AT, MODEL_BYTES, Next, Record, StoreError, VERSION, encode, load, load_model, model_of,
    newest, next, store,
};

use super::examples::{anchor, beacon, longest, tag};
use super::flash::{Failed, Flash};

type Nrf = Flash<4, 4096>;

fn with(first: Option<(&Record, u32)>, second: Option<(&Record, u32)>) -> Nrf {
    let mut flash = Nrf::erased();
    for (page, record) in Nrf::PAGES.into_iter().zip([first, second]) {
        if let Some((record, sequence)) = record {
            let mut buffer = [0; MAX_BYTES];
            encode(record, sequence, &mut buffer);
            flash.bytes[page as usize..][..MAX_BYTES].copy_from_slice(&buffer);
        }
    }
    flash
}

#[test]
fn pages_take_turns() {
    let mut flash = Nrf::erased();
    assert_eq!(load(&mut flash, Nrf::PAGES), Err(LoadError::Missing));
    for (turn, record) in [anchor(), tag(), beacon(), longest(), anchor()].iter().enumerate() {
        let other = flash.page(1 - turn % 2).to_vec();
        store(&mut flash, Nrf::PAGES, record).unwrap();
        assert_eq!(load(&mut flash, Nrf::PAGES), Ok(record.clone()));
        assert_eq!(flash.page(1 - turn % 2), other, "the other page is as it was");
        let sequence = turn as u32 + 1;
        assert_eq!(newest([flash.page(0), flash.page(1)]), Ok((turn % 2, record.clone(), sequence)));
    }
    // Nothing beside the two pages was touched.
    assert!(flash.bytes[..4096].iter().chain(&flash.bytes[8192..12_288]).all(|byte| *byte == 0xFF));
}

#[test]
fn a_classifier_goes_with_its_record() {
    let mut model = [0; MODEL_BYTES];
    assert_eq!(load_model(&mut Nrf::erased(), Nrf::PAGES, &mut model), Err(LoadError::Missing));
    // A record without a classifier has none.
    let mut flash = with(Some((&tag(), 3)), Some((&tag(), 4)));
    assert_eq!(load_model(&mut flash, Nrf::PAGES, &mut model), Ok(None));
    for (page, byte) in Nrf::PAGES.into_iter().zip([b'a', b'b']) {
        flash.bytes[page as usize + MODEL_AT..][..5].fill(byte);
    }
    let mut expected = [0xFF; MODEL_BYTES];
    expected[..5].fill(b'b');
    assert_eq!(load_model(&mut flash, Nrf::PAGES, &mut model), Ok(Some(&expected[..])));
    assert_eq!(model_of(flash.page(1)), Some(&expected[..]));
    assert_eq!(load(&mut flash, Nrf::PAGES), Ok(tag()), "the record does not mind it");
    // The classifier of a damaged page does not count; a new record takes the whole page.
    flash.bytes[Nrf::PAGES[1] as usize + 20] ^= 4;
    assert_eq!(load_model(&mut flash, Nrf::PAGES, &mut model).map(|model| model.map(|model| model[0])), Ok(Some(b'a')));
    store(&mut flash, Nrf::PAGES, &anchor()).unwrap();
    assert_eq!(load_model(&mut flash, Nrf::PAGES, &mut model), Ok(None));
    // The part of a page that was read.
    let page = flash.page(0);
    assert_eq!(model_of(&page[..MODEL_AT + 3]), Some(&b"aaa"[..]));
    assert_eq!((model_of(&page[..MODEL_AT]), model_of(&[])), (None, None));
}

#[test]
fn the_later_page_counts_across_the_wrap() {
    for (first, second, newer) in
        [(1, 2, 1), (2, 1, 0), (u32::MAX, 0, 1), (0, u32::MAX, 0), (5, 5, 0), (0x8000_0000, 1, 0)]
    {
        let mut flash = with(Some((&anchor(), first)), Some((&tag(), second)));
        let (record, sequence) = [(anchor(), first), (tag(), second)][newer].clone();
        assert_eq!(load(&mut flash, Nrf::PAGES), Ok(record), "{first}, {second}");
        let expected = Next { page: 1 - newer, sequence: sequence.wrapping_add(1) };
        assert_eq!(next([flash.page(0), flash.page(1)]), expected, "{first}, {second}");
        store(&mut flash, Nrf::PAGES, &beacon()).unwrap();
        assert_eq!(load(&mut flash, Nrf::PAGES), Ok(beacon()), "{first}, {second}");
    }
}

#[test]
fn a_damaged_page_leaves_the_other() {
    let mut flash = with(Some((&anchor(), 8)), Some((&tag(), 9)));
    flash.bytes[Nrf::PAGES[1] as usize + 20] ^= 4;
    assert_eq!(load(&mut flash, Nrf::PAGES), Ok(anchor()));
    // This page is also the one that is written next.
    store(&mut flash, Nrf::PAGES, &beacon()).unwrap();
    assert_eq!(newest([flash.page(0), flash.page(1)]), Ok((1, beacon(), 9)));
    flash.bytes[Nrf::PAGES[0] as usize] ^= 4;
    flash.bytes[Nrf::PAGES[1] as usize] ^= 4;
    assert_eq!(load(&mut flash, Nrf::PAGES), Err(LoadError::Corrupt));
    let mut lone = with(None, Some((&tag(), 9)));
    assert_eq!(load(&mut lone, Nrf::PAGES), Ok(tag()));
    lone.bytes[Nrf::PAGES[1] as usize + 20] ^= 4;
    assert_eq!(load(&mut lone, Nrf::PAGES), Err(LoadError::Corrupt), "there was one");
}

#[test]
fn a_later_record_of_another_version_is_not_passed_over() {
    let mut flash = with(Some((&anchor(), 1)), Some((&tag(), 2)));
    let page = Nrf::PAGES[1] as usize;
    // CRC-32 by its definition, bit by bit, without the final inversion.
    let seal = |bytes: &[u8]| {
        bytes.iter().fold(u32::MAX, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
        })
    };
    flash.bytes[page + 4] = VERSION + 1;
    let length = usize::from(flash.bytes[page + 6]);
    let covered = [&flash.bytes[page..page + 12], &flash.bytes[page + 16..page + 16 + length]].concat();
    let checksum = !seal(&covered);
    flash.bytes[page + 12..page + 16].copy_from_slice(&checksum.to_le_bytes());
    // The later page is of an unknown version, and the earlier one is outdated: the node must report it.
    assert_eq!(load(&mut flash, Nrf::PAGES), Err(LoadError::Version(VERSION + 1)));
    // The next record takes the other page, and is in force.
    store(&mut flash, Nrf::PAGES, &beacon()).unwrap();
    assert_eq!(newest([flash.page(0), flash.page(1)]), Ok((0, beacon(), 3)));
}

#[test]
fn a_record_that_cannot_be_done_is_not_stored() {
    let mut flash = with(Some((&anchor(), 1)), None);
    let before = flash.bytes.clone();
    let mut record = tag();
    record.identity.address = Some(0xFFFF);
    let refused = store(&mut flash, Nrf::PAGES, &record);
    assert!(matches!(refused, Err(StoreError::Invalid(invalid)) if invalid.field == "identity.address"));
    assert_eq!(flash.bytes, before);
}

#[test]
fn flash_that_does_not_hold_is_noticed() {
    /// A bit of the key, 0xAB, is stuck at 0.
    struct Stuck(Nrf);
    use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
    impl ErrorType for Stuck {
        type Error = Failed;
    }
    impl ReadNorFlash for Stuck {
        const READ_SIZE: usize = 4;
        fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Failed> {
            self.0.read(offset, bytes)?;
            if let Some(byte) = (Nrf::PAGES[0] + 120).checked_sub(offset).and_then(|at| bytes.get_mut(at as usize)) {
                *byte &= 0xFE;
            }
            Ok(())
        }
        fn capacity(&self) -> usize {
            self.0.capacity()
        }
    }
    impl NorFlash for Stuck {
        const WRITE_SIZE: usize = 4;
        const ERASE_SIZE: usize = 4096;
        fn erase(&mut self, from: u32, to: u32) -> Result<(), Failed> {
            self.0.erase(from, to)
        }
        fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Failed> {
            self.0.write(offset, bytes)
        }
    }
    assert_eq!(store(&mut Stuck(Nrf::erased()), Nrf::PAGES, &beacon()), Err(StoreError::Verify));
}

#[test]
fn pages_beyond_the_flash_are_an_error() {
    let mut flash = Nrf::erased();
    assert_eq!(load(&mut flash, [0x10_0000, 0x10_1000]), Err(LoadError::Corrupt));
    assert!(matches!(store(&mut flash, [0x10_0000, 0x10_1000], &tag()), Err(StoreError::Flash(_))));
}
