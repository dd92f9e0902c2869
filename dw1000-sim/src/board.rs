//! How fast a board talks to its chip.

use std::time::Duration;

/// What a transaction and an interrupt cost on a board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardProfile {
    /// SPI clock until the application changes it, Hz.
    pub spi_hz: u32,
    /// Time around the bytes of a transaction: driver, chip select, DMA set-up; nanoseconds.
    pub transaction_overhead_ns: u32,
    /// From an edge of the IRQ pin to the first instruction of the task that waited for it, nanoseconds.
    pub interrupt_latency_ns: u32,
}

impl BoardProfile {
    /// DWM1001: nRF52832 at 64 MHz, SPI 8 MHz at most (its SPIM), started at 2 MHz.
    pub const DWM1001: Self = Self { spi_hz: 2_000_000, transaction_overhead_ns: 5_000, interrupt_latency_ns: 4_000 };
    /// EVB1000: STM32F105 at 72 MHz, SPI 18 MHz, started at 2.25 MHz.
    pub const EVB1000: Self = Self { spi_hz: 2_250_000, transaction_overhead_ns: 3_000, interrupt_latency_ns: 3_000 };
    /// A processor that takes no time of its own; only the bytes on the bus do.
    pub const INSTANT: Self = Self { spi_hz: 2_000_000, transaction_overhead_ns: 0, interrupt_latency_ns: 0 };
}

/// What a board takes for what its driver does with the chip: interrupts, and transactions on the bus.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Handling {
    interrupt_ns: u64,
    transaction_ns: u64,
    byte_ns: f64,
}

impl Handling {
    /// That of a board whose bus runs at `spi_hz`.
    pub fn new(board: &BoardProfile, spi_hz: u32) -> Self {
        Self {
            interrupt_ns: board.interrupt_latency_ns.into(),
            transaction_ns: board.transaction_overhead_ns.into(),
            byte_ns: 8e9 / f64::from(spi_hz.max(1)),
        }
    }

    /// So many transactions of so many bytes together.
    pub fn bus(&self, transactions: u64, bytes: usize) -> Duration {
        Duration::from_nanos(transactions * self.transaction_ns + (bytes as f64 * self.byte_ns) as u64)
    }

    /// The same, upon an interrupt.
    pub fn upon_interrupt(&self, transactions: u64, bytes: usize) -> Duration {
        Duration::from_nanos(self.interrupt_ns) + self.bus(transactions, bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_takes_a_dwm1001_a_tenth_of_a_millisecond() {
        let board = Handling::new(&BoardProfile::DWM1001, 8_000_000);
        // Eight transactions, 44 + 23 bytes at 1 µs each: 4 + 8·5 + 67 µs.
        assert_eq!(board.upon_interrupt(8, 67), Duration::from_micros(111));
        // No time of its own, and 20 MHz: 67 · 0.4 µs.
        assert_eq!(Handling::new(&BoardProfile::INSTANT, 20_000_000).bus(8, 67), Duration::from_nanos(26_800));
    }
}
