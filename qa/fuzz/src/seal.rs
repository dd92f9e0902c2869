//! Checksums and framing around the bytes of an input.

use crc::{CRC_16_IBM_3740, CRC_32_ISO_HDLC, Crc};

/// The bytes with their CRC-16 behind them.
pub fn with_crc_16(mut bytes: Vec<u8>) -> Vec<u8> {
    let checksum = Crc::<u16>::new(&CRC_16_IBM_3740).checksum(&bytes);
    bytes.extend(checksum.to_le_bytes());
    bytes
}

/// A page of flash: letters, version, sequence number and body, with the length and the CRC-32 (`wire::config::page`).
pub fn page(letters: [u8; 4], version: u8, sequence: [u8; 4], body: &[u8]) -> Vec<u8> {
    let length = u16::try_from(body.len()).unwrap_or(u16::MAX).to_le_bytes();
    let mut page = [&letters[..], &[version, 0], &length, &sequence].concat();
    let crc = Crc::<u32>::new(&CRC_32_ISO_HDLC);
    let mut checksum = crc.digest();
    checksum.update(&page);
    checksum.update(body);
    page.extend(checksum.finalize().to_le_bytes());
    page.extend(body);
    page
}

/// A model: letters, version, length, body and CRC-16 (`positioning_core`'s `stored`).
pub fn model(letters: [u8; 2], version: u8, body: &[u8]) -> Vec<u8> {
    let length = u32::try_from(body.len()).unwrap_or(u32::MAX).to_le_bytes();
    with_crc_16([&letters[..], &[version], &length[..3], body].concat())
}

/// A telemetry frame around a body: schema, CRC-16, COBS and the final zero.
pub fn telemetry(body: &[u8]) -> Vec<u8> {
    let plain = with_crc_16([&[wire::telemetry::SCHEMA][..], body].concat());
    let mut frame = vec![0; cobs::max_encoding_length(plain.len())];
    let length = cobs::encode(&plain, &mut frame);
    frame.truncate(length);
    frame.push(0);
    frame
}
