//! The complete anchor. A board's binary provides a radio, a delay and a [`Reporter`], and calls [`run`].
//!
//! Radio → protocol → changes of links, and the distances of tags where the exchange sends them to anchors.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(feature = "node")]
pub mod node;

use core::convert::Infallible;

use embassy_sync::blocking_mutex::raw::RawMutex;
use embedded_hal_async::delay::DelayNs;
use firmware_common::Reporter;
use ranging::exchange::{Action, Event, Guidance, Protocol, Report};
use ranging::radio::Sensors;
use ranging::{RadioInstant, Restart};
use wire::uwb::native::Downlink;

pub use ranging::node::Listener;

/// Runs an anchor with the protocol `machine`.
pub async fn run<R: Restart>(
    mut radio: R,
    mut delay: impl DelayNs,
    mut machine: impl Protocol,
    mut listener: impl Listener,
) -> Infallible {
    ranging::node::run(&mut radio, &mut delay, &mut machine, &mut listener).await
}

/// The listener of a board's anchor. It passes all reports to the node's reporter.
pub struct TelemetrySink<'r, M: RawMutex, const BYTES: usize, C = fn() -> u64>(pub &'r Reporter<M, BYTES, C>);

impl<M: RawMutex, const BYTES: usize, C: Fn() -> u64> Listener for TelemetrySink<'_, M, BYTES, C> {
    async fn report(&mut self, report: Report<'_>, _: RadioInstant) -> Guidance {
        self.0.report(report);
        Guidance::NONE
    }

    fn observe(&mut self, _: RadioInstant, event: &Event<'_>, _: &Action<'_>) {
        self.0.step(event);
    }

    fn has_host(&self) -> bool {
        self.0.host.is_there()
    }

    fn message(&mut self) -> Option<Downlink> {
        self.0.host.message()
    }

    fn refused(&mut self, frames: u32) {
        self.0.counts.refused.set(frames);
    }

    fn sensed(&mut self, sensors: &Sensors) {
        self.0.sensed(sensors);
    }

    async fn radio_failed(&mut self, error: &impl core::fmt::Debug, failures: u32) {
        self.0.radio_failed(error, failures);
    }
}
