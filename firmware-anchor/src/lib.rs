//! The anchor, whole: a board's binary brings a radio, a delay and a listener for telemetry, and calls [`run`].
//!
//! Radio → machine of the exchange → changes of links, and the distances of tags where the exchange tells them to
//! anchors.
#![no_std]
#![forbid(unsafe_code)]

use core::convert::Infallible;

use embedded_hal_async::delay::DelayNs;
use ranging::exchange::Machine;
use ranging::node::{self, Restart};

pub use ranging::node::Listener;

/// Runs an anchor: `machine` is its side of the exchange.
pub async fn run<R: Restart>(
    mut radio: R,
    mut delay: impl DelayNs,
    mut machine: impl Machine,
    mut listener: impl Listener,
) -> Infallible {
    node::run(&mut radio, &mut delay, &mut machine, &mut listener).await
}
