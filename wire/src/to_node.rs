//! Frames from a host to a node: messages to tags, for a gateway that sends them.
//!
//! A frame is a byte 1, the tag, what the message's bytes are, its number, the bytes and a CRC-16, in the way of
//! [`telemetry`](crate::telemetry): encoded by COBS, and ended by a zero. `docs/reference/wire-format.md` has an example.

use heapless::Vec;

use crate::telemetry::CRC;
use crate::uwb::native::{Downlink, UserData};

/// The first byte of a message to a tag.
const DOWNLINK: u8 = 1;
const CRC_BYTES: usize = 2;
/// Bytes of a message before its own.
const HEAD: usize = 5;
/// The longest frame before COBS.
const MAX_PLAIN: usize = HEAD + UserData::MOST + CRC_BYTES;
/// The longest frame, with COBS and the final zero, bytes.
pub const MAX_FRAME: usize = cobs::max_encoding_length(MAX_PLAIN) + 1;

/// Writes a message to a tag as a frame with its final zero, and returns it.
pub fn encode<'o>(message: &Downlink, frame: &'o mut [u8; MAX_FRAME]) -> &'o [u8] {
    let Downlink { tag, kind, data, .. } = message;
    let [low, high] = tag.to_le_bytes();
    let mut plain: Vec<u8, MAX_PLAIN> = [DOWNLINK, low, high, *kind, data.number()].into_iter().collect();
    plain.extend(data.bytes().iter().copied());
    let check = CRC.checksum(&plain).to_le_bytes();
    plain.extend(check);
    let length = cobs::encode(&plain, frame);
    // COBS leaves no zero.
    if let Some(end) = frame.get_mut(length) {
        *end = 0;
    }
    frame.get(..=length).unwrap_or(&[])
}

/// Finds frames in the bytes that come from a host. What is no frame is skipped.
#[derive(Clone, Debug, Default)]
pub struct FrameReader {
    /// The bytes since the last zero; full of what is too long for a frame.
    bytes: Vec<u8, MAX_FRAME>,
}

impl FrameReader {
    /// Before any byte.
    pub const fn new() -> Self {
        Self { bytes: Vec::new() }
    }

    /// Takes the next byte. Returns the message that it ends.
    pub fn feed(&mut self, byte: u8) -> Option<Downlink> {
        if byte != 0 {
            // The last place is for a zero: without one, these bytes are no frame.
            let _ = self.bytes.push(byte);
            return None;
        }
        let message = if self.bytes.is_full() { None } else { self.decode() };
        self.bytes.clear();
        message
    }

    #[inline(never)]
    fn decode(&mut self) -> Option<Downlink> {
        let plain = &mut self.bytes;
        let length = cobs::decode_in_place(plain).ok()?;
        let (checked, check) = plain.get(..length)?.split_last_chunk::<CRC_BYTES>()?;
        let is_whole = CRC.checksum(checked) == u16::from_le_bytes(*check);
        let [DOWNLINK, low, high, kind, number, bytes @ ..] = checked else { return None };
        let data = UserData::new(*number, bytes).filter(|_| is_whole)?;
        Some(Downlink { tag: u16::from_le_bytes([*low, *high]), gateway: 0, left: 0, kind: *kind, data })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::uwb::native::TagCommand;

    fn message(bytes: &[u8]) -> Downlink {
        Downlink::new(0x0809, 200, TagCommand::Data(bytes)).expect("it fits")
    }

    fn read(reader: &mut FrameReader, bytes: &[u8]) -> std::vec::Vec<Downlink> {
        bytes.iter().filter_map(|byte| reader.feed(*byte)).collect()
    }

    #[test]
    fn golden_frame_is_that_of_the_page() {
        let mut frame = [0; MAX_FRAME];
        // Before COBS: 01 09 08 00 C8 "door 3" and CRC-16/IBM-3740 of these: see the page.
        let encoded = encode(&message(b"door 3"), &mut frame).to_vec();
        let digits: std::vec::Vec<_> = encoded.iter().map(|byte| std::format!("{byte:02X}")).collect();
        let digits = digits.chunks(4).map(|group| group.concat()).collect::<std::vec::Vec<_>>().join(" ");
        let page = include_str!("../../docs/reference/wire-format.md");
        assert!(page.contains(&digits), "{digits}");
        assert_eq!(encoded[..6], [4, 1, 9, 8, 10, 200]);
        assert_eq!(read(&mut FrameReader::new(), &encoded), [message(b"door 3")]);
    }

    #[test]
    fn frames_are_found_among_other_bytes() {
        let mut reader = FrameReader::new();
        let mut frames = [[0; MAX_FRAME]; 2];
        let longest = message(&[0; UserData::MOST]);
        let [first, second] = &mut frames;
        let (first, second) =
            (encode(&longest, first).to_vec(), encode(&message(&[7; UserData::MOST]), second).to_vec());
        assert!(first.len() <= MAX_FRAME && second.len() <= MAX_FRAME);
        let text = b"a line of text that somebody typed into a terminal, much longer than any frame";
        let torn = &first[..first.len() - 3];
        let all = [torn, &[0], text, &[0, 0], &first, &second, text, &[0], &second].concat();
        assert_eq!(read(&mut reader, &all).len(), 3);
    }

    #[test]
    fn a_changed_byte_and_what_is_no_message_are_refused() {
        let mut frame = [0; MAX_FRAME];
        let encoded = encode(&message(b"door 3"), &mut frame).to_vec();
        for place in 0..encoded.len() - 1 {
            for bit in 0..8 {
                let mut changed = encoded.clone();
                changed[place] ^= 1 << bit;
                assert!(read(&mut FrameReader::new(), &changed).is_empty(), "{place} {bit}");
            }
        }
        // A frame of another kind, with a right check.
        let mut plain = std::vec![2, 9, 8, 0, 200, 1];
        plain.extend(CRC.checksum(&plain).to_le_bytes());
        let mut frame = [0; MAX_FRAME];
        let length = cobs::encode(&plain, &mut frame);
        assert!(read(&mut FrameReader::new(), &frame[..=length]).is_empty());
    }
}
