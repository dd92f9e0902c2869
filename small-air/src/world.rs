//! Virtual time: it stops while there is something to do, and jumps to the next event.

use core::cell::{Cell, RefCell};
use core::future::{Future, poll_fn};
use core::pin::Pin;
use core::sync::atomic::{AtomicU32, Ordering};
use core::task::{Context, Poll, Waker};

use ranging::PhyConfig;

use crate::air::{Air, Path};
use crate::clock::{Crystal, micros, ticks};
use crate::{AirDelay, AirRadio};

/// The time of the running world, microseconds, in two halves: the processors have no 64-bit atomics.
static UPTIME_US: [AtomicU32; 2] = [AtomicU32::new(0), AtomicU32::new(0)];

/// Microseconds since the beginning of the running world. Only one world may run at a time.
pub fn uptime_us() -> u64 {
    let [low, high] = [0, 1].map(|half| u64::from(UPTIME_US[half].load(Ordering::Relaxed)));
    high << 32 | low
}

/// An air and its time.
pub struct World {
    now: Cell<u64>,
    /// The earliest time that a future waits for.
    next: Cell<u64>,
    pub(crate) air: RefCell<Air>,
}

impl World {
    /// A world at its beginning. `loss_per_mille` of a thousand receptions are lost.
    pub fn new(phy: PhyConfig, seed: u64, loss_per_mille: u32) -> Self {
        let air = RefCell::new(Air::new(phy, seed, loss_per_mille));
        let world = Self { now: Cell::new(0), next: Cell::new(0), air };
        world.set_now(0);
        world
    }

    /// Adds a node and returns its radio; none if there are too many nodes.
    pub fn add(&self, place: Path, crystal: Crystal) -> Option<AirRadio<'_>> {
        self.air.borrow_mut().add(place, crystal).map(|node| AirRadio::new(self, node))
    }

    /// The number of times that the radios have slept.
    pub fn naps(&self) -> u32 {
        self.air.borrow().nodes.iter().map(|node| node.naps).sum()
    }

    /// A delay in this world.
    pub fn delay(&self) -> AirDelay<'_> {
        AirDelay::new(self)
    }

    /// True time, ticks.
    pub(crate) fn now(&self) -> u64 {
        self.now.get()
    }

    fn set_now(&self, now: u64) {
        self.now.set(now);
        let us = micros(now);
        UPTIME_US[0].store(us as u32, Ordering::Relaxed);
        UPTIME_US[1].store((us >> 32) as u32, Ordering::Relaxed);
    }

    /// Ready at a time. A future that also waits for something else registers both.
    pub(crate) fn reached(&self, time: u64) -> bool {
        let reached = self.now.get() >= time;
        if !reached {
            self.next.set(self.next.get().min(time));
        }
        reached
    }

    pub(crate) async fn wait_until(&self, time: u64) {
        poll_fn(|_| if self.reached(time) { Poll::Ready(()) } else { Poll::Pending }).await;
    }

    /// Runs for `micros` more microseconds, and calls `between` each time before time advances.
    ///
    /// Wakers do nothing here: every future is polled at every time that any of them waits for. A future that wakes
    /// another within the same time must be polled before it.
    pub fn run(&self, micros: u64, mut future: Pin<&mut impl Future>, mut between: impl FnMut()) {
        let end = self.now() + ticks(micros);
        let mut context = Context::from_waker(Waker::noop());
        loop {
            self.next.set(end);
            if future.as_mut().poll(&mut context).is_ready() {
                return;
            }
            between();
            let next = self.air.borrow().next().unwrap_or(end).min(self.next.get());
            self.set_now(next.min(end).max(self.now()));
            if next >= end {
                return;
            }
            self.air.borrow_mut().pass(next);
        }
    }
}
