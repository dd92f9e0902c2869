//! Estimates how long the engine will be busy. It measures the engine's rounds, so that the tag starts rounds only when
//! there is time to compute them.

/// The mean is exponential: a new round has a weight of 1 / `SMOOTHING`.
const SMOOTHING: i64 = 8;
/// A round that took longer was interrupted by something else, microseconds.
const LONGEST_US: u64 = 200_000;

/// The state of the engine.
#[derive(Debug)]
pub(crate) struct Workload {
    /// When the engine took the present round, microseconds.
    begun_us: Option<u64>,
    /// The mean time of a round, microseconds.
    round_us: i64,
}

impl Workload {
    /// The state before the first round.
    pub(crate) const fn new() -> Self {
        Self { begun_us: None, round_us: 0 }
    }

    /// The engine takes a round.
    pub(crate) fn begin(&mut self, now_us: u64) {
        self.begun_us = Some(now_us);
    }

    /// The engine has finished its round.
    pub(crate) fn end(&mut self, now_us: u64) {
        let Some(begun_us) = self.begun_us.take() else { return };
        let took = now_us.saturating_sub(begun_us).min(LONGEST_US) as i64;
        self.round_us += if self.round_us == 0 { took } else { (took - self.round_us) / SMOOTHING };
    }

    /// The mean time of a round, microseconds.
    pub(crate) fn round_us(&self) -> u32 {
        u32::try_from(self.round_us).unwrap_or(0)
    }

    /// The time until the engine has finished the present round and those that wait, microseconds from now.
    pub(crate) fn left_us(&self, now_us: u64, waiting: usize) -> u32 {
        let present = self.begun_us.map_or(0, |begun_us| {
            let passed = now_us.saturating_sub(begun_us).min(LONGEST_US) as i64;
            (self.round_us - passed).max(0)
        });
        u32::try_from(present + self.round_us * waiting as i64).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_that_wait_are_reckoned_by_the_mean_and_the_present_one_by_what_is_left_of_it() {
        let mut workload = Workload::new();
        assert_eq!(workload.left_us(0, 2), 0);
        workload.begin(1_000);
        workload.end(5_000);
        assert_eq!(workload.left_us(5_000, 1), 4_000);
        workload.begin(6_000);
        // One millisecond of four has passed, and another round waits.
        assert_eq!(workload.left_us(7_000, 1), 7_000);
        // The round takes longer than any before: the remaining time is unknown.
        assert_eq!(workload.left_us(20_000, 0), 0);
    }

    #[test]
    fn the_mean_follows_an_engine_that_has_become_slower_or_quicker() {
        let mut workload = Workload::new();
        let mut rounds = |took_us: u64| {
            for start in 0..40 {
                workload.begin(start * 1_000_000);
                workload.end(start * 1_000_000 + took_us);
            }
            workload.left_us(0, 1)
        };
        assert!((985..=1_000).contains(&rounds(1_000)));
        assert!((7_900..=8_000).contains(&rounds(8_000)));
        assert!((1_000..=1_100).contains(&rounds(1_000)));
    }

    #[test]
    fn no_clock_makes_it_panic() {
        let mut workload = Workload::new();
        workload.end(5);
        workload.begin(u64::MAX);
        workload.end(0);
        workload.begin(0);
        assert_eq!(workload.left_us(u64::MAX, usize::from(u8::MAX)), 0);
        workload.end(u64::MAX);
        assert_eq!(workload.left_us(0, 1), LONGEST_US as u32);
    }
}
