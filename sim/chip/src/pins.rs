//! The small peripherals of a board: the chip's reset line and delays.

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

/// RSTn: an open drain, pulled low or released.
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

/// Waits in virtual time. This is true time, because a processor's crystal has an error of only parts per million.
#[derive(Clone)]
pub struct SimDelay {
    pub(crate) world: World,
    /// The processor whose timer it is, if its costs are modelled.
    pub(crate) processor: Option<Processor>,
}

impl SimDelay {
    /// Waits `ms` milliseconds. Unlike the trait's methods, it counts from the call, not from the first poll, and costs
    /// the processor nothing.
    pub fn pause_ms(&self, ms: u64) -> Sleep {
        self.pause(Duration::from_millis(ms))
    }

    /// Waits from the call on. It costs the processor nothing.
    pub fn pause(&self, duration: Duration) -> Sleep {
        self.world.sleep_until(self.world.now() + duration)
    }

    /// A delay for work in the background. It does not wake ranging and costs nothing, so the user of the delay must
    /// charge its own work.
    pub fn for_background(&self) -> Self {
        Self { world: self.world.clone(), processor: None }
    }

    /// The world, for true time.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Waits by the processor's timer, from the first poll on. The timer then wakes the processor.
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

/// A wait during which the processor may sleep if it is long enough, also if it is cancelled.
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
