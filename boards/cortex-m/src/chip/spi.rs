//! Transactions with the DW1000, none of them awaited: a frame's bytes take 10 to 130 µs, less than the way into another task and
//! back is worth, and one that is dropped on its way would leave the chip selected and the memory being written.

use core::pin::Pin;
use core::task::{Context, Poll};

use embedded_hal::digital::OutputPin;
use embedded_hal::spi::SpiBus;
use embedded_hal_async::spi::{ErrorType, Operation, SpiDevice};
use ranging::dw1000::{ClockedSpi, SpiClock};

/// SPI to the DW1000.
pub struct Bus<S: SpiBus, P> {
    /// The bus.
    pub spi: S,
    /// The chip's select line, high while it is not selected.
    pub select: P,
    /// Clocks the following transactions as the chip allows.
    pub set_clock: fn(&mut S, SpiClock) -> Result<(), S::Error>,
    /// Cycles of the processor a microsecond, in which waits are counted.
    pub cycles_per_us: u32,
}

impl<S: SpiBus, P: OutputPin> Bus<S, P> {
    /// Selects the chip, does the operations, and deselects it.
    fn transact(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), S::Error> {
        // The boards' pins do not fail.
        let _ = self.select.set_low();
        let result = operations.iter_mut().try_for_each(|operation| match operation {
            Operation::Read(words) => self.spi.read(words),
            Operation::Write(words) => self.spi.write(words),
            Operation::Transfer(read, write) => self.spi.transfer(read, write),
            Operation::TransferInPlace(words) => self.spi.transfer_in_place(words),
            Operation::DelayNs(ns) => {
                cortex_m::asm::delay(ns.div_ceil(1000).saturating_mul(self.cycles_per_us));
                Ok(())
            }
        });
        let _ = self.select.set_high();
        result
    }
}

impl<S: SpiBus, P> ErrorType for Bus<S, P> {
    type Error = S::Error;
}

impl<S: SpiBus, P: OutputPin> SpiDevice for Bus<S, P> {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> impl Future<Output = Result<(), S::Error>> {
        Transaction { bus: self, operations }
    }
}

impl<S: SpiBus, P: OutputPin> ClockedSpi for Bus<S, P> {
    fn set_clock(&mut self, clock: SpiClock) -> Result<(), S::Error> {
        (self.set_clock)(&mut self.spi, clock)
    }
}

/// A transaction, done at the first poll. An `async fn` would bring its states to each of the driver's transactions.
struct Transaction<'b, 'a, 'o, S: SpiBus, P> {
    bus: &'b mut Bus<S, P>,
    operations: &'a mut [Operation<'o, u8>],
}

impl<S: SpiBus, P: OutputPin> Future for Transaction<'_, '_, '_, S, P> {
    type Output = Result<(), S::Error>;

    /// Not inlined: the driver of the DW1000 has some forty transactions.
    #[inline(never)]
    fn poll(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<Self::Output> {
        let this = self.get_mut();
        Poll::Ready(this.bus.transact(this.operations))
    }
}
