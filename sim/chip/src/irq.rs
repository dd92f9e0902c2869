//! The IRQ line from a chip to its processor.

use crate::kernel::Continuation;
use crate::processor::Processor;
use crate::time::TrueTime;
use crate::world::World;
use embedded_hal::digital::ErrorType;
use embedded_hal_async::digital::Wait;
use std::cell::{Cell, RefCell};
use std::convert::Infallible;
use std::future::poll_fn;
use std::rc::Rc;
use std::task::Poll;

/// The level, its last edges, and the tasks that wait for one.
pub(crate) struct IrqLine {
    level: Cell<bool>,
    rises: Cell<u64>,
    falls: Cell<u64>,
    processor: Processor,
    waiting: RefCell<Option<Continuation>>,
    /// The time at which the task that waited continues after the edge that woke it.
    answered_at: Cell<Option<TrueTime>>,
}

impl IrqLine {
    pub(crate) fn new(processor: Processor) -> Self {
        Self {
            level: Cell::new(false),
            rises: Cell::new(0),
            falls: Cell::new(0),
            processor,
            waiting: RefCell::new(None),
            answered_at: Cell::new(None),
        }
    }

    pub(crate) fn set(&self, world: &World, level: bool) {
        if self.level.replace(level) == level {
            return;
        }
        let edges = if level { &self.rises } else { &self.falls };
        edges.set(edges.get() + 1);
        if let Some(continuation) = self.waiting.take() {
            let at = self.processor.wake(world.now());
            self.answered_at.set(Some(at));
            world.kernel().schedule_continuation(at, continuation);
        }
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

    /// Waits until `due` holds and the processor, which that wakes, has reached the task.
    async fn until(&self, due: impl Fn(&IrqLine) -> bool) {
        let line = &self.line;
        line.answered_at.set(None);
        line.processor.charge(line.processor.board().wait_instructions);
        let _armed = Armed(line);
        poll_fn(|cx| {
            let kernel = self.world.kernel();
            if !due(line) {
                line.processor.settle(self.world.now());
                *line.waiting.borrow_mut() = Some(kernel.executor.continuation(cx.waker()));
                return Poll::Pending;
            }
            // If the level was right before the wait began, no edge has woken the task. The interrupt then comes at
            // once.
            let at = line.answered_at.get().unwrap_or_else(|| line.processor.wake(self.world.now()));
            line.answered_at.set(Some(at));
            if self.world.now() < at {
                // Another part of the same task may have been woken meanwhile. The wake-up by the edge is pending, but
                // it may be for an earlier poll.
                kernel.schedule_wake(at, cx.waker());
                return Poll::Pending;
            }
            Poll::Ready(())
        })
        .await;
    }
}

/// A cancelled wait wakes no task.
struct Armed<'a>(&'a IrqLine);

impl Drop for Armed<'_> {
    fn drop(&mut self) {
        self.0.waiting.take();
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
