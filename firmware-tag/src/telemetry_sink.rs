//! The sink of a node's tag. It turns all results into telemetry for the node's reporter.

use embassy_sync::blocking_mutex::raw::RawMutex;
use firmware_common::Reporter;
use firmware_common::messages::{difference_messages, range_message};
use ranging::exchange::{Event, Link};
use ranging::radio::Sensors;
use wire::config::Solver;
use wire::telemetry::{Condition, Doubt, Fix, MotionSensor, Outcome, Sighting, TagAnswer};
use wire::uwb::native::{Answer, Downlink};

use crate::{Measured, Observer, Position, RoomReport, RoundOutcome, Sink, Task};

/// Passes a tag's results to its reporter.
pub struct TelemetrySink<'r, M: RawMutex, const BYTES: usize, C = fn() -> u64, O = ()> {
    reporter: &'r Reporter<M, BYTES, C>,
    report_ranges: bool,
    observer: O,
}

impl<'r, M: RawMutex, const BYTES: usize, C> TelemetrySink<'r, M, BYTES, C> {
    /// A sink for this reporter, with or without a message for each range.
    pub const fn new(reporter: &'r Reporter<M, BYTES, C>, report_ranges: bool) -> Self {
        Self { reporter, report_ranges, observer: () }
    }

    /// The same, with an observer that sees each result first.
    pub fn with_observer<O: Observer>(self, observer: O) -> TelemetrySink<'r, M, BYTES, C, O> {
        TelemetrySink { reporter: self.reporter, report_ranges: self.report_ranges, observer }
    }
}

impl<M: RawMutex, const BYTES: usize, C, O: Clone> Clone for TelemetrySink<'_, M, BYTES, C, O> {
    fn clone(&self) -> Self {
        Self { observer: self.observer.clone(), ..*self }
    }
}

impl<M: RawMutex, const BYTES: usize, C, O: Copy> Copy for TelemetrySink<'_, M, BYTES, C, O> {}

impl<M: RawMutex, const BYTES: usize, C: Fn() -> u64, O: Observer> Sink for TelemetrySink<'_, M, BYTES, C, O> {
    fn now_us(&self) -> u64 {
        self.reporter.now_us()
    }

    async fn publish(&self, epoch: RoundOutcome<'_>) {
        self.observer.epoch(&epoch).await;
        let t_us = self.now_us();
        let (measured, event_log) = (epoch.measured, &self.reporter.event_log);
        if self.report_ranges {
            match &measured {
                Measured::Ranges(round) => {
                    round.ranges.iter().for_each(|range| event_log.send(range_message(t_us, round.number, range)));
                }
                Measured::Differences(round) => {
                    difference_messages(t_us, round).for_each(|difference| event_log.send(difference));
                }
                // Sightings are reported when they come.
                Measured::RssiWindow(_) => {}
            }
        }
        let (outcome, doubt) = match epoch.outcome {
            Ok(Position { position_m, covariance_m2, used, quality, flag, alternative_m }) => {
                (Outcome::position(position_m, covariance_m2, used, quality), Doubt::of(flag, alternative_m))
            }
            Err(reason) => (Outcome::Reason(reason), Doubt::None),
        };
        let age_us = u32::try_from(t_us.saturating_sub(epoch.poll_us)).unwrap_or(u32::MAX);
        let (round, asked) = (measured.number(), measured.asked());
        let fix = Fix { t_us, round, age_us, asked, outcome, solver: in_telemetry(epoch.solver), doubt };
        event_log.fix(fix, measured.count() as u8);
    }

    fn step(&self, event: &Event<'_>) {
        self.reporter.step(event);
    }

    fn rests(&self, until_us: u64) {
        self.reporter.ranging.beat(until_us);
    }

    fn link(&self, link: Link) {
        self.observer.link(link);
        self.reporter.event_log.link(self.now_us(), link);
    }

    fn sensed(&self, sensors: &Sensors) {
        self.reporter.sensed(sensors);
    }

    fn radio_failed(&self, error: &impl core::fmt::Debug, failures: u32) {
        self.reporter.radio_failed(error, failures);
    }

    fn refused(&self, frames: u32) {
        self.reporter.counts.refused.set(frames);
    }

    fn round_dropped(&self) {
        self.reporter.counts.rounds_dropped.add();
    }

    fn alive(&self, task: Task) {
        match task {
            Task::Engine => self.reporter.engine.beat(self.now_us()),
        }
    }

    fn sighting(&self, sighting: Sighting) {
        self.observer.sighting();
        self.reporter.event_log.send(sighting);
    }

    fn beacon(&self, word: Condition) {
        self.reporter.event_log.state(self.now_us(), word);
    }

    fn room(&self, told: RoomReport) {
        // The log has a room only if it has changed.
        if told.is_news {
            self.reporter.event_log.log(told.room);
        } else {
            self.reporter.event_log.send(told.room);
        }
    }

    fn motion_sensor(&self, state: MotionSensor) {
        self.reporter.event_log.state(self.now_us(), Condition::MotionSensor(state));
    }

    fn heard(&self, dropped: u32) {
        self.reporter.counts.sightings.add();
        (0..dropped).for_each(|_| self.reporter.counts.sightings_dropped.add());
    }

    fn message(&self) -> Option<Downlink> {
        self.reporter.host.message()
    }

    fn identify(&self, until_us: u64) {
        self.reporter.event_log.identify(until_us);
    }

    fn answered(&self, message: &Downlink, answer: Answer) {
        let (tag, number, code) = (message.tag, message.data.number(), answer as u8);
        self.reporter.event_log.send(TagAnswer { t_us: self.now_us(), tag, number, age_us: 0, code });
    }

    fn scanner_restarted(&self, times: u32) {
        self.reporter.event_log.state(self.now_us(), Condition::ScannerRestarted(times));
    }
}

/// The solver of the record as telemetry's type.
fn in_telemetry(solver: Solver) -> wire::telemetry::Solver {
    match solver {
        Solver::Track => wire::telemetry::Solver::Track,
        Solver::Robust => wire::telemetry::Solver::Robust,
        Solver::BWls => wire::telemetry::Solver::BWls,
        Solver::BWlsR => wire::telemetry::Solver::BWlsR,
        Solver::BoundingBox => wire::telemetry::Solver::BoundingBox,
    }
}
