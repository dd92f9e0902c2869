//! Transactions with the DW1000. They block and are not awaited, for two reasons. A frame's bytes take 10 to 130 µs,
//! less than a change to another task and back is worth. And a future that is dropped during a transaction would leave
//! the chip selected and the memory being written.

use core::pin::Pin;
use core::task::{Context, Poll};

use baliza_dw1000::driver::{ClockedSpi, SpiClock};
use embedded_hal::digital::OutputPin;
use embedded_hal::spi::SpiBus;
use embedded_hal_async::spi::{ErrorType, Operation, SpiDevice};

/// SPI to the DW1000.
pub struct Bus<S: SpiBus, P> {
    /// The bus.
    pub spi: S,
    /// The chip's select line, high while it is not selected.
    pub select: P,
    /// Sets the bus clock for the following transactions, within the chip's limits.
    pub set_clock: fn(&mut S, SpiClock) -> Result<(), S::Error>,
    /// Processor cycles in a microsecond, for waits.
    pub cycles_per_us: u32,
}

impl<S: SpiBus, P: OutputPin> Bus<S, P> {
    /// Selects the chip, carries out the operations, and deselects the chip.
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

/// A transaction that completes at its first poll. An `async fn` would add its states to each of the driver's
/// transactions.
struct Transaction<'b, 'a, 'o, S: SpiBus, P> {
    bus: &'b mut Bus<S, P>,
    operations: &'a mut [Operation<'o, u8>],
}

impl<S: SpiBus, P: OutputPin> Future for Transaction<'_, '_, '_, S, P> {
    type Output = Result<(), S::Error>;

    /// Not inlined: the driver of the DW1000 has about forty transactions.
    #[inline(never)]
    fn poll(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<Self::Output> {
        let this = self.get_mut();
        Poll::Ready(this.bus.transact(this.operations))
    }
}
