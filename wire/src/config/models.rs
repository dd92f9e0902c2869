//! What a tag knows of beacons' RSSI values on the spot: a map of fingerprints and a model of rooms, in flash beside the record's pages.
//!
//! A region is a page's header with other letters, as [`decode`](crate::config::decode) has it for records, and [`StoredSiteModels`] in postcard:
//!
//! | offset | bytes | what |
//! |---|---|---|
//! | 0 | 4 | `BLZB` |
//! | 4 | 1 | [`MODELS_VERSION`] |
//! | 5 | 1 | 0 |
//! | 6 | 2 | length of the models, bytes |
//! | 8 | 4 | 0 |
//! | 12 | 4 | CRC-32 of the twelve bytes before and of the models |
//! | 16 | … | the models |
//!
//! There is one region. Its pages are written one after the other; the checksum is of all, so that a power cut leaves the models of
//! before, the new ones, or none that is believed. What the models themselves hold has checksums of its own.

use embedded_storage::nor_flash::ReadNorFlash;
use serde::{Deserialize, Serialize};

use crate::config::page::{Framed, HEADER_BYTES, Letters, parse, seal};
use crate::config::{LoadError, MAX_BEACONS};

/// The version of [`StoredSiteModels`]; a reader takes no other.
pub const MODELS_VERSION: u8 = 1;
/// Bytes of flash for them: a map of 200 points and 12 beacons with deviations takes 4056, a model of thirteen rooms and twelve beacons
/// 4120.
pub const MODELS_BYTES: usize = 8192;

const LETTERS: Letters = *b"BLZB";

/// What a tag knows of RSSI values on the spot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StoredSiteModels<'a> {
    /// A map, as `positioning_core::ble::fingerprint::Map` lays it out.
    #[serde(borrow)]
    pub map: Option<BeaconModel<'a>>,
    /// A model of rooms, as `positioning_core::ble::rooms::Model` lays it out.
    #[serde(borrow)]
    pub rooms: Option<BeaconModel<'a>>,
    /// What the rooms are called, a line each.
    pub room_names: &'a str,
}

/// A model, and whose RSSI values it is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BeaconModel<'a> {
    /// In the order of the model's scans: major and minor number, two bytes each, little-endian; at most [`MAX_BEACONS`] beacons.
    pub beacons: &'a [u8],
    /// The model.
    pub model: &'a [u8],
}

impl<'a> BeaconModel<'a> {
    /// Major and minor of the beacons, in their order.
    pub fn numbers(&self) -> impl Iterator<Item = (u16, u16)> + use<'a> {
        let of = |&[a, b, c, d]: &[u8; 4]| (u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d]));
        self.beacons.as_chunks::<4>().0.iter().map(of)
    }

    fn is_sane(&self) -> bool {
        self.beacons.len().is_multiple_of(4) && self.beacons.len() <= 4 * MAX_BEACONS
    }
}

/// The models as the beginning of a region; the rest of the buffer is 0xFF, as erased flash is. `None` where they do not fit.
pub fn encode_models<'b>(models: &StoredSiteModels<'_>, region: &'b mut [u8; MODELS_BYTES]) -> Option<&'b [u8]> {
    region.fill(0xFF);
    let (_, body) = region.split_at_mut(HEADER_BYTES);
    let length = postcard::to_slice(models, body).ok()?.len();
    Some(seal(Framed { letters: LETTERS, version: MODELS_VERSION, sequence: 0 }, length, region))
}

/// The models of a region.
///
/// # Errors
/// [`LoadError::Missing`]: it is erased; [`LoadError::Version`]: they are of another version; else [`LoadError::Corrupt`].
pub fn decode_models(region: &[u8]) -> Result<StoredSiteModels<'_>, LoadError> {
    let (header, body) = parse(LETTERS, region)?;
    if header.version != MODELS_VERSION {
        return Err(LoadError::Version(header.version));
    }
    match postcard::take_from_bytes::<StoredSiteModels<'_>>(body) {
        Ok((models, [])) if [models.map, models.rooms].iter().flatten().all(BeaconModel::is_sane) => Ok(models),
        Ok(_) | Err(_) => Err(LoadError::Corrupt),
    }
}

/// The same from a flash that is not in memory: `region` is filled and kept by the models. `at` counts from the flash's beginning.
///
/// # Errors
/// As [`decode_models`]; a flash that cannot be read is [`LoadError::Corrupt`].
pub fn load_models<'b>(
    flash: &mut impl ReadNorFlash,
    at: u32,
    region: &'b mut [u8; MODELS_BYTES],
) -> Result<StoredSiteModels<'b>, LoadError> {
    flash.read(at, region).map_err(|_| LoadError::Corrupt)?;
    decode_models(region)
}
