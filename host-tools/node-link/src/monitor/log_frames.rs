//! The log: decodes frames of defmt to lines of text, and counts the frames that cannot be read.

use std::path::Path;

use defmt_parser::Level;

use super::elf::{Image, SourceLocation};
use super::table::Decoded;

/// Longer than any frame.
const MAX_FRAME: usize = 4096;

/// A line of the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogLine {
    /// The time since the node started, microseconds; `None`: the image has no time stamps.
    pub t_us: Option<u64>,
    /// The level; `None`: printed without a level.
    pub level: Option<Level>,
    /// The text.
    pub text: String,
    /// The source location, where the ELF file has it.
    pub place: Option<SourceLocation>,
    /// Whether telemetry has the same content.
    pub is_in_telemetry: bool,
}

/// Splits the stream of defmt into frames, without a table.
#[derive(Default)]
pub struct Frames {
    frame: Vec<u8>,
    /// The current frame is too long. It is skipped up to its end.
    overlong: bool,
    malformed: u64,
}

impl Frames {
    /// Takes bytes. Returns the completed frames, each without its zero.
    pub fn feed(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut whole = Vec::new();
        for &byte in bytes {
            if byte != 0 {
                self.overlong |= self.frame.len() >= MAX_FRAME;
                if !self.overlong {
                    self.frame.push(byte);
                }
                continue;
            }
            let frame = std::mem::take(&mut self.frame);
            if std::mem::take(&mut self.overlong) {
                self.malformed += 1;
            } else if !frame.is_empty() {
                whole.push(frame);
            }
        }
        whole
    }

    /// Drops an unfinished frame: the connection was lost, or the stream has ended.
    pub fn cut(&mut self) {
        if !self.frame.is_empty() {
            self.malformed += 1;
        }
        self.frame.clear();
        self.overlong = false;
    }

    /// The number of frames that were too long or cut off.
    pub fn malformed(&self) -> u64 {
        self.malformed
    }
}

/// Decodes a frame by the table of an image; `None`: the frame is malformed.
pub fn read(image: &Image, frame: &[u8]) -> Option<LogLine> {
    let plain = rzcobs::decode(frame).ok()?;
    if !image.formats.fit(&plain) {
        return None;
    }
    let Decoded { index, time, level, text } = image.table.decode(&plain)?;
    let place = image.places.get(&index).cloned();
    Some(LogLine {
        t_us: time.as_deref().and_then(microseconds),
        level,
        text,
        is_in_telemetry: place
            .as_ref()
            .is_some_and(|place| Path::new(&place.file).ends_with(wire::telemetry::log::SOURCE)),
        place,
    })
}

/// The inverse of `{=u64:us}`: its output, seconds with six digits, as a number of microseconds. The decoder returns
/// the time only as text.
fn microseconds(time: &str) -> Option<u64> {
    let (seconds, micros) = time.split_once('.')?;
    if micros.len() != 6 {
        return None;
    }
    seconds.parse::<u64>().ok()?.checked_mul(1_000_000)?.checked_add(micros.parse().ok()?)
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::process::Command;

    use defmt_parser::Level;
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64;

    use super::super::elf::Image;
    use super::super::testing::{BUILD, elf, elf_with, frame};
    use super::{Frames, LogLine, microseconds, read};

    fn image() -> Image {
        Image::parse(Path::new("image"), &elf(Some(BUILD))).expect("an image")
    }

    /// Time, level and text; `None`: the frame is malformed.
    type Line = Option<(Option<u64>, Option<Level>, String)>;

    /// The lines of a stream of complete frames.
    fn lines(bytes: &[u8]) -> Vec<Line> {
        let image = image();
        let frames = Frames::default().feed(bytes);
        let line = |frame: Vec<u8>| read(&image, &frame).map(|LogLine { t_us, level, text, .. }| (t_us, level, text));
        frames.into_iter().map(line).collect()
    }

    fn text(frame: &[u8]) -> Option<String> {
        lines(frame).into_iter().next()?.map(|(.., text)| text)
    }

    #[test]
    fn a_value_on_which_the_decoder_panics_is_malformed_and_prints_nothing() {
        const STATEMENT: [(u16, &str, &str); 1] = [(1, "defmt_info", "at {=u64:iso8601ms}")];
        const AGAIN: &str = "BALIZA_DECODES_A_PANIC";
        if std::env::var_os(AGAIN).is_some() {
            let image =
                Image::parse(Path::new("image"), &elf_with(Some(BUILD), &STATEMENT, "rzcobs")).expect("an image");
            let frames = Frames::default().feed(&frame(1, 0, &u64::MAX.to_le_bytes()));
            assert!(frames.len() == 1 && read(&image, &frames[0]).is_none());
            return;
        }
        // Again in a process of its own, whose standard error is read.
        let mut again = Command::new(std::env::current_exe().expect("this test"));
        again.args(["a_value_on_which_the_decoder_panics", "--nocapture"]).env(AGAIN, "1");
        let run = again.output().expect("it runs");
        let said = String::from_utf8_lossy(&run.stderr).into_owned() + &String::from_utf8_lossy(&run.stdout);
        assert!(run.status.success() && said.contains("1 passed") && !said.contains("panicked at"), "{said}");
    }

    #[test]
    fn a_frame_written_by_hand() {
        // Statement 1, 1 500 000 µs = 0x16E360, argument 42: 01 00 60 E3 16 00 00 00 00 00 2A. rzCOBS writes a group of
        // seven bytes as its nonzero bytes, followed by one byte with a bit for each byte of the group. A bit is set
        // for a zero, and the lowest bit is for the first byte: 01 00 60 E3 16 00 00 → 01 60 E3 16, zeros at 1, 5 and
        // 6: 0110 0010 = 62. 00 00 00 2A → 2A, zeros at 0, 1 and 2, and the three missing bytes count as zeros: 0111
        // 0111 = 77.
        let by_hand = [0x01, 0x60, 0xE3, 0x16, 0x62, 0x2A, 0x77, 0x00];
        assert_eq!(lines(&by_hand), [Some((Some(1_500_000), Some(Level::Info), "hello 42".into()))]);
        assert_eq!(frame(1, 1_500_000, &[42]), by_hand);
    }

    #[test]
    fn arguments_of_all_kinds() {
        assert_eq!(text(&frame(2, 0, b"\x03\0\0\0tag\x01")), Some("tag is true".into()));
        // Two elements, 1 and 256, printed by statement 5.
        assert_eq!(text(&frame(3, 0, &[2, 0, 0, 0, 5, 0, 1, 0, 0, 1])), Some("values [1, 256]".into()));
        // The first variant of an enumeration, which holds a u16, and the second variant.
        assert_eq!(text(&frame(4, 0, &[6, 0, 0, 5, 0, 9, 0])), Some("Some(9)".into()));
        assert_eq!(text(&frame(4, 0, &[6, 0, 1])), Some("None".into()));
        // 0x0A05: bits 0 to 3 are 5, bits 9 to 11 are 5.
        assert_eq!(text(&frame(8, 0, &[0x05, 0x0A])), Some("flags 5 5".into()));
    }

    #[test]
    fn a_length_that_a_torn_line_made_up_takes_no_memory() {
        // 4 294 967 295 elements, for which a decoder without this check would request 170 GB.
        assert_eq!(text(&frame(3, 0, &[0xFF, 0xFF, 0xFF, 0xFF, 5, 0, 1, 0])), None);
        // A string longer than its frame.
        assert_eq!(text(&frame(2, 0, b"\xFF\xFF\xFF\x7Ftag\x01")), None);
    }

    #[test]
    fn formats_within_formats_end() {
        // Statement 7 prints a value by a nested format. Here the format is statement 7 again, two thousand times.
        let nested: Vec<u8> = [7, 0].repeat(2000);
        assert_eq!(text(&frame(4, 0, &nested)), None);
    }

    #[test]
    fn what_is_malformed_costs_no_other_frame() {
        let good = frame(1, 5, &[1]);
        let unknown = frame(33, 5, &[1]);
        let cut = &good[2..];
        let all = [&good[..], &unknown, &good, cut, &good, &[0xFF, 0], &good].concat();
        let read = lines(&all);
        assert_eq!(read.iter().map(Option::is_some).collect::<Vec<_>>(), [true, false, true, false, true, false, true]);
    }

    #[test]
    fn a_frame_without_end_is_passed_over() {
        let mut frames = Frames::default();
        assert!(frames.feed(&vec![0x55; 1 << 20]).is_empty());
        assert_eq!(frames.feed(&[0, 1, 2, 0]), [vec![1, 2]]);
        assert_eq!(frames.malformed(), 1);
        assert!(frames.feed(&[1]).is_empty());
        frames.cut();
        assert_eq!((frames.feed(&[2, 0]), frames.malformed()), (vec![vec![2]], 2));
    }

    #[test]
    fn random_frames_and_flipped_bits_do_no_harm() {
        let image = image();
        let mut random = Pcg64::seed_from_u64(1);
        let good = [
            frame(2, 7, b"\x03\0\0\0tag\x01"),
            frame(3, 8, &[2, 0, 0, 0, 5, 0, 1, 0, 0, 1]),
            frame(4, 9, &[6, 0, 0, 5, 0, 9, 0]),
        ]
        .concat();
        let (mut whole, mut malformed) = (0, 0);
        for round in 0..2000 {
            let mut bytes = good.repeat(5);
            for byte in &mut bytes {
                if round % 2 == 0 {
                    *byte = random.random();
                } else if random.random_bool(0.01) {
                    *byte ^= 1 << random.random_range(0..8);
                }
            }
            for frame in Frames::default().feed(&bytes) {
                *(if read(&image, &frame).is_some() { &mut whole } else { &mut malformed }) += 1;
            }
        }
        // Half of the rounds have 15 frames each, of about 13 bytes. One frame in eight is damaged in each round, so
        // most frames are decoded.
        assert!(whole > 1000 * 15 / 2 && malformed > 1000, "{whole} {malformed}");
    }

    #[test]
    fn times_of_the_log() {
        assert_eq!(microseconds("12.345678"), Some(12_345_678));
        assert_eq!(microseconds("0.000001"), Some(1));
        // Milliseconds, a clock time, no time, and a time beyond the range.
        for other in ["12.345", "00:00:12.345678", "", "99999999999999999999.000000", "18446744073709.999999"] {
            assert_eq!(microseconds(other), None, "{other}");
        }
    }
}
