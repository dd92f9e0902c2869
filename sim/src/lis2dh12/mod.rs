//! A register-level LIS2DH12 in virtual time, on a board that is carried. It is behind a TWI with realistic timing and
//! has its line INT1.
//!
//! [`Device`] is the chip. [`Sensor`] makes it sample, gives the firmware its bus ([`Twi`]) and its line ([`Int1`]),
//! and measures its current. A [`Condition`] says what is wrong with it.

mod device;
mod registers;
#[cfg(test)]
mod tests;

use std::cell::{Cell, RefCell};
use std::convert::Infallible;
use std::future::{pending, poll_fn};
use std::rc::Rc;
use std::task::{Poll, Waker};
use std::time::Duration;

use dw1000_sim::{Processor, TaskId, TrueTime, World};
use embedded_hal::digital;
use embedded_hal::i2c::{self, ErrorKind, NoAcknowledgeSource, Operation};
use embedded_hal_async::digital::Wait;
use embedded_hal_async::i2c::I2c;

pub use device::Device;

/// The address on the bus, SA0 high.
const ADDRESS: u8 = 0x19;
/// The bus's clock, Hz: standard mode.
const TWI_HZ: u64 = 100_000;
/// Start and stop, in clocks; each byte takes eight and one for the acknowledgement.
const FRAME_CLOCKS: u64 = 2;
const BYTE_CLOCKS: u64 = 9;
/// Instructions of a transaction: the driver, the start of the bus by direct memory access, and its interrupt. An
/// estimate.
const TRANSACTION_INSTRUCTIONS: u32 = 600;

/// The condition of a sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Condition {
    /// Nothing.
    #[default]
    Works,
    /// It acknowledges nothing.
    Silent,
    /// Its bus hangs.
    Hung,
    /// Another device is at its address.
    Foreign,
    /// Its line INT1 is always high, or always low.
    Stuck(bool),
}

/// A sensor on a board.
#[derive(Clone)]
pub struct Sensor(Rc<State>);

/// The measured acceleration at a time in seconds: mg along the sensor's axes, noise included.
type Acceleration = Box<dyn Fn(f64) -> [f64; 3]>;

struct State {
    world: World,
    condition: Condition,
    acceleration: Acceleration,
    device: RefCell<Device>,
    is_supplied: Cell<bool>,
    sampling: RefCell<Option<TaskId>>,
    waiting: RefCell<Option<Waker>>,
    /// The charge drawn up to `counted_to`, microcoulombs.
    drawn_uc: Cell<f64>,
    counted_to: Cell<TrueTime>,
}

impl Sensor {
    /// A sensor whose supply is on.
    pub fn new(world: &World, condition: Condition, acceleration: impl Fn(f64) -> [f64; 3] + 'static) -> Self {
        let sensor = Self(Rc::new(State {
            world: world.clone(),
            condition,
            acceleration: Box::new(acceleration),
            device: RefCell::default(),
            is_supplied: Cell::new(false),
            sampling: RefCell::default(),
            waiting: RefCell::default(),
            drawn_uc: Cell::new(0.0),
            counted_to: Cell::new(world.now()),
        }));
        sensor.set_supply(true);
        sensor
    }

    /// Switches its supply. The sensor forgets everything.
    pub fn set_supply(&self, on: bool) {
        self.count();
        let fresh = if self.0.condition == Condition::Foreign { Device::foreign() } else { Device::new() };
        *self.0.device.borrow_mut() = fresh;
        self.0.is_supplied.set(on);
        self.sample_from_now();
    }

    /// Its bus, for the firmware on a processor.
    pub fn twi(&self, processor: &Processor) -> Twi {
        Twi { sensor: self.clone(), processor: processor.clone() }
    }

    /// Its line, for the firmware on a processor.
    pub fn int1(&self, processor: &Processor) -> Int1 {
        Int1 { sensor: self.clone(), processor: processor.clone() }
    }

    /// The charge that it has drawn, microcoulombs.
    pub fn drawn_uc(&self) -> f64 {
        self.count();
        self.0.drawn_uc.get()
    }

    fn count(&self) {
        let state = &self.0;
        let now = state.world.now();
        let seconds = now.as_secs_f64() - state.counted_to.replace(now).as_secs_f64();
        let current_ua = if state.is_supplied.get() { state.device.borrow().current_ua() } else { 0.0 };
        state.drawn_uc.set(state.drawn_uc.get() + current_ua * seconds);
    }

    fn is_high(&self) -> bool {
        match self.0.condition {
            Condition::Stuck(level) => level,
            Condition::Works | Condition::Silent | Condition::Hung | Condition::Foreign => {
                self.0.is_supplied.get() && self.0.device.borrow().int1()
            }
        }
    }

    /// The data rate has changed: sampling restarts.
    fn sample_from_now(&self) {
        let state = &self.0;
        if let Some(task) = state.sampling.take() {
            state.world.abort(task);
        }
        let Some(period) = state.device.borrow().period().filter(|_| state.is_supplied.get()) else { return };
        let (sensor, world) = (self.clone(), state.world.clone());
        let task = state.world.spawn(async move {
            let mut next = world.now() + period;
            loop {
                world.sleep_until(next).await;
                sensor.sample(next);
                next = next + period;
            }
        });
        *state.sampling.borrow_mut() = Some(task);
    }

    fn sample(&self, at: TrueTime) {
        let acceleration_mg = (self.0.acceleration)(at.as_secs_f64());
        self.0.device.borrow_mut().sample(acceleration_mg);
        self.wake_waiting();
    }

    fn wake_waiting(&self) {
        if let Some(waker) = self.0.waiting.take() {
            waker.wake();
        }
    }
}

/// The bus to a sensor.
pub struct Twi {
    sensor: Sensor,
    processor: Processor,
}

/// No device acknowledged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoAcknowledge;

impl i2c::Error for NoAcknowledge {
    fn kind(&self) -> ErrorKind {
        ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address)
    }
}

impl i2c::ErrorType for Twi {
    type Error = NoAcknowledge;
}

impl I2c for Twi {
    async fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), NoAcknowledge> {
        let Sensor(state) = &self.sensor;
        self.processor.background(&state.world, TRANSACTION_INSTRUCTIONS).await;
        let answers = match state.condition {
            Condition::Hung => pending().await,
            Condition::Silent => false,
            Condition::Works | Condition::Foreign | Condition::Stuck(_) => {
                state.is_supplied.get() && address == ADDRESS
            }
        };
        let bytes = |operation: &Operation<'_>| match operation {
            Operation::Read(into) => into.len() as u64,
            Operation::Write(sent) => sent.len() as u64,
        };
        let clocks = |bytes: u64| FRAME_CLOCKS + BYTE_CLOCKS * (1 + bytes);
        let clocks: u64 =
            if answers { operations.iter().map(|operation| clocks(bytes(operation))).sum() } else { clocks(0) };
        state.world.sleep_until(state.world.now() + Duration::from_nanos(clocks * 1_000_000_000 / TWI_HZ)).await;
        if !answers {
            return Err(NoAcknowledge);
        }
        self.sensor.count();
        let mut restarts = false;
        for operation in operations {
            match operation {
                Operation::Read(into) => state.device.borrow_mut().read(into),
                Operation::Write(sent) => restarts |= state.device.borrow_mut().write(sent),
            }
        }
        if restarts {
            self.sensor.sample_from_now();
        }
        self.sensor.wake_waiting();
        Ok(())
    }
}

/// The line INT1 of a sensor, at a pin of its processor.
pub struct Int1 {
    sensor: Sensor,
    processor: Processor,
}

impl Int1 {
    /// Waits for a level. The processor pays the cost of the wake-up.
    async fn until(&self, is_due: impl Fn(bool) -> bool) {
        let mut has_waited = false;
        poll_fn(|context| {
            if is_due(self.sensor.is_high()) {
                return Poll::Ready(());
            }
            has_waited = true;
            *self.sensor.0.waiting.borrow_mut() = Some(context.waker().clone());
            Poll::Pending
        })
        .await;
        if has_waited {
            self.processor.charge_background(self.processor.board().wake_instructions);
        }
    }
}

impl digital::ErrorType for Int1 {
    type Error = Infallible;
}

impl Wait for Int1 {
    async fn wait_for_high(&mut self) -> Result<(), Infallible> {
        self.until(|is_high| is_high).await;
        Ok(())
    }

    async fn wait_for_low(&mut self) -> Result<(), Infallible> {
        self.until(|is_high| !is_high).await;
        Ok(())
    }

    async fn wait_for_rising_edge(&mut self) -> Result<(), Infallible> {
        self.wait_for_low().await?;
        self.wait_for_high().await
    }

    async fn wait_for_falling_edge(&mut self) -> Result<(), Infallible> {
        self.wait_for_high().await?;
        self.wait_for_low().await
    }

    async fn wait_for_any_edge(&mut self) -> Result<(), Infallible> {
        let before = self.sensor.is_high();
        self.until(|is_high| is_high != before).await;
        Ok(())
    }
}
