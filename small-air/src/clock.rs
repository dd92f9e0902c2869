//! A node's clock: 40 bits that begin at any count and run a little fast or slow. True time is in ticks of 1/63.8976
//! GHz since the beginning, unsigned 64-bit: nine years.

use ranging::{RadioDuration, RadioInstant};

/// Ticks in ten microseconds.
const TICKS_IN_10_US: u64 = 638_976;
/// One in parts per billion.
const BILLION: i64 = 1_000_000_000;

/// Converts microseconds to ticks.
pub const fn ticks(micros: u64) -> u64 {
    micros * TICKS_IN_10_US / 10
}

/// Converts ticks to microseconds.
pub const fn micros(ticks: u64) -> u64 {
    (ticks as u128 * 10 / TICKS_IN_10_US as u128) as u64
}

/// The crystal of a node's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crystal {
    /// The count at the beginning.
    pub start: u64,
    /// How much the clock is fast, parts per billion.
    pub fast_ppb: i32,
}

impl Crystal {
    /// The count of the clock at a true time.
    pub fn local(&self, time: u64) -> RadioInstant {
        let gained = i128::from(time) * i128::from(self.fast_ppb) / i128::from(BILLION);
        RadioInstant::from_ticks(self.start.wrapping_add(time).wrapping_add(gained as u64))
    }

    /// The true time at which the clock shows `instant`; of all such times the one nearest to `near`.
    pub fn global(&self, instant: RadioInstant, near: u64) -> u64 {
        let mut time = near;
        // The first step neglects the clock's own rate; the second step corrects this. The remaining error is in
        // millionths of millionths.
        for _ in 0..2 {
            let ahead = instant.since(self.local(time)).ticks();
            time = time.saturating_add_signed(ahead - ahead / BILLION * i64::from(self.fast_ppb));
        }
        time
    }
}

/// A duration of the clock as true time. Over the milliseconds of a window, the rate error does not matter.
pub fn span(duration: RadioDuration) -> u64 {
    u64::try_from(duration.ticks()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_is_read_both_ways_across_its_wrap() {
        for fast_ppb in [-20_000, 0, 20_000] {
            let crystal = Crystal { start: (1 << 40) - 5, fast_ppb };
            for time in [0, 1, 1_000_000, 63_897_600_000, 900_000_000_000] {
                let instant = crystal.local(time);
                for off in [-2_000_000_000_i64, 0, 2_000_000_000] {
                    let found = crystal.global(instant, time.saturating_add_signed(off));
                    assert!(found.abs_diff(time) <= 1, "{fast_ppb} ppb, {time}: {found}");
                }
            }
        }
    }

    #[test]
    fn a_fast_clock_gains_what_it_says() {
        let crystal = Crystal { start: 7, fast_ppb: 20_000 };
        // A second is 63 897 600 000 ticks; twenty millionths of it are 1 277 952.
        assert_eq!(crystal.local(63_897_600_000).ticks(), 7 + 63_897_600_000 + 1_277_952);
        assert_eq!((ticks(1_000_000), micros(63_897_600_000)), (63_897_600_000, 1_000_000));
    }
}
