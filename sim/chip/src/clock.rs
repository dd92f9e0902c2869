//! A node's oscillator: the conversion between true time and the counter of its DW1000.
//!
//! The counter runs at 128 × 499.2 MHz × (1 + offset). The offset is the sum of a constant, a random walk and a swing
//! by temperature. It is constant over segments of 50 ms. Within a segment, time and counter are proportional, so the
//! conversion can be inverted. Counts are in 1/256 tick (61 fs) and do not wrap here; the chip shows 40 bits of them.

use crate::random::{Stream, gauss};
use crate::time::{PS_PER_S, TrueTime};
use std::collections::VecDeque;

/// Ticks per picosecond of a clock without drift: 63.8976 GHz.
pub const TICKS_PER_PS: f64 = 0.063_897_6;
/// A segment's length.
const SEGMENT_PS: u64 = PS_PER_S / 20;
/// Segments kept: enough for a delayed transmission that is a counter's period ahead, and for looking back a little.
const KEPT: usize = 8;

/// The error of an oscillator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockConfig {
    /// Constant offset, parts per million. Positive: the clock is fast.
    pub offset_ppm: f64,
    /// Standard deviation of the random walk after one second, parts per million.
    pub walk_ppm: f64,
    /// Amplitude of a slow sine (temperature), parts per million.
    pub swing_ppm: f64,
    /// Period of that sine, seconds.
    pub swing_period_s: f64,
}

impl ClockConfig {
    /// No drift at all.
    pub const IDEAL: Self = Self { offset_ppm: 0.0, walk_ppm: 0.0, swing_ppm: 0.0, swing_period_s: 1.0 };

    /// A crystal with an error of `offset_ppm` and the random walk of crystals within a room: 0.01 ppm per second, ±0.2
    /// ppm in 5 min.
    pub const fn crystal(offset_ppm: f64) -> Self {
        Self { offset_ppm, walk_ppm: 0.01, swing_ppm: 0.2, swing_period_s: 300.0 }
    }
}

/// A count of 1/256 tick since the clock's own zero. It does not wrap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Count(pub(crate) u64);

impl Count {
    /// Whole ticks.
    pub const fn ticks(self) -> u64 {
        self.0 >> 8
    }

    /// The count of whole `ticks`.
    pub const fn from_ticks(ticks: u64) -> Self {
        Self(ticks << 8)
    }

    /// The count `ticks` later (earlier where negative).
    pub fn plus_ticks(self, ticks: f64) -> Self {
        Self(self.0.wrapping_add_signed((ticks * 256.0).round() as i64))
    }
}

#[derive(Clone, Copy, Debug)]
struct Segment {
    start: u64,
    count: u64,
    /// 1/256 ticks per picosecond.
    rate: f64,
}

impl Segment {
    fn count_at(&self, ps: u64) -> u64 {
        let along = ps as f64 - self.start as f64;
        self.count.wrapping_add_signed((along * self.rate).round() as i64)
    }

    fn ps_at(&self, count: u64) -> u64 {
        let along = (count as f64 - self.count as f64) / self.rate;
        self.start.saturating_add_signed(along.round() as i64)
    }
}

/// A drifting clock.
#[derive(Debug)]
pub struct Clock {
    config: ClockConfig,
    segments: VecDeque<Segment>,
    walk_ppm: f64,
    trim_ppm: f64,
    random: Stream,
}

impl Clock {
    /// A clock that shows `first` at true time zero.
    pub fn new(config: ClockConfig, first: Count, random: Stream) -> Self {
        let mut clock = Self { config, segments: VecDeque::with_capacity(KEPT), walk_ppm: 0.0, trim_ppm: 0.0, random };
        let rate = clock.rate(0);
        clock.segments.push_back(Segment { start: 0, count: first.0, rate });
        clock
    }

    /// What the clock shows at `time`.
    pub fn count_at(&mut self, time: TrueTime) -> Count {
        let ps = time.as_ps();
        self.extend_while(|last| last.start + SEGMENT_PS <= ps);
        Count(self.segment(|s| s.start <= ps).count_at(ps))
    }

    /// The time at which the clock shows `count`, to a picosecond.
    pub fn time_of(&mut self, count: Count) -> TrueTime {
        self.extend_while(|last| last.count_at(last.start + SEGMENT_PS) <= count.0);
        TrueTime::from_ps(self.segment(|s| s.count <= count.0).ps_at(count.0))
    }

    /// The error of the clock at `time`, parts per million. Positive: fast.
    pub fn ppm_at(&mut self, time: TrueTime) -> f64 {
        let ps = time.as_ps();
        self.extend_while(|last| last.start + SEGMENT_PS <= ps);
        (self.segment(|s| s.start <= ps).rate / (256.0 * TICKS_PER_PS) - 1.0) * 1e6
    }

    /// Pulls the oscillator by `ppm` from `time` on (load capacitance, as the crystal trim sets it).
    pub fn trim(&mut self, time: TrueTime, ppm: f64) {
        if ppm == self.trim_ppm {
            return;
        }
        self.trim_ppm = ppm;
        let count = self.count_at(time);
        let start = time.as_ps();
        while self.segments.back().is_some_and(|s| s.start >= start) {
            self.segments.pop_back();
        }
        let rate = self.rate(start);
        self.segments.push_back(Segment { start, count: count.0, rate });
    }

    /// The latest kept segment that `begun` accepts, otherwise the earliest.
    fn segment(&self, begun: impl Fn(&Segment) -> bool) -> &Segment {
        self.segments.iter().rev().find(|s| begun(s)).unwrap_or(&self.segments[0])
    }

    fn extend_while(&mut self, short: impl Fn(&Segment) -> bool) {
        while let Some(last) = self.segments.back().copied().filter(&short) {
            let start = last.start + SEGMENT_PS;
            let step = gauss(&mut self.random);
            self.walk_ppm += step * self.config.walk_ppm * (SEGMENT_PS as f64 / PS_PER_S as f64).sqrt();
            if self.segments.len() == KEPT {
                self.segments.pop_front();
            }
            let rate = self.rate(start);
            self.segments.push_back(Segment { start, count: last.count_at(start), rate });
        }
    }

    fn rate(&self, ps: u64) -> f64 {
        let turns = ps as f64 / PS_PER_S as f64 / self.config.swing_period_s;
        let swing = self.config.swing_ppm * (std::f64::consts::TAU * turns).sin();
        256.0 * TICKS_PER_PS * (1.0 + 1e-6 * (self.config.offset_ppm + self.walk_ppm + swing + self.trim_ppm))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};

    fn clock(config: ClockConfig) -> Clock {
        Clock::new(config, Count::from_ticks(1000), stream(1, Purpose::Oscillator, 0))
    }

    #[test]
    fn a_second_has_the_chips_ticks() {
        let mut ideal = clock(ClockConfig::IDEAL);
        // 128 × 499.2 MHz = 63 897 600 000 ticks a second.
        assert_eq!(ideal.count_at(TrueTime::from_secs_f64(1.0)).ticks(), 63_897_601_000);
        // 20 ppm of that are 1 277 952 ticks.
        let mut fast = clock(ClockConfig { offset_ppm: 20.0, ..ClockConfig::IDEAL });
        assert_eq!(fast.count_at(TrueTime::from_secs_f64(1.0)).ticks(), 63_897_601_000 + 1_277_952);
        assert!((fast.ppm_at(TrueTime::from_secs_f64(2.0)) - 20.0).abs() < 1e-6);
    }

    #[test]
    fn counter_and_time_are_inverse_within_a_picosecond() {
        let mut wandering = clock(ClockConfig { walk_ppm: 5.0, ..ClockConfig::crystal(-13.0) });
        for step in 0..2000u64 {
            let time = TrueTime::from_ps(step * 987_654_321_987 / 100 + step * step);
            let count = wandering.count_at(time);
            let back = wandering.time_of(count);
            assert!(back.as_ps().abs_diff(time.as_ps()) <= 1, "{time} {back}");
        }
    }

    #[test]
    fn a_delayed_start_looks_ahead_without_disturbing_the_present() {
        let (mut a, mut b) = (clock(ClockConfig::crystal(3.0)), clock(ClockConfig::crystal(3.0)));
        let now = TrueTime::from_secs_f64(0.02);
        let ahead = a.count_at(now).plus_ticks(63_897_600.0 * 200.0);
        assert!(a.time_of(ahead) > now);
        assert_eq!(a.count_at(now), b.count_at(now));
        let later = TrueTime::from_secs_f64(0.21);
        assert_eq!(a.count_at(later), b.count_at(later));
    }

    #[test]
    fn trimming_changes_the_rate_and_leaves_no_jump() {
        let mut c = clock(ClockConfig::IDEAL);
        let t = TrueTime::from_secs_f64(0.5);
        let before = c.count_at(t);
        c.trim(t, -10.0);
        assert_eq!(c.count_at(t), before);
        // Half a second at −10 ppm: 63 897 600 000 / 2 × 10⁻⁵ = 319 488 ticks fewer.
        let after = c.count_at(TrueTime::from_secs_f64(1.0));
        assert!((after.ticks() - before.ticks()).abs_diff(31_948_800_000 - 319_488) <= 1);
    }
}
