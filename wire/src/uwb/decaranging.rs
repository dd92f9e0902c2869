//! Frames of an EVK1000 with DecaRanging, in both variants and of all known software. The PAN identifier is 0xDECA. The
//! first byte of the payload is the function code. The numbers in parentheses are bytes:
//!
//! - blink, from a tag: `C5`, sequence, EUI-64; in the longer form 6 more bytes.
//! - ranging init, anchor → tag. Addresses: 64-bit; 16 or 64; 64. Code 20. Data: tag's short address (2), anchor's
//!   delay (2), in newer software tag's delay (2).
//! - poll, tag → anchor. Addresses: 16-bit; 16 or 64; 64. Code 21 (fast: 61). Data: temperature (1), voltage (1); newer
//!   software and fast: nothing.
//! - response, anchor → tag. Addresses as the poll's. Code 10 (fast: 50). Data: option 02 (1), parameter (2), in newer
//!   software the last time of flight (5) (fast: nothing).
//! - final, tag → anchor. Addresses as the poll's. Code 29 (fast: 69). Data: poll TX (5), response RX (5), final TX
//!   (5). Fast: final TX − response RX (4), response RX − poll TX (4).
//! - report, anchor → tag. Addresses as the poll's. Code 2A (fast: 6A). Data: time of flight in ticks (5; fast: 4);
//!   newer software sends no report.
//!
//! A delay's lower 15 bits are microseconds, or milliseconds if bit 15 is set. Older software reads all 16 bits as
//! milliseconds.

use super::{FrameBuffer, FrameError, Header, Reader};
use radio::{RadioDuration, RadioInstant};

/// The PAN identifier of DecaRanging.
pub const PAN: u16 = 0xDECA;

const BLINK: u8 = 0xC5;
const RANGING_INIT: u8 = 0x20;
const POLL: u8 = 0x21;
const RESPONSE: u8 = 0x10;
const FINAL: u8 = 0x29;
const REPORT: u8 = 0x2A;
const FAST_POLL: u8 = 0x61;
const FAST_RESPONSE: u8 = 0x50;
const FAST_FINAL: u8 = 0x69;
const FAST_REPORT: u8 = 0x6A;
/// The response's option: no action.
const NO_OPTION: u8 = 0x02;
/// First byte of a response's parameter, in older software: a report follows the final, with four times the time of
/// flight.
pub const REPORT_FOLLOWS: u8 = 1;

/// Which of the two sets of messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Variant {
    /// Codes 21, 10, 29, 2A; the final carries three instants.
    Standard,
    /// Codes 61, 50, 69, 6A; the final carries two intervals.
    Fast,
}

/// The frame by which a tag without an anchor announces itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blink {
    /// Sequence number.
    pub sequence: u8,
    /// EUI-64 of the tag.
    pub tag: u64,
}

impl Blink {
    /// Parses a blink, in the shorter or the longer form.
    ///
    /// # Errors
    /// The first error found.
    #[inline]
    pub fn parse(bytes: &[u8]) -> Result<Self, FrameError> {
        let mut reader = Reader(bytes);
        let [kind, sequence] = reader.take()?;
        let tag = reader.u64()?;
        match (kind, reader.0.len()) {
            (BLINK, 0 | 6) => Ok(Self { sequence, tag }),
            (BLINK, bytes) => Err(FrameError::TooLong(bytes)),
            (code, _) => Err(FrameError::Code(code)),
        }
    }

    /// Writes the shorter form, in place of what `out` held.
    #[inline]
    pub fn emit(&self, out: &mut FrameBuffer) {
        out.clear();
        out.put(&[BLINK, self.sequence]);
        out.put(&self.tag.to_le_bytes());
    }
}

/// A frame between a paired tag and anchor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Sequence, addresses; the PAN identifier is [`PAN`].
    pub header: Header,
    /// The message.
    pub message: Message,
}

/// The message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Message {
    /// An anchor takes a tag.
    RangingInit {
        /// The tag's short address from now on.
        tag: u16,
        /// From a poll's arrival to the response's departure: bits as in the frame.
        anchor_delay: u16,
        /// From a response's arrival to the final's departure, if the frame has it; else it equals the anchor's.
        tag_delay: Option<u16>,
    },
    /// A tag begins an exchange; temperature and voltage are the chip's raw readings (none in the fast variant).
    Poll(Variant, Option<[u8; 2]>),
    /// The anchor answers.
    Response(Variant, Answer),
    /// The tag sends its instants.
    Final(Final),
    /// The anchor reports the time of flight, whole ticks; or four times it, see [`REPORT_FOLLOWS`].
    Report(Variant, RadioDuration),
}

/// The contents of a response; all zero and `None` in the fast variant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Answer {
    /// The option's parameter; see [`REPORT_FOLLOWS`].
    pub parameter: [u8; 2],
    /// The time of flight of the exchange before, whole ticks; 0: none. Newer software.
    pub tof: Option<RadioDuration>,
}

/// The tag's measurements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Final {
    /// Standard variant: instants of the tag's clock.
    Instants {
        /// Departure of the poll.
        poll_tx: RadioInstant,
        /// Arrival of the response.
        resp_rx: RadioInstant,
        /// Departure of this frame.
        final_tx: RadioInstant,
    },
    /// Fast variant: intervals of the tag's clock, below 67 ms.
    Intervals {
        /// Final TX − response RX.
        reply2: RadioDuration,
        /// Response RX − poll TX.
        round1: RadioDuration,
    },
}

impl Frame {
    /// Parses a frame.
    ///
    /// # Errors
    /// The first error found.
    #[inline]
    pub fn parse(bytes: &[u8]) -> Result<Self, FrameError> {
        let (header, payload) = Header::parse(bytes)?;
        let mut reader = Reader(payload);
        let code = reader.u8()?;
        let message = match code {
            RANGING_INIT => Message::RangingInit {
                tag: reader.u16()?,
                anchor_delay: reader.u16()?,
                tag_delay: if reader.0.is_empty() { None } else { Some(reader.u16()?) },
            },
            POLL => Message::Poll(Variant::Standard, if reader.0.is_empty() { None } else { Some(reader.take()?) }),
            RESPONSE => {
                let [NO_OPTION, a, b] = reader.take()? else { return Err(FrameError::Field) };
                let tof = if reader.0.is_empty() { None } else { Some(flight_of(reader.take()?)) };
                Message::Response(Variant::Standard, Answer { parameter: [a, b], tof })
            }
            FINAL => {
                let [poll_tx, resp_rx, final_tx] = [reader.take()?, reader.take()?, reader.take()?];
                let [poll_tx, resp_rx, final_tx] = [poll_tx, resp_rx, final_tx].map(RadioInstant::from_le_bytes);
                Message::Final(Final::Instants { poll_tx, resp_rx, final_tx })
            }
            REPORT => Message::Report(Variant::Standard, flight_of(reader.take()?)),
            FAST_POLL => Message::Poll(Variant::Fast, None),
            FAST_RESPONSE => Message::Response(Variant::Fast, Answer::default()),
            FAST_FINAL => {
                let [reply2, round1] = [reader.u32()?, reader.u32()?].map(|t| RadioDuration::from_ticks(t.into()));
                Message::Final(Final::Intervals { reply2, round1 })
            }
            FAST_REPORT => Message::Report(Variant::Fast, RadioDuration::from_ticks((reader.u32()? as i32).into())),
            code => return Err(FrameError::Code(code)),
        };
        reader.end()?;
        if header.pan == PAN { Ok(Self { header, message }) } else { Err(FrameError::Header) }
    }

    /// Writes the frame, in place of what `out` held.
    #[inline]
    pub fn emit(&self, out: &mut FrameBuffer) {
        out.clear();
        self.header.emit(out);
        match self.message {
            Message::RangingInit { tag, anchor_delay, tag_delay } => {
                out.put(&[RANGING_INIT]);
                for field in [Some(tag), Some(anchor_delay), tag_delay].into_iter().flatten() {
                    out.put(&field.to_le_bytes());
                }
            }
            Message::Poll(Variant::Standard, readings) => {
                out.put(&[POLL]);
                out.put(readings.as_ref().map_or(&[], |readings| readings));
            }
            Message::Poll(Variant::Fast, _) => out.put(&[FAST_POLL]),
            Message::Response(Variant::Standard, Answer { parameter, tof }) => {
                out.put(&[RESPONSE, NO_OPTION]);
                out.put(&parameter);
                if let Some(tof) = tof {
                    out.put(&flight_bytes(tof));
                }
            }
            Message::Response(Variant::Fast, _) => out.put(&[FAST_RESPONSE]),
            Message::Final(Final::Instants { poll_tx, resp_rx, final_tx }) => {
                out.put(&[FINAL]);
                for instant in [poll_tx, resp_rx, final_tx] {
                    out.put(&instant.to_le_bytes());
                }
            }
            Message::Final(Final::Intervals { reply2, round1 }) => {
                out.put(&[FAST_FINAL]);
                out.put(&(reply2.ticks() as u32).to_le_bytes());
                out.put(&(round1.ticks() as u32).to_le_bytes());
            }
            Message::Report(Variant::Standard, tof) => {
                out.put(&[REPORT]);
                out.put(&flight_bytes(tof));
            }
            Message::Report(Variant::Fast, tof) => {
                out.put(&[FAST_REPORT]);
                out.put(&(tof.ticks() as i32).to_le_bytes());
            }
        }
    }

    /// The frame that answers this one: to its source, from its destination.
    #[inline]
    pub const fn answer(&self, sequence: u8, message: Message) -> Self {
        let Header { pan, destination, source, .. } = self.header;
        Self { header: Header { sequence, pan, destination: source, source: destination }, message }
    }
}

/// 40 bits, signed: a negative flight is valid.
#[inline]
const fn flight_of(bytes: [u8; 5]) -> RadioDuration {
    RadioInstant::from_le_bytes(bytes).since(RadioInstant::from_ticks(0))
}

#[inline]
const fn flight_bytes(tof: RadioDuration) -> [u8; 5] {
    RadioInstant::from_ticks(0).plus(tof).to_le_bytes()
}

/// Bytes on the air of a blink's shorter form, including its check bytes.
pub const BLINK_BYTES: u16 = 12;
/// Bytes on the air of the longest frame of an exchange with 16-bit addresses (the standard final), including its check
/// bytes.
pub const LONGEST_BYTES: u16 = 9 + 16 + 2;

/// A delay's field, from a time: microseconds, or whole milliseconds (rounded up) if those do not fit.
#[inline]
pub const fn delay_field(time: RadioDuration) -> u16 {
    let micros = time.as_micros();
    if micros < 0 {
        0
    } else if micros < 0x8000 {
        micros as u16
    } else {
        let millis = (micros + 999) / 1000;
        0x8000 | if millis < 0x7FFF { millis as u16 } else { 0x7FFF }
    }
}

/// The time of a delay's field.
#[inline]
pub const fn delay_of(field: u16) -> RadioDuration {
    let value = (field & 0x7FFF) as u32;
    RadioDuration::from_micros(if field & 0x8000 == 0 { value } else { value * 1000 })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHORT: [u8; 9] = [0x41, 0x88, 9, 0xCA, 0xDE, 0x02, 0x01, 0x04, 0x03];
    const LONG: [u8; 21] =
        [0x41, 0xCC, 9, 0xCA, 0xDE, 8, 7, 6, 5, 4, 3, 2, 1, 0x18, 0x17, 0x16, 0x15, 0x14, 0x13, 0x12, 0x11];
    const INIT: [u8; 15] = [0x41, 0x8C, 9, 0xCA, 0xDE, 8, 7, 6, 5, 4, 3, 2, 1, 0x04, 0x03];

    fn golden(head: &[u8], payload: &[u8], on_air: usize, message: Message) {
        let bytes = [head, payload].concat();
        assert_eq!(bytes.len() + 2, on_air);
        let frame = Frame::parse(&bytes).unwrap();
        assert_eq!(frame.message, message);
        assert_eq!(frame.header.sequence, 9);
        let mut out = FrameBuffer::new();
        frame.emit(&mut out);
        assert_eq!(out.bytes(), bytes);
        // Three messages have a shorter form.
        let shorter = match message {
            Message::RangingInit { tag_delay: Some(_), .. } => 2,
            Message::Poll(_, Some(_)) => 2,
            Message::Response(_, Answer { tof: Some(_), .. }) => 5,
            _ => 0,
        };
        for cut in (0..bytes.len()).filter(|cut| *cut != bytes.len() - shorter) {
            assert_eq!(Frame::parse(&bytes[..cut]), Err(FrameError::Truncated), "cut to {cut}");
        }
        assert!(Frame::parse(&[&bytes[..], &[0]].concat()).is_err(), "a byte too many");
        let mut foreign = bytes.clone();
        foreign[3] = 0xCB;
        assert_eq!(Frame::parse(&foreign), Err(FrameError::Header), "another PAN");
    }

    #[test]
    fn golden_standard_frames() {
        // Lengths on the air: header 9 (16-bit addresses), 21 (64-bit) or 15 (init), code, data, 2 check bytes.
        let init = |tag_delay| Message::RangingInit { tag: 0x1234, anchor_delay: 0x8096, tag_delay };
        let anchors = [0x20, 0x34, 0x12, 150, 0x80];
        golden(&INIT, &anchors, 22, init(None));
        golden(&LONG, &anchors, 28, init(None));
        golden(&SHORT, &[0x21, 0x7F, 0x8E], 14, Message::Poll(Variant::Standard, Some([0x7F, 0x8E])));
        golden(&LONG, &[0x21, 0x7F, 0x8E], 26, Message::Poll(Variant::Standard, Some([0x7F, 0x8E])));
        golden(&SHORT, &[0x10, 2, 1, 0], 15, response([1, 0], None));
        let instants = Final::Instants {
            poll_tx: RadioInstant::from_ticks(0x05_0403_0201),
            resp_rx: RadioInstant::from_ticks(0x15_1413_1211),
            final_tx: RadioInstant::from_ticks(0xF5_2423_2221),
        };
        let data = [0x29, 1, 2, 3, 4, 5, 0x11, 0x12, 0x13, 0x14, 0x15, 0x21, 0x22, 0x23, 0x24, 0xF5];
        golden(&SHORT, &data, 27, Message::Final(instants));
        // 2132 ticks (10 m) are 0x0854.
        let report = Message::Report(Variant::Standard, RadioDuration::from_ticks(2132));
        golden(&SHORT, &[0x2A, 0x54, 0x08, 0, 0, 0], 17, report);
    }

    fn response(parameter: [u8; 2], tof: Option<i64>) -> Message {
        Message::Response(Variant::Standard, Answer { parameter, tof: tof.map(RadioDuration::from_ticks) })
    }

    #[test]
    fn golden_frames_of_newer_software() {
        // The anchor's delay of 150 ms, the tag's of 200 ms.
        let init = Message::RangingInit { tag: 0x1234, anchor_delay: 0x8096, tag_delay: Some(0x80C8) };
        golden(&INIT, &[0x20, 0x34, 0x12, 150, 0x80, 200, 0x80], 24, init);
        golden(&LONG, &[0x20, 0x34, 0x12, 150, 0x80, 200, 0x80], 30, init);
        golden(&SHORT, &[0x21], 12, Message::Poll(Variant::Standard, None));
        golden(&LONG, &[0x21], 24, Message::Poll(Variant::Standard, None));
        // 2132 ticks (10 m) are 0x0854; −21 is all ones except for 20.
        golden(&SHORT, &[0x10, 2, 0, 0, 0x54, 0x08, 0, 0, 0], 20, response([0, 0], Some(2132)));
        golden(&LONG, &[0x10, 2, 0, 0, 0xEB, 0xFF, 0xFF, 0xFF, 0xFF], 32, response([0, 0], Some(-21)));
    }

    #[test]
    fn golden_fast_frames() {
        golden(&SHORT, &[0x61], 12, Message::Poll(Variant::Fast, None));
        golden(&SHORT, &[0x50], 12, Message::Response(Variant::Fast, Answer::default()));
        let [reply2, round1] = [0x0403_0201, 0xF807_0605].map(RadioDuration::from_ticks);
        golden(&SHORT, &[0x69, 1, 2, 3, 4, 5, 6, 7, 0xF8], 20, Message::Final(Final::Intervals { reply2, round1 }));
        // −21 ticks: a flight that is negative because of noise.
        let report = Message::Report(Variant::Fast, RadioDuration::from_ticks(-21));
        golden(&SHORT, &[0x6A, 0xEB, 0xFF, 0xFF, 0xFF], 16, report);
    }

    #[test]
    fn negative_flights_pass_in_forty_bits() {
        let bytes = [&SHORT[..], &[0x2A, 0xEB, 0xFF, 0xFF, 0xFF, 0xFF]].concat();
        let report = Message::Report(Variant::Standard, RadioDuration::from_ticks(-21));
        assert_eq!(Frame::parse(&bytes).map(|frame| frame.message), Ok(report));
    }

    #[test]
    fn golden_blinks() {
        let short = [0xC5, 3, 8, 7, 6, 5, 4, 3, 2, 1];
        let blink = Blink { sequence: 3, tag: 0x0102_0304_0506_0708 };
        assert_eq!(Blink::parse(&short), Ok(blink));
        let mut out = FrameBuffer::new();
        blink.emit(&mut out);
        assert_eq!(out.bytes(), short);
        assert_eq!(short.len() + 2, usize::from(BLINK_BYTES));
        let long = [&short[..], &[0x43, 0x02, 0xD1, 0x7F, 0x8E, 0x00]].concat();
        assert_eq!(Blink::parse(&long), Ok(blink));
        for length in (0..long.len()).filter(|length| *length != short.len()) {
            let error =
                if length < short.len() { FrameError::Truncated } else { FrameError::TooLong(length - short.len()) };
            assert_eq!(Blink::parse(&long[..length]), Err(error), "cut to {length}");
        }
    }

    #[test]
    fn delays_are_micro_or_milliseconds() {
        assert_eq!(delay_of(0x8096).as_micros(), 150_000);
        assert_eq!(delay_of(400), RadioDuration::from_micros(400));
        assert_eq!(delay_field(RadioDuration::from_micros(401)), 400, "ticks round down");
        assert_eq!(delay_field(RadioDuration::from_micros(150_000)), 0x8096);
        assert_eq!(delay_field(RadioDuration::from_ticks(-1)), 0);
        assert_eq!(delay_field(RadioDuration::from_ticks(i64::MAX / 20)), 0xFFFF);
    }
}
