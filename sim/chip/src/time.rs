//! True time: the time of a clock without drift, in picoseconds since the simulation began.
//!
//! A picosecond is 0.06 of a DW1000 tick (15.65 ps) or 0.3 mm of light. 64 bits of picoseconds last 213 days.

use std::fmt;
use std::ops::{Add, Sub};
use std::time::Duration;

/// Picoseconds in a microsecond.
pub const PS_PER_US: u64 = 1_000_000;
/// Picoseconds in a second.
pub const PS_PER_S: u64 = 1_000_000_000_000;

/// An instant of true time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TrueTime(u64);

impl TrueTime {
    /// The beginning of the simulation.
    pub const ZERO: Self = Self(0);
    /// Later than everything.
    pub const NEVER: Self = Self(u64::MAX);

    /// The instant `picoseconds` after the beginning.
    pub const fn from_ps(picoseconds: u64) -> Self {
        Self(picoseconds)
    }

    /// The instant `seconds` after the beginning, rounded to a picosecond.
    pub fn from_secs_f64(seconds: f64) -> Self {
        Self((seconds * PS_PER_S as f64).round() as u64)
    }

    /// The instant `micros` microseconds after the beginning.
    pub const fn from_micros(micros: u64) -> Self {
        Self(micros * PS_PER_US)
    }

    /// Picoseconds since the beginning.
    pub const fn as_ps(self) -> u64 {
        self.0
    }

    /// Seconds since the beginning.
    pub fn as_secs_f64(self) -> f64 {
        self.0 as f64 / PS_PER_S as f64
    }

    /// The instant `picoseconds` later; [`TrueTime::NEVER`] if that is beyond the range.
    pub const fn plus_ps(self, picoseconds: u64) -> Self {
        Self(self.0.saturating_add(picoseconds))
    }

    /// Picoseconds from `earlier` to `self`, 0 if it is not earlier.
    pub const fn ps_since(self, earlier: Self) -> u64 {
        self.0.saturating_sub(earlier.0)
    }
}

impl Add<Duration> for TrueTime {
    type Output = Self;

    fn add(self, by: Duration) -> Self {
        Self(self.0.saturating_add(u64::try_from(by.as_nanos()).unwrap_or(u64::MAX).saturating_mul(1000)))
    }
}

impl Sub for TrueTime {
    type Output = Duration;

    #[expect(clippy::suspicious_arithmetic_impl, reason = "picoseconds to nanoseconds")]
    /// The time between two instants, rounded down to a nanosecond; zero if the other is later.
    fn sub(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.ps_since(earlier) / 1000)
    }
}

impl fmt::Display for TrueTime {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{:.6} s", self.as_secs_f64())
    }
}
