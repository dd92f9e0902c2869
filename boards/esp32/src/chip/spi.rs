//! The lines to a DW1000.

use core::pin::Pin;
use core::task::{Context, Poll};

use baliza_dw1000::driver::{ClockedSpi, ResetLine, SpiClock, fastest_clock};
use embedded_hal::delay::DelayNs as _;
use embedded_hal_async::spi::{ErrorType, Operation, SpiDevice};
use esp_hal::Blocking;
use esp_hal::delay::Delay;
use esp_hal::gpio::{AnyPin, DriveMode, Input, InputConfig, Level, Output, OutputConfig, Pull};
use esp_hal::spi::master::{AnySpi, Config, Spi};
use esp_hal::spi::{Error, Mode};
use esp_hal::time::Rate;
use wire::config::Pins;

/// The slow clock: at most 3 MHz are allowed while the DW1000 runs from its crystal.
const SLOW_MHZ: u32 = 2;

/// The DW1000's interrupt line.
pub type Interrupt = Input<'static>;

/// The SPI peripheral before its pins are set.
pub struct Port(AnySpi<'static>);

impl Port {
    pub fn new(spi: impl Into<AnySpi<'static>>) -> Self {
        Self(spi.into())
    }

    /// Connects it to pins that have been checked.
    pub fn wire(self, pins: &Pins, fast_mhz: u32) -> (Bus, Interrupt, Reset) {
        // SAFETY: the pins exist on the chip, none occurs twice, and no other code has any of them: the board gives no
        // pins away.
        let pin = |number: u8| unsafe { AnyPin::steal(number) };
        // Set the idle levels before the peripheral takes the lines over: the DW1000 is not selected and not reset.
        let select = Output::new(pin(pins.cs), Level::High, OutputConfig::default());
        let floating = OutputConfig::default().with_drive_mode(DriveMode::OpenDrain).with_pull(Pull::None);
        let reset = Output::new(pin(pins.reset), Level::High, floating);
        // The line is low while the DW1000 has no power.
        let irq = Input::new(pin(pins.irq), InputConfig::default().with_pull(Pull::Down));
        let slow = clock(SLOW_MHZ);
        let spi = Spi::new(self.0, slow).expect("2 MHz is a fraction of the chip's clock");
        let spi = spi.with_sck(pin(pins.sck)).with_mosi(pin(pins.mosi)).with_miso(pin(pins.miso));
        (Bus { spi, select, slow, fast: clock(fast_mhz), unproven_mhz: Some(fast_mhz) }, irq, Reset(reset))
    }
}

fn clock(mhz: u32) -> Config {
    Config::default().with_frequency(Rate::from_mhz(mhz)).with_mode(Mode::_0)
}

/// SPI with the DW1000's chip select.
///
/// The processor fills and empties the peripheral's own buffer of 64 bytes, and waits meanwhile: at 20 MHz 26 µs for 64
/// bytes, or 4 µs for the ten bytes of a usual register access. Direct memory access would need descriptors and copies
/// for each transaction, and an interrupt at the end would cost two changes of thread. Also, a future that is dropped
/// during a transaction would leave the chip selected.
pub struct Bus {
    spi: Spi<'static, Blocking>,
    select: Output<'static>,
    slow: Config,
    fast: Config,
    /// The fast clock until the chip was seen to return what was written to it.
    unproven_mhz: Option<u32>,
}

impl Bus {
    /// In RAM, as the peripheral's driver is. It is therefore not inlined: the driver of the DW1000 has about forty
    /// transactions.
    #[esp_hal::ram]
    fn transact(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Error> {
        self.select.set_low();
        let result = operations.iter_mut().try_for_each(|operation| self.operate(operation));
        self.select.set_high();
        result
    }

    #[esp_hal::ram]
    fn operate(&mut self, operation: &mut Operation<'_, u8>) -> Result<(), Error> {
        match operation {
            Operation::Read(words) => self.spi.read(words),
            Operation::Write(words) => self.spi.write(words),
            Operation::Transfer(read, write) => embedded_hal::spi::SpiBus::transfer(&mut self.spi, read, write),
            Operation::TransferInPlace(words) => self.spi.transfer(words),
            Operation::DelayNs(ns) => {
                Delay::new().delay_ns(*ns);
                Ok(())
            }
        }
    }

    fn apply(&mut self, config: &Config) -> Result<(), Error> {
        self.spi.apply_config(config).map_err(|_| Error::Unsupported)
    }

    /// Takes the fastest clock that the wires carry.
    #[cold]
    fn prove(&mut self, wanted_mhz: u32) -> Result<(), Error> {
        let mhz = fastest_clock(wanted_mhz, SLOW_MHZ, |mhz, bytes| {
            self.apply(&clock(mhz))?;
            self.transact(&mut [Operation::TransferInPlace(bytes)])
        })?;
        if mhz < wanted_mhz {
            defmt::warn!("SPI: wrong answers at {} MHz; {} MHz from here on: shorten the wires", wanted_mhz, mhz);
        }
        self.fast = clock(mhz);
        self.unproven_mhz = None;
        Ok(())
    }
}

impl ErrorType for Bus {
    type Error = Error;
}

impl SpiDevice for Bus {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> impl Future<Output = Result<(), Error>> {
        Transaction { bus: self, operations }
    }
}

/// A transaction that completes at its first poll. An `async fn` would add its states to each of the driver's
/// transactions.
struct Transaction<'b, 'a, 'o> {
    bus: &'b mut Bus,
    operations: &'a mut [Operation<'o, u8>],
}

impl Future for Transaction<'_, '_, '_> {
    type Output = Result<(), Error>;

    fn poll(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<Self::Output> {
        let this = self.get_mut();
        Poll::Ready(this.bus.transact(this.operations))
    }
}

impl ClockedSpi for Bus {
    #[inline(never)]
    fn set_clock(&mut self, clock: SpiClock) -> Result<(), Error> {
        if let (SpiClock::Fast, Some(mhz)) = (clock, self.unproven_mhz) {
            self.prove(mhz)?;
        }
        let config = match clock {
            SpiClock::Slow => self.slow,
            SpiClock::Fast => self.fast,
        };
        self.apply(&config)
    }
}

/// The DW1000's reset line: low, or floating.
pub struct Reset(Output<'static>);

impl ResetLine for Reset {
    fn pull_low(&mut self) {
        self.0.set_low();
    }

    fn release(&mut self) {
        // Open drain: "high" is floating.
        self.0.set_high();
    }
}
