//! The complete tag, in two tasks. [`ranging()`] owns the radio and the protocol, and [`engine()`] computes positions.
//! A board spawns them at two priorities.
//!
//! Radio → protocol → a round of ranges or of differences → [`TaskChannels`] → [`Tracker`] → an [`RoundOutcome`]: a
//! position with its covariance, or the reason why there is none. Ranging never waits for the engine: if the engine is
//! late, the oldest round is dropped and counted. The position, by which a tag chooses its anchors, and the rate from
//! [`RateControl`] flow back to the protocol. A motion sensor ([`motion`]) has a task beside, so that a tag that is
//! picked up ranges at once. A Bluetooth scan ([`scan`]) has a task beside as well. The RSSI of listed beacons goes
//! into the same track, so that a tag can move from anchors to beacons and back.
#![no_std]
#![forbid(unsafe_code)]

pub mod advertise;
mod channels;
mod commands;
mod config;
pub mod motion;
#[cfg(feature = "node")]
mod nlos_model;
#[cfg(feature = "node")]
pub mod node;
mod rate_control;
pub mod scan;
mod sightings;
mod site_models;
mod sounding;
mod telemetry_sink;
mod tracker;
mod workload;

#[cfg(test)]
extern crate std;

use core::convert::Infallible;

use embassy_futures::select::{Either4, select4};
use embassy_sync::blocking_mutex::raw::RawMutex;
use embedded_hal_async::delay::DelayNs;
use ranging::exchange::{Action, Event, Guidance, Link, Protocol, Report, RoundFix};
use ranging::node::Listener;
use ranging::radio::Sensors;
use ranging::{Radio, RadioDuration, RadioInstant, Restart};
use wire::telemetry::{Condition, MotionSensor, Sighting};
use wire::uwb::native::{Answer, Downlink, PolledPosition, UserData};

use advertise::Found;
use channels::Quiet;
use commands::Commands;
use sounding::Sounder;

pub use channels::{DATA, Measured, ReceivedAdvertisement, RssiWindow, SendError, TaskChannels};
pub use config::{LocatorConfig, anchor_positions, method};
pub use positioning_core::locator::{AnchorPosition, Position, SiteModels};
pub use rate_control::RateControl;
pub use sightings::{KnownBeacon, KnownBeacons};
pub use site_models::site_models;
pub use sounding::Sounding;
pub use telemetry_sink::TelemetrySink;
pub use tracker::{RoomReport, RoundOutcome, Tracker};

/// The number of listed beacons that a tag with Bluetooth can follow.
pub const MAX_LISTED: usize = wire::config::MAX_BEACONS;

/// The number of listed beacons that this build's tag can follow. The code for them, 13 kB, is only in images with
/// Bluetooth.
pub const LISTED: usize = if cfg!(feature = "ble") { MAX_LISTED } else { 0 };

/// The period of the engine's heartbeat while no rounds come, milliseconds.
const IDLE_MS: u32 = 1000;

/// Takes a tag's results, and provides the time. Both tasks have the same one.
#[allow(async_fn_in_trait, reason = "nodes run on one core; no future crosses a thread")]
pub trait Sink {
    /// Microseconds since the node started.
    fn now_us(&self) -> u64;

    /// A round is over, and its position has been computed if possible.
    async fn publish(&self, epoch: RoundOutcome<'_>);

    /// The outcome of an action of the exchange.
    fn step(&self, event: &Event<'_>);

    /// The exchange does nothing until this time, microseconds since the node started. No step shows that it is alive
    /// before.
    fn rests(&self, until_us: u64);

    /// A link or the network has changed.
    fn link(&self, link: Link);

    /// The radio has measured its temperature and supply.
    fn sensed(&self, sensors: &Sensors);

    /// The radio failed for the `failures`-th time in a row. It will be restarted.
    fn radio_failed(&self, error: &impl core::fmt::Debug, failures: u32);

    /// The exchange has refused this many frames since the node started.
    fn refused(&self, frames: u32);

    /// The engine had no time for a round.
    fn round_dropped(&self);

    /// A task is alive. The task of ranging shows this by its steps instead.
    fn alive(&self, task: Task);

    /// A beacon that the tag knows was received.
    fn sighting(&self, sighting: Sighting);

    /// The estimated condition of a listed beacon has changed.
    fn beacon(&self, word: Condition);

    /// The tag is in this room.
    fn room(&self, told: RoomReport);

    /// The usability of the motion sensor has changed.
    fn motion_sensor(&self, state: MotionSensor);

    /// A beacon's advertisement was received. To make room, `dropped` older ones were dropped.
    fn heard(&self, dropped: u32);

    /// The scanner was silent and has been restarted, `times` times so far.
    fn scanner_restarted(&self, times: u32);

    /// The host's next message to a tag.
    fn message(&self) -> Option<Downlink>;

    /// A person looks for this tag until this time, microseconds since the node started.
    fn identify(&self, until_us: u64);

    /// The tag has answered a host's message.
    fn answered(&self, message: &Downlink, answer: Answer);
}

/// Sees what a tag reports, before it is reported. Examples: a display, a simulation that accounts for the
/// time it takes.
#[allow(async_fn_in_trait, reason = "nodes run on one core; no future crosses a thread")]
pub trait Observer {
    /// A round is over.
    async fn epoch(&self, epoch: &RoundOutcome<'_>) {
        let _ = epoch;
    }

    /// A link or the network has changed.
    fn link(&self, link: Link) {
        let _ = link;
    }

    /// A beacon that the tag knows was received.
    fn sighting(&self) {}
}

/// The observer that does nothing.
impl Observer for () {}

/// A task that reports that it is alive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// The task that computes positions.
    Engine,
}

/// The task that owns the radio.
pub async fn ranging<R: Restart, M: RawMutex>(
    mut radio: R,
    mut delay: impl DelayNs,
    mut machine: impl Protocol,
    channels: &TaskChannels<M>,
    sink: &impl Sink,
) -> Infallible {
    ranging::node::run(&mut radio, &mut delay, &mut machine, &mut RangingListener::new(channels, sink)).await
}

/// Puts what `make` makes where it stays. It is made on the stack: not on that of a task which runs on.
#[inline(never)]
fn begun<T>(place: &mut Option<T>, make: impl FnOnce() -> T) -> &mut T {
    *place = Some(make());
    place.as_mut().expect("it was made")
}

/// The task that computes positions. It alone owns the solver and the track. It can follow `BEACONS` listed beacons:
/// usually [`LISTED`].
pub async fn engine<const BEACONS: usize, M: RawMutex>(
    channels: &TaskChannels<M>,
    mut delay: impl DelayNs,
    locator: LocatorConfig<'_>,
    mut rates: RateControl,
    sink: &impl Sink,
) -> Infallible {
    let LocatorConfig { settings, solver, beacons, tells_position } = locator;
    let mut tracker = None;
    let tracker = begun(&mut tracker, || Tracker::<BEACONS>::new(settings, solver, &beacons));
    let turns = tracker.wants_response();
    let mut fix = None;
    loop {
        sink.alive(Task::Engine);
        if let Some(rate) = channels.asked_rate().and_then(|chz| rates.ask(chz)) {
            channels.rouse(rate);
        }
        let idle_ms = match tracker.window_end_us() {
            Some(end_us) => (end_us.saturating_sub(sink.now_us()).div_ceil(1000)).min(IDLE_MS.into()) as u32,
            None => IDLE_MS,
        };
        let (round, sighting, movement) = (channels.next_round(), channels.next_sighting(), channels.next_movement());
        match select4(round, sighting, movement, delay.delay_ms(idle_ms)).await {
            Either4::First(round) => {
                channels.begin(sink.now_us());
                let epoch = tracker.follow(round.measured(), round.sounding.as_ref(), round.poll_us);
                let position = epoch.outcome.as_ref().ok();
                let was_shaken = rates.is_shaken();
                let rate = rates.after(sink.now_us(), position);
                let position_m = position.map(|position| position.position_m);
                fix = position.filter(|_| tells_position).and_then(|found| {
                    let position = PolledPosition::new(found.position_m, found.covariance_m2, found.flag.is_some())?;
                    Some(RoundFix { round: epoch.measured.number(), position })
                });
                channels.guide(Guidance { position_m, fix, rate, turns, ..Guidance::NONE });
                let found = fix.map(|fix| Found::of(&fix, &epoch.measured));
                if let Some(rate) = rate.filter(|_| !rates.is_still()) {
                    channels.rouse(rate);
                }
                if rates.is_shaken() && !was_shaken {
                    sink.motion_sensor(MotionSensor::Endless);
                }
                sink.publish(epoch).await;
                channels.tell_found(found);
                channels.end(sink.now_us());
            }
            Either4::Second(heard) => {
                if let Some(sighting) = tracker.receive(&heard) {
                    sink.sighting(sighting);
                }
            }
            Either4::Third(()) => {
                let was_shaken = rates.is_shaken();
                if let Some(rate) = rates.moved(sink.now_us()) {
                    channels.rouse(rate);
                }
                if was_shaken && !rates.is_shaken() {
                    sink.motion_sensor(MotionSensor::Ready);
                }
            }
            Either4::Fourth(()) => {}
        }
        if BEACONS == 0 {
            continue;
        }
        if let Some(epoch) = tracker.window(sink.now_us()) {
            if let Ok(position) = &epoch.outcome {
                channels.guide(Guidance { position_m: Some(position.position_m), fix, turns, ..Guidance::NONE });
            }
            sink.publish(epoch).await;
        }
        if let Some(told) = tracker.room() {
            sink.room(told);
        }
        if let Some(word) = tracker.beacon_condition() {
            sink.beacon(word);
        }
    }
}

/// What the ranging loop reports to.
pub struct RangingListener<'a, M: RawMutex, S> {
    channels: &'a TaskChannels<M>,
    sink: &'a S,
    sounder: Sounder,
    commands: Commands,
}

impl<'a, M: RawMutex, S: Sink> RangingListener<'a, M, S> {
    /// A listener between these channels and this sink.
    pub fn new(channels: &'a TaskChannels<M>, sink: &'a S) -> Self {
        Self { channels, sink, sounder: Sounder::default(), commands: Commands::default() }
    }

    /// The radio is not used for this time.
    fn rest(&self, duration: RadioDuration) {
        let micros = u64::try_from(duration.as_micros()).unwrap_or(0);
        let until_us = self.sink.now_us().saturating_add(micros);
        self.sink.rests(until_us);
        self.channels.tell_quiet(Quiet { until_us });
    }

    #[inline(never)]
    fn present_guidance(&mut self, now_us: u64) -> Guidance {
        let guidance = self.channels.take_guidance(now_us);
        self.sounder.wanted = guidance.turns;
        guidance
    }
}

impl<M: RawMutex, S: Sink> Listener for RangingListener<'_, M, S> {
    async fn report(&mut self, report: Report<'_>, present: RadioInstant) -> Guidance {
        let now_us = self.sink.now_us();
        // When a poll was sent or received.
        let poll_us =
            |poll: RadioInstant| now_us.saturating_sub(u64::try_from(present.since(poll).as_micros()).unwrap_or(0));
        let dropped = match report {
            Report::Round(round) => self.channels.put_ranges(&round, poll_us(round.poll), self.sounder.take()),
            Report::Differences(round) => {
                self.channels.put_differences(&round, poll_us(round.poll), self.sounder.take())
            }
            Report::Downlink(received) => {
                self.commands.obey(received, self.channels, self.sink);
                0
            }
            // Anchors report the polls and the arrivals of others' frames.
            Report::Polled(_) | Report::Arrival(_) => 0,
            Report::Link(link) => {
                self.sink.link(link);
                0
            }
        };
        (0..dropped).for_each(|_| self.sink.round_dropped());
        self.present_guidance(now_us)
    }

    fn refused(&mut self, frames: u32) {
        self.sink.refused(frames);
    }

    fn guidance(&mut self) -> Option<Guidance> {
        Some(self.present_guidance(self.sink.now_us()))
    }

    fn data(&mut self, carried: Option<(bool, u8)>) -> Option<UserData> {
        self.channels.data(carried)
    }

    fn message(&mut self) -> Option<Downlink> {
        self.sink.message()
    }

    async fn look<R: Radio>(&mut self, radio: &mut R, _: &Report<'_>) -> Result<bool, R::Error> {
        self.sounder.look(radio, self.sink.now_us()).await
    }

    fn observe(&mut self, now: RadioInstant, event: &Event<'_>, action: &Action<'_>) {
        self.sink.step(event);
        self.sounder.observe(event, action);
        match action {
            Action::WaitUntil(instant) => self.rest(instant.since(now)),
            Action::Sleep { duration, .. } => self.rest(*duration),
            Action::Compensate | Action::Transmit { .. } | Action::Receive { .. } | Action::Report(_) => {}
        }
    }

    fn sensed(&mut self, sensors: &Sensors) {
        self.sink.sensed(sensors);
    }

    async fn roused(&mut self) -> Guidance {
        let guidance = self.channels.roused(|| self.sink.now_us()).await;
        self.sounder.wanted = guidance.turns;
        guidance
    }

    async fn radio_failed(&mut self, error: &impl core::fmt::Debug, failures: u32) {
        self.sink.radio_failed(error, failures);
    }
}
