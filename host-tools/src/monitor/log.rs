//! The log: frames of defmt in, lines of text out, and what could not be read is counted.

use std::panic::{AssertUnwindSafe, catch_unwind};

use defmt_parser::Level;

use super::image::{Image, Place};

/// Longer than any frame.
const MAX_FRAME: usize = 4096;

/// A line of the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogLine {
    /// Since the node started, microseconds; `None`: the image stamps no times.
    pub t_us: Option<u64>,
    /// `None`: printed without a level.
    pub level: Option<Level>,
    /// What it says.
    pub text: String,
    /// Where in the sources it is said, as far as the ELF file knows.
    pub place: Option<Place>,
}

/// Cuts the stream of defmt into frames, without a table.
#[derive(Default)]
pub struct Frames {
    frame: Vec<u8>,
    /// The frame has become too long, and is passed over up to its end.
    overlong: bool,
    malformed: u64,
}

impl Frames {
    /// Takes bytes, gives the frames that became whole, each without its zero.
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

    /// The beginning of a frame will not be ended: the connection was lost, or the stream has ended.
    pub fn cut(&mut self) {
        if !self.frame.is_empty() {
            self.malformed += 1;
        }
        self.frame.clear();
        self.overlong = false;
    }

    /// Frames that were none, by their length or because they were cut off.
    pub fn malformed(&self) -> u64 {
        self.malformed
    }
}

/// Reads a frame by the table of an image; `None`: it is malformed.
pub fn read(image: &Image, frame: &[u8]) -> Option<LogLine> {
    let plain = rzcobs::decode(frame).ok()?;
    if !image.formats.fit(&plain) {
        return None;
    }
    let (frame, _) = image.table.decode(&plain).ok()?;
    // A time that no calendar holds, and the like: the decoder takes the program's own word for what it prints.
    let shown = catch_unwind(AssertUnwindSafe(|| {
        (frame.display_timestamp().map(|time| time.to_string()), frame.display_message().to_string())
    }));
    let (time, text) = shown.ok()?;
    Some(LogLine {
        t_us: time.as_deref().and_then(microseconds),
        level: frame.level(),
        text,
        place: image.places.get(&frame.index()).cloned(),
    })
}

/// What `{=u64:us}` prints, as a number again: seconds and six digits. The decoder gives it no other way.
fn microseconds(time: &str) -> Option<u64> {
    let (seconds, micros) = time.split_once('.')?;
    if micros.len() != 6 {
        return None;
    }
    seconds.parse::<u64>().ok()?.checked_mul(1_000_000)?.checked_add(micros.parse().ok()?)
}
