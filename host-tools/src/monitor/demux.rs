//! A serial line's mixture: frames of defmt, `FF 00 <rzcobs> 00` as espflash has them, between frames of telemetry, `<COBS> 00`,
//! and the text of a boot loader. Bytes in, channels out.
//!
//! Zeros part the mixture, whatever it is. A piece that is exactly `FF` announces a frame of defmt: it is no frame of
//! telemetry, since COBS would have 254 bytes follow. Where a piece was torn and `FF` stands at its end, it announces as well,
//! unless the whole piece is a valid frame. So whatever is lost, the second frame after it is right again.

use super::source::{Channel, Event};
use telemetry::Malformed;

/// Longer than any frame: what has no zero for so long is none.
const MAX_PIECE: usize = 4096;
/// Announces a frame of defmt, with a zero behind it.
const ANNOUNCEMENT: u8 = 0xFF;

/// Parts a mixture.
#[derive(Default)]
pub struct Demux {
    piece: Vec<u8>,
    /// The next piece is defmt's.
    announced: bool,
}

impl Demux {
    /// Takes bytes, gives what became whole by them.
    pub fn feed(&mut self, bytes: &[u8]) -> Vec<Event> {
        let mut events = Vec::new();
        for &byte in bytes {
            match byte {
                0 => self.end_of_piece(&mut events),
                b'\n' if self.is_text() => self.line(&mut events),
                _ => self.piece.push(byte),
            }
            if self.piece.len() >= MAX_PIECE {
                // For telemetry's decoder to count.
                push(&mut events, Channel::Telemetry, &std::mem::take(&mut self.piece));
                self.announced = false;
            }
        }
        events
    }

    /// What is left when nothing comes any more, for the decoders to count.
    pub fn finish(&mut self) -> Vec<Event> {
        let mut events = Vec::new();
        let channel = if self.announced { Channel::Log } else { Channel::Telemetry };
        push(&mut events, channel, &std::mem::take(&mut self.piece));
        events
    }

    fn end_of_piece(&mut self, events: &mut Vec<Event>) {
        let mut piece = std::mem::take(&mut self.piece);
        if piece.is_empty() {
            return;
        }
        let telemetry = is_telemetry(&piece);
        if !telemetry && piece.last() == Some(&ANNOUNCEMENT) && !self.announced {
            piece.pop();
            self.announced = true;
            if !piece.is_empty() {
                piece.push(0);
                push(events, Channel::Telemetry, &piece);
            }
            return;
        }
        let channel = if self.announced && !telemetry { Channel::Log } else { Channel::Telemetry };
        self.announced = false;
        piece.push(0);
        push(events, channel, &piece);
    }

    /// Whether the piece can only be text. A frame of telemetry has its schema, 1, as the second byte, which is no text; its
    /// first byte may be anything, a line's end too.
    fn is_text(&self) -> bool {
        let text = |byte: &u8| byte.is_ascii_graphic() || byte.is_ascii_whitespace();
        !self.announced && !self.piece.is_empty() && self.piece.iter().all(text)
    }

    fn line(&mut self, events: &mut Vec<Event>) {
        let line = String::from_utf8_lossy(&std::mem::take(&mut self.piece)).trim().to_owned();
        if !line.is_empty() {
            events.push(Event::Text(line));
        }
    }
}

/// Whole, though perhaps of a newer node.
fn is_telemetry(piece: &[u8]) -> bool {
    matches!(telemetry::decode(piece), Ok(_) | Err(Malformed::Schema(_) | Malformed::Unknown))
}

/// Joined to the last event where it is the same channel's.
fn push(events: &mut Vec<Event>, channel: Channel, piece: &[u8]) {
    if piece.is_empty() {
        return;
    }
    match events.last_mut() {
        Some(Event::Bytes(last, bytes)) if *last == channel => bytes.extend_from_slice(piece),
        _ => events.push(Event::Bytes(channel, piece.to_vec())),
    }
}
