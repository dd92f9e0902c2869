//! All that a node's tasks tell the outside, in one place: the event log, the counts, their signs of life, by one clock.

use core::convert::Infallible;

use embassy_sync::blocking_mutex::raw::RawMutex;
use embedded_hal_async::delay::DelayNs;
use ranging::exchange::{Event, Report};
use wire::telemetry::Hello;

use crate::messages::range_message;

use crate::supervision::{Heartbeat, all_alive};
use crate::{Counts, EventLog};

/// The longest that a task may be silent that did not say that it rests: a receiver's window lasts 8 s at most.
const PATIENCE_MS: u32 = 10_000;

/// For a `static`: what the tasks of one node tell. `BYTES` of telemetry wait for the channel at most; `C` is its clock.
pub struct Reporter<M: RawMutex, const BYTES: usize, C = fn() -> u64> {
    /// What is told.
    pub event_log: EventLog<M, BYTES>,
    /// What is counted.
    pub counts: Counts,
    /// The sign of life of the task that has the radio.
    pub ranging: Heartbeat,
    /// The sign of life of the task that makes positions; an anchor has none.
    pub engine: Heartbeat,
    clock: C,
}

impl<M: RawMutex, const BYTES: usize, C: Fn() -> u64> Reporter<M, BYTES, C> {
    /// Of a node whose `clock` tells the microseconds since its start.
    pub const fn new(clock: C) -> Self {
        Self {
            event_log: EventLog::new(),
            counts: Counts::new(),
            ranging: Heartbeat::new(PATIENCE_MS),
            engine: Heartbeat::new(PATIENCE_MS),
            clock,
        }
    }

    /// Microseconds since the start.
    pub fn now_us(&self) -> u64 {
        (self.clock)()
    }

    /// A step of the exchange: counted, and a sign of life.
    pub fn step(&self, event: &Event<'_>) {
        self.counts.event(event);
        self.ranging.beat(self.now_us());
    }

    /// The radio failed again: `failures` counts the failures in a row.
    pub fn radio_failed(&self, error: &impl core::fmt::Debug, failures: u32) {
        self.counts.radio_failures.add();
        self.ranging.beat(self.now_us());
        // What it failed with is for a debugger.
        let _ = error;
        self.event_log.state(self.now_us(), wire::telemetry::Condition::RadioFailed(failures));
    }

    /// What a machine reports, where no positions are made of it: ranges and links as they are.
    pub fn report(&self, report: Report<'_>) {
        let now = self.now_us();
        match report {
            Report::Round(round) => {
                for range in round.ranges {
                    self.event_log.send(range_message(now, round.number, range));
                }
            }
            // Nobody but a tag listens to rounds of others, and it makes positions of them.
            Report::Differences(_) => {}
            Report::Link(link) => self.event_log.link(now, link),
        }
    }

    /// Whether the watchdog may be fed, in a node that makes positions and in one that does not; else which task is silent, by
    /// its place: 0 for ranging, 1 for the engine.
    pub fn all_alive(&self, makes_positions: bool) -> Result<(), usize> {
        let both = [&self.ranging, &self.engine];
        all_alive(self.now_us(), if makes_positions { &both } else { &both[..1] })
    }

    /// [`EventLog::keep_telling`] with this node's counts and clock.
    pub async fn keep_telling(&self, hello: Hello, delay: impl DelayNs) -> Infallible {
        self.event_log.keep_telling(hello, &self.counts, &self.clock, delay).await
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use embassy_sync::blocking_mutex::raw::NoopRawMutex;

    #[test]
    fn an_anchor_lives_without_an_engine() {
        let reporter = Reporter::<NoopRawMutex, 512>::new(|| 10_001_000);
        assert_eq!(reporter.all_alive(true), Err(0));
        reporter.step(&Event::Started);
        assert_eq!((reporter.all_alive(true), reporter.all_alive(false)), (Err(1), Ok(())));
        reporter.engine.beat(9_000_000);
        assert_eq!(reporter.all_alive(true), Ok(()));
    }
}
