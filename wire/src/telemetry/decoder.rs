//! Decodes a stream of bytes into messages, and counts what was lost.
//!
//! A frame ends at a zero, so the decoder is synchronised again at the next zero, whatever came before. If the zero
//! between two frames was lost, or a text precedes a frame without a zero, the decoder finds the frame at the end of
//! the chunk by its schema byte and checksum.
//!
//! The stream may contain other data: a serial line also carries `defmt` frames `FF 00 … 00` and a boot loader's text.
//! The decoder counts these as foreign, not as malformed.

use crate::telemetry::{DecodeError, LONGEST_FRAME, Message, SCHEMA, decode};

/// The longest frame without its zero.
const KEPT: usize = LONGEST_FRAME - 1;
/// Ends a chunk that is followed by a `defmt` frame.
const DEFMT: u8 = 0xFF;
/// Fewer printable bytes than this are not classified as text.
const LEAST_TEXT: usize = 8;

/// Counts of a [`Decoder`] since its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counts {
    /// Messages.
    pub frames: u64,
    /// Chunks too long to be a frame.
    pub too_long: u64,
    /// Frames that violate COBS.
    pub cobs: u64,
    /// Frames with a wrong checksum.
    pub checksum: u64,
    /// Whole frames whose body does not match the schema.
    pub body: u64,
    /// Whole frames of another schema: from a newer or older node.
    pub schema: u64,
    /// Whole frames with a message, or a value in one, that this build does not know: from a newer node.
    pub unknown: u64,
    /// Streams that began in the middle of a frame: each start or [`interruption`](Decoder::interrupted) makes at most
    /// one.
    pub torn_at_start: u64,
    /// Chunks of other data: `defmt` frames, text.
    pub foreign: u64,
    /// Bytes of those, without their markers and zeros.
    pub foreign_bytes: u64,
    /// Bytes of malformed frames, and of those torn at the start, without their zeros. Whole frames of another node's
    /// build do not count.
    pub lost_bytes: u64,
}

impl Counts {
    /// Frames that were not whole, except those torn at the start.
    pub fn malformed(&self) -> u64 {
        self.too_long + self.cobs + self.checksum + self.body
    }

    /// Whole frames that this build cannot read.
    pub fn newer(&self) -> u64 {
        self.schema + self.unknown
    }
}

/// Decodes bytes into messages.
#[derive(Clone, Debug)]
pub struct Decoder {
    /// The last bytes since the last zero.
    chunk: [u8; KEPT],
    kept: usize,
    /// Bytes of the same chunk that came before the kept ones, and how many of them are not text.
    dropped: usize,
    dropped_stray: usize,
    /// No zero has come yet.
    start: bool,
    /// The last chunk ended as a chunk before a `defmt` frame does.
    defmt: bool,
    counts: Counts,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// A decoder at the start of a stream, which may begin in the middle of a frame.
    pub const fn new() -> Self {
        const NONE: Counts = Counts {
            frames: 0,
            too_long: 0,
            cobs: 0,
            checksum: 0,
            body: 0,
            schema: 0,
            unknown: 0,
            torn_at_start: 0,
            foreign: 0,
            foreign_bytes: 0,
            lost_bytes: 0,
        };
        Self { chunk: [0; KEPT], kept: 0, dropped: 0, dropped_stray: 0, start: true, defmt: false, counts: NONE }
    }

    /// Takes the next byte; `None` as long as it ends no frame.
    ///
    /// Foreign data and a frame torn at the start are counted, and give `None`.
    ///
    /// # Errors
    /// If a frame has ended that cannot be decoded; [`DecodeError`] has the reason.
    #[inline]
    pub fn feed(&mut self, byte: u8) -> Option<Result<Message, DecodeError>> {
        if byte == 0 {
            return self.end();
        }
        if self.kept == KEPT {
            self.drop_half();
        }
        if let Some(place) = self.chunk.get_mut(self.kept) {
            *place = byte;
            self.kept += 1;
        }
        None
    }

    /// The counts so far.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Bytes of a frame that has not ended yet.
    pub fn pending(&self) -> usize {
        self.dropped + self.kept
    }

    /// Bytes are missing from here on (a cable was unplugged): a frame that has not ended is lost, and the next data
    /// may begin in the middle of a frame.
    pub fn interrupted(&mut self) {
        self.counts.lost_bytes += self.pending() as u64;
        *self = Self { counts: self.counts, ..Self::new() };
    }

    /// Makes room in a chunk that is longer than a frame: its last bytes may be a frame.
    fn drop_half(&mut self) {
        let half = KEPT / 2;
        self.dropped = self.dropped.saturating_add(half);
        self.dropped_stray = self.dropped_stray.saturating_add(strays(self.chunk.get(..half).unwrap_or(&[])));
        self.chunk.copy_within(half.., 0);
        self.kept = KEPT - half;
    }

    /// A zero was received.
    fn end(&mut self) -> Option<Result<Message, DecodeError>> {
        let Self { chunk, kept, dropped, dropped_stray, start, defmt, .. } =
            core::mem::replace(self, Self { counts: self.counts, start: false, ..Self::new() });
        let chunk = chunk.get(..kept).unwrap_or(&[]);
        let (&last, before_last) = chunk.split_last()?;

        let whole = if dropped == 0 { decode(chunk) } else { Err(DecodeError::TooLong) };
        let torn = match whole {
            Ok(message) => {
                self.counts.frames += 1;
                return Some(Ok(message));
            }
            Err(DecodeError::Schema(_)) => {
                self.counts.schema += 1;
                return Some(whole);
            }
            Err(DecodeError::Unknown) => {
                self.counts.unknown += 1;
                return Some(whole);
            }
            Err(torn @ (DecodeError::TooLong | DecodeError::Cobs | DecodeError::Checksum | DecodeError::Body)) => torn,
        };

        let found = frame_at_the_end(chunk);
        self.defmt = found.is_none() && last == DEFMT;
        // The bytes that are neither in the found frame nor the marker of the next one.
        let rest = match found {
            Some((begin, _)) => chunk.get(..begin).unwrap_or(&[]),
            None if self.defmt => before_last,
            None => chunk,
        };
        let bytes = dropped.saturating_add(rest.len());
        let text = bytes >= LEAST_TEXT && dropped_stray + strays(rest) == 0;
        let mut answer = None;
        if bytes == 0 {
            // Only the marker.
        } else if defmt || text {
            self.counts.foreign += 1;
            self.counts.foreign_bytes += bytes as u64;
        } else {
            self.counts.lost_bytes += bytes as u64;
            if start {
                self.counts.torn_at_start += 1;
            } else {
                *self.counter(torn) += 1;
                answer = Some(Err(torn));
            }
        }
        found
            .map(|(_, message)| {
                self.counts.frames += 1;
                Ok(message)
            })
            .or(answer)
    }

    fn counter(&mut self, malformed: DecodeError) -> &mut u64 {
        match malformed {
            DecodeError::TooLong => &mut self.counts.too_long,
            DecodeError::Cobs => &mut self.counts.cobs,
            DecodeError::Checksum => &mut self.counts.checksum,
            DecodeError::Schema(_) => &mut self.counts.schema,
            DecodeError::Unknown => &mut self.counts.unknown,
            DecodeError::Body => &mut self.counts.body,
        }
    }
}

/// A whole frame that ends at the end of a chunk, with the index of its beginning.
fn frame_at_the_end(chunk: &[u8]) -> Option<(usize, Message)> {
    // The first byte of a frame belongs to COBS, the second is the schema.
    let schemas = chunk.iter().enumerate().skip(2).filter(|(_, byte)| **byte == SCHEMA);
    schemas.map(|(at, _)| at - 1).find_map(|begin| Some((begin, decode(chunk.get(begin..)?).ok()?)))
}

/// How many bytes are neither printable nor common in text (line ends, tabulators, colours).
fn strays(bytes: &[u8]) -> usize {
    bytes.iter().filter(|byte| !matches!(byte, b'\t'..=b'\r' | 0x1B | b' '..=b'~')).count()
}
