//! What all nodes of a network must agree on beside its PHY: how long an answer takes its slowest anchor, how soon its
//! slowest node receives again, and whether a final follows the responses. The slots follow from it
//! (`ranging::native::Timing`).
//!
//! The coordinator sets the slot lengths by the requests of the slowest node, and its sync frames contain them. A new
//! layout is in force from the superframe from which the list of members that came with it is in force.

use radio::RadioDuration;

/// A reply delay as it is on the air: (16 + c mod 16) · 2^⌊c / 16⌋ µs for the code c of seven bits, 16 µs to 3.968 ms
/// in steps of 3 to 6 %.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Span(u8);

/// Rounded up as in [`RadioDuration::from_micros`], so that a whole number of microseconds is its own span.
const MICROSECOND: RadioDuration = RadioDuration::from_ticks(63_898);

impl Span {
    /// The longest, 3.968 ms.
    pub const LONGEST: Self = Self(0x7F);

    /// The shortest span that is at least as long; for longer durations the longest span. A node calls it for a few
    /// frames a second, from many places: its code exists once.
    #[inline(never)]
    pub const fn at_least(duration: RadioDuration) -> Self {
        let ticks = duration.ticks();
        // Octave by octave, each with sixteen steps; the first begins at 16 µs.
        let mut octave = 0;
        let mut step = MICROSECOND.ticks();
        while octave < 7 && ticks > 31 * step {
            octave += 1;
            step *= 2;
        }
        let mut within = 0;
        while within < 15 && ticks > (16 + within) * step {
            within += 1;
        }
        Self(octave << 4 | within as u8)
    }

    /// From the lowest seven bits of a byte.
    #[inline]
    pub const fn from_code(code: u8) -> Self {
        Self(code & Self::LONGEST.0)
    }

    /// Seven bits.
    #[inline]
    pub const fn code(self) -> u8 {
        self.0
    }

    /// Its duration.
    #[inline]
    pub const fn duration(self) -> RadioDuration {
        RadioDuration::from_micros((16 + (self.0 as u32 & 0x0F)) << (self.0 >> 4))
    }
}

/// The scheme of a round.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Scheme {
    /// A poll and a response of each anchor; the tag estimates the anchors' clocks from poll to poll.
    #[default]
    SingleSided,
    /// The same, and a final of the tag. Each anchor reports its arrival in its next response: asymmetric double-sided
    /// ranging, which needs no model of clocks.
    DoubleSided,
}

/// The layout of a network's slots, or a node's request for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Layout {
    /// From the end of a poll to the first pulse of the first response.
    pub answer: Span,
    /// From the end of one response to the first pulse of the next one.
    pub listen_again: Span,
    /// Whether rounds have room for a final.
    pub scheme: Scheme,
}

impl Layout {
    /// A request for this layout has no effect.
    pub const LEAST: Self = Self { answer: Span(0), listen_again: Span(0), scheme: Scheme::SingleSided };

    /// The layout that serves both.
    #[inline]
    pub fn max(self, other: Self) -> Self {
        Self {
            answer: self.answer.max(other.answer),
            listen_again: self.listen_again.max(other.listen_again),
            scheme: self.scheme.max(other.scheme),
        }
    }

    /// From two bytes: code of the answer; code of receiving again, with the scheme in its highest bit.
    #[inline]
    pub(crate) const fn from_bytes([answer, tag]: [u8; 2]) -> Self {
        Self { answer: Span::from_code(answer), ..Self::from_tag_byte(tag) }
    }

    /// Two bytes; the highest bit of the first is free.
    #[inline]
    pub(crate) const fn bytes(self) -> [u8; 2] {
        [self.answer.code(), self.tag_byte()]
    }

    /// A tag's request: it answers no other node.
    #[inline]
    pub const fn from_tag_byte(byte: u8) -> Self {
        let scheme = if byte & 0x80 == 0 { Scheme::SingleSided } else { Scheme::DoubleSided };
        Self { answer: Self::LEAST.answer, listen_again: Span::from_code(byte), scheme }
    }

    /// [`from_tag_byte`](Self::from_tag_byte)'s byte.
    #[inline]
    pub const fn tag_byte(self) -> u8 {
        let double_sided = match self.scheme {
            Scheme::SingleSided => 0,
            Scheme::DoubleSided => 0x80,
        };
        self.listen_again.code() | double_sided
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_are_rounded_up_by_an_eighth_at_most() {
        // Code 0x35: (16 + 5) · 2³ = 168 µs.
        assert_eq!(Span::from_code(0x35).duration(), RadioDuration::from_micros(168));
        for micros in [0, 1, 16, 17, 33, 100, 250, 600, 1999, 3968] {
            let wanted = RadioDuration::from_micros(micros);
            let span = Span::at_least(wanted).duration();
            assert!(span >= wanted, "{micros}: {span:?}");
            // Up to a sixteenth at the beginning of an octave; 16 µs is the minimum.
            assert!(span.as_micros() <= i64::from((micros + micros / 16 + 1).max(16)), "{micros}: {span:?}");
        }
        assert_eq!(Span::at_least(RadioDuration::from_micros(100_000)), Span::LONGEST);
    }

    #[test]
    fn layouts_come_back_from_their_bytes() {
        for code in 0..=0x7F {
            for scheme in [Scheme::SingleSided, Scheme::DoubleSided] {
                let layout =
                    Layout { answer: Span::from_code(code), listen_again: Span::from_code(0x7F - code), scheme };
                assert_eq!(Layout::from_bytes(layout.bytes()), layout);
                let of_a_tag = Layout { answer: Layout::LEAST.answer, ..layout };
                assert_eq!(Layout::from_tag_byte(layout.tag_byte()), of_a_tag);
            }
        }
    }
}
