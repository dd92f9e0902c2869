//! From the record in flash to what the node's parts are configured with, once, at the start.

use node_record::{Mode, Record, Role};
use ranging::dw1000::{self, FrameFilter, TxPower};
use ranging::frame::decaranging::Variant;
use ranging::native::{Network, Turnaround};
use ranging::phy::{Channel, DataRate, PhyError, PreambleLength, Prf};
use ranging::{PhyConfig, RadioDuration};

/// What a node is configured with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// EUI-64.
    pub eui: u64,
    /// Short address.
    pub address: u16,
    /// For the radio's driver.
    pub radio: dw1000::Config,
    /// How its network ranges.
    pub exchange: Exchange,
    /// The network's PAN, frames and quickness.
    pub network: Network,
    /// What the node does.
    pub role: Role,
}

/// How a network ranges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Exchange {
    /// Native mode.
    Native,
    /// DecaRanging, in this variant.
    DecaRanging(Variant),
}

/// Why a record cannot be followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SettingsFault {
    /// 0xFFFF is everybody's address, 0xFFFE nobody's.
    Address(u16),
    /// The radio has no such channel.
    Channel(u8),
    /// It has no such pulse rate, MHz.
    PulseRate(u8),
    /// It has no such data rate, kbit/s.
    DataRate(u16),
    /// It has no preamble of so many symbols.
    Preamble(u16),
    /// These do not go together.
    Phy(PhyError),
    /// An answer cannot be quicker than a transmission.
    Turnaround,
}

impl Settings {
    /// Those of a record; `chip_eui` is the chip's own EUI-64, for records without one.
    pub fn of(record: &Record, chip_eui: u64) -> Result<Self, SettingsFault> {
        let eui = record.identity.eui.unwrap_or(chip_eui);
        let address = record.identity.address.unwrap_or(eui as u16);
        if address >= 0xFFFE {
            return Err(SettingsFault::Address(address));
        }
        let network = network(&record.network)?;
        let exchange = match record.network.mode {
            Mode::Native => Exchange::Native,
            Mode::DecaRanging { fast: false } => Exchange::DecaRanging(Variant::Standard),
            Mode::DecaRanging { fast: true } => Exchange::DecaRanging(Variant::Fast),
        };
        let calibration = &record.calibration;
        let antenna_delay = calibration.antenna_delay.unwrap_or(dw1000::DEFAULT_ANTENNA_DELAY);
        let radio = dw1000::Config {
            tx_power: calibration
                .tx_power
                .map_or(TxPower::Smart, |register| TxPower::Calibrated { register, smart: true }),
            tx_antenna_delay: antenna_delay,
            rx_antenna_delay: antenna_delay,
            crystal_trim: calibration.crystal_trim,
            pan: network.pan,
            short_address: address,
            eui,
            filter: match exchange {
                Exchange::Native => FrameFilter::DATA,
                // Blinks, and addresses that a tag learns when it is taken: everything is heard.
                Exchange::DecaRanging(_) => FrameFilter::OFF,
            },
            ..dw1000::Config::new(network.phy)
        };
        Ok(Self { eui, address, radio, exchange, network, role: record.role })
    }

    /// What the radio adds to the snapped start of a transmission.
    pub fn antenna_delay(&self) -> RadioDuration {
        RadioDuration::from_ticks(self.radio.tx_antenna_delay.into())
    }
}

fn network(network: &node_record::Network) -> Result<Network, SettingsFault> {
    let node_record::Turnaround { answer_us, listen_again_us, transmit_us } = network.turnaround;
    if transmit_us > answer_us {
        return Err(SettingsFault::Turnaround);
    }
    let micros = |us: u16| RadioDuration::from_micros(us.into());
    let turnaround =
        Turnaround { answer: micros(answer_us), listen_again: micros(listen_again_us), transmit: micros(transmit_us) };
    Ok(Network { pan: network.pan, phy: phy(&network.phy)?, turnaround })
}

fn phy(phy: &node_record::Phy) -> Result<PhyConfig, SettingsFault> {
    let channel = Channel::from_number(phy.channel).ok_or(SettingsFault::Channel(phy.channel))?;
    let prf = match phy.prf_mhz {
        16 => Prf::Mhz16,
        64 => Prf::Mhz64,
        other => return Err(SettingsFault::PulseRate(other)),
    };
    let rate = match phy.rate_kbps {
        110 => DataRate::Kbps110,
        850 => DataRate::Kbps850,
        6810 => DataRate::Kbps6810,
        other => return Err(SettingsFault::DataRate(other)),
    };
    let preamble = match phy.preamble {
        64 => PreambleLength::Symbols64,
        128 => PreambleLength::Symbols128,
        256 => PreambleLength::Symbols256,
        512 => PreambleLength::Symbols512,
        1024 => PreambleLength::Symbols1024,
        1536 => PreambleLength::Symbols1536,
        2048 => PreambleLength::Symbols2048,
        4096 => PreambleLength::Symbols4096,
        other => return Err(SettingsFault::Preamble(other)),
    };
    let config = PhyConfig::new(channel, prf, rate, preamble).map_err(SettingsFault::Phy)?;
    match phy.code {
        Some(code) => config.with_preamble_code(code).map_err(SettingsFault::Phy),
        None => Ok(config),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use node_record::{Calibration, Identity};

    fn record() -> Record {
        Record {
            identity: Identity::default(),
            role: Role::Anchor { position_m: None },
            network: node_record::Network {
                pan: 0xBA12,
                mode: Mode::Native,
                phy: node_record::Phy { channel: 5, prf_mhz: 64, rate_kbps: 6810, preamble: 128, code: None },
                turnaround: node_record::Turnaround { answer_us: 250, listen_again_us: 40, transmit_us: 150 },
            },
            calibration: Calibration::default(),
            pins: None,
            anchors: Default::default(),
            beacons: Default::default(),
            beacon_key: None,
        }
    }

    #[test]
    fn a_plain_record_gives_the_defaults_and_the_chips_own_identity() {
        let settings = Settings::of(&record(), 0x1122_3344_5566_7788).unwrap();
        assert_eq!((settings.eui, settings.address), (0x1122_3344_5566_7788, 0x7788));
        assert_eq!(settings.network.phy, PhyConfig::FAST);
        assert_eq!(settings.network.turnaround, Turnaround::DWM1001);
        assert_eq!((settings.radio.pan, settings.radio.short_address), (0xBA12, 0x7788));
        assert_eq!(settings.radio.filter, FrameFilter::DATA);
        assert_eq!(settings.antenna_delay().ticks(), 16_436);
    }

    #[test]
    fn what_the_record_says_counts_more_than_defaults() {
        let mut record = record();
        record.identity = Identity { eui: Some(9), address: Some(0x42) };
        record.network.mode = Mode::DecaRanging { fast: true };
        record.network.phy.code = Some(12);
        record.calibration =
            Calibration { antenna_delay: Some(16_500), crystal_trim: Some(17), tx_power: Some(0x1F1F_1F1F) };
        let settings = Settings::of(&record, 1).unwrap();
        assert_eq!((settings.eui, settings.address), (9, 0x42));
        assert_eq!(settings.exchange, Exchange::DecaRanging(Variant::Fast));
        assert_eq!(settings.network.phy.preamble_code(), 12);
        assert_eq!((settings.radio.tx_antenna_delay, settings.radio.rx_antenna_delay), (16_500, 16_500));
        assert_eq!(settings.radio.crystal_trim, Some(17));
        assert_eq!(settings.radio.tx_power, TxPower::Calibrated { register: 0x1F1F_1F1F, smart: true });
        assert_eq!(settings.radio.filter, FrameFilter::OFF);
    }

    #[test]
    fn what_cannot_be_done_is_named() {
        let fault = |spoil: &dyn Fn(&mut Record)| {
            let mut record = record();
            spoil(&mut record);
            Settings::of(&record, 0xFFFF).unwrap_err()
        };
        assert_eq!(fault(&|_| ()), SettingsFault::Address(0xFFFF));
        let sound = |spoil: &dyn Fn(&mut Record)| {
            fault(&|record| {
                record.identity.address = Some(1);
                spoil(record);
            })
        };
        assert_eq!(sound(&|record| record.network.phy.channel = 6), SettingsFault::Channel(6));
        assert_eq!(sound(&|record| record.network.phy.prf_mhz = 32), SettingsFault::PulseRate(32));
        assert_eq!(sound(&|record| record.network.phy.rate_kbps = 111), SettingsFault::DataRate(111));
        assert_eq!(sound(&|record| record.network.phy.preamble = 65), SettingsFault::Preamble(65));
        assert_eq!(sound(&|record| record.network.phy.code = Some(1)), SettingsFault::Phy(PhyError::PreambleCode(1)));
        assert_eq!(sound(&|record| record.network.turnaround.transmit_us = 251), SettingsFault::Turnaround);
    }
}
