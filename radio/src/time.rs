//! The clock of a radio: 40 bits that count 128 × 499.2 MHz = 63.8976 GHz and wrap every 17.2 s.
//!
//! Hardware times are newtypes, so that a tick is never mistaken for a nanosecond, nor an instant for a duration.

/// Ticks a second: 128 × 499.2 MHz (128 for each chip of IEEE 802.15.4's UWB PHY).
pub const TICKS_PER_SECOND: u64 = 63_897_600_000;
/// Metres that light travels in air within one tick, at the refractive index 1.000293 of air.
pub const METRES_PER_TICK: f64 = 299_792_458.0 / 1.000_293 / 63_897_600_000.0;

const MASK: u64 = (1 << 40) - 1;

/// An instant of one radio's clock: 40 bits, wrapping.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RadioInstant(u64);

/// A span of one radio's clock, in ticks; signed, and longer than the clock's range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RadioDuration(i64);

impl RadioInstant {
    /// The instant of a 40-bit count; higher bits are dropped.
    pub const fn from_ticks(ticks: u64) -> Self {
        Self(ticks & MASK)
    }

    /// The 40-bit count.
    pub const fn ticks(self) -> u64 {
        self.0
    }

    /// The instant of five bytes, least significant first, as registers and frames hold it.
    pub const fn from_le_bytes(b: [u8; 5]) -> Self {
        Self(u64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], 0, 0, 0]))
    }

    /// Five bytes, least significant first.
    pub const fn to_le_bytes(self) -> [u8; 5] {
        let b = self.0.to_le_bytes();
        [b[0], b[1], b[2], b[3], b[4]]
    }

    /// From `earlier` to `self` across any wrap, for durations from −8.6 s to +8.6 s.
    pub const fn since(self, earlier: Self) -> RadioDuration {
        let forward = self.0.wrapping_sub(earlier.0) & MASK;
        // Sign extension from 40 to 64 bits.
        RadioDuration(((forward << 24) as i64) >> 24)
    }

    /// The instant `by` later (earlier if negative), wrapping.
    pub const fn plus(self, by: RadioDuration) -> Self {
        Self(self.0.wrapping_add(by.0 as u64) & MASK)
    }

    /// The multiple of `step` ticks, a power of two, at or before `self`: where a radio with this
    /// [step](crate::Capabilities::delayed_step) really starts for a start that is programmed for `self`.
    pub const fn snapped(self, step: u32) -> Self {
        Self(self.0 & !(step as u64 - 1))
    }
}

impl RadioDuration {
    /// No time.
    pub const ZERO: Self = Self(0);

    /// A span of ticks.
    pub const fn from_ticks(ticks: i64) -> Self {
        Self(ticks)
    }

    /// The span in ticks.
    pub const fn ticks(self) -> i64 {
        self.0
    }

    /// A span of microseconds, rounded down to a tick (63 897.6 ticks each).
    pub const fn from_micros(micros: u32) -> Self {
        Self((micros as i64 * 638_976) / 10)
    }

    /// The span in microseconds, rounded towards zero.
    pub const fn as_micros(self) -> i64 {
        self.0 * 10 / 638_976
    }
}
