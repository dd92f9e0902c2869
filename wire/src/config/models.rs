//! A tag's models of the beacons' RSSI at the site: a map of fingerprints and a model of rooms, in flash beside the
//! config record's pages.
//!
//! A region is a page's header with other letters, as [`decode`](crate::config::decode) reads it for config records,
//! and [`StoredSiteModels`] in postcard:
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
//! There is one region. Its pages are written one after the other, and the checksum covers all of them. So a power cut
//! leaves the former models, the new ones, or none with a valid checksum. The contents of the models have their own
//! checksums.

use embedded_storage::nor_flash::ReadNorFlash;
use serde::{Deserialize, Serialize};

use crate::config::page::{Framed, HEADER_BYTES, Letters, parse, seal};
use crate::config::{LoadError, MAX_BEACONS};

/// The version of [`StoredSiteModels`]; a reader accepts no other.
pub const MODELS_VERSION: u8 = 1;
/// Bytes of flash for the models: a map of 200 points and 12 beacons with deviations takes 4056, a model of thirteen
/// rooms and twelve beacons 4120.
pub const MODELS_BYTES: usize = 8192;

const LETTERS: Letters = *b"BLZB";

/// A tag's models of the RSSI values at the site.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StoredSiteModels<'a> {
    /// A map, in the layout of `positioning_core::ble::fingerprint::Map`.
    #[serde(borrow)]
    pub map: Option<BeaconModel<'a>>,
    /// A model of rooms, in the layout of `positioning_core::ble::rooms::Model`.
    #[serde(borrow)]
    pub rooms: Option<BeaconModel<'a>>,
    /// The names of the rooms, one for each line.
    pub room_names: &'a str,
}

/// A model, and the beacons to which its RSSI values belong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BeaconModel<'a> {
    /// In the order of the model's scans: major and minor number, two bytes each, little-endian; at most
    /// [`MAX_BEACONS`] beacons.
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

/// The models as the beginning of a region; the rest of the buffer is 0xFF, as in erased flash. `None` if they do not
/// fit.
pub fn encode_models<'b>(models: &StoredSiteModels<'_>, region: &'b mut [u8; MODELS_BYTES]) -> Option<&'b [u8]> {
    region.fill(0xFF);
    let (_, body) = region.split_at_mut(HEADER_BYTES);
    let length = postcard::to_slice(models, body).ok()?.len();
    Some(seal(Framed { letters: LETTERS, version: MODELS_VERSION, sequence: 0 }, length, region))
}

/// The models of a region.
///
/// # Errors
/// [`LoadError::Missing`] if it is erased, [`LoadError::Version`] if the models are of another version, else
/// [`LoadError::Corrupt`].
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

/// The same from a flash that is not in memory: the models are read into `region` and borrow it. `at` counts from the
/// flash's beginning.
///
/// # Errors
/// As [`decode_models`]; a flash that cannot be read gives [`LoadError::Corrupt`].
pub fn load_models<'b>(
    flash: &mut impl ReadNorFlash,
    at: u32,
    region: &'b mut [u8; MODELS_BYTES],
) -> Result<StoredSiteModels<'b>, LoadError> {
    flash.read(at, region).map_err(|_| LoadError::Corrupt)?;
    decode_models(region)
}
