//! The DW1000's bus, interrupt and reset line.

use embassy_stm32::exti::ExtiInput;
use embassy_stm32::gpio::{Output, OutputOpenDrain};
use embassy_stm32::mode::{Async, Blocking};
use embassy_stm32::spi::mode::Master;
use embassy_stm32::spi::{Config, Error, Spi};
use embassy_stm32::time::Hertz;
use embassy_time::Delay;
use embedded_hal_async::spi::{ErrorType, Operation, SpiDevice};
use ranging::dw1000::{ClockedSpi, ResetLine, SpiClock};

use crate::cortex::spi;

/// 72 MHz / 32, and / 4.
pub(super) const SLOW: Hertz = Hertz(2_250_000);
const FAST: Hertz = Hertz(18_000_000);

/// Cycles of the processor a microsecond.
const CYCLES: u32 = 72;

/// What the driver of the DW1000 is made of.
pub struct Uwb {
    /// SPI with the chip's select line.
    pub bus: Bus,
    /// High while the chip has something to tell.
    pub interrupt: Interrupt,
    /// RSTn.
    pub reset: Reset,
    /// For the driver's waits.
    pub delay: Delay,
}

/// The chip's interrupt pin.
pub type Interrupt = ExtiInput<'static, Async>;

/// SPI to the DW1000. Transactions are not awaited.
pub struct Bus {
    spi: Spi<'static, Blocking, Master>,
    config: Config,
    select: Output<'static>,
}

impl Bus {
    /// `config` is that of `spi`.
    pub(super) fn new(spi: Spi<'static, Blocking, Master>, config: Config, select: Output<'static>) -> Self {
        Self { spi, config, select }
    }
}

impl ErrorType for Bus {
    type Error = Error;
}

impl SpiDevice for Bus {
    async fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Error> {
        spi::transact(&mut self.spi, &mut self.select, CYCLES, operations)
    }
}

impl ClockedSpi for Bus {
    fn set_clock(&mut self, clock: SpiClock) -> Result<(), Error> {
        self.config.frequency = match clock {
            SpiClock::Slow => SLOW,
            SpiClock::Fast => FAST,
        };
        // What it refuses are other modes than the one that it was made with.
        self.spi.set_config(&self.config).map_err(|()| Error::ModeFault)
    }
}

/// The line that resets the DW1000: low is driven, high is not.
pub struct Reset(OutputOpenDrain<'static>);

impl Reset {
    pub(super) fn new(line: OutputOpenDrain<'static>) -> Self {
        Self(line)
    }
}

impl ResetLine for Reset {
    fn pull_low(&mut self) {
        self.0.set_low();
    }

    fn release(&mut self) {
        self.0.set_high();
    }
}
