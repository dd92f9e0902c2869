//! The tag's task and the host compute the same positions from the same recording, to the last bit of `f32`.

mod advertisements;
mod ranges;

use std::cell::{Cell, RefCell};
use std::convert::Infallible;
use std::fmt::Debug;
use std::future::{Future, poll_fn};
use std::pin::{Pin, pin};
use std::task::{Context, Poll, Waker};

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embedded_hal_async::delay::DelayNs;
use firmware_tag::{LocatorConfig, Position, RateControl, RoomReport, RoundOutcome, Sink, Task, TaskChannels};
use positioning_core::SolveError;
use ranging::exchange::{Event, Link};
use ranging::native::Rate;
use ranging::radio::Sensors;
use wire::telemetry::{Condition, MotionSensor, Sighting};
use wire::uwb::native::{Answer, Downlink};

type Outcome = Result<Position, SolveError>;

/// The clock of a tag's tasks, and the sink of its positions.
#[derive(Default)]
struct Node {
    now_us: Cell<u64>,
    outcomes: RefCell<Vec<(u64, Outcome)>>,
}

impl Sink for &Node {
    fn now_us(&self) -> u64 {
        self.now_us.get()
    }

    async fn publish(&self, epoch: RoundOutcome<'_>) {
        self.outcomes.borrow_mut().push((epoch.poll_us, epoch.outcome));
    }

    fn link(&self, _: Link) {}

    fn radio_failed(&self, error: &impl Debug, _: u32) {
        panic!("there is no radio: {error:?}");
    }

    fn sensed(&self, sensors: &Sensors) {
        panic!("there is no radio: {sensors:?}");
    }

    fn step(&self, _: &Event<'_>) {}

    fn rests(&self, _: u64) {}

    fn refused(&self, _: u32) {}

    fn round_dropped(&self) {}

    fn alive(&self, _: Task) {}

    fn sighting(&self, _: Sighting) {}

    fn beacon(&self, _: Condition) {}

    fn room(&self, _: RoomReport) {}

    fn motion_sensor(&self, _: MotionSensor) {}

    fn heard(&self, _: u32) {}

    fn scanner_restarted(&self, _: u32) {}

    fn message(&self) -> Option<Downlink> {
        None
    }

    fn identify(&self, _: u64) {}

    fn answered(&self, _: &Downlink, _: Answer) {}
}

/// A delay by the node's clock, which the test sets.
struct Delay<'a>(&'a Node);

impl DelayNs for Delay<'_> {
    async fn delay_ns(&mut self, ns: u32) {
        let until_us = self.0.now_us.get() + u64::from(ns.div_ceil(1000));
        poll_fn(|_| if self.0.now_us.get() < until_us { Poll::Pending } else { Poll::Ready(()) }).await;
    }
}

/// Runs the tag's task while `feed` sets the clock and supplies measurements. The task works when `feed` says so.
/// Returns all its positions.
fn tag(
    config: LocatorConfig<'_>,
    feed: impl FnOnce(&Node, &TaskChannels<NoopRawMutex>, &mut dyn FnMut()),
) -> Vec<(u64, Outcome)> {
    let (node, channels) = (Node::default(), TaskChannels::<NoopRawMutex>::new());
    let sink = &node;
    {
        let rates = RateControl::new(Rate::Greedy, None);
        let mut engine =
            pin!(firmware_tag::engine::<{ firmware_tag::LISTED }, _>(&channels, Delay(&node), config, rates, &sink));
        feed(&node, &channels, &mut || work(engine.as_mut()));
    }
    node.outcomes.take()
}

fn work(engine: Pin<&mut impl Future<Output = Infallible>>) {
    assert!(engine.poll(&mut Context::from_waker(Waker::noop())).is_pending());
}
