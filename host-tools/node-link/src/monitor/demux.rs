//! Separates the mixture on a serial line: frames of defmt, `FF 00 <rzcobs> 00` as espflash expects them, frames of
//! telemetry, `<COBS> 00`, and the text of a boot loader. The input is bytes, the output is events of the channels.
//!
//! Zeros separate the pieces of the mixture. A piece that is exactly `FF` announces a frame of defmt. It cannot be a
//! frame of telemetry, because in COBS 254 bytes would follow `FF`. A damaged piece with `FF` at its end also announces
//! a frame of defmt, unless the whole piece is a valid frame of telemetry. So the second frame after any loss is
//! decoded correctly again.

use super::source::{Event, NodeChannel};
use wire::telemetry::DecodeError;

/// Longer than any frame. A piece without a zero within this number of bytes is not a frame.
const MAX_PIECE: usize = 4096;
/// Announces a frame of defmt; a zero follows it.
const ANNOUNCEMENT: u8 = 0xFF;

/// Separates a mixture.
#[derive(Default)]
pub struct Demux {
    piece: Vec<u8>,
    /// The next piece is a frame of defmt.
    announced: bool,
}

impl Demux {
    /// Takes bytes. Returns the events that they complete.
    pub fn feed(&mut self, bytes: &[u8]) -> Vec<Event> {
        let mut events = Vec::new();
        for &byte in bytes {
            match byte {
                0 => self.end_of_piece(&mut events),
                b'\n' if self.is_text() => self.line(&mut events),
                _ => self.piece.push(byte),
            }
            if self.piece.len() >= MAX_PIECE {
                // The decoder of telemetry counts this piece.
                push(&mut events, NodeChannel::Telemetry, &std::mem::take(&mut self.piece));
                self.announced = false;
            }
        }
        events
    }

    /// Returns the rest when no more bytes come. The decoders count it.
    pub fn finish(&mut self) -> Vec<Event> {
        let mut events = Vec::new();
        let channel = if self.announced { NodeChannel::Log } else { NodeChannel::Telemetry };
        push(&mut events, channel, &std::mem::take(&mut self.piece));
        events
    }

    fn end_of_piece(&mut self, events: &mut Vec<Event>) {
        let mut piece = std::mem::take(&mut self.piece);
        if piece.is_empty() {
            return;
        }
        if !self.announced && piece.last() == Some(&ANNOUNCEMENT) && !is_telemetry(&piece) {
            piece.pop();
            self.announced = true;
            if !piece.is_empty() {
                piece.push(0);
                push(events, NodeChannel::Telemetry, &piece);
            }
            return;
        }
        let channel = if self.announced && !is_telemetry(&piece) { NodeChannel::Log } else { NodeChannel::Telemetry };
        self.announced = false;
        piece.push(0);
        push(events, channel, &piece);
    }

    /// Whether the piece can only be text. The second byte of a frame of telemetry is its schema, 1, which is not text.
    /// The first byte of a frame may have any value, also that of a line end.
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

/// Whether the piece is a complete frame of telemetry, perhaps from a newer node.
fn is_telemetry(piece: &[u8]) -> bool {
    matches!(wire::telemetry::decode(piece), Ok(_) | Err(DecodeError::Schema(_) | DecodeError::Unknown))
}

/// Adds a piece. It is appended to the last event where that has the same channel.
fn push(events: &mut Vec<Event>, channel: NodeChannel, piece: &[u8]) {
    if piece.is_empty() {
        return;
    }
    match events.last_mut() {
        Some(Event::Bytes(last, bytes)) if *last == channel => bytes.extend_from_slice(piece),
        _ => events.push(Event::Bytes(channel, piece.to_vec())),
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64;

    use super::super::source::{Event, NodeChannel};
    use super::super::testing::{BUILD, fix, frame, hello, telemetry_frame};
    use super::Demux;

    /// Log, telemetry and text of a mixture that is fed in pieces of `size` bytes.
    fn parted(mixture: &[u8], size: usize) -> (Vec<u8>, Vec<u8>, Vec<String>) {
        let mut demux = Demux::default();
        let mut events: Vec<_> = mixture.chunks(size).flat_map(|piece| demux.feed(piece)).collect();
        events.extend(demux.finish());
        let (mut log, mut telemetry, mut text) = (Vec::new(), Vec::new(), Vec::new());
        for event in events {
            match event {
                Event::Bytes(NodeChannel::Log, bytes) => log.extend(bytes),
                Event::Bytes(NodeChannel::Telemetry, bytes) => telemetry.extend(bytes),
                Event::Text(line) => text.push(line),
                other => panic!("{other:?}"),
            }
        }
        (log, telemetry, text)
    }

    /// A frame of defmt as espflash expects it.
    fn announced(frame: &[u8]) -> Vec<u8> {
        [&[0xFF, 0], frame].concat()
    }

    #[test]
    fn channels_part_whatever_the_pieces() {
        let (line, greeting, place) =
            (frame(1, 5, &[1]), telemetry_frame(&hello(4, BUILD)), telemetry_frame(&fix(6, 3.21)));
        // The first frame of defmt begins with an extra zero.
        let first = announced(&[&[0], &line[..]].concat());
        let mixture = [&first[..], &greeting, &announced(&line), &announced(&line), &place].concat();
        for size in [1, 2, 7, 1000] {
            let (log, telemetry, text) = parted(&mixture, size);
            assert_eq!(log, line.repeat(3));
            assert_eq!(telemetry, [&greeting[..], &place].concat());
            assert!(text.is_empty());
        }
    }

    #[test]
    fn a_boot_loaders_lines_are_text() {
        let boot = b"ESP-ROM:esp32c3-api1-20210207\r\nrst:0x1 (POWERON)\r\n\r\n";
        let line = frame(1, 5, &[1]);
        let mixture = [&boot[..], &announced(&line), &telemetry_frame(&fix(6, 3.21)), b"again\n"].concat();
        let (log, telemetry, text) = parted(&mixture, 3);
        assert_eq!((log, telemetry), (line, telemetry_frame(&fix(6, 3.21))));
        assert_eq!(text, ["ESP-ROM:esp32c3-api1-20210207", "rst:0x1 (POWERON)", "again"]);
    }

    #[test]
    fn text_without_an_end_costs_no_frame_of_the_log() {
        let line = frame(1, 5, &[1]);
        let (log, telemetry, _) = parted(&[&b"half a li"[..], &announced(&line)].concat(), 100);
        assert_eq!((log, telemetry), (line, b"half a li\0".to_vec()));
    }

    #[test]
    fn a_frame_that_begins_like_a_line_end_is_a_frame() {
        // COBS begins with the distance to the first zero, here ten, which is also a line feed. The field 0.1 mm · 0
        // gives the zeros.
        let of_distance = |distance: u8| {
            (0..1 << 20)
                .step_by(9973)
                .map(|t_us| telemetry_frame(&fix(t_us, 0.0)))
                .find(|frame| frame.first() == Some(&distance))
        };
        let frame = of_distance(10).expect("there is one");
        let (_, telemetry, text) = parted(&frame.repeat(3), 1);
        assert_eq!((telemetry, text), (frame.repeat(3), vec![]));
    }

    #[test]
    fn random_bytes_and_flipped_bits_come_out_somewhere() {
        let mut random = Pcg64::seed_from_u64(2);
        let mixture =
            [announced(&frame(1, 5, &[1])), telemetry_frame(&fix(6, 3.21)), b"text\n".to_vec()].concat().repeat(300);
        let mut noise = mixture.clone();
        noise.iter_mut().for_each(|byte| *byte = random.random());
        parted(&noise, 64);
        parted(&vec![0x55; 1 << 20], 4096);

        let mut flipped = mixture.clone();
        for byte in &mut flipped {
            if random.random_bool(0.01) {
                *byte ^= 1 << random.random_range(0..8);
            }
        }
        let (log, telemetry, text) = parted(&flipped, 64);
        // 300 frames of each kind, of about 8, 40 and 5 bytes: one in twelve, one in three and one in twenty is
        // damaged. The frame after a damaged frame may be lost too.
        let frames = telemetry.split(|byte| *byte == 0).filter(|frame| wire::telemetry::decode(frame).is_ok()).count();
        let lines = log.split(|byte| *byte == 0).filter(|line| [*line, &[0]].concat() == frame(1, 5, &[1])).count();
        let text = text.iter().filter(|line| *line == "text").count();
        assert!(frames > 160 && lines > 200 && text > 200, "{frames} {lines} {text}");
    }
}
