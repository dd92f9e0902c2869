//! The module's motion sensor, a LIS2DH12: its bus, which is on only while it is used, and its line INT1.
//!
//! SCL is P0.28, SDA P0.29, INT1 P0.25, and SA0 is high (the module's data sheet; `rust-dwm1001` and Zephyr's
//! `decawave_dwm1001_dev` have the same pins). The bus uses TWIM0 of the two TWI masters, because the DW1000 uses
//! SPIM2.
//!
//! After the set-up only the pin INT1 is watched, by its sense mechanism: the port's event needs no clock and no
//! channel of GPIOTE.

use embassy_nrf::gpio::{Input, Pull};
use embassy_nrf::interrupt::{InterruptExt, Priority};
use embassy_nrf::pac::{self, gpio::vals};
use embassy_nrf::twim::{self, Error, Twim};
use embassy_nrf::{Peri, bind_interrupts, interrupt, peripherals};
use embedded_hal_async::i2c::{ErrorType, I2c, Operation};
use static_cell::StaticCell;

bind_interrupts!(struct Interrupts {
    TWISPI0 => twim::InterruptHandler<peripherals::TWISPI0>;
});

/// The pins of the bus.
const SCL: usize = 28;
const SDA: usize = 29;

/// The peripherals of the chip that the sensor uses.
pub struct Parts {
    pub(super) twi: Peri<'static, peripherals::TWISPI0>,
    pub(super) scl: Peri<'static, peripherals::P0_28>,
    pub(super) sda: Peri<'static, peripherals::P0_29>,
    pub(super) int1: Peri<'static, peripherals::P0_25>,
}

impl Parts {
    /// The bus, switched on, and the line. May be called once in a program's run.
    pub fn into_bus_and_line(self) -> (Bus, Input<'static>) {
        // The buffer for data that the driver sends from flash, which the DMA cannot read: a register and its value.
        static SENT: StaticCell<[u8; 2]> = StaticCell::new();
        let mut config = twim::Config::default();
        config.frequency = twim::Frequency::K100;
        // The lines are short, and at 100 kHz 13 kΩ are enough, whether or not the module has resistors of its own.
        (config.scl_pullup, config.sda_pullup) = (true, true);
        interrupt::TWISPI0.set_priority(Priority::P2);
        let twi = Twim::new(self.twi, Interrupts, self.sda, self.scl, config, SENT.init([0; 2]));
        // The pull-down keeps the line low while nothing drives it.
        (Bus { twi, _lines: Lines }, Input::new(self.int1, Pull::Down))
    }
}

/// The TWI to the sensor. It is switched off when dropped.
pub struct Bus {
    twi: Twim<'static>,
    /// Dropped after the TWI.
    _lines: Lines,
}

impl ErrorType for Bus {
    type Error = Error;
}

impl I2c for Bus {
    async fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), Error> {
        self.twi.transaction(address, operations).await
    }
}

/// The two lines without a master: pulled up, so that the sensor's inputs do not float.
struct Lines;

impl Drop for Lines {
    fn drop(&mut self) {
        for pin in [SCL, SDA] {
            pac::P0.pin_cnf(pin).write(|w| {
                w.set_input(vals::Input::Disconnect);
                w.set_pull(vals::Pull::Pullup);
            });
        }
    }
}
