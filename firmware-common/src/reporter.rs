//! The reporter: the one object to which all tasks of a node report. It holds the event log, the counts, the tasks'
//! heartbeats and the clock.

use core::convert::Infallible;

use embassy_sync::blocking_mutex::raw::RawMutex;
use embedded_hal_async::delay::DelayNs;
use ranging::exchange::{Event, Polled, Report};
use ranging::radio::Sensors;
use wire::telemetry::{Hello, Supply, TagAnswer, TagData, TagFix};
use wire::uwb::native::PolledPosition;

use crate::messages::{arrival_message, range_message};

use crate::supervision::{Heartbeat, all_alive};
use crate::{Counts, EventLog, Host};

/// The longest time without a heartbeat of a task that has not announced a rest: a receiver's window lasts 8 s at most.
const PATIENCE_MS: u32 = 10_000;

/// The reporter of one node's tasks, for a `static`. At most `BYTES` of telemetry wait for the channel. `C` is the
/// node's clock.
pub struct Reporter<M: RawMutex, const BYTES: usize, C = fn() -> u64> {
    /// The telemetry and the log.
    pub event_log: EventLog<M, BYTES>,
    /// The counters.
    pub counts: Counts,
    /// Whether a host reads this, and what it tells tags.
    pub host: Host<M>,
    /// The heartbeat of the task that owns the radio.
    pub ranging: Heartbeat,
    /// The heartbeat of the task that computes positions. An anchor has no such task.
    pub engine: Heartbeat,
    clock: C,
}

impl<M: RawMutex, const BYTES: usize, C: Fn() -> u64> Reporter<M, BYTES, C> {
    /// A reporter of a node whose `clock` returns the microseconds since its start.
    pub const fn new(clock: C) -> Self {
        Self {
            event_log: EventLog::new(),
            counts: Counts::new(),
            host: Host::new(),
            ranging: Heartbeat::new(PATIENCE_MS),
            engine: Heartbeat::new(PATIENCE_MS),
            clock,
        }
    }

    /// Microseconds since the start.
    pub fn now_us(&self) -> u64 {
        (self.clock)()
    }

    /// Counts a step of the exchange and beats the heartbeat of ranging.
    pub fn step(&self, event: &Event<'_>) {
        self.counts.event(event);
        self.ranging.beat(self.now_us());
    }

    /// Reports that the radio failed again. `failures` is the number of failures in a row.
    pub fn radio_failed(&self, error: &impl core::fmt::Debug, failures: u32) {
        self.counts.radio_failures.add();
        self.ranging.beat(self.now_us());
        // Only a debugger shows the error itself.
        let _ = error;
        self.event_log.state(self.now_us(), wire::telemetry::Condition::RadioFailed(failures));
    }

    /// Sends what a protocol reports, in a node that computes no positions: ranges and links as they are.
    pub fn report(&self, report: Report<'_>) {
        let now = self.now_us();
        match report {
            Report::Round(round) => {
                for range in round.ranges {
                    self.event_log.send(range_message(now, round.number, range));
                }
            }
            // Only a tag listens to rounds of others, and it computes positions from them.
            Report::Differences(_) => {}
            Report::Polled(polled) => self.polled(now, polled),
            Report::Arrival(arrival) => self.event_log.send(arrival_message(now, &arrival)),
            // An anchor passes messages to tags on, and has none for itself.
            Report::Downlink(_) => {}
            Report::Link(link) => self.event_log.link(now, link),
        }
    }

    /// Sends what a tag's poll carried for hosts.
    #[inline(never)]
    fn polled(&self, t_us: u64, polled: &Polled) {
        let Polled { tag, round, asked, age, position, data } = *polled;
        let age_us = u32::try_from(age.as_micros()).unwrap_or(u32::MAX);
        if let Some(PolledPosition(position)) = position {
            self.event_log.send(TagFix { t_us, tag, round, asked, age_us, position });
        }
        if let Some(data) = data {
            match data.answer() {
                Some(answer) => {
                    let (number, code) = (data.number(), answer as u8);
                    self.event_log.send(TagAnswer { t_us, tag, number, age_us, code });
                }
                None => self.event_log.send(TagData::new(t_us, age_us, tag, &data)),
            }
        }
    }

    /// Sends what the radio has measured of its supply and its temperature.
    pub fn sensed(&self, sensors: &Sensors) {
        self.event_log.send(Supply::new(self.now_us(), sensors.voltage, sensors.temperature_celsius));
    }

    /// Whether the watchdog may be fed, in a node that computes positions and in one that does not.
    ///
    /// # Errors
    /// A task is silent: its number, 0 for ranging, 1 for the engine.
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
