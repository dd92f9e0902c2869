//! Leases: which tag owns which round slot, how often and when.

use crate::uwb::{FrameBuffer, FrameError, MAX_ROUND, Reader};

/// Blinks in a round slot. They come one after the other at the distance of responses, and leave the place of a round's
/// last response free, for an answer to one of them.
pub const MAX_BLINKS: u8 = MAX_ROUND as u8 - 1;
const _: () = assert!(MAX_BLINKS < 8, "three bits");

/// How often a leased slot is its owner's: once in 2ᵃ · 5ᵇ superframes, at most [`Period::MOST`].
///
/// With these periods most turns of two leases fit into one slot: those of 10 and 100 superframes do, and there are 90
/// of 100 left beside ten of 100.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Period(u8);

impl Period {
    /// Every superframe.
    pub const ONE: Self = Self(0);
    /// The longest, superframes: 500 s of superframes of 100 ms.
    pub const MOST: u16 = 5000;
    const FIVES_SHIFT: u8 = 3;
    const MAX_TWOS: u8 = 7;
    const MAX_FIVES: u8 = 5;

    /// The longest that is not longer than this many superframes; at least one.
    #[inline(never)]
    pub const fn at_most(superframes: u16) -> Self {
        let limit = if superframes > Self::MOST { Self::MOST } else { superframes };
        let mut best = Self::ONE;
        let mut fives = 0;
        while fives <= Self::MAX_FIVES {
            let mut twos = 0;
            while twos <= Self::MAX_TWOS {
                let period = Self(fives << Self::FIVES_SHIFT | twos);
                let length = period.wide();
                if length <= limit as u32 && length > best.wide() {
                    best = period;
                }
                twos += 1;
            }
            fives += 1;
        }
        best
    }

    const fn twos(self) -> u8 {
        self.0 & Self::MAX_TWOS
    }

    const fn fives(self) -> u8 {
        self.0 >> Self::FIVES_SHIFT
    }

    const fn wide(self) -> u32 {
        const POWERS: [u32; 6] = [1, 5, 25, 125, 625, 3125];
        let fives = if self.fives() > Self::MAX_FIVES { Self::MAX_FIVES } else { self.fives() };
        POWERS[fives as usize] << self.twos()
    }

    /// In superframes.
    #[inline(never)]
    pub const fn superframes(self) -> u16 {
        self.wide() as u16
    }

    /// The greatest common divisor of two periods, superframes: their turns meet if their phases agree modulo this.
    #[inline(never)]
    pub const fn common_with(self, other: Self) -> u16 {
        let twos = if self.twos() < other.twos() { self.twos() } else { other.twos() };
        let fives = if self.fives() < other.fives() { self.fives() } else { other.fives() };
        Self(fives << Self::FIVES_SHIFT | twos).superframes()
    }

    /// From six bits.
    ///
    /// # Errors
    /// A period longer than [`Period::MOST`], or exponents beyond those of such periods.
    #[inline]
    pub(super) const fn from_code(code: u8) -> Result<Self, FrameError> {
        let period = Self(code);
        if period.fives() > Self::MAX_FIVES || period.wide() > Self::MOST as u32 {
            return Err(FrameError::Field);
        }
        Ok(period)
    }

    /// Six bits: b, then a in the low three.
    #[inline]
    pub(super) const fn code(self) -> u8 {
        self.0
    }
}

/// The turns that a tag requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Turns {
    /// How often.
    pub period: Period,
    /// Whether they are for blinks, and not for rounds.
    pub are_blinks: bool,
}

impl Turns {
    /// Slots for rounds with this period.
    pub const fn rounds(period: Period) -> Self {
        Self { period, are_blinks: false }
    }

    /// Parts of slots for blinks with this period.
    pub const fn blinks(period: Period) -> Self {
        Self { period, are_blinks: true }
    }
}

/// The turns of a tag: a round slot, or a part of one, in the superframes whose number is congruent to a phase, modulo a
/// period.
///
/// Numbers of superframes wrap after 65,536. A period that does not divide this has one shorter pause there, the same
/// for all nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Turn {
    /// The round slot, below 64.
    pub slot: u8,
    /// How often.
    pub period: Period,
    /// Both in one, as on the air: anchors keep a thousand of them.
    pub phase_and_part: u16,
}

impl Turn {
    /// The part is in the highest bits.
    const PART_SHIFT: u16 = 13;

    /// Turns in a slot or, as one of its blinks, in a part of it, with a phase below the period.
    #[inline]
    pub const fn new(slot: u8, part: u8, period: Period, phase: u16) -> Self {
        Self { slot, period, phase_and_part: phase | (part as u16) << Self::PART_SHIFT }
    }

    /// The remainder of the superframe's number, below the period.
    #[inline]
    pub const fn phase(self) -> u16 {
        self.phase_and_part & ((1 << Self::PART_SHIFT) - 1)
    }

    /// Which of the slot's [`MAX_BLINKS`] blinks is the tag's, from 1 on; 0: the whole slot, for rounds.
    #[inline]
    pub const fn part(self) -> u8 {
        (self.phase_and_part >> Self::PART_SHIFT) as u8
    }

    /// What a tag has requested to get it.
    #[inline]
    pub const fn turns(self) -> Turns {
        Turns { period: self.period, are_blinks: self.part() > 0 }
    }

    /// Whether the slot is its owner's in this superframe.
    #[inline]
    pub const fn is_in(self, superframe: u16) -> bool {
        superframe % self.period.superframes() == self.phase()
    }

    /// Superframes from this one to the next that is its owner's, at least one.
    #[inline(never)]
    pub const fn next_after(self, superframe: u16) -> u16 {
        let period = self.period.superframes();
        let at = superframe % period;
        let ahead = if self.phase() > at { self.phase() - at } else { self.phase() + period - at };
        // From zero on, remainders begin anew.
        let to_wrap = 0x1_0000 - superframe as u32;
        if (ahead as u32) < to_wrap { ahead } else { (to_wrap + self.phase() as u32) as u16 }
    }

    /// Whether two turns ever meet.
    #[inline]
    pub const fn meets(self, other: Self) -> bool {
        let common = self.period.common_with(other.period);
        let [part, of_other] = [self.part(), other.part()];
        let share_air = part == 0 || of_other == 0 || part == of_other;
        self.slot == other.slot && share_air && self.phase() % common == other.phase() % common
    }

    /// The bit of its slot.
    #[inline]
    pub const fn bit(self) -> u64 {
        1 << (self.slot & Lease::SLOT)
    }
}

/// What the coordinator says of a lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Grant {
    /// The tag gets these turns.
    New,
    /// The tag has polled in these turns and keeps them.
    Kept,
    /// No turn is free: the tag waits. Its turn says nothing but the period.
    Refused,
    /// These turns are for another tag from now on.
    Ended,
}

/// What an anchor's response says of the lease of the poll's turn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Confirmation {
    /// Nothing: the anchor does not know it, or not of a renewal.
    #[default]
    None,
    /// It was renewed not long ago.
    Renewed,
    /// It has ended: another tag waits for a turn.
    Ended,
}

impl Confirmation {
    #[inline]
    pub(super) const fn from_code(code: u8) -> Result<Self, FrameError> {
        match code {
            0 => Ok(Self::None),
            1 => Ok(Self::Renewed),
            2 => Ok(Self::Ended),
            _ => Err(FrameError::Field),
        }
    }
}

/// An entry of a sync frame: whose a turn is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Lease {
    /// Short address of the tag.
    pub tag: u16,
    /// Its turns.
    pub turn: Turn,
    /// What is said of them.
    pub grant: Grant,
}

impl Lease {
    /// Its length on the air.
    pub const BYTES: usize = 6;
    const SLOT: u8 = 0x3F;
    const KEPT: u8 = 0x40;
    const REFUSED: u8 = 0x80;
    const ENDED: u8 = 0xC0;
    #[inline]
    pub(super) fn parse(reader: &mut Reader<'_>) -> Result<Self, FrameError> {
        let tag = reader.u16()?;
        let [slot, period] = reader.take()?;
        let period = Period::from_code(period)?;
        let turn = Turn { slot: slot & Self::SLOT, period, phase_and_part: reader.u16()? };
        let grant = match slot & !Self::SLOT {
            0 => Grant::New,
            Self::KEPT => Grant::Kept,
            Self::REFUSED => Grant::Refused,
            _ => Grant::Ended,
        };
        if turn.phase() >= period.superframes() {
            return Err(FrameError::Field);
        }
        Ok(Self { tag, turn, grant })
    }

    #[inline]
    pub(super) fn emit(&self, out: &mut FrameBuffer) {
        let Turn { slot, period, phase_and_part } = self.turn;
        let grant = match self.grant {
            Grant::New => 0,
            Grant::Kept => Self::KEPT,
            Grant::Refused => Self::REFUSED,
            Grant::Ended => Self::ENDED,
        };
        out.put(&self.tag.to_le_bytes());
        out.put(&[slot & Self::SLOT | grant, period.code()]);
        out.put(&phase_and_part.to_le_bytes());
    }
}

/// A poll in a leased turn, which an anchor passes on towards the coordinator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LeasedPoll {
    /// Short address of the tag.
    pub tag: u16,
    /// The byte of its request for the layout.
    pub wish: u8,
}

impl LeasedPoll {
    /// Its length on the air.
    pub const BYTES: usize = 3;

    #[inline]
    pub(super) fn parse(reader: &mut Reader<'_>) -> Result<Self, FrameError> {
        Ok(Self { tag: reader.u16()?, wish: reader.u8()? })
    }

    #[inline]
    pub(super) fn emit(&self, out: &mut FrameBuffer) {
        out.put(&self.tag.to_le_bytes());
        out.put(&[self.wish]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn periods_are_products_of_twos_and_fives_and_never_longer_than_asked_for() {
        let lengths = [0, 1, 3, 7, 10, 99, 100, 127, 999, 4999, 5000, 6000, u16::MAX].map(Period::at_most);
        let expected = [1, 1, 2, 5, 10, 80, 100, 125, 800, 4000, 5000, 5000, 5000];
        assert_eq!(lengths.map(Period::superframes), expected);
        // 256 would be 2^8: the exponent of two ends at seven.
        assert_eq!(Period::at_most(256).superframes(), 250);
        let codes = (0..=u8::MAX).filter_map(|code| Period::from_code(code).ok());
        for period in codes {
            assert_eq!(Period::at_most(period.superframes()), period);
        }
    }

    #[test]
    fn the_next_turn_is_the_first_of_all_later_superframes_that_is_one() {
        for (length, phase) in [(1, 0), (10, 3), (100, 99), (5000, 17)] {
            let turn = Turn::new(0, 0, Period::at_most(length), phase);
            for number in [0, 3, 16, 17, 99, 5119, 60_000, 65_499, 65_530, u16::MAX] {
                let counted = (1..).find(|&after| turn.is_in(number.wrapping_add(after)));
                assert_eq!(Some(turn.next_after(number)), counted, "{turn:?} after {number}");
            }
        }
    }

    #[test]
    fn turns_meet_as_a_count_of_their_superframes_says() {
        let turn = |superframes, phase| Turn::new(3, 0, Period::at_most(superframes), phase);
        for (a, b) in [(2, 5), (4, 10), (10, 100), (5, 25), (1, 8), (8, 20)] {
            for (of_a, of_b) in (0..a).flat_map(|of_a| (0..b).map(move |of_b| (of_a, of_b))) {
                let (one, other) = (turn(a, of_a), turn(b, of_b));
                let counted = (0..a * b).any(|number| one.is_in(number) && other.is_in(number));
                assert_eq!(one.meets(other), counted, "{one:?} {other:?}");
                assert!(!one.meets(Turn { slot: 4, ..other }));
                // A blink shares its slot with other blinks, but not with rounds.
                let blink = Turn::new(one.slot, 1, one.period, one.phase());
                assert_eq!(blink.meets(other), counted);
                assert_eq!(blink.meets(Turn::new(other.slot, 1, other.period, other.phase())), counted);
                assert!(!blink.meets(Turn::new(other.slot, 2, other.period, other.phase())));
            }
        }
    }
}
