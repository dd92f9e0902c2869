//! The small peripherals of a board: the chip's reset line, and waiting.

use crate::chip::Chip;
use crate::kernel::Sleep;
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
}

impl SimDelay {
    /// Waits `ms` milliseconds; unlike the trait's methods it counts from the call, not from the first poll.
    pub fn pause_ms(&self, ms: u64) -> Sleep {
        self.pause(Duration::from_millis(ms))
    }

    /// Waits from the call on.
    pub fn pause(&self, duration: Duration) -> Sleep {
        self.world.sleep_until(self.world.now() + duration)
    }

    /// The world, for true time.
    pub fn world(&self) -> &World {
        &self.world
    }
}

impl DelayNs for SimDelay {
    async fn delay_ns(&mut self, ns: u32) {
        self.pause(Duration::from_nanos(u64::from(ns))).await;
    }
}
