//! The counters of a node since its start: what became of its frames at the radio, and what was dropped for lack of
//! time.

use core::sync::atomic::{AtomicU32, Ordering};

use ranging::exchange::Event;
use wire::telemetry::Counters;

/// A counter that one task writes and any task may read. It wraps.
#[derive(Debug, Default)]
pub struct Tally(AtomicU32);

impl Tally {
    /// A counter at zero.
    pub const fn new() -> Self {
        Self(AtomicU32::new(0))
    }

    /// Adds one.
    pub fn add(&self) {
        // Load and store: some chips have no other atomic operations, and only one task writes.
        self.0.store(self.get().wrapping_add(1), Ordering::Relaxed);
    }

    /// The count is kept elsewhere, and is this now.
    pub fn set(&self, count: u32) {
        self.0.store(count, Ordering::Relaxed);
    }

    /// The count.
    pub fn get(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }
}

/// All counters of a node, for a `static`. Each has one task that writes it.
#[derive(Debug, Default)]
#[allow(missing_docs, reason = "they are the fields of `wire::telemetry::Counters`")]
pub struct Counts {
    pub sent: Tally,
    pub received: Tally,
    pub timeouts: Tally,
    pub corrupt: Tally,
    pub late: Tally,
    pub not_sent: Tally,
    pub radio_failures: Tally,
    pub rounds_dropped: Tally,
    pub sightings: Tally,
    pub sightings_dropped: Tally,
    pub refused: Tally,
}

impl Counts {
    /// All counters at zero.
    pub const fn new() -> Self {
        Self {
            sent: Tally::new(),
            received: Tally::new(),
            timeouts: Tally::new(),
            corrupt: Tally::new(),
            late: Tally::new(),
            not_sent: Tally::new(),
            radio_failures: Tally::new(),
            rounds_dropped: Tally::new(),
            sightings: Tally::new(),
            sightings_dropped: Tally::new(),
            refused: Tally::new(),
        }
    }

    /// Counts the outcome of an action of the exchange.
    pub fn event(&self, event: &Event<'_>) {
        match event {
            Event::Sent(_) => self.sent.add(),
            Event::NotSent => self.not_sent.add(),
            Event::Received(_) => self.received.add(),
            Event::Corrupt => self.corrupt.add(),
            Event::Timeout => self.timeouts.add(),
            Event::Late => self.late.add(),
            Event::Started | Event::Woken | Event::Reported => {}
        }
    }

    /// The counters as a telemetry message.
    pub fn told(&self, t_us: u64, telemetry_dropped: u32) -> Counters {
        Counters {
            t_us,
            sent: self.sent.get(),
            received: self.received.get(),
            timeouts: self.timeouts.get(),
            corrupt: self.corrupt.get(),
            late: self.late.get(),
            not_sent: self.not_sent.get(),
            radio_failures: self.radio_failures.get(),
            rounds_dropped: self.rounds_dropped.get(),
            telemetry_dropped,
            sightings: self.sightings.get(),
            sightings_dropped: self.sightings_dropped.get(),
            refused: self.refused.get(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ranging::{Diagnostics, RadioInstant, RxFrame};

    #[test]
    fn every_fate_of_a_frame_is_counted_once() {
        let counts = Counts::new();
        let rx_time = RadioInstant::default();
        let frame = RxFrame { bytes: &[], rx_time, diagnostics: Diagnostics::default() };
        let events = [
            (Event::Started, 1),
            (Event::Sent(rx_time), 7),
            (Event::NotSent, 2),
            (Event::Received(frame), 6),
            (Event::Corrupt, 3),
            (Event::Timeout, 5),
            (Event::Late, 4),
            (Event::Woken, 1),
            (Event::Reported, 1),
        ];
        for (event, times) in events {
            (0..times).for_each(|_| counts.event(&event));
        }
        counts.radio_failures.add();
        counts.refused.set(9);
        let expected = Counters {
            t_us: 5,
            sent: 7,
            not_sent: 2,
            received: 6,
            corrupt: 3,
            timeouts: 5,
            late: 4,
            radio_failures: 1,
            telemetry_dropped: 8,
            refused: 9,
            ..Counters::default()
        };
        assert_eq!(counts.told(5, 8), expected);
    }

    #[test]
    fn a_tally_wraps() {
        let tally = Tally(AtomicU32::new(u32::MAX));
        tally.add();
        assert_eq!(tally.get(), 0);
    }
}
