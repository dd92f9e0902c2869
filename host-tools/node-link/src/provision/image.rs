//! Files with a config record and models: both pages of a board's flash, and, for a tag with RSSI models, the region
//! with these models, before or after the pages as the board has it.
//!
//! The record is in both pages. So the earlier content of the flash is not used any more, and a partly written file
//! leaves one valid page.

use ihex::Record as Hex;
use positioning_core::nlos::{Classifier, Model, NodeModel};
use wire::config::{
    Board, HEADER_BYTES, LoadError, MAX_BYTES, MODEL_AT, MODELS_BYTES, Record, WIFI_AT, WIFI_BYTES, Wifi, decode,
    encode, encode_wifi, model_of, newest, version, wifi_of,
};

use super::site_models;
use analysis::train::features_of;

/// Number of data bytes in a line of Intel HEX.
const HEX_LINE: usize = 16;
/// Two pages of 4096 bytes, and the models.
const LONGEST: u64 = 8192 + MODELS_BYTES as u64;
/// The sequence number of a record in a file. The file replaces the earlier records in flash.
const FIRST: u32 = 1;

/// The intended content of a node's flash.
#[derive(Clone, Copy, Debug)]
pub struct Contents<'a> {
    /// The node's config record.
    pub record: &'a Record,
    /// A classifier of line of sight.
    pub model: Option<&'a [u8]>,
    /// RSSI models of the site, as `wire::config::encode_models` writes them.
    pub site_models: Option<&'a [u8]>,
    /// How the node reaches its station by Wi-Fi.
    pub wifi: Option<&'a Wifi>,
}

impl Contents<'_> {
    /// A page as in the board's flash, with 0xFF where nothing is written.
    pub fn page(&self, board: Board, sequence: u32) -> Vec<u8> {
        let mut page = self.written(sequence);
        page.resize(board.pages().size as usize, 0xFF);
        page
    }

    /// The bytes of a page up to the last written byte.
    fn written(&self, sequence: u32) -> Vec<u8> {
        let mut buffer = [0; MAX_BYTES];
        let mut page = encode(self.record, sequence, &mut buffer).to_vec();
        if let Some(model) = self.model {
            page.resize(MODEL_AT, 0xFF);
            page.extend_from_slice(model);
        }
        if let Some(wifi) = self.wifi {
            page.resize(WIFI_AT, 0xFF);
            page.extend_from_slice(encode_wifi(wifi, &mut [0; WIFI_BYTES]));
        }
        page
    }

    /// The content of the flash in pieces, by increasing address. Each piece has only the written bytes.
    fn pieces(&self, board: Board) -> Vec<(u32, Vec<u8>)> {
        let written = self.written(FIRST);
        let mut pieces: Vec<_> = board.pages().addresses().map(|address| (address, written.clone())).into();
        if let (Some(site_models), Some(at)) = (self.site_models, board.pages().models_address()) {
            pieces.push((at, site_models.to_vec()));
        }
        pieces.sort();
        pieces
    }

    /// The address in flash at which a file with this content begins.
    pub fn address(&self, board: Board) -> u32 {
        self.pieces(board).first().map_or(0, |(address, _)| *address)
    }

    /// Both pages and the models in the order of their addresses, for the address of the first of them.
    pub fn binary(&self, board: Board) -> Vec<u8> {
        let page = board.pages().size as usize;
        let mut bytes = Vec::new();
        for (address, piece) in self.pieces(board) {
            let is_models = board.pages().models_address() == Some(address);
            let end = bytes.len() + if is_models { MODELS_BYTES } else { page };
            bytes.extend(piece);
            bytes.resize(end, 0xFF);
        }
        bytes
    }

    /// The same content as Intel HEX, which includes the addresses.
    ///
    /// # Errors
    /// No record can cause an error.
    pub fn intel_hex(&self, board: Board) -> Result<String, ihex::WriterError> {
        let mut lines = Vec::new();
        for (address, bytes) in self.pieces(board) {
            // A piece does not cross a boundary of 64 KiB, so one upper half of the address is enough.
            lines.push(Hex::ExtendedLinearAddress((address >> 16) as u16));
            lines.extend(bytes.chunks(HEX_LINE).enumerate().map(|(index, chunk)| Hex::Data {
                offset: address as u16 + (index * HEX_LINE) as u16,
                value: chunk.to_vec(),
            }));
        }
        lines.push(Hex::EndOfFile);
        ihex::create_object_file_representation(&lines)
    }
}

/// A file that may hold a record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordImage {
    bytes: Vec<u8>,
}

/// The content of an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Held {
    /// The record that a node with these pages would use.
    pub record: Record,
    /// The version of the record's format.
    pub version: u8,
    /// Its sequence number.
    pub sequence: u32,
    /// The classifier after the record, where the bytes are not erased; valid or not.
    pub model: Option<Vec<u8>>,
    /// RSSI models, valid or not, where the region is not erased.
    pub site_models: Option<Vec<u8>>,
    /// How the node reaches its station by Wi-Fi.
    pub wifi: Result<Wifi, LoadError>,
}

impl Held {
    /// A description of the classifier: its name and its features, or why it is not valid.
    pub fn classifier(&self) -> Option<String> {
        let model = self.model.as_ref()?;
        Some(match Model::decode(model) {
            Ok((model, _)) => format!("{} ({})", model.name(), features_of(&model)),
            Err(fault) => format!("none: {fault}"),
        })
    }

    /// Descriptions of the map and of the rooms, where there are any, or why they are not valid.
    pub fn map_and_rooms(&self) -> [Option<String>; 2] {
        self.site_models.as_deref().map_or([None, None], site_models::describe)
    }
}

/// The newest valid record of two pages, and the RSSI models in their region.
///
/// # Errors
/// There is no record.
pub fn held(pages: [&[u8]; 2], site_models: &[u8]) -> Result<Held, LoadError> {
    let model = |which: usize| pages.get(which).and_then(|page| model_of(page)).map(<[u8]>::to_vec);
    let site_models = site_models.iter().any(|byte| *byte != 0xFF).then(|| site_models.to_vec());
    let (which, record, sequence) = newest(pages)?;
    let version = version(pages[which])?;
    Ok(Held { record, version, sequence, model: model(which), site_models, wifi: wifi_of(pages[which]) })
}

impl RecordImage {
    /// An image from a file's bytes: one page or two pages, or Intel HEX.
    ///
    /// # Errors
    /// The bytes begin like Intel HEX, but a line is not valid. The error is the line number and a message.
    pub fn new(bytes: &[u8]) -> Result<Self, (u64, String)> {
        match std::str::from_utf8(bytes) {
            Ok(text) if text.starts_with(':') => from_hex(text).map(|bytes| Self { bytes }),
            Ok(_) | Err(_) => Ok(Self { bytes: bytes.to_vec() }),
        }
    }

    /// The pages, and the RSSI models before or after them.
    fn parts(&self) -> ([&[u8]; 2], &[u8]) {
        let (first, rest) = self.bytes.split_at_checked(MODELS_BYTES).unwrap_or((&self.bytes, &[]));
        let models_first = !rest.is_empty() && (first.starts_with(b"BLZB") || rest.starts_with(b"BLZR"));
        let (pages, site_models) = if models_first { (rest, first) } else { (first, rest) };
        // A file of at most 4096 bytes has pages of 2048 bytes, or a single page.
        let size = if pages.len() > 4096 { 4096 } else { 2048 };
        let (first, second) = pages.split_at_checked(size).unwrap_or((pages, &[]));
        ([first, second], site_models)
    }

    /// The newest valid record, although other parts of the file may be wrong.
    ///
    /// # Errors
    /// There is no valid record.
    pub fn read(&self) -> Result<Held, LoadError> {
        let (pages, site_models) = self.parts();
        held(pages, site_models)
    }

    /// The newest valid record, if the complete file is correct.
    ///
    /// # Errors
    /// There is no record, or a page is damaged or of another version, or the file is cut short. The error is a
    /// message.
    pub fn check(&self) -> Result<Held, String> {
        let held = self.read().map_err(|fault| match fault {
            LoadError::Corrupt if !self.parts().0[0].starts_with(b"BLZR") => {
                "this is no node record: it does not begin as one".to_owned()
            }
            LoadError::Corrupt if self.bytes.len() < HEADER_BYTES => "the record is cut short".to_owned(),
            fault => fault.to_string(),
        })?;
        if !self.bytes.len().is_multiple_of(2048) {
            return Err(format!("the file is cut short: {} bytes are no whole pages", self.bytes.len()));
        }
        for (number, page) in (1..).zip(self.parts().0) {
            match decode(page) {
                Ok(_) | Err(LoadError::Missing) => (),
                Err(fault) => return Err(format!("page {number} of 2: {fault}; the other page is whole")),
            }
            if let Some(Err(fault)) = model_of(page).map(NodeModel::decode) {
                return Err(format!("page {number} of 2: the record is whole, but beside it is {fault}"));
            }
            match wifi_of(page) {
                Ok(_) | Err(LoadError::Missing) => (),
                Err(_) => {
                    let what = "damaged settings of Wi-Fi";
                    return Err(format!("page {number} of 2: the record is whole, but beside it is {what}"));
                }
            }
        }
        held.site_models.as_deref().map_or(Ok(()), site_models::check)?;
        Ok(held)
    }
}

/// The bytes of Intel HEX from its first address on, in complete pages, with 0xFF in the gaps.
fn from_hex(text: &str) -> Result<Vec<u8>, (u64, String)> {
    let mut upper = 0_u32;
    let mut pieces: Vec<(u32, Vec<u8>)> = Vec::new();
    for (line, record) in (1..).zip(ihex::Reader::new(text)) {
        match record.map_err(|error| (line, error.to_string()))? {
            // A linear address ends with sixteen zero bits, a segment with four.
            Hex::Data { offset, value } => pieces.push((upper + u32::from(offset), value)),
            Hex::ExtendedLinearAddress(address) => upper = u32::from(address) << 16,
            Hex::ExtendedSegmentAddress(segment) => upper = u32::from(segment) << 4,
            Hex::EndOfFile => break,
            Hex::StartSegmentAddress { .. } | Hex::StartLinearAddress(_) => (),
        }
    }
    let first = pieces.iter().map(|(address, _)| *address).min().unwrap_or(0);
    let end = pieces.iter().map(|(address, bytes)| u64::from(*address) + bytes.len() as u64).max().unwrap_or(0);
    let length = end.saturating_sub(first.into());
    if length > LONGEST {
        return Err((1, format!("it spans {length} bytes: a record's pages and models are {LONGEST} at most")));
    }
    let mut bytes = vec![0xFF; (length as usize).next_multiple_of(2048)];
    // The length shows whether pages have 4096 bytes: then the second page begins at that offset.
    for (address, piece) in pieces {
        let at = (address - first) as usize;
        if let Some(place) = bytes.get_mut(at..at + piece.len()) {
            place.copy_from_slice(&piece);
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::provision::{EXAMPLE, Site};
    use wire::config::{StoredSiteModels, encode_models};

    fn record() -> Record {
        let site = Site::parse("site.toml".as_ref(), EXAMPLE).expect("the example is right");
        site.nodes[0].record.clone()
    }

    fn of<'a>(record: &'a Record, model: Option<&'a [u8]>) -> Contents<'a> {
        Contents { record, model, site_models: None, wifi: None }
    }

    #[test]
    fn segment_addresses_are_added_and_not_combined() {
        // Intel's specification: a segment of 0x1234 begins at 0x12340, so that offset 0x0040 of it is 0x12380. The
        // second record lies 0x20 bytes behind the first: 0x12350 + 0x50.
        let text = ":020000021234B6\n:01004000AA15\n:020000021235B5\n:01005000BBF4\n:00000001FF\n";
        let bytes = from_hex(text).expect("good");
        assert_eq!((bytes.len(), bytes[0], bytes[0x1F], bytes[0x20]), (2048, 0xAA, 0xFF, 0xBB));
    }

    #[test]
    fn a_file_has_the_record_in_both_pages() {
        for (board, size) in [(Board::Dwm1001, 4096), (Board::Evk1000, 2048), (Board::Esp32C6, 4096)] {
            let bytes = of(&record(), None).binary(board);
            assert_eq!(bytes.len(), 2 * size, "{board:?}");
            assert_eq!(decode(&bytes[..size]), Ok((record(), 1)));
            assert_eq!(decode(&bytes[size..]), Ok((record(), 1)));
            assert_eq!(
                RecordImage::new(&bytes).unwrap().check(),
                Ok(Held {
                    record: record(),
                    version: 2,
                    sequence: 1,
                    model: None,
                    site_models: None,
                    wifi: Err(LoadError::Missing)
                })
            );
        }
    }

    #[test]
    fn intel_hex_has_its_address() {
        let text = of(&record(), None).intel_hex(Board::Evk1000).unwrap();
        let lines: Vec<_> = text.lines().collect();
        // The upper half of the address is 0x0803: 02 bytes, offset 0000, type 04. Sum 2 + 4 + 8 + 3 = 0x11, checksum
        // 0xEF.
        assert_eq!(lines[0], ":020000040803EF");
        // Sixteen bytes at 0xF000. They begin with "BLZR".
        assert!(lines[1].starts_with(":10F00000424C5A52"), "{}", lines[1]);
        assert_eq!(lines.last(), Some(&":00000001FF"));
        assert!(text.lines().any(|line| line.starts_with(":10F80000424C5A52")));
        for board in Board::HARDWARE {
            let image = RecordImage::new(of(&record(), None).intel_hex(board).unwrap().as_bytes()).unwrap();
            assert_eq!(image.check().map(|held| held.record), Ok(record()), "{board:?}");
        }
    }

    #[test]
    fn hex_files_that_are_none_are_refused_without_panic() {
        let text = of(&record(), None).intel_hex(Board::Dwm1001).unwrap();
        let flipped = text.replacen("424C", "424D", 1);
        assert_eq!(RecordImage::new(flipped.as_bytes()).map_err(|(line, _)| line), Err(2), "its checksum is wrong");
        let wide = ":020000040000FA\n:0100000000FF\n:020000040800F2\n:0100000000FF\n:00000001FF\n";
        assert_eq!(RecordImage::new(wide.as_bytes()).map_err(|(line, _)| line), Err(1));
        assert!(RecordImage::new(b":").is_err());
    }

    #[test]
    fn a_classifier_goes_with_its_record() {
        use positioning_core::nlos::{Kind, Platt, Skewness};
        let mut buffer = [0; 64];
        let model = Model { kind: Kind::Skewness(Skewness::default()), calibration: Platt::NONE };
        let model = model.encode(&mut buffer).expect("it fits");
        for board in Board::HARDWARE {
            let bytes = of(&record(), Some(model)).binary(board);
            let hex = of(&record(), Some(model)).intel_hex(board).unwrap();
            for bytes in [bytes.as_slice(), hex.as_bytes()] {
                let held = RecordImage::new(bytes).unwrap().check().unwrap();
                assert_eq!(held.record, record(), "{board:?}");
                assert_eq!(held.classifier().as_deref(), Some("skewness (skewness_near)"), "{board:?}");
            }
            let size = board.pages().size as usize;
            let mut damaged = bytes.clone();
            damaged[size + MODEL_AT + 9] ^= 1;
            let said = RecordImage::new(&damaged).unwrap().check().unwrap_err();
            assert_eq!(said, "page 2 of 2: the record is whole, but beside it is a damaged model", "{board:?}");
        }
    }

    #[test]
    fn settings_of_wifi_go_with_a_record_and_its_classifier() {
        let wifi = Wifi {
            ssid: "hall".parse().expect("short"),
            password: "correct horse".parse().expect("short"),
            host: "192.168.1.20".parse().expect("short"),
            port: 7000,
            key: Some(wire::config::WifiKey { gateway: 7, secret: [9; 32] }),
        };
        for board in [Board::Esp32C3, Board::Esp32C6, Board::Evk1000] {
            for model in [None, Some(&[1, 2, 3][..])] {
                let record = record();
                let bytes = Contents { wifi: Some(&wifi), ..of(&record, model) }.binary(board);
                let held = RecordImage::new(&bytes).unwrap().read().unwrap();
                assert_eq!((&held.record, held.wifi.as_ref()), (&record, Ok(&wifi)), "{board:?}");
                assert_eq!(held.model.is_some(), model.is_some());
            }
            let record = record();
            let mut damaged = Contents { wifi: Some(&wifi), ..of(&record, None) }.binary(board);
            damaged[WIFI_AT + 20] ^= 1;
            let said = RecordImage::new(&damaged).unwrap().check().unwrap_err();
            assert_eq!(
                said, "page 1 of 2: the record is whole, but beside it is damaged settings of Wi-Fi",
                "{board:?}"
            );
        }
    }

    #[test]
    fn a_single_page_is_enough() {
        for size in [2048, 4096] {
            let bytes = &of(&record(), None).binary(Board::Dwm1001)[..size];
            assert_eq!(RecordImage::new(bytes).unwrap().check().map(|held| held.sequence), Ok(1), "{size} bytes");
        }
    }

    #[test]
    fn each_damaged_file_has_its_own_error() {
        let said = |bytes: &[u8]| RecordImage::new(bytes).unwrap().check().expect_err("it is wrong");
        let good = of(&record(), None).binary(Board::Dwm1001);
        assert_eq!(said(&good[..5000]), "the file is cut short: 5000 bytes are no whole pages");
        assert_eq!(said(&good[..40]), "the record is damaged or cut short: its checksum is wrong");
        assert_eq!(said(&good[..8]), "the record is cut short");
        assert_eq!(said(&[]), "there is no record: the flash is erased");
        assert_eq!(said(&[0xFF; 8192]), "there is no record: the flash is erased");
        assert_eq!(said(b"#!/bin/sh\n"), "this is no node record: it does not begin as one");
        let mut flipped = good.clone();
        flipped[4096 + 30] ^= 1;
        let expected =
            "page 2 of 2: the record is damaged or cut short: its checksum is wrong; the other page is whole";
        assert_eq!(said(&flipped), expected);
        assert_eq!(RecordImage::new(&flipped).unwrap().read().map(|held| held.record), Ok(record()));
    }

    #[test]
    fn models_of_beacons_stand_where_the_board_has_them() {
        let region = encode_models(
            &StoredSiteModels { room_names: "hall", ..StoredSiteModels::default() },
            &mut [0; MODELS_BYTES],
        )
        .expect("they fit")
        .to_vec();
        for (board, address, place) in [(Board::Dwm1001, 0x7C000, 0), (Board::Esp32C3, 0x9000, 8192)] {
            let record = record();
            let contents = Contents { site_models: Some(&region), ..of(&record, None) };
            assert_eq!(contents.address(board), address, "{board:?}");
            let bytes = contents.binary(board);
            assert_eq!((bytes.len(), &bytes[place..place + region.len()]), (16_384, region.as_slice()), "{board:?}");
            let hex = contents.intel_hex(board).unwrap();
            for bytes in [bytes.as_slice(), hex.as_bytes()] {
                let held = RecordImage::new(bytes).unwrap().check().unwrap();
                assert_eq!(held.record, record, "{board:?}");
                assert!(held.site_models.is_some_and(|site_models| site_models.starts_with(&region)), "{board:?}");
            }
            let mut damaged = bytes.clone();
            damaged[place + 20] ^= 1;
            let said = RecordImage::new(&damaged).unwrap().check().unwrap_err();
            assert_eq!(said, "the record is whole, but beside it is damaged models of beacons", "{board:?}");
            // Flash as read from a board, with an erased region.
            let mut none = bytes;
            none[place..place + 8192].fill(0xFF);
            assert_eq!(RecordImage::new(&none).unwrap().check().map(|held| held.site_models), Ok(None), "{board:?}");
        }
        // A board without Bluetooth has no region for the models.
        assert_eq!(Contents { site_models: Some(&region), ..of(&record(), None) }.binary(Board::Evk1000).len(), 4096);
    }
}
