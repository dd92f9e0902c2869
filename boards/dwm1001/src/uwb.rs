//! The DW1000's bus, interrupt and reset line.

use core::sync::atomic::{Ordering, compiler_fence};

use baliza_board_cortex_m::spi;
use baliza_dw1000::driver::{ResetLine, SpiClock};
use embassy_nrf::Peri;
use embassy_nrf::gpio::{AnyPin, Flex, Input, Output, OutputDrive};
use embassy_nrf::pac::{SPIM2, spim::vals::Frequency};
use embassy_nrf::spim::{Error, Spim};
use embedded_hal::spi::{ErrorType, SpiBus};

/// The chip's interrupt pin.
pub type Interrupt = Input<'static>;

/// SPI to the DW1000.
pub type Bus = spi::Bus<Master, Output<'static>>;

/// The longest transfer of the nRF52832's EasyDMA: its counters have eight bits.
const LONGEST: usize = 255;
/// The beginning of the RAM. The DMA can read nothing but the RAM.
const RAM: usize = 0x2000_0000;

/// SPIM2, controlled by its registers while the processor waits: one start for each operation, and no interrupt.
///
/// `Spim` sets the peripheral up and owns it. The transfers of `Spim` each begin with one of no bytes and wait for two
/// interrupts. This is a remedy for anomaly 109: the first byte of a transfer may be wrong if the transfer starts while
/// the processor sleeps with its 64 MHz clock off. Here the processor starts the transfer itself and does not sleep
/// until its end.
pub struct Master {
    _owned: Spim<'static>,
}

impl Master {
    /// `spi` is SPIM2.
    pub(super) fn new(spi: Spim<'static>) -> Self {
        Self { _owned: spi }
    }

    /// Sends and receives. If one buffer is shorter than the other, the peripheral fills it up.
    fn exchange(&mut self, sent: *const [u8], received: *mut [u8]) -> Result<(), Error> {
        let (from, to) = (sent.cast::<u8>(), received.cast::<u8>());
        if sent.len() > 0 && (from as usize) < RAM {
            return Err(Error::BufferNotInRAM);
        }
        let mut done = 0;
        while done < sent.len().max(received.len()) {
            let part = |length: usize| length.saturating_sub(done).min(LONGEST) as u8;
            SPIM2.dma().tx().ptr().write_value(from.wrapping_add(done) as u32);
            SPIM2.dma().tx().maxcnt().write(|w| w.set_maxcnt(part(sent.len())));
            SPIM2.dma().rx().ptr().write_value(to.wrapping_add(done) as u32);
            SPIM2.dma().rx().maxcnt().write(|w| w.set_maxcnt(part(received.len())));
            SPIM2.events_end().write_value(0);
            // The data to be sent is in memory before the start, and the received data is read after the end.
            compiler_fence(Ordering::SeqCst);
            SPIM2.tasks_start().write_value(1);
            while SPIM2.events_end().read() == 0 {}
            compiler_fence(Ordering::SeqCst);
            done += LONGEST;
        }
        Ok(())
    }
}

impl ErrorType for Master {
    type Error = Error;
}

impl SpiBus for Master {
    fn read(&mut self, words: &mut [u8]) -> Result<(), Error> {
        self.exchange(&[], words)
    }

    fn write(&mut self, words: &[u8]) -> Result<(), Error> {
        self.exchange(words, &mut [])
    }

    fn transfer(&mut self, read: &mut [u8], write: &[u8]) -> Result<(), Error> {
        self.exchange(write, read)
    }

    fn transfer_in_place(&mut self, words: &mut [u8]) -> Result<(), Error> {
        // The DMA sends each byte before it writes the byte that is received for it.
        let words: *mut [u8] = words;
        self.exchange(words, words)
    }

    fn flush(&mut self) -> Result<(), Error> {
        Ok(())
    }
}

/// Sets the clock of SPIM2.
pub(super) fn set_clock(_: &mut Master, clock: SpiClock) -> Result<(), Error> {
    // The DW1000 allows 20 MHz. This is the fastest clock of the processor's SPI.
    let frequency = match clock {
        SpiClock::Slow => Frequency::M2,
        SpiClock::Fast => Frequency::M8,
    };
    SPIM2.frequency().write(|w| w.set_frequency(frequency));
    Ok(())
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
    #[inline(never)]
    fn pull_low(&mut self) {
        // Low is driven, high is not.
        self.0.set_as_output(OutputDrive::Standard0Disconnect1);
        self.0.set_low();
    }

    #[inline(never)]
    fn release(&mut self) {
        self.0.set_as_disconnected();
    }
}
