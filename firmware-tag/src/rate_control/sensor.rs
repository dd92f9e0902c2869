//! The reports of a motion sensor: their times, and whether a report is the beginning of a movement.

/// The sensor counts as quiet after this time without a report, microseconds.
const QUIET_US: u64 = 5_000_000;

/// The reports of a sensor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Movements {
    last_us: u64,
}

impl Movements {
    /// The state after the first report.
    pub(super) const fn begin(now_us: u64) -> Self {
        Self { last_us: now_us }
    }

    /// Notes a report at this time. Returns whether a movement begins with it.
    pub(super) const fn note(&mut self, now_us: u64) -> bool {
        let begins = self.is_quiet(now_us);
        self.last_us = now_us;
        begins
    }

    /// Whether there has been no report for `QUIET_US`.
    pub(super) const fn is_quiet(&self, now_us: u64) -> bool {
        now_us.saturating_sub(self.last_us) >= QUIET_US
    }
}
