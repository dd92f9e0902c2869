//! The small peripherals of a board: the chip's reset line, and waiting.

use crate::chip::Chip;
use crate::processor::Processor;
use crate::sleep::Sleep;
use crate::time::TrueTime;
use crate::world::World;
use embedded_hal::digital::{ErrorType, OutputPin};
use embedded_hal_async::delay::DelayNs;
use std::cell::RefCell;
use std::convert::Infallible;
use std::rc::Rc;
use std::time::Duration;

/// RSTn: an open drain, pulled low or let go.
pub struct ResetPin {
    pub(crate) world: World,
    pub(crate) chip: Rc<RefCell<Chip>>,
}

impl ErrorType for ResetPin {
    type Error = Infallible;
}

impl OutputPin for ResetPin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.chip.borrow_mut().set_reset(&self.world, true);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.chip.borrow_mut().set_reset(&self.world, false);
        Ok(())
    }
}

/// Waits in virtual time; true time, as a processor's crystal errs by parts per million.
#[derive(Clone)]
pub struct SimDelay {
    pub(crate) world: World,
    /// The processor whose timer it is, if its costs count.
    pub(crate) processor: Option<Processor>,
}

impl SimDelay {
    /// Waits `ms` milliseconds; unlike the trait's methods it counts from the call, not from the first poll, and costs the processor
    /// nothing.
    pub fn pause_ms(&self, ms: u64) -> Sleep {
        self.pause(Duration::from_millis(ms))
    }

    /// Waits from the call on; costs the processor nothing.
    pub fn pause(&self, duration: Duration) -> Sleep {
        self.world.sleep_until(self.world.now() + duration)
    }

    /// A delay for work in the background: it wakes no ranging and costs nothing, so that whoever waits charges what it does.
    pub fn for_background(&self) -> Self {
        Self { world: self.world.clone(), processor: None }
    }

    /// The world, for true time.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Waits by the processor's timer, from the first poll on, and is then woken by it.
    async fn wait(&self, duration: Duration) {
        let Some(processor) = &self.processor else { return self.pause(duration).await };
        let end = processor.timer_end(self.world.now(), duration);
        let resting = Resting { world: &self.world, processor, since: processor.settle(self.world.now()) };
        self.world.sleep_until(end).await;
        drop(resting);
        self.world.pass(processor.wake(self.world.now())).await;
    }
}

impl DelayNs for SimDelay {
    async fn delay_ns(&mut self, ns: u32) {
        self.wait(Duration::from_nanos(ns.into())).await;
    }

    async fn delay_us(&mut self, us: u32) {
        self.wait(Duration::from_micros(us.into())).await;
    }

    async fn delay_ms(&mut self, ms: u32) {
        self.wait(Duration::from_millis(ms.into())).await;
    }
}

/// A wait that may be long enough to be slept through, also one that is given up.
struct Resting<'a> {
    world: &'a World,
    processor: &'a Processor,
    since: TrueTime,
}

impl Drop for Resting<'_> {
    fn drop(&mut self) {
        self.processor.slept(self.world.now().ps_since(self.since));
    }
}
