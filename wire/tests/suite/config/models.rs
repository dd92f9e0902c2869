//! Models of the beacons' RSSI: their bytes, and what remains of them after a power failure.

use baliza_wire::config::{
    BeaconModel, LoadError, MODELS_BYTES, StoredSiteModels, decode_models, encode_models, load_models,
};
use embedded_storage::nor_flash::NorFlash;

use super::flash::Flash;

/// Beacons 1-7 and 300-2.
const BEACONS: [u8; 8] = [1, 0, 7, 0, 44, 1, 2, 0];

fn models(map: &[u8]) -> StoredSiteModels<'_> {
    StoredSiteModels {
        map: Some(BeaconModel { beacons: &BEACONS, model: map }),
        rooms: Some(BeaconModel { beacons: &BEACONS[..4], model: b"RM" }),
        room_names: "hall\nattic",
    }
}

fn encoded(models: &StoredSiteModels<'_>) -> Vec<u8> {
    let mut region = [0; MODELS_BYTES];
    encode_models(models, &mut region).expect("they fit").to_vec()
}

/// CRC-32 by its definition, bit by bit.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
    })
}

#[test]
fn the_bytes_are_these() {
    // By the postcard specification: 01 (some), the length of the beacons, the beacons, the length of the model, the
    // model; the same for rooms; the length of the names, the names.
    let mut body = vec![1, 8];
    body.extend(BEACONS);
    body.extend([3, b'F', b'M', 9, 1, 4, 1, 0, 7, 0, 2, b'R', b'M', 10]);
    body.extend(b"hall\nattic");
    let mut expected = vec![b'B', b'L', b'Z', b'B', 1, 0, body.len() as u8, 0, 0, 0, 0, 0];
    let checksum = crc(&[expected.as_slice(), &body].concat());
    expected.extend(checksum.to_le_bytes());
    expected.extend(&body);
    assert_eq!(encoded(&models(b"FM\x09")), expected);
    let back = decode_models(&expected).expect("decoded");
    assert_eq!(back, models(b"FM\x09"));
    assert_eq!(back.map.expect("a map").numbers().collect::<Vec<_>>(), [(1, 7), (300, 2)]);
}

#[test]
fn none_too_long_other_and_damaged_ones_are_told_apart() {
    assert_eq!(decode_models(&[0xFF; MODELS_BYTES]), Err(LoadError::Missing));
    assert_eq!(decode_models(&[]), Err(LoadError::Missing));
    let whole = encoded(&models(b"FM"));
    for bit in 0..8 * whole.len() {
        let mut flipped = whole.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        assert!(decode_models(&flipped).is_err(), "bit {bit}");
    }
    for length in 1..whole.len() {
        assert_eq!(decode_models(&whole[..length]), Err(LoadError::Corrupt), "{length} bytes");
    }
    let resealed = |at: usize, value: u8| {
        let mut bytes = whole.clone();
        bytes[at] = value;
        let covered = [&bytes[..12], &bytes[16..]].concat();
        bytes[12..16].copy_from_slice(&crc(&covered).to_le_bytes());
        decode_models(&bytes).map(drop)
    };
    assert_eq!(resealed(4, 9), Err(LoadError::Version(9)));
    assert_eq!(resealed(17, 7), Err(LoadError::Corrupt), "half a beacon");
    assert_eq!(resealed(0, b'X'), Err(LoadError::Corrupt), "another's letters");
    let (many, long) = ([0; 4 * 25], [0; MODELS_BYTES]);
    let of =
        |beacons, model| StoredSiteModels { map: Some(BeaconModel { beacons, model }), ..StoredSiteModels::default() };
    assert_eq!(decode_models(&encoded(&of(&many, &[]))), Err(LoadError::Corrupt), "more beacons than a tag knows");
    assert_eq!(encode_models(&of(&[], &long), &mut [0; MODELS_BYTES]), None);
}

#[test]
fn a_flash_is_read_into_memory() {
    let mut flash = Flash::<4, 4096>::erased();
    let bytes = encoded(&models(b"FM"));
    flash.bytes[8192..][..bytes.len()].copy_from_slice(&bytes);
    let mut region = [0; MODELS_BYTES];
    assert_eq!(load_models(&mut flash, 8192, &mut region), Ok(models(b"FM")));
    assert_eq!(load_models(&mut flash, 0, &mut region), Err(LoadError::Missing));
    assert_eq!(load_models(&mut flash, 12_288, &mut region), Err(LoadError::Corrupt), "beyond its end");
}

/// Writes a region as a flasher does: page by page, each erased and then written.
fn write<const WORD: usize, const PAGE: usize>(flash: &mut Flash<WORD, PAGE>, bytes: &[u8]) -> Result<(), ()> {
    let mut region = [0xFF; MODELS_BYTES];
    region[..bytes.len()].copy_from_slice(bytes);
    for (index, page) in region.chunks(PAGE).enumerate() {
        let at = (index * PAGE) as u32;
        flash.erase(at, at + PAGE as u32).map_err(drop)?;
        flash.write(at, page).map_err(drop)?;
    }
    Ok(())
}

#[test]
fn a_power_cut_leaves_the_models_of_before_or_the_new_ones_or_none() {
    // More than one page each.
    let maps = [vec![0x5A; 5000], vec![0xA5; 4500]];
    let [old, new] = maps.each_ref().map(|map| encoded(&models(map)));
    for (before, after) in [(&[][..], new.as_slice()), (&old, &new), (&old, &[])] {
        let mut flash = Flash::<16, 4096>::erased();
        write(&mut flash, before).unwrap();
        let mut uncut = flash.clone().powered();
        write(&mut uncut, after).unwrap();
        assert_eq!(uncut.operations, 2 + MODELS_BYTES / 16);
        let (mut kept, mut none) = (0, 0);
        for operation in 0..uncut.operations {
            let mut cut = flash.cut_at(operation, operation as u64);
            assert_eq!(write(&mut cut, after), Err(()));
            match decode_models(&cut.bytes[..MODELS_BYTES]) {
                Ok(models) => {
                    let map = models.map.expect("whole").model;
                    assert!(maps.iter().any(|whole| whole == map), "within operation {operation}");
                    kept += 1;
                }
                Err(fault) => {
                    assert!(matches!(fault, LoadError::Missing | LoadError::Corrupt), "{fault:?}");
                    none += 1;
                }
            }
        }
        // Erased cells at the end are written last and change nothing.
        assert!(none > 0 && (after.is_empty() || kept > 0), "{kept} kept, {none} none");
    }
}
