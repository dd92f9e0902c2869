//! A stock board, implemented from its description: its software, its timing, its bytes and its arithmetic. Nothing
//! here uses the crate's frames.

use ranging::{PhyConfig, RadioDuration, RadioInstant};

use crate::air::ANTENNA_DELAY;

/// Metres per tick, by the board's own constants.
pub const METRES: f64 = 299_702_547.0 / (499.2e6 * 128.0);
/// The unit of the chip's timers: 512 periods of 499.2 MHz.
pub const SYMBOL_US: f64 = 1.0256;
/// The receiver is switched on this much before the expected frame.
pub const START_UP_SYMBOLS: f64 = 16.0;

/// Known software of EVK1000 boards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Software {
    /// A ranging init of 5 bytes with one delay in plain milliseconds; a report. Windows end 3000 symbols after the
    /// frame.
    Older { reply_ms: u16 },
    /// A ranging init of 7 bytes with two delays in microseconds. Windows end 50 symbols after the frame.
    NewerMicros,
    /// The same in milliseconds: 150 from poll to response, 200 from response to final.
    NewerMillis,
}

/// A board.
#[derive(Clone, Copy, Debug)]
pub struct Kit {
    pub software: Software,
    pub phy: PhyConfig,
    /// 64-bit addresses in all frames.
    pub long: bool,
    /// From a blink to the ranging init: 150 ms, 750 with S1-8 on.
    pub init_ms: u32,
    /// A tag that accepts only a ranging init of its own length, and whose windows are shorter.
    pub strict: bool,
}

impl Kit {
    pub fn margin_symbols(&self) -> f64 {
        match self.software {
            // Less would cut the init at 110 kbit/s, which is ten bytes longer than the blink.
            Software::Older { .. } if self.strict => 1000.0,
            Software::Older { .. } => 3000.0,
            Software::NewerMicros | Software::NewerMillis => 50.0,
        }
    }

    /// Bytes of the header.
    pub fn head_bytes(&self) -> u16 {
        if self.long { 21 } else { 9 }
    }

    /// The frame's time on the air, µs: header, the bytes that follow, and two check bytes.
    pub fn frame_us(&self, follows: u16) -> f64 {
        micros(self.phy.airtime(self.head_bytes() + follows + 2))
    }

    pub fn init_us(&self) -> f64 {
        let head = if self.long { 21 } else { 15 };
        let follows = if matches!(self.software, Software::Older { .. }) { 5 } else { 7 };
        micros(self.phy.airtime(head + follows + 2))
    }

    /// The bytes of a frame; short addresses are the ends of long ones.
    pub fn frame(&self, sequence: u8, to: u64, from: u64, follows: &[u8]) -> Vec<u8> {
        let mut out = vec![0x41, if self.long { 0xCC } else { 0x88 }, sequence, 0xCA, 0xDE];
        let length = if self.long { 8 } else { 2 };
        out.extend(&to.to_le_bytes()[..length]);
        out.extend(&from.to_le_bytes()[..length]);
        out.extend(follows);
        out
    }

    /// The bytes after the header in a frame to this board. The chip's filter rejects all other frames.
    pub fn payload(&self, bytes: &[u8], own: u64) -> Option<(u64, Vec<u8>)> {
        let length = if self.long { 8 } else { 2 };
        let head = usize::from(self.head_bytes());
        let kind = [0x41, if self.long { 0xCC } else { 0x88 }];
        let ours = bytes.len() > head && bytes[..2] == kind && bytes[3..5] == [0xCA, 0xDE];
        if !ours || bytes[5..5 + length] != own.to_le_bytes()[..length] {
            return None;
        }
        Some((little(&bytes[5 + length..head]), bytes[head..].to_vec()))
    }
}

pub fn micros(span: RadioDuration) -> f64 {
    span.ticks() as f64 / 63_897.6
}

pub fn span(micros: f64) -> RadioDuration {
    RadioDuration::from_ticks((micros * 63_897.6) as i64)
}

/// An unsigned number, least significant byte first.
pub fn little(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte))
}

/// The same of 40 bits, signed.
pub fn signed40(bytes: &[u8]) -> i64 {
    (little(bytes) << 24) as i64 >> 24
}

/// Ticks from one instant to a later one, in 40 bits.
pub fn ticks(later: u64, earlier: u64) -> f64 {
    (later.wrapping_sub(earlier) & 0xFF_FFFF_FFFF) as f64
}

/// The instant at which a frame with this programmed start leaves the antenna: low nine bits ignored, antenna delay
/// added.
pub fn leaves(start: RadioInstant) -> u64 {
    ((start.ticks() & !511) + ANTENNA_DELAY as u64) & 0xFF_FFFF_FFFF
}
