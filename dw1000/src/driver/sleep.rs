//! Sleep and deep sleep, and waking with the configuration that the chip has kept (DW1000 user manual, 2.4, 7.2.45).

use core::future::Future;

use embassy_futures::select::select;
use embedded_hal_async::{delay::DelayNs, digital::Wait};

use super::bus::{ClockedSpi, ResetLine, SpiClock};
use super::register::{self as reg, Register};
use super::startup::{CLOCK_CRYSTAL, CLOCK_SEQUENCED, CLOCKS_DEFAULT, DEVICE_ID, PLL_LOCK_DETECTION};
use super::{Dw1000, Error, Transceiver, configuration};

/// AON_WCFG: the chip's actions on waking (7.2.45.1).
const RESTORE_CONFIGURATION: u16 = 1 << 6;
const LOAD_LENGTH_64_PARAMETERS: u16 = 1 << 7;
const LOAD_DETECTOR: u16 = 1 << 11;
const LOAD_LDO_TUNE: u16 = 1 << 12;
/// AON_CFG0: the kind of sleep and the sources of waking (7.2.45.6).
const SLEEP_ENABLE: u8 = 1 << 0;
const WAKE_BY_PIN: u8 = 1 << 1;
const WAKE_BY_SPI: u8 = 1 << 2;
const WAKE_BY_COUNTER: u8 = 1 << 3;
/// The crystal's start (2.4.1).
const CRYSTAL_START_MS: u32 = 5;
/// How long the select line is held low, microseconds.
const SELECT_US: u32 = 600;
/// Crystals start within some 3 ms. From here on the driver polls the chip about every 100 µs, because the chip takes
/// 18 mA as soon as it is awake.
const FIRST_LOOK_US: u32 = 2_500;
const LOOK_US: u32 = 100;
const LOOKS: u32 = 40;
/// The time of a poll on the bus, and of the steps after the crystal's start: the PLL, some registers.
const LOOKING_US: u32 = 40;
const SETTLING_US: u32 = 300;
/// The assumed time of waking before the first measurement.
pub(super) const WAKING_US: u32 = SELECT_US + FIRST_LOOK_US + 6 * (LOOK_US + LOOKING_US) + SETTLING_US;
/// The chip stays idle in waits shorter than this. Idle takes 18 mA, and the crystal alone takes 4 mA while it starts
/// (data sheet, table 3). So sleep saves energy from about the time of waking on.
const PAYS_FROM_US: u32 = 7_000;

/// The external source of waking.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum WakeBy {
    /// The chip-select line, held low for 500 µs: [`Dw1000::wake`] does it.
    ChipSelect,
    /// The WAKEUP pin, driven high for 500 µs by the board before [`Dw1000::wake`].
    Pin,
}

/// How the chip sleeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Wake {
    /// Deep sleep, 50 nA: until an external source wakes it.
    Outside(WakeBy),
    /// Sleep, 1 µA: until an external source wakes it, or until `counter` × 4096 periods of its low-power oscillator
    /// have passed. The oscillator's frequency is between 7 and 13 kHz: 0.3 to 0.6 s for each 4096 periods.
    Counter {
        /// Periods of 4096 cycles.
        counter: u16,
        /// The source that may wake it earlier.
        or: WakeBy,
    },
}

impl<S, I, R, D> Dw1000<S, I, R, D>
where
    S: ClockedSpi,
    I: Wait,
    R: ResetLine,
    D: DelayNs,
{
    /// Puts the chip to sleep. Its clock stops, so timestamps before and after the sleep cannot be compared. Only
    /// [`wake`](Self::wake) and [`init`](Self::init) work until it wakes.
    ///
    /// # Errors
    /// If the chip is not initialised, or asleep, or the bus fails.
    pub async fn sleep(&mut self, wake: Wake) -> Result<(), Error<S::Error>> {
        self.ensure_off().await?;
        self.transceiver = Transceiver::NotReady;
        let (from_outside, counter) = match wake {
            Wake::Outside(by) => (by, None),
            Wake::Counter { counter, or } => (or, Some(counter)),
        };
        if let Some(counter) = counter {
            self.set_sleep_counter(counter).await?;
        }
        let mut on_wake = RESTORE_CONFIGURATION | LOAD_DETECTOR;
        if self.factory.ldo_tuned {
            on_wake |= LOAD_LDO_TUNE;
        }
        if self.config.phy.preamble_length().symbols() == 64 {
            on_wake |= LOAD_LENGTH_64_PARAMETERS;
        }
        self.bus.write(reg::AON_WCFG, &on_wake.to_le_bytes()).await?;
        let from_outside = match from_outside {
            WakeBy::ChipSelect => WAKE_BY_SPI,
            WakeBy::Pin => WAKE_BY_PIN,
        };
        let by_counter = if counter.is_some() { WAKE_BY_COUNTER } else { 0 };
        self.bus.write(reg::AON_CFG0, &[SLEEP_ENABLE | from_outside | by_counter]).await?;
        self.save_always_on().await
    }

    /// Sleeps for `micros` microseconds, including waking, or until `roused` is done. Sleeps only if the configuration
    /// allows it and the wait is long enough. Returns whether it slept.
    pub(super) async fn sleep_for(
        &mut self,
        micros: u32,
        roused: impl Future<Output = ()>,
    ) -> Result<bool, Error<S::Error>> {
        if !self.config.sleeps || micros < PAYS_FROM_US {
            return Ok(false);
        }
        self.sleep(Wake::Outside(WakeBy::ChipSelect)).await?;
        select(self.delay.delay_us(micros.saturating_sub(self.waking_us)), roused).await;
        self.wake().await?;
        Ok(true)
    }

    /// Wakes the chip, if it does not wake by itself or by its pin, and makes it ready: 4 ms. If it has lost its
    /// configuration (its supply was off), it is initialised again.
    ///
    /// # Errors
    /// If no DW1000 answers, or its PLL does not lock, or the bus fails.
    pub async fn wake(&mut self) -> Result<(), Error<S::Error>> {
        self.transceiver = Transceiver::NotReady;
        self.bus.spi.set_clock(SpiClock::Slow)?;
        self.bus.hold_select(1_000 * SELECT_US).await?;
        self.await_crystal().await?;
        let channel = u32::from_le_bytes(self.bus.read(reg::CHAN_CTRL).await?);
        if channel != configuration::chan_ctrl(&self.config) {
            return self.init().await;
        }
        // This register may not be kept either, and the wait for the PLL needs it.
        let (register, value) = PLL_LOCK_DETECTION;
        self.bus.write(register, value).await?;
        self.await_pll().await?;
        self.bus.spi.set_clock(SpiClock::Fast)?;
        // The only register that is not kept; restoring another register overwrites it (7.2.26).
        let [delay, _] = self.antenna_delays();
        self.bus.write(reg::TX_ANTD, &delay.to_le_bytes()).await?;
        self.stop().await
    }

    /// Waits until the chip answers. If the wait is longer than any crystal needs, the following reads show the
    /// failure.
    async fn await_crystal(&mut self) -> Result<(), Error<S::Error>> {
        self.delay.delay_us(FIRST_LOOK_US).await;
        for looks in 0..LOOKS {
            if self.device_id().await? == DEVICE_ID {
                self.waking_us = SELECT_US + FIRST_LOOK_US + looks * (LOOK_US + LOOKING_US) + SETTLING_US;
                break;
            }
            self.delay.delay_us(LOOK_US).await;
        }
        Ok(())
    }

    /// Holds the chip-select line low for longer than the 500 µs that wake the chip, and waits for its crystal.
    pub(super) async fn wake_by_select(&mut self) -> Result<(), Error<S::Error>> {
        self.bus.hold_select(1_000 * SELECT_US).await?;
        self.delay.delay_ms(CRYSTAL_START_MS).await;
        Ok(())
    }

    /// The counter is set while the chip runs from the crystal's clock, in three uploads: off, its value, on
    /// (7.2.45.6).
    async fn set_sleep_counter(&mut self, counter: u16) -> Result<(), Error<S::Error>> {
        self.bus.spi.set_clock(SpiClock::Slow)?;
        let upload: [(Register, &[u8]); 2] = [(reg::AON_CTRL, &[0x04]), (reg::AON_CTRL, &[0x00])];
        let off: [(Register, &[u8]); 3] =
            [(reg::PMSC_CTRL0, &[CLOCK_CRYSTAL]), (reg::AON_CFG0, &[0]), (reg::AON_CFG1, &[0])];
        let value: [(Register, &[u8]); 1] = [(reg::AON_CFG0.plus(2), &counter.to_le_bytes())];
        let on: [(Register, &[u8]); 1] = [(reg::AON_CFG1, &[1])];
        for step in [&off[..], &upload, &value, &upload, &on, &upload] {
            self.bus.write_each(step).await?;
        }
        self.set_clocks(CLOCK_SEQUENCED, CLOCKS_DEFAULT).await
    }
}
