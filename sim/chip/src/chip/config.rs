//! The settings of a chip, and the counts of its use.

use super::Currents;
use crate::clock::ClockConfig;

/// The settings of a chip.
#[derive(Clone, Debug, PartialEq)]
pub struct ChipConfig {
    /// Its oscillator.
    pub clock: ClockConfig,
    /// The count of the 40-bit counter when it starts: at power-up, after RSTn, a soft reset and sleep. On silicon it
    /// is 0. With `None` it is drawn at random, so that nodes differ and counters wrap.
    pub counter: Option<u64>,
    /// 64-bit identifier in its one-time memory (0: not written).
    pub eui: u64,
    /// Part identifier in its one-time memory.
    pub part: u32,
    /// Crystal trim in its one-time memory (0: none).
    pub trim: u8,
    /// Words of its one-time memory, by address (user manual, 6.3.1), such as 0x01C, the antenna delays. They override
    /// the fields above and the model's own words (0x004, 0x005, 0x007 to 0x009).
    pub otp: Vec<(u16, u32)>,
    /// True transmit delay from the chip to the antenna, ticks.
    pub tx_antenna_ticks: f64,
    /// True receive delay from the antenna to the chip, ticks.
    pub rx_antenna_ticks: f64,
    /// Gain of the antenna, dBi.
    pub antenna_dbi: f64,
    /// Temperature, °C. A change of 1 °C moves a range by 2.15 mm.
    pub temperature_c: f64,
    /// Supply voltage, V. A change of 1 V moves a range by 5.35 cm.
    pub supply_v: f64,
    /// The currents that it draws from its supply.
    pub currents: Currents,
}

impl Default for ChipConfig {
    fn default() -> Self {
        Self {
            clock: ClockConfig::crystal(0.0),
            counter: None,
            eui: 0,
            part: 0,
            trim: 0,
            otp: Vec::new(),
            tx_antenna_ticks: 16_436.0,
            rx_antenna_ticks: 16_436.0,
            antenna_dbi: 0.0,
            temperature_c: 23.0,
            supply_v: 3.3,
            currents: Currents::TYPICAL,
        }
    }
}

/// Counts of what a host did with its chip, and of actions that a real chip would not accept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChipStatistics {
    /// SPI transactions.
    pub transactions: u64,
    /// Bytes on the bus, headers included.
    pub spi_bytes: u64,
    /// Transactions that were too fast for the chip in its state.
    pub too_fast: u64,
    /// Transactions with a chip that was off, in reset, starting or asleep.
    pub deaf: u64,
    /// TXSTRT or RXENAB while the chip was not idle, or not able to do it.
    pub not_idle: u64,
    /// Frames with wrong time stamps because the receiver was not reset after an error.
    pub bad_stamps: u64,
    /// Delayed starts that came too late, or more than half a counter's period ahead.
    pub late: u64,
    /// Transmitter or receiver enabled with a tuning that differs from the user manual's for the mode. The model lets
    /// such frames pass; silicon may not. [`Chip::mistuned`](super::Chip::mistuned) names the registers.
    pub mistuned: u64,
}
