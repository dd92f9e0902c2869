//! A scanner that works as controllers do: while it is on, it listens to one channel for a fixed time, then to the
//! next.

use super::{Bluetooth, Channel};
use crate::PS_PER_US;
use crate::TrueTime;

/// The time that it stays on a channel, microseconds; the same as on the ESP boards.
const CHANNEL_US: u64 = 30_000;

/// The scanner of one node. Dropping it removes the scanner.
pub struct Scanner {
    air: Bluetooth,
    ear: u64,
}

impl Scanner {
    pub(super) fn new(air: Bluetooth, ear: u64) -> Self {
        Self { air, ear }
    }
}

impl firmware_tag::scan::Scanner for Scanner {
    async fn start(&mut self) {
        self.air.switch(self.ear, true);
    }

    async fn stop(&mut self) {
        self.air.switch(self.ear, false);
    }
}

impl Drop for Scanner {
    fn drop(&mut self) {
        self.air.remove(self.ear);
    }
}

/// Whether a scanner that was switched on at `since` is on the channel during all of `from` to `to`.
pub(super) fn is_on(since: TrueTime, channel: Channel, from: TrueTime, to: TrueTime) -> bool {
    let stretch = |time: TrueTime| time.ps_since(since) / (CHANNEL_US * PS_PER_US);
    let on = Channel::ALL[(stretch(from) % 3) as usize];
    since <= from && stretch(from) == stretch(to) && on == channel
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scanner_goes_through_the_channels() {
        let ms = |ms: u64| TrueTime::from_micros(1000 * ms);
        let on = |channel, from, to| is_on(ms(10), channel, ms(from), ms(to));
        assert!(on(Channel::Ch37, 10, 11) && on(Channel::Ch38, 41, 42) && on(Channel::Ch39, 71, 72));
        assert!(on(Channel::Ch37, 101, 102), "and again");
        assert!(!on(Channel::Ch38, 10, 11));
        assert!(!on(Channel::Ch37, 9, 11), "it was off");
        assert!(!on(Channel::Ch37, 39, 41), "it left for the next channel");
    }
}
