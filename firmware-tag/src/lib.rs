//! The tag, whole: a board's binary brings a radio, a delay and a [`Sink`], and calls [`run`].
//!
//! Radio → machine of the exchange → a round of ranges → [`Memory`] → [`Locator`] → an [`Epoch`]: a position with its
//! covariance, or the reason why there is none. Every round gives exactly one epoch.
#![no_std]
#![forbid(unsafe_code)]

mod locator;
mod memory;

#[cfg(test)]
extern crate std;

use core::convert::Infallible;

use embedded_hal_async::delay::DelayNs;
use ranging::RadioInstant;
use ranging::exchange::{Guidance, Link, Machine, Report};
use ranging::node::{self, Listener, Restart};

pub use locator::{AnchorPlace, Dimensions, Epoch, Locator, Position};
pub use memory::Memory;

/// Where a tag's results go: telemetry, a log, a test.
#[allow(async_fn_in_trait, reason = "nodes run on one core; no future crosses a thread")]
pub trait Sink {
    /// A round is over.
    async fn publish(&mut self, epoch: Epoch<'_>);

    /// A link or the network has changed.
    async fn link(&mut self, link: Link);

    /// The radio failed for the `failures`-th time in a row; it is brought up again.
    async fn radio_failed(&mut self, error: &impl core::fmt::Debug, failures: u32);
}

/// Runs a tag: `machine` is its side of the exchange.
pub async fn run<R: Restart>(
    mut radio: R,
    mut delay: impl DelayNs,
    mut machine: impl Machine,
    locator: Locator<'_>,
    sink: impl Sink,
) -> Infallible {
    node::run(
        &mut radio,
        &mut delay,
        &mut machine,
        &mut Positioner { locator, memory: Memory::default(), sink, place: None },
    )
    .await
}

/// From rounds to epochs.
struct Positioner<'a, S> {
    locator: Locator<'a>,
    memory: Memory,
    sink: S,
    /// Of the last round.
    place: Option<[f32; 3]>,
}

impl<S: Sink> Listener for Positioner<'_, S> {
    async fn report(&mut self, report: Report<'_>, _: RadioInstant) -> Guidance {
        match report {
            Report::Round(round) => {
                let epoch = self.locator.locate(round, &self.memory.complete(&round));
                self.place = epoch.outcome.ok().map(|position| position.position_m);
                self.sink.publish(epoch).await;
            }
            Report::Link(link) => self.sink.link(link).await,
        }
        Guidance { position_m: self.place, rate: None }
    }

    async fn radio_failed(&mut self, error: &impl core::fmt::Debug, failures: u32) {
        self.memory.forget();
        self.sink.radio_failed(error, failures).await;
    }
}
