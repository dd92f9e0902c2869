//! The DW1000's bus, interrupt and reset line.

use embassy_nrf::Peri;
use embassy_nrf::gpio::{AnyPin, Flex, Input, Output, OutputDrive};
use embassy_nrf::pac::{SPIM2, spim::vals::Frequency};
use embassy_nrf::spim::{Error, Spim};
use embedded_hal_async::spi::{ErrorType, Operation, SpiDevice};
use ranging::dw1000::{ClockedSpi, ResetLine, SpiClock};

use super::Delay;
use crate::cortex::spi;

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
pub type Interrupt = Input<'static>;

/// Cycles of the processor a microsecond.
const CYCLES: u32 = 64;

/// SPI to the DW1000. Transactions are not awaited.
pub struct Bus {
    spi: Spim<'static>,
    select: Output<'static>,
}

impl Bus {
    /// `spi` is SPIM2.
    pub(super) fn new(spi: Spim<'static>, select: Output<'static>) -> Self {
        Self { spi, select }
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
        // The chip allows 20 MHz; this is the processor's fastest.
        let frequency = match clock {
            SpiClock::Slow => Frequency::M2,
            SpiClock::Fast => Frequency::M8,
        };
        SPIM2.frequency().write(|w| w.set_frequency(frequency));
        Ok(())
    }
}

/// The line that resets the DW1000.
pub struct Reset(Flex<'static>);

impl Reset {
    pub(super) fn new(pin: Peri<'static, AnyPin>) -> Self {
        let mut pin = Flex::new(pin);
        pin.set_low();
        pin.set_as_disconnected();
        Self(pin)
    }
}

impl ResetLine for Reset {
    fn pull_low(&mut self) {
        // Low is driven, high is not.
        self.0.set_as_output(OutputDrive::Standard0Disconnect1);
        self.0.set_low();
    }

    fn release(&mut self) {
        self.0.set_as_disconnected();
    }
}
