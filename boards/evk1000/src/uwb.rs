//! The DW1000's bus, interrupt and reset line.

use baliza_board_cortex_m::spi;
use baliza_dw1000::driver::{ResetLine, SpiClock};
use embassy_stm32::exti::ExtiInput;
use embassy_stm32::gpio::{Output, OutputOpenDrain};
use embassy_stm32::mode::{Async, Blocking};
use embassy_stm32::spi::mode::Master;
use embassy_stm32::spi::{Config, Error, Spi};
use embassy_stm32::time::Hertz;

/// The chip's interrupt pin.
pub type Interrupt = ExtiInput<'static, Async>;

/// SPI to the DW1000.
pub type Bus = spi::Bus<Spi<'static, Blocking, Master>, Output<'static>>;

/// The bus at a clock that the DW1000 allows: 72 MHz / 32, or 72 MHz / 4.
pub(super) fn config(clock: SpiClock) -> Config {
    let mut config = Config::default();
    config.frequency = match clock {
        SpiClock::Slow => Hertz(2_250_000),
        SpiClock::Fast => Hertz(18_000_000),
    };
    config
}

pub(super) fn set_clock(spi: &mut Spi<'static, Blocking, Master>, clock: SpiClock) -> Result<(), Error> {
    // It refuses only another mode than the one that it was created with.
    spi.set_config(&config(clock)).map_err(|()| Error::ModeFault)
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
