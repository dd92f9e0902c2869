//! The IRQ line from a chip to its processor.

use crate::kernel::Continuation;
use crate::time::TrueTime;
use crate::world::World;
use embedded_hal::digital::ErrorType;
use embedded_hal_async::digital::Wait;
use std::cell::{Cell, RefCell};
use std::convert::Infallible;
use std::future::poll_fn;
use std::rc::Rc;
use std::task::Poll;

/// The level, its last edges, and who waits for one.
pub(crate) struct IrqLine {
    level: Cell<bool>,
    rises: Cell<u64>,
    falls: Cell<u64>,
    last_edge: Cell<TrueTime>,
    latency_ps: Cell<u64>,
    waiting: RefCell<Option<Continuation>>,
}

impl IrqLine {
    pub(crate) fn new(latency_ns: u32) -> Self {
        Self {
            level: Cell::new(false),
            rises: Cell::new(0),
            falls: Cell::new(0),
            last_edge: Cell::new(TrueTime::ZERO),
            latency_ps: Cell::new(u64::from(latency_ns) * 1000),
            waiting: RefCell::new(None),
        }
    }

    pub(crate) fn set(&self, world: &World, level: bool) {
        if self.level.replace(level) == level {
            return;
        }
        let edges = if level { &self.rises } else { &self.falls };
        edges.set(edges.get() + 1);
        self.last_edge.set(world.now());
        if let Some(continuation) = self.waiting.take() {
            world.kernel().schedule_continuation(self.answered_at(), continuation);
        }
    }

    /// When the processor gets to work on the last edge.
    fn answered_at(&self) -> TrueTime {
        self.last_edge.get().plus_ps(self.latency_ps.get())
    }
}

/// The processor's pin.
pub struct IrqPin {
    world: World,
    line: Rc<IrqLine>,
}

impl IrqPin {
    pub(crate) fn new(world: World, line: Rc<IrqLine>) -> Self {
        Self { world, line }
    }

    /// The level now.
    pub fn is_high(&self) -> bool {
        self.line.level.get()
    }

    /// Waits until `due` holds and the processor has had time to notice the last edge.
    async fn until(&self, due: impl Fn(&IrqLine) -> bool) {
        poll_fn(|cx| {
            let line = &self.line;
            if !due(line) {
                let continuation = self.world.kernel().executor.continuation(cx.waker());
                *line.waiting.borrow_mut() = Some(continuation);
                return Poll::Pending;
            }
            if self.world.now() < line.answered_at() {
                // Another part of the same task was woken meanwhile; the edge's own wake-up is on its way, but may be for
                // an earlier poll.
                self.world.kernel().schedule_wake(line.answered_at(), cx.waker());
                return Poll::Pending;
            }
            Poll::Ready(())
        })
        .await;
    }
}

impl ErrorType for IrqPin {
    type Error = Infallible;
}

impl Wait for IrqPin {
    async fn wait_for_high(&mut self) -> Result<(), Infallible> {
        let rises = self.line.rises.get();
        self.until(|l| l.level.get() || l.rises.get() != rises).await;
        Ok(())
    }

    async fn wait_for_low(&mut self) -> Result<(), Infallible> {
        let falls = self.line.falls.get();
        self.until(|l| !l.level.get() || l.falls.get() != falls).await;
        Ok(())
    }

    async fn wait_for_rising_edge(&mut self) -> Result<(), Infallible> {
        let rises = self.line.rises.get();
        self.until(|l| l.rises.get() != rises).await;
        Ok(())
    }

    async fn wait_for_falling_edge(&mut self) -> Result<(), Infallible> {
        let falls = self.line.falls.get();
        self.until(|l| l.falls.get() != falls).await;
        Ok(())
    }

    async fn wait_for_any_edge(&mut self) -> Result<(), Infallible> {
        let edges = self.line.rises.get() + self.line.falls.get();
        self.until(|l| l.rises.get() + l.falls.get() != edges).await;
        Ok(())
    }
}
