//! How fast a board talks to its chip.

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
