//! A page of flash with a config record: its bytes.
//!
//! | offset | bytes | what |
//! |---|---|---|
//! | 0 | 4 | `BLZR` |
//! | 4 | 1 | [`VERSION`] of the record |
//! | 5 | 1 | 0 |
//! | 6 | 2 | length of the record, bytes |
//! | 8 | 4 | sequence number, wrapping: of two pages the later one counts |
//! | 12 | 4 | CRC-32 (ISO-HDLC, that of Ethernet) of the twelve bytes before and of the record |
//! | 16 | … | the record in postcard |
//!
//! | 1280 | 400 | [`MODEL_AT`]: a tag's trained classifier of line of sight, with its own checksum, or erased |
//! | 1680 | 240 | [`WIFI_AT`](crate::config::WIFI_AT): how a node with Wi-Fi reaches its station, with its own checksum, or erased |
//!
//! Version 2 is version 1 with [`Appended`] after the record's fields, and zeros for a reply delay that is not pinned.
//! Version 3 is version 2 with [`Limits`] after that, and version 4 is version 3 with the network's key after that (16
//! bytes). A record is written in the least version that has its fields, which older images read.
//! Numbers are little-endian. The rest of the page is erased, 0xFF. The header stays the same in all versions, so that
//! a reader can recognise an unknown version.

use crc::{CRC_32_ISO_HDLC, Crc, Table};
use serde::{Deserialize, Serialize};

use crate::config::{Invalid, Record, Region, ReplyDelay, Role, Scheme, Solver, TagArea, VERSION};
use crate::serial_number::SerialNumber;

/// Room for a config record in its page, bytes; the rest of the page is left erased.
pub const MAX_BYTES: usize = 1280;
/// The offset of a tag's trained classifier of line of sight, in the layout of `positioning_core::nlos::Model`. The
/// field is optional: without a classifier this flash is erased, and the record is the same.
pub const MODEL_AT: usize = MAX_BYTES;
/// Room for a classifier, bytes: the largest perceptron in bytes takes 389.
pub const MODEL_BYTES: usize = 400;
/// Bytes before the record.
pub const HEADER_BYTES: usize = 16;

/// The version from which on a record has [`Limits`], …
const LIMITS_VERSION: u8 = 3;
/// … and the one with the network's key.
const KEY_VERSION: u8 = VERSION;

/// The fields that version 2 has after those of version 1, in records of every role.
#[derive(Clone, Copy, Default, Serialize, Deserialize)]
struct Appended {
    region: Option<Region>,
    solver: Solver,
    scheme: Option<Scheme>,
}

impl Appended {
    fn of(record: &Record) -> Self {
        let region = record.network.region;
        match &record.role {
            Role::Tag(tag) => Self { region, solver: tag.solver, scheme: tag.scheme },
            Role::Anchor { position_m: _ } | Role::Advertiser(_) | Role::Scanner => Self { region, ..Self::default() },
        }
    }

    fn put_into(self, record: &mut Record) {
        record.network.region = self.region;
        match &mut record.role {
            Role::Tag(tag) => (tag.solver, tag.scheme) = (self.solver, self.scheme),
            Role::Anchor { position_m: _ } | Role::Advertiser(_) | Role::Scanner => (),
        }
    }
}

/// What version 3 has after the fields of version 2, of a tag: the deviation of its height, and the least and the greatest
/// coordinates of its area, `f32`. All zeros: neither is known. As numbers of equal size they are read without a parser,
/// whose code would cost more flash than they do.
type Limits = [f32; 7];

fn limits_of(record: &Record) -> Limits {
    let Role::Tag(tag) = &record.role else { return [0.0; 7] };
    let [least_m, greatest_m] = tag.area.map_or([[0.0; 3]; 2], |area| [area.least_m, area.greatest_m]);
    let ([x0, y0, z0], [x1, y1, z1]) = (least_m, greatest_m);
    [tag.height_sigma_m, x0, y0, z0, x1, y1, z1]
}

fn put_limits(bytes: &[u8; size_of::<Limits>()], record: &mut Record) {
    let Role::Tag(tag) = &mut record.role else { return };
    let mut numbers: Limits = [0.0; 7];
    for (number, bytes) in numbers.iter_mut().zip(bytes.as_chunks().0) {
        *number = f32::from_le_bytes(*bytes);
    }
    let [sigma_m, x0, y0, z0, x1, y1, z1] = numbers;
    tag.height_sigma_m = sigma_m;
    let area = TagArea { least_m: [x0, y0, z0], greatest_m: [x1, y1, z1] };
    tag.area = (area.least_m != area.greatest_m).then_some(area);
}

/// The first bytes of a page: they identify its format.
pub(crate) type Letters = [u8; 4];

const LETTERS: Letters = *b"BLZR";
/// Computed bit by bit: a page is checked twice at each start, which is not worth a table of 1 KiB.
const CRC: Crc<u32, Table<0>> = Crc::<u32, Table<0>>::new(&CRC_32_ISO_HDLC);

/// Why there is no config record.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LoadError {
    /// There is none: the flash is erased.
    Missing,
    /// It is whole, but of this version, which is not one from 1 to [`VERSION`].
    Version(u8),
    /// Its checksum is wrong, it is cut short, or it is something else.
    Corrupt,
    /// It is whole, but a value in it is invalid.
    Invalid(Invalid),
}

impl core::fmt::Display for LoadError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Missing => f.write_str("there is no record: the flash is erased"),
            Self::Version(version) => {
                write!(f, "the record is of version {version}, this program reads versions 1 to {VERSION}")
            }
            Self::Corrupt => f.write_str("the record is damaged or cut short: its checksum is wrong"),
            Self::Invalid(invalid) => write!(f, "the record is whole, but {invalid}"),
        }
    }
}

impl core::error::Error for LoadError {}

/// The header of a whole page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Header {
    pub(crate) version: u8,
    /// The later number is greater, across the wrap.
    pub(crate) sequence: u32,
}

impl Header {
    /// Whether its page was written after the other.
    pub(crate) const fn is_later_than(self, other: Self) -> bool {
        // A store writes both pages in turn: their numbers are one apart.
        SerialNumber(self.sequence).minus(other.sequence) > 0
    }
}

/// The config record as the beginning of a page, at most [`MAX_BYTES`] long; the rest of the buffer is 0xFF, as in
/// erased flash.
pub fn encode<'a>(record: &Record, sequence: u32, page: &'a mut [u8; MAX_BYTES]) -> &'a [u8] {
    page.fill(0xFF);
    let (_, body) = page.split_at_mut(HEADER_BYTES);
    let limits = limits_of(record);
    let appended = Appended::of(record);
    let (version, written) = match record.network.key {
        Some(key) => (KEY_VERSION, postcard::to_slice(&(record, appended, limits, key), body)),
        None if limits == [0.0; 7] => (LIMITS_VERSION - 1, postcard::to_slice(&(record, appended), body)),
        None => (LIMITS_VERSION, postcard::to_slice(&(record, appended, limits), body)),
    };
    let length = match written {
        Ok(written) => written.len(),
        // MAX_BYTES holds the longest possible record: `the_longest_record_fits`.
        Err(_) => unreachable!(),
    };
    seal(Framed { letters: LETTERS, version, sequence }, length, page)
}

/// The contents of a header.
pub(crate) struct Framed {
    pub(crate) letters: Letters,
    pub(crate) version: u8,
    pub(crate) sequence: u32,
}

/// Writes the header before a body of this length, which is already in `page`. Returns both.
pub(crate) fn seal(framed: Framed, length: usize, page: &mut [u8]) -> &[u8] {
    let (header, body) = page.split_at_mut(HEADER_BYTES);
    let (checked, checksum) = header.split_at_mut(HEADER_BYTES - 4);
    checked[..4].copy_from_slice(&framed.letters);
    checked[4] = framed.version;
    checked[5] = 0;
    checked[6..8].copy_from_slice(&(length as u16).to_le_bytes());
    checked[8..].copy_from_slice(&framed.sequence.to_le_bytes());
    checksum.copy_from_slice(&checksum_of(checked, &body[..length]).to_le_bytes());
    &page[..HEADER_BYTES + length]
}

/// The config record of a page, or of the part of its beginning that was read, and its sequence number.
///
/// # Errors
/// If no record in it is whole, of a known version and valid.
pub fn decode(page: &[u8]) -> Result<(Record, u32), LoadError> {
    let (header, body) = parse(LETTERS, page)?;
    if !matches!(header.version, 1..=VERSION) {
        return Err(LoadError::Version(header.version));
    }
    let (mut record, mut rest) = postcard::take_from_bytes::<Record>(body).map_err(|_| LoadError::Corrupt)?;
    if header.version == 1 {
        // Version 1 could not express that no delay is pinned: its default means that.
        record.network.turnaround = record.network.turnaround.filter(|pinned| *pinned != ReplyDelay::DWM1001);
    } else {
        let (appended, end) = postcard::take_from_bytes::<Appended>(rest).map_err(|_| LoadError::Corrupt)?;
        appended.put_into(&mut record);
        rest = end;
    }
    if header.version >= LIMITS_VERSION {
        let (limits, end) = rest.split_first_chunk().ok_or(LoadError::Corrupt)?;
        put_limits(limits, &mut record);
        rest = end;
    }
    if header.version >= KEY_VERSION {
        let (key, end) = rest.split_first_chunk().ok_or(LoadError::Corrupt)?;
        record.network.key = Some(*key);
        rest = end;
    }
    if !rest.is_empty() {
        return Err(LoadError::Corrupt);
    }
    record.validate().map_err(LoadError::Invalid)?;
    Ok((record, header.sequence))
}

/// The version of a page, or of the part of its beginning that was read.
///
/// # Errors
/// If no record in it is whole.
pub fn version(page: &[u8]) -> Result<u8, LoadError> {
    header_of(page).map(|header| header.version)
}

/// The header of a config record's page.
pub(crate) fn header_of(page: &[u8]) -> Result<Header, LoadError> {
    parse(LETTERS, page).map(|(header, _)| header)
}

/// The header and the body's bytes, if letters and checksum agree.
pub(crate) fn parse(letters: Letters, page: &[u8]) -> Result<(Header, &[u8]), LoadError> {
    if page.iter().take(HEADER_BYTES).all(|byte| *byte == 0xFF) {
        return Err(LoadError::Missing);
    }
    let (header, rest) = page.split_first_chunk::<HEADER_BYTES>().ok_or(LoadError::Corrupt)?;
    let [m0, m1, m2, m3, version, reserved, l0, l1, s0, s1, s2, s3, c0, c1, c2, c3] = *header;
    if [m0, m1, m2, m3] != letters || reserved != 0 {
        return Err(LoadError::Corrupt);
    }
    let body = rest.get(..usize::from(u16::from_le_bytes([l0, l1]))).ok_or(LoadError::Corrupt)?;
    if checksum_of(&header[..HEADER_BYTES - 4], body) != u32::from_le_bytes([c0, c1, c2, c3]) {
        return Err(LoadError::Corrupt);
    }
    Ok((Header { version, sequence: u32::from_le_bytes([s0, s1, s2, s3]) }, body))
}

fn checksum_of(header: &[u8], body: &[u8]) -> u32 {
    let mut digest = CRC.digest();
    digest.update(header);
    digest.update(body);
    digest.finalize()
}
