//! A node's clock: 40 bits that begin anywhere and run a little fast or slow. True time is in ticks of 1/63.8976 GHz since the
//! beginning, unsigned 64-bit: nine years.

use ranging::{RadioDuration, RadioInstant};

/// Ticks in ten microseconds.
const TICKS_IN_10_US: u64 = 638_976;
/// Parts in a billion.
const BILLION: i64 = 1_000_000_000;

/// Ticks of so many microseconds.
pub const fn ticks(micros: u64) -> u64 {
    micros * TICKS_IN_10_US / 10
}

/// Microseconds of so many ticks.
pub const fn micros(ticks: u64) -> u64 {
    (ticks as u128 * 10 / TICKS_IN_10_US as u128) as u64
}

/// What drives a node's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crystal {
    /// The count at the beginning.
    pub start: u64,
    /// Fast by this, parts in a billion.
    pub fast_ppb: i32,
}

impl Crystal {
    /// What the clock shows at a time.
    pub fn local(&self, time: u64) -> RadioInstant {
        let gained = i128::from(time) * i128::from(self.fast_ppb) / i128::from(BILLION);
        RadioInstant::from_ticks(self.start.wrapping_add(time).wrapping_add(gained as u64))
    }

    /// When the clock shows this, of all such times the one nearest to `near`.
    pub fn global(&self, instant: RadioInstant, near: u64) -> u64 {
        let mut time = near;
        // The second step makes good what the first neglects, the clock's own rate: millionths of millionths are left.
        for _ in 0..2 {
            let ahead = instant.since(self.local(time)).ticks();
            time = time.saturating_add_signed(ahead - ahead / BILLION * i64::from(self.fast_ppb));
        }
        time
    }
}

/// A span of a clock as true time: over the milliseconds of a window the rate does not matter.
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
