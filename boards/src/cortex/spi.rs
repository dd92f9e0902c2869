//! Transactions with the DW1000, none of them awaited: a frame's bytes take 10 to 130 µs, less than the way into another task and
//! back is worth, and one that is dropped on its way would leave the chip selected and the memory being written.

use embedded_hal::digital::OutputPin;
use embedded_hal::spi::SpiBus;
use embedded_hal_async::spi::Operation;

/// Selects the chip, does the operations, and deselects it. Waits are counted in the processor's cycles, so many a microsecond.
pub(crate) fn transact<S: SpiBus>(
    spi: &mut S,
    select: &mut impl OutputPin,
    cycles_per_us: u32,
    operations: &mut [Operation<'_, u8>],
) -> Result<(), S::Error> {
    // The boards' pins do not fail.
    let _ = select.set_low();
    let result = operations.iter_mut().try_for_each(|operation| match operation {
        Operation::Read(words) => spi.read(words),
        Operation::Write(words) => spi.write(words),
        Operation::Transfer(read, write) => spi.transfer(read, write),
        Operation::TransferInPlace(words) => spi.transfer_in_place(words),
        Operation::DelayNs(ns) => {
            cortex_m::asm::delay(ns.div_ceil(1000).saturating_mul(cycles_per_us));
            Ok(())
        }
    });
    let _ = select.set_high();
    result
}
