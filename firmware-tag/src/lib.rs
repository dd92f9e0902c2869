//! The tag, whole, in two tasks: [`ranging()`] owns the radio and the machine of the exchange, [`engine()`] makes positions. A board
//! spawns them at two priorities; [`run`] and [`run_as_told`] join them where there is one.
//!
//! Radio → machine → a round of ranges, or of differences → [`TaskChannels`] → [`Tracker`] → an [`Epoch`]: a position with its
//! covariance, or the reason why there is none. Ranging never waits for the engine: where that is late, the oldest round goes, and is counted.
//! Back flow the position, by which a tag chooses its anchors, and its [`RateControl`]. A motion sensor ([`motion`]) runs beside, so that a tag that
//! is picked up ranges at once. A Bluetooth scan ([`scan`]) runs beside, and what it
//! hears of listed beacons goes into the same track, so that a tag goes from anchors to beacons and back.
#![no_std]
#![forbid(unsafe_code)]

mod channels;
mod config;
mod digest;
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

use embassy_futures::join::{join, join3};
use embassy_futures::select::{Either4, select4};
use embassy_sync::blocking_mutex::raw::{NoopRawMutex, RawMutex};
use embedded_hal_async::delay::DelayNs;
use firmware_common::{Reporter, Settings, TagProtocol, build};
use ranging::Restart;
use ranging::exchange::{Action, Event, Guidance, Link, Protocol, Report};
use ranging::node::Listener;
use ranging::{Radio, RadioDuration, RadioInstant};
use wire::telemetry::{Board, Condition, Hello, MotionSensor, Role, Sighting};

use channels::Quiet;
use sounding::Sounder;

pub use channels::{Heard, Levels, Measured, TaskChannels};
pub use config::{LocatorConfig, anchor_positions, method};
pub use digest::Digest;
pub use positioning_core::locator::{AnchorPosition, Position, SiteModels};
pub use rate_control::RateControl;
pub use sightings::KnownBeacons;
pub use site_models::site_models;
pub use sounding::Sounding;
pub use telemetry_sink::TelemetrySink;
pub use tracker::{Epoch, RoomReport, Tracker};

/// Whether a tag heeds beacons: what it needs for them, 13 kB of code, is only in images with Bluetooth.
pub(crate) const HEARS_BEACONS: bool = cfg!(any(feature = "ble", test));

/// Listed beacons that a tag follows.
pub(crate) const LISTED: usize = if HEARS_BEACONS { wire::config::MAX_BEACONS } else { 0 };

/// The engine's sign of life while no rounds come, milliseconds.
const IDLE_MS: u32 = 1000;

/// Where a tag's results go, and what tells it the time: a node's reporter, a simulation's log. Both tasks have the same one.
#[allow(async_fn_in_trait, reason = "nodes run on one core; no future crosses a thread")]
pub trait Sink {
    /// Microseconds since the node started.
    fn now_us(&self) -> u64;

    /// A round is over, and what can be made of it is made.
    async fn publish(&self, epoch: Epoch<'_>);

    /// What became of an action of the exchange.
    fn step(&self, event: &Event<'_>) {
        let _ = event;
    }

    /// The exchange does nothing until then, microseconds since the node started: no step is a sign of its life before.
    fn rests(&self, until_us: u64) {
        let _ = until_us;
    }

    /// A link or the network has changed.
    fn link(&self, link: Link);

    /// The radio failed for the `failures`-th time in a row; it is brought up again.
    fn radio_failed(&self, error: &impl core::fmt::Debug, failures: u32);

    /// The engine had no time for a round.
    fn round_dropped(&self) {}

    /// A task is alive; that of ranging shows it by its steps.
    fn alive(&self, task: Task) {
        let _ = task;
    }

    /// A beacon that the tag knows was heard.
    fn sighting(&self, sighting: Sighting) {
        let _ = sighting;
    }

    /// Something else is believed of a listed beacon.
    fn beacon(&self, word: Condition) {
        let _ = word;
    }

    /// The tag is in this room.
    fn room(&self, told: RoomReport) {
        let _ = told;
    }

    /// What the motion sensor is good for from now on.
    fn motion_sensor(&self, state: MotionSensor) {
        let _ = state;
    }

    /// A beacon's advertisement was heard, which cost so many older ones their place.
    fn heard(&self, dropped: u32) {
        let _ = dropped;
    }

    /// The scanner was silent and has been restarted; how many times so far.
    fn scanner_restarted(&self, times: u32) {
        let _ = times;
    }
}

/// A task that shows that it is alive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// The one that makes positions.
    Engine,
}

/// Runs a tag's two tasks in one: `machine` is its side of the exchange.
pub async fn run<R: Restart, D: DelayNs + Clone>(
    radio: R,
    delay: D,
    machine: impl Protocol,
    locator: LocatorConfig<'_>,
    rates: RateControl,
    sink: impl Sink,
) -> Infallible {
    let channels = TaskChannels::<NoopRawMutex>::new();
    let ranging = ranging(radio, delay.clone(), machine, &channels, &sink);
    join(ranging, engine(&channels, delay, locator, rates, &sink)).await.0
}

/// Runs a tag as its record says, in one task, and tells the outside by its reporter: first who it is, and then for ever. `watch` sees
/// each epoch before it is published.
pub async fn run_as_told<R: Restart, D: DelayNs + Clone, M: RawMutex, const BYTES: usize>(
    radio: R,
    delay: D,
    (settings, tag): (&Settings, &wire::config::Tag),
    locator: LocatorConfig<'_>,
    (channels, reporter): (&TaskChannels<M>, &Reporter<M, BYTES>),
    board: Board,
    watch: impl FnMut(&Epoch<'_>),
) -> Infallible {
    let (eui, address, build) = (settings.eui, settings.address, *build::BUILD);
    let hello = Hello { t_us: reporter.now_us(), eui, address, role: Role::Tag, board, build };
    reporter.event_log.greet(hello);
    let sink = TelemetrySink::new(reporter, tag.report_ranges);
    let machine = TagProtocol::new(settings, tag);
    let ranging = ranging(radio, delay.clone(), machine, channels, &sink);
    let engine = watched_engine(channels, delay.clone(), locator, RateControl::of(tag), &sink, watch);
    join3(ranging, engine, reporter.keep_telling(hello, delay)).await.0
}

/// The task that owns the radio.
pub async fn ranging<R: Restart, M: RawMutex>(
    mut radio: R,
    mut delay: impl DelayNs,
    mut machine: impl Protocol,
    channels: &TaskChannels<M>,
    sink: &impl Sink,
) -> Infallible {
    ranging::node::run(
        &mut radio,
        &mut delay,
        &mut machine,
        &mut Ranging { channels, sink, sounder: Sounder::default() },
    )
    .await
}

/// The task that makes positions, sole owner of whatever that needs.
pub fn engine<M: RawMutex>(
    channels: &TaskChannels<M>,
    delay: impl DelayNs,
    locator: LocatorConfig<'_>,
    rates: RateControl,
    sink: &impl Sink,
) -> impl Future<Output = Infallible> {
    // Not async: the future would hold a second copy of all this.
    watched_engine(channels, delay, locator, rates, sink, |_| ())
}

/// The same, that shows each epoch before it is published.
async fn watched_engine<M: RawMutex>(
    channels: &TaskChannels<M>,
    mut delay: impl DelayNs,
    locator: LocatorConfig<'_>,
    mut rates: RateControl,
    sink: &impl Sink,
    mut watch: impl FnMut(&Epoch<'_>),
) -> Infallible {
    let LocatorConfig { settings, solver, beacons } = locator;
    let mut tracker = Tracker::new(settings, solver, &beacons);
    let turns = tracker.wants_response();
    loop {
        sink.alive(Task::Engine);
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
                channels.guide(Guidance { position_m, rate, turns, ..Guidance::NONE });
                if let Some(rate) = rate.filter(|_| !rates.is_still()) {
                    channels.rouse(rate);
                }
                if rates.is_shaken() && !was_shaken {
                    sink.motion_sensor(MotionSensor::Endless);
                }
                watch(&epoch);
                sink.publish(epoch).await;
                channels.end(sink.now_us());
            }
            Either4::Second(heard) => {
                if HEARS_BEACONS && let Some(sighting) = tracker.receive(&heard) {
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
        if HEARS_BEACONS {
            if let Some(epoch) = tracker.window(sink.now_us()) {
                if let Ok(position) = &epoch.outcome {
                    channels.guide(Guidance { position_m: Some(position.position_m), turns, ..Guidance::NONE });
                }
                watch(&epoch);
                sink.publish(epoch).await;
            }
            if let Some(told) = tracker.room() {
                sink.room(told);
            }
        }
        if HEARS_BEACONS && let Some(word) = tracker.beacon_condition() {
            sink.beacon(word);
        }
    }
}

/// What the loop of ranging reports to.
struct Ranging<'a, M: RawMutex, S> {
    channels: &'a TaskChannels<M>,
    sink: &'a S,
    sounder: Sounder,
}

impl<M: RawMutex, S: Sink> Ranging<'_, M, S> {
    /// Nothing is done with the radio for so long.
    fn rest(&self, duration: RadioDuration) {
        let micros = u64::try_from(duration.as_micros()).unwrap_or(0);
        let until_us = self.sink.now_us().saturating_add(micros);
        self.sink.rests(until_us);
        self.channels.tell_quiet(Quiet { until_us });
    }
}

impl<M: RawMutex, S: Sink> Listener for Ranging<'_, M, S> {
    async fn report(&mut self, report: Report<'_>, present: RadioInstant) -> Guidance {
        let now_us = self.sink.now_us();
        // When a poll left or came.
        let poll_us =
            |poll: RadioInstant| now_us.saturating_sub(u64::try_from(present.since(poll).as_micros()).unwrap_or(0));
        let dropped = match report {
            Report::Round(round) => self.channels.put_ranges(&round, poll_us(round.poll), self.sounder.take()),
            Report::Differences(round) => {
                self.channels.put_differences(&round, poll_us(round.poll), self.sounder.take())
            }
            Report::Link(link) => {
                self.sink.link(link);
                0
            }
        };
        (0..dropped).for_each(|_| self.sink.round_dropped());
        let guidance = self.channels.take_guidance(now_us);
        self.sounder.wanted = guidance.turns;
        guidance
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

    async fn roused(&mut self) -> Guidance {
        let guidance = self.channels.roused(|| self.sink.now_us()).await;
        self.sounder.wanted = guidance.turns;
        guidance
    }

    async fn radio_failed(&mut self, error: &impl core::fmt::Debug, failures: u32) {
        self.sink.radio_failed(error, failures);
    }
}
