//! Reset, first contact, factory values, the first-path detector's program, and the configuration (2.4, 2.5.5, 7.2.50).

use embedded_hal_async::{delay::DelayNs, digital::Wait};

use super::bus::{ClockedSpi, ResetLine, SpiClock};
use super::configuration;
use super::register::{self as reg, Register, status};
use super::{Dw1000, Error, Transceiver};
use radio::Config;
use radio::phy::{Channel, PreambleLength, Prf};

/// DEV_ID of every DW1000.
pub(super) const DEVICE_ID: u32 = 0xDECA_0130;

/// SOFTRESET in PMSC_CTRL0's last byte, active low: its bits reset the whole chip, only the receiver, or nothing.
const RESET_ALL: u8 = 0x00;
pub(super) const RESET_RECEIVER: u8 = 0xE0;
pub(super) const RESET_NOTHING: u8 = 0xF0;

/// PMSC_CTRL0's first byte: the system runs from the crystal, or from the PLL by automatic sequencing.
pub(super) const CLOCK_CRYSTAL: u8 = 0x01;
pub(super) const CLOCK_SEQUENCED: u8 = 0x00;
/// Its second byte: as after reset, and with the clock needed for loading from the one-time programmable memory.
pub(super) const CLOCKS_DEFAULT: u8 = 0x02;
const CLOCKS_LOADING: u8 = 0x03;

/// Addresses in the one-time programmable memory (6.3.1).
const OTP_LDO_TUNE: u16 = 0x04;
const OTP_VOLTAGE: u16 = 0x08;
const OTP_TEMPERATURE: u16 = 0x09;
/// Two words for each of the six channels: TX_POWER at 16 and at 64 MHz.
const OTP_TX_POWER: u16 = 0x10;
/// In each direction, ticks: at 16 MHz in the lower half, at 64 MHz in the upper.
const OTP_ANTENNA_DELAY: u16 = 0x1C;
const OTP_CRYSTAL: u16 = 0x1E;

/// OTP_SF: loads the regulators' tuning, or an operating parameter set (7.2.46.9).
const KICK_LDO: u8 = 1 << 1;
const KICK_PARAMETERS: u8 = 1 << 0;
const PARAMETERS_LENGTH_64: u8 = 0 << 5;
const PARAMETERS_DEFAULT: u8 = 2 << 5;

/// With this value of EC_CTRL the flag of the PLL's lock is reliable (PLLLDT, 7.2.37.1).
pub(super) const PLL_LOCK_DETECTION: (Register, &[u8]) = (reg::EC_CTRL, &[0x04]);

/// Crystal trim for a module without a measured one.
const CRYSTAL_MIDDLE: u8 = 0x10;

/// The maker's measurements of this chip; zeros or ones if there are none.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Factory {
    pub ldo_tuned: bool,
    pub crystal_trim: u8,
    /// Reading of the voltage sensor at 3.3 V.
    pub voltage: u8,
    /// Reading of the temperature sensor at 23 °C.
    pub temperature: u8,
    /// At 16 MHz and at 64 MHz.
    pub antenna_delays: [u16; 2],
    /// By channel, then by pulse frequency as above.
    pub tx_powers: [[u32; 2]; 6],
}

impl Factory {
    /// TX_POWER as calibrated for a channel and pulse frequency, for smart power.
    pub fn tx_power(&self, channel: Channel, prf: Prf) -> Option<u32> {
        let place = match channel {
            Channel::Ch1 => 0,
            Channel::Ch2 => 1,
            Channel::Ch3 => 2,
            Channel::Ch4 => 3,
            Channel::Ch5 => 4,
            Channel::Ch7 => 5,
        };
        let [at_16, at_64] = self.tx_powers[place];
        let register = match prf {
            Prf::Mhz16 => at_16,
            Prf::Mhz64 => at_64,
        };
        Some(register).filter(|&register| register != 0 && register != u32::MAX)
    }

    /// The antenna delay in each direction at a pulse frequency, ticks.
    pub fn antenna_delay(&self, prf: Prf) -> Option<u16> {
        let [at_16, at_64] = self.antenna_delays;
        let ticks = match prf {
            Prf::Mhz16 => at_16,
            Prf::Mhz64 => at_64,
        };
        Some(ticks).filter(|&ticks| ticks != 0 && ticks != u16::MAX)
    }
}

impl<S, I, R, D> Dw1000<S, I, R, D>
where
    S: ClockedSpi,
    I: Wait,
    R: ResetLine,
    D: DelayNs,
{
    /// Resets the chip in any state, also asleep, and writes the configuration: 9 ms. May be called at any time.
    ///
    /// # Errors
    /// If no DW1000 answers, or its PLL does not lock, or the bus fails.
    pub async fn init(&mut self) -> Result<(), Error<S::Error>> {
        self.transceiver = Transceiver::NotReady;
        self.holds_buffer = false;
        self.bus.spi.set_clock(SpiClock::Slow)?;
        self.reset.pull_low();
        self.delay.delay_us(100).await;
        self.reset.release();
        // The crystal starts within 4 ms.
        self.delay.delay_ms(5).await;
        self.identify().await?;
        self.soft_reset().await?;

        self.bus.write_each(&[(reg::PMSC_CTRL0, &[CLOCK_CRYSTAL]), PLL_LOCK_DETECTION]).await?;
        self.read_factory_values().await?;
        if self.factory.ldo_tuned {
            self.bus.write(reg::OTP_SF, &[KICK_LDO]).await?;
        }
        self.load_first_path_detector().await?;
        self.await_pll().await?;
        self.bus.spi.set_clock(SpiClock::Fast)?;
        // Reserved bits that prevent deep sleep (7.2.45.7).
        self.bus.write(reg::AON_CFG1, &[0]).await?;
        self.write_configuration().await?;
        self.stop().await
    }

    /// Replaces the configuration of a running chip.
    ///
    /// # Errors
    /// If the chip is not initialised, or asleep, or the bus fails.
    pub async fn configure(&mut self, config: Config) -> Result<(), Error<S::Error>> {
        self.ensure_off().await?;
        self.config = config;
        self.transceiver = Transceiver::Unknown;
        self.write_configuration().await?;
        self.transceiver = Transceiver::Off;
        Ok(())
    }

    /// Replaces the network and the short address, which a node learns when it joins: one write of four bytes.
    ///
    /// # Errors
    /// If the chip is not initialised, or asleep, or the bus fails.
    pub async fn set_address(&mut self, pan: u16, short_address: u16) -> Result<(), Error<S::Error>> {
        self.ensure_off().await?;
        self.config.pan = pan;
        self.config.short_address = short_address;
        let value = u32::from(short_address) | u32::from(pan) << 16;
        self.bus.write(reg::PANADR, &value.to_le_bytes()).await
    }

    pub(super) async fn device_id(&mut self) -> Result<u32, Error<S::Error>> {
        Ok(u32::from_le_bytes(self.bus.read(reg::DEV_ID).await?))
    }

    /// Checks that a DW1000 answers. A chip that sleeps, because it has no reset line, is woken first.
    async fn identify(&mut self) -> Result<(), Error<S::Error>> {
        if self.device_id().await? == DEVICE_ID {
            return Ok(());
        }
        self.wake_by_select().await?;
        match self.device_id().await? {
            DEVICE_ID => Ok(()),
            other => Err(Error::WrongChip(other)),
        }
    }

    async fn soft_reset(&mut self) -> Result<(), Error<S::Error>> {
        // Packet sequencing off. Nothing must be restored from, or kept in, the memory that survives the reset.
        self.bus
            .write_each(&[
                (reg::PMSC_CTRL0, &[CLOCK_CRYSTAL]),
                (reg::PMSC_CTRL1, &[0, 0]),
                (reg::AON_WCFG, &[0, 0]),
                (reg::AON_CFG0, &[0]),
            ])
            .await?;
        self.save_always_on().await?;
        self.bus.write(reg::PMSC_CTRL0.plus(3), &[RESET_ALL]).await?;
        // The PLL needs 10 µs.
        self.delay.delay_us(1000).await;
        self.bus.write(reg::PMSC_CTRL0.plus(3), &[RESET_NOTHING]).await
    }

    async fn read_factory_values(&mut self) -> Result<(), Error<S::Error>> {
        let [ldo, _, _, _] = self.read_once_programmed(OTP_LDO_TUNE).await?;
        let [voltage, _, _, _] = self.read_once_programmed(OTP_VOLTAGE).await?;
        let [temperature, _, _, _] = self.read_once_programmed(OTP_TEMPERATURE).await?;
        let [crystal, _, _, _] = self.read_once_programmed(OTP_CRYSTAL).await?;
        let [low_16, high_16, low_64, high_64] = self.read_once_programmed(OTP_ANTENNA_DELAY).await?;
        let antenna_delays = [[low_16, high_16], [low_64, high_64]].map(u16::from_le_bytes);
        let mut tx_powers = [[0; 2]; 6];
        for (address, power) in (OTP_TX_POWER..).zip(tx_powers.as_flattened_mut()) {
            *power = u32::from_le_bytes(self.read_once_programmed(address).await?);
        }
        let (ldo_tuned, crystal_trim) = (ldo != 0, crystal & 0x1F);
        self.factory = Factory { ldo_tuned, crystal_trim, voltage, temperature, antenna_delays, tx_powers };
        Ok(())
    }

    async fn read_once_programmed(&mut self, address: u16) -> Result<[u8; 4], Error<S::Error>> {
        // Manual read mode and the read; the read clears itself, the mode does not.
        self.bus
            .write_each(&[(reg::OTP_ADDR, &address.to_le_bytes()), (reg::OTP_CTRL, &[0x03]), (reg::OTP_CTRL, &[0x00])])
            .await?;
        self.bus.read(reg::OTP_RDAT).await
    }

    async fn load_first_path_detector(&mut self) -> Result<(), Error<S::Error>> {
        self.set_clocks(CLOCK_CRYSTAL, CLOCKS_LOADING).await?;
        // LDELOAD, 120 µs (2.5.5.10).
        self.bus.write(reg::OTP_CTRL, &0x8000_u16.to_le_bytes()).await?;
        self.delay.delay_us(150).await;
        self.set_clocks(CLOCK_SEQUENCED, CLOCKS_DEFAULT).await
    }

    /// Writes the first byte of PMSC_CTRL0 before the second, as Decawave's software does.
    pub(super) async fn set_clocks(&mut self, first: u8, second: u8) -> Result<(), Error<S::Error>> {
        self.bus.write_each(&[(reg::PMSC_CTRL0, &[first]), (reg::PMSC_CTRL0.plus(1), &[second])]).await
    }

    pub(super) async fn await_pll(&mut self) -> Result<(), Error<S::Error>> {
        for _ in 0..20 {
            if self.status().await? & status::CPLOCK != 0 {
                return Ok(());
            }
            self.delay.delay_us(100).await;
        }
        Err(Error::PllNotLocked)
    }

    pub(super) async fn save_always_on(&mut self) -> Result<(), Error<S::Error>> {
        self.bus.write_each(&[(reg::AON_CTRL, &[0x00]), (reg::AON_CTRL, &[0x02])]).await
    }

    async fn write_configuration(&mut self) -> Result<(), Error<S::Error>> {
        for write in configuration::writes(&self.config, &self.factory, self.antenna_delays()) {
            self.bus.write(write.register, write.bytes()).await?;
        }
        let trim = match (self.config.crystal_trim, self.factory.crystal_trim) {
            (Some(trim), _) => trim & 0x1F,
            (None, 0) => CRYSTAL_MIDDLE,
            (None, trim) => trim,
        };
        // The upper three bits must be 011, or the chip malfunctions (7.2.44.5).
        self.bus.write_each(&[(reg::FS_XTALT, &[0x60 | trim]), (reg::RX_FWTO, &[0, 0])]).await?;
        self.tx_length = 0;
        self.rx_timer = 0;
        self.rx_timer_on = false;
        self.load_operating_parameters().await
    }

    /// Loads the receiver's parameter set for preambles of 64 symbols, or for all others. While it loads, the chip runs
    /// from its crystal, and the bus clock must fit it.
    async fn load_operating_parameters(&mut self) -> Result<(), Error<S::Error>> {
        let set = if self.config.phy.preamble_length() == PreambleLength::Symbols64 {
            PARAMETERS_LENGTH_64
        } else {
            PARAMETERS_DEFAULT
        };
        self.bus.spi.set_clock(SpiClock::Slow)?;
        self.set_clocks(CLOCK_CRYSTAL, CLOCKS_LOADING).await?;
        self.bus.write(reg::OTP_SF, &[set | KICK_PARAMETERS]).await?;
        self.set_clocks(CLOCK_SEQUENCED, CLOCKS_DEFAULT).await?;
        self.delay.delay_us(10).await;
        Ok(self.bus.spi.set_clock(SpiClock::Fast)?)
    }
}
