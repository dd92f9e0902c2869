//! The calendar of a node that has none: the station's, by its receipts.

/// How fast what is known of a clock ages: twice the tolerance of a usual crystal, millionths.
const DRIFT_PPM: u64 = 50;

/// How far the node's clock is behind the station's.
#[derive(Clone, Copy, Debug)]
pub struct StationClock {
    ahead_us: i64,
    /// The true value differs by this at most, at this time.
    error_us: u64,
    at_us: u64,
}

impl StationClock {
    /// A receipt that was sent at `station_us` by the station's clock answers what was sent at `sent_us` by the node's, and
    /// came at `now_us`. Somewhere in between it was sent.
    pub fn of(station_us: u64, sent_us: u64, now_us: u64) -> Self {
        let error_us = now_us.saturating_sub(sent_us) / 2;
        let middle_us = now_us - error_us.min(now_us);
        Self { ahead_us: station_us.cast_signed().saturating_sub(middle_us.cast_signed()), error_us, at_us: now_us }
    }

    /// The better one of what was known and what a receipt says.
    pub fn or_better(self, other: Self) -> Self {
        let aged_us = other.at_us.saturating_sub(self.at_us).saturating_mul(DRIFT_PPM) / 1_000_000;
        if other.error_us < self.error_us.saturating_add(aged_us) { other } else { self }
    }

    /// A time of the node by the station's clock: microseconds since 1970.
    pub fn utc_us(&self, node_us: u64) -> u64 {
        node_us.saturating_add_signed(self.ahead_us)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_quickest_answer_counts_until_it_is_old() {
        // The station's clock shows 1,000 s more. Ways of 2 ms and 4 ms: the middle is 1 ms wrong.
        let first = StationClock::of(1_010_002_000, 10_000_000, 10_006_000);
        assert_eq!((first.utc_us(10_000_000), first.error_us), (1_009_999_000, 3_000));
        // Ways of 2 ms and 40 ms a second later, and of 1 ms each.
        let slow = StationClock::of(1_011_002_000, 11_000_000, 11_042_000);
        assert_eq!(first.or_better(slow).utc_us(0), first.utc_us(0));
        let quick = StationClock::of(1_012_001_000, 12_000_000, 12_002_000);
        assert_eq!(first.or_better(quick).utc_us(0), 1_000_000_000);
        // 20 ms of uncertainty: 50 millionths make that in 400 s, less the 1 ms that is there already.
        let later = |s: u64| {
            let sent_us = (12 + s) * 1_000_000;
            quick.or_better(StationClock::of(1_000_000_000 + sent_us + 30_000, sent_us, sent_us + 40_000))
        };
        assert_eq!((later(370).utc_us(0), later(390).utc_us(0)), (1_000_000_000, 1_000_010_000));
    }

    #[test]
    fn times_beyond_all_bounds_saturate() {
        for (station_us, sent_us, now_us) in [(0, u64::MAX, 0), (u64::MAX, 0, u64::MAX), (0, 0, u64::MAX), (0, 5, 3)] {
            let clock = StationClock::of(station_us, sent_us, now_us);
            let _ = (clock.utc_us(0), clock.utc_us(u64::MAX), clock.or_better(clock));
        }
    }
}
