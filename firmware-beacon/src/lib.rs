//! The complete iBeacon. A board's binary provides an advertiser, a delay, random numbers and a [`Reporter`], and calls
//! [`run`].
//!
//! Config record and chip address → checked [`Settings`] → an [`Advertisement`] at the start and at each rotation → the
//! board's [`Advertise`].
#![no_std]
#![forbid(unsafe_code)]

mod settings;

#[cfg(test)]
extern crate std;

use core::convert::Infallible;

use embassy_sync::blocking_mutex::raw::RawMutex;
use embedded_hal_async::delay::DelayNs;
use firmware_common::Reporter;
use wire::telemetry::Condition;

pub use settings::{Advertisement, Channels, RANDOM_BYTES, Settings, SettingsError};

/// A controller that advertises. Both methods may be called in any state.
#[allow(async_fn_in_trait, reason = "nodes run on one core; no future crosses a thread")]
pub trait Advertise {
    /// The error of a failed command.
    type Error: core::fmt::Debug;

    /// Advertises this from now on, in place of the advertisement before: not connectable, not scannable.
    ///
    /// # Errors
    /// The controller refuses or does not answer.
    async fn start(&mut self, advertisement: &Advertisement) -> Result<(), Self::Error>;

    /// Stops advertising.
    ///
    /// # Errors
    /// The controller refuses or does not answer.
    async fn stop(&mut self) -> Result<(), Self::Error>;
}

/// Receives the beacon's events.
pub trait Listener {
    /// The beacon advertises this from now on.
    fn advertising(&mut self, advertisement: &Advertisement);

    /// The controller failed, for the `failures`-th time in a row. The command will be repeated. There is no heartbeat
    /// until the controller works.
    fn failed(&mut self, error: &impl core::fmt::Debug, failures: u32);

    /// The program is alive: a heartbeat.
    fn alive(&mut self);
}

/// The listener of a node's beacon. It passes all events to the node's reporter.
pub struct TelemetrySink<'r, M: RawMutex, const BYTES: usize, C = fn() -> u64>(pub &'r Reporter<M, BYTES, C>);

impl<M: RawMutex, const BYTES: usize, C: Fn() -> u64> Listener for TelemetrySink<'_, M, BYTES, C> {
    fn advertising(&mut self, advertisement: &Advertisement) {
        #[cfg(feature = "defmt")]
        defmt::info!("on the air: {}", advertisement);
        let _ = advertisement;
        self.0.event_log.state(self.0.now_us(), Condition::Advertising);
    }

    fn failed(&mut self, error: &impl core::fmt::Debug, failures: u32) {
        // No heartbeat here: if the failures go on, the watchdog resets the chip.
        let _ = error;
        self.0.counts.radio_failures.add();
        self.0.event_log.state(self.0.now_us(), Condition::RadioFailed(failures));
    }

    fn alive(&mut self) {
        self.0.ranging.beat(self.0.now_us());
    }
}

/// The longest time from one heartbeat to the next while the controller works, milliseconds, without the time of its
/// commands.
pub const HEARTBEAT_MS: u32 = 1000;

/// The first pause after a failure, and the longest that it grows to, milliseconds.
const SHORTEST_PAUSE_MS: u32 = 50;
const LONGEST_PAUSE_MS: u32 = HEARTBEAT_MS;

/// Runs a beacon. `random` fills a slice with random bytes from a good source.
pub async fn run(
    mut advertiser: impl Advertise,
    mut delay: impl DelayNs,
    mut random: impl FnMut(&mut [u8]),
    settings: &Settings,
    mut listener: impl Listener,
) -> Infallible {
    let mut failures: u32 = 0;
    loop {
        let mut bytes = [0; RANDOM_BYTES];
        random(&mut bytes);
        let advertisement = settings.advertisement(&bytes);
        match change(&mut advertiser, &advertisement).await {
            Ok(()) => {
                failures = 0;
                listener.advertising(&advertisement);
                wait(&mut delay, &mut listener, settings.rotation_ms()).await;
            }
            Err(error) => {
                failures = failures.saturating_add(1);
                listener.failed(&error, failures);
                let pause = SHORTEST_PAUSE_MS.checked_shl(failures - 1).unwrap_or(LONGEST_PAUSE_MS);
                delay.delay_ms(pause.clamp(SHORTEST_PAUSE_MS, LONGEST_PAUSE_MS)).await;
            }
        }
    }
}

/// Replaces the advertisement. The address can only change while nothing is advertised.
async fn change<A: Advertise>(advertiser: &mut A, advertisement: &Advertisement) -> Result<(), A::Error> {
    advertiser.stop().await?;
    advertiser.start(advertisement).await
}

/// Waits for the next rotation with heartbeats meanwhile. It waits for ever if there is no rotation.
async fn wait(delay: &mut impl DelayNs, listener: &mut impl Listener, until_ms: Option<u32>) {
    let mut left_ms = until_ms;
    while left_ms != Some(0) {
        listener.alive();
        let step_ms = left_ms.map_or(HEARTBEAT_MS, |left| left.min(HEARTBEAT_MS));
        delay.delay_ms(step_ms).await;
        left_ms = left_ms.map(|left| left.saturating_sub(step_ms));
    }
}

#[cfg(test)]
mod tests;
