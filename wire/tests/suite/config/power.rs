//! The power fails at any moment of writing.

use baliza_wire::config::{LoadError, Record, load, store};

use super::examples::{anchor, beacon, tag};
use super::flash::Flash;

/// Cuts the power within each operation of a store. The old record or the new one is whole, and the next store works.
fn every_cut<const WORD: usize, const PAGE: usize>(flash: &Flash<WORD, PAGE>, old: Result<Record, LoadError>) {
    let pages = Flash::<WORD, PAGE>::PAGES;
    let new = beacon();
    let mut uncut = flash.clone();
    uncut.operations = 0;
    store(&mut uncut, pages, &new).unwrap();
    // One page erased, 16 + 116 bytes written.
    assert_eq!(uncut.operations, 1 + 132_usize.div_ceil(WORD));

    for operation in 0..uncut.operations {
        for seed in 0..20 {
            let mut cut = flash.cut_at(operation, seed);
            assert!(store(&mut cut, pages, &new).is_err());
            let mut cut = cut.powered();
            let kept = load(&mut cut, pages);
            let name = format!("words of {WORD}, cut within operation {operation}, {seed}");
            // A half-written last word may have all its bits.
            let done = operation == uncut.operations - 1 && kept.as_ref() == Ok(&new);
            match &old {
                Ok(_) => assert!(kept == old || done, "{name}: {kept:?}"),
                Err(_) => {
                    assert!(matches!(kept, Err(LoadError::Missing | LoadError::Corrupt)) || done, "{name}: {kept:?}")
                }
            }
            store(&mut cut, pages, &tag()).unwrap();
            assert_eq!(load(&mut cut, pages), Ok(tag()), "{name}");
        }
    }
}

fn every_cut_of_every_state<const WORD: usize, const PAGE: usize>() {
    let mut flash = Flash::<WORD, PAGE>::erased();
    every_cut(&flash, Err(LoadError::Missing));
    store(&mut flash, Flash::<WORD, PAGE>::PAGES, &anchor()).unwrap();
    every_cut(&flash, Ok(anchor()));
    store(&mut flash, Flash::<WORD, PAGE>::PAGES, &tag()).unwrap();
    every_cut(&flash, Ok(tag()));
}

#[test]
fn a_power_cut_leaves_the_old_record_or_the_new_one() {
    // STM32F105; nRF52832 and the ESPs; a flash with words of 16 bytes.
    every_cut_of_every_state::<2, 2048>();
    every_cut_of_every_state::<4, 4096>();
    every_cut_of_every_state::<16, 4096>();
}
