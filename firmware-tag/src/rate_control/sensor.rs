//! What a motion sensor has reported: when, and whether that was the beginning of a movement.

/// Without a report for so long the sensor is quiet, microseconds.
const QUIET_US: u64 = 5_000_000;

/// The reports of a sensor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Movements {
    last_us: u64,
}

impl Movements {
    /// The first.
    pub(super) const fn begin(now_us: u64) -> Self {
        Self { last_us: now_us }
    }

    /// One more, now; whether a movement begins with it.
    pub(super) const fn note(&mut self, now_us: u64) -> bool {
        let begins = self.is_quiet(now_us);
        self.last_us = now_us;
        begins
    }

    /// Whether nothing has been reported for a while.
    pub(super) const fn is_quiet(&self, now_us: u64) -> bool {
        now_us.saturating_sub(self.last_us) >= QUIET_US
    }
}
