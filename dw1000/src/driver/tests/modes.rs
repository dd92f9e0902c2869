//! The register values of every mode against the tables of the published `dw1000` crate, an independent source.

use core::convert::Infallible;
use std::vec::Vec;

use dw1000::configs::{BitRate, PreambleLength as TheirPreamble, PulseRepetitionFrequency, SfdSequence, UwbChannel};
use embedded_hal_02::{blocking::spi, digital::v2::OutputPin};

use crate::driver::configuration;
use crate::driver::register::{self as reg, Register};
use crate::driver::startup::Factory;
use radio::Config;
use radio::phy::{Channel, DataRate, PhyConfig, PreambleLength, Prf, Sfd};

/// Types that the crate's look-up functions name in their errors.
struct NoBus;

impl spi::Transfer<u8> for NoBus {
    type Error = Infallible;
    fn transfer<'w>(&mut self, words: &'w mut [u8]) -> Result<&'w [u8], Infallible> {
        Ok(words)
    }
}

impl spi::Write<u8> for NoBus {
    type Error = Infallible;
    fn write(&mut self, _: &[u8]) -> Result<(), Infallible> {
        Ok(())
    }
}

impl OutputPin for NoBus {
    type Error = Infallible;
    fn set_low(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
    fn set_high(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

fn value(config: &Config, register: Register) -> u64 {
    let write = configuration::writes(config, &Factory::default(), [0; 2])
        .into_iter()
        .find(|write| write.register == register)
        .unwrap();
    let mut bytes = [0; 8];
    bytes[..write.bytes().len()].copy_from_slice(write.bytes());
    u64::from_le_bytes(bytes)
}

fn theirs(phy: &PhyConfig) -> (UwbChannel, PulseRepetitionFrequency, BitRate, TheirPreamble, SfdSequence) {
    (
        UwbChannel::try_from(phy.channel().number()).unwrap(),
        match phy.prf() {
            Prf::Mhz16 => PulseRepetitionFrequency::Mhz16,
            Prf::Mhz64 => PulseRepetitionFrequency::Mhz64,
        },
        match phy.data_rate() {
            DataRate::Kbps110 => BitRate::Kbps110,
            DataRate::Kbps850 => BitRate::Kbps850,
            DataRate::Kbps6810 => BitRate::Kbps6800,
        },
        match phy.preamble_length() {
            PreambleLength::Symbols64 => TheirPreamble::Symbols64,
            PreambleLength::Symbols128 => TheirPreamble::Symbols128,
            PreambleLength::Symbols256 => TheirPreamble::Symbols256,
            PreambleLength::Symbols512 => TheirPreamble::Symbols512,
            PreambleLength::Symbols1024 => TheirPreamble::Symbols1024,
            PreambleLength::Symbols1536 => TheirPreamble::Symbols1536,
            PreambleLength::Symbols2048 => TheirPreamble::Symbols2048,
            PreambleLength::Symbols4096 => TheirPreamble::Symbols4096,
        },
        match phy.sfd() {
            Sfd::Standard => SfdSequence::IEEE,
            Sfd::Decawave => SfdSequence::DecawaveAlt,
        },
    )
}

/// The eight modes of the EVK1000, and every other channel, also at 850 kbit/s and with preambles of 64 symbols.
fn all() -> Vec<PhyConfig> {
    let mut all: Vec<_> = (1..=8).map(|mode| PhyConfig::evk1000_mode(mode).unwrap()).collect();
    for channel in [Channel::Ch1, Channel::Ch2, Channel::Ch3, Channel::Ch4, Channel::Ch5, Channel::Ch7] {
        for prf in [Prf::Mhz16, Prf::Mhz64] {
            for (rate, preamble) in [
                (DataRate::Kbps6810, PreambleLength::Symbols64),
                (DataRate::Kbps6810, PreambleLength::Symbols256),
                (DataRate::Kbps850, PreambleLength::Symbols512),
                (DataRate::Kbps850, PreambleLength::Symbols1024),
                (DataRate::Kbps110, PreambleLength::Symbols1536),
                (DataRate::Kbps110, PreambleLength::Symbols2048),
                (DataRate::Kbps110, PreambleLength::Symbols4096),
            ] {
                all.push(PhyConfig::new(channel, prf, rate, preamble).unwrap());
            }
        }
    }
    all
}

#[test]
fn tuning_agrees_with_the_published_crate() {
    for phy in all() {
        let config = Config::new(phy);
        let (channel, prf, rate, preamble, sfd) = theirs(&phy);
        let pac = phy.pac().symbols() as u8;
        assert_eq!(pac, preamble.get_recommended_pac_size(), "{phy:?}");
        let drx_tune2 = prf.get_recommended_drx_tune2::<NoBus, NoBus>(pac).unwrap();
        let expected = [
            (reg::DRX_TUNE0B, u64::from(rate.get_recommended_drx_tune0b(sfd))),
            (reg::DRX_TUNE1A, u64::from(prf.get_recommended_drx_tune1a())),
            (reg::DRX_TUNE2, u64::from(drx_tune2)),
            (reg::DRX_TUNE4H, u64::from(preamble.get_recommended_dxr_tune4h())),
            (reg::RF_RXCTRLH, u64::from(channel.get_recommended_rf_rxctrlh())),
            (reg::RF_TXCTRL, u64::from(channel.get_recommended_rf_txctrl())),
            (reg::TC_PGDELAY, u64::from(channel.get_recommended_tc_pgdelay())),
            (reg::FS_PLLCFG, u64::from(channel.get_recommended_fs_pllcfg())),
            (reg::FS_PLLTUNE, u64::from(channel.get_recommended_fs_plltune())),
            (reg::LDE_CFG2, u64::from(prf.get_recommended_lde_cfg2())),
        ];
        for (register, expected) in expected {
            assert_eq!(value(&config, register), expected, "{register:x?} {phy:?}");
        }
        // The crate has no value for 1024 symbols at 110 kbit/s, which the EVK1000 uses.
        match preamble.get_recommended_drx_tune1b::<NoBus, NoBus>(rate) {
            Ok(expected) => assert_eq!(value(&config, reg::DRX_TUNE1B), u64::from(expected), "{phy:?}"),
            Err(_) => assert_eq!((phy.preamble_length().symbols(), value(&config, reg::DRX_TUNE1B)), (1024, 0x64)),
        }
    }
}

#[test]
fn replica_coefficients_are_the_manuals() {
    // User manual, table 51 (and Decawave's software): by code 1 to 12. The published crate indexes its table from code
    // 0 although it begins with code 1, so it has the next code's value for each code.
    let by_code = [
        (Channel::Ch1, Prf::Mhz16, 1, 0x5998),
        (Channel::Ch1, Prf::Mhz16, 2, 0x5998),
        (Channel::Ch2, Prf::Mhz16, 3, 0x51EA),
        (Channel::Ch2, Prf::Mhz16, 4, 0x428E),
        (Channel::Ch3, Prf::Mhz16, 5, 0x451E),
        (Channel::Ch3, Prf::Mhz16, 6, 0x2E14),
        (Channel::Ch7, Prf::Mhz16, 7, 0x8000),
        (Channel::Ch7, Prf::Mhz16, 8, 0x51EA),
        (Channel::Ch5, Prf::Mhz64, 9, 0x28F4),
        (Channel::Ch5, Prf::Mhz64, 10, 0x3332),
        (Channel::Ch5, Prf::Mhz64, 11, 0x3AE0),
        (Channel::Ch5, Prf::Mhz64, 12, 0x3D70),
        (Channel::Ch4, Prf::Mhz64, 17, 0x3332),
        (Channel::Ch4, Prf::Mhz64, 18, 0x35C2),
        (Channel::Ch4, Prf::Mhz64, 19, 0x35C2),
        (Channel::Ch4, Prf::Mhz64, 20, 0x47AE),
    ];
    for (channel, prf, code, coefficient) in by_code {
        for (rate, divisor) in [(DataRate::Kbps6810, 1), (DataRate::Kbps850, 1), (DataRate::Kbps110, 8)] {
            let phy = PhyConfig::new(channel, prf, rate, PreambleLength::Symbols1024).unwrap();
            let config = Config::new(phy.with_preamble_code(code).unwrap());
            assert_eq!(value(&config, reg::LDE_REPC), coefficient / divisor, "code {code}");
        }
    }
}

#[test]
fn evk1000_modes_in_the_registers_that_decide_the_air() {
    // TX_FCTRL without a length, by hand: rate from bit 13 (00, 10), ranging bit 15, PRF from 16 (01, 10), TXPSR from
    // 18 (01 with PE 01 from 20: 128 symbols; 10 with 00: 1024). CHAN_CTRL: channel twice, DWSFD bit 17 at 110 kbit/s,
    // PRF from 18, code 3 or 9 from 22 and 27. DRX_SFDTOC: 1024 + 64 + 1 − 32 = 1057; 128 + 8 + 1 − 8 = 129. SYS_CFG:
    // HIRQ_POL; at 110 kbit/s DIS_STXP and RXM110K. TX_POWER: table 20; without boost at 110 kbit/s.
    let modes: [(u8, u64, u64, u64, u64, u64); 8] = [
        (1, 0x0009_8000, 0x18C6_0022, 1057, 0x0044_0200, 0x7575_7575),
        (2, 0x0015_C000, 0x18C4_0022, 129, 0x0000_0200, 0x1535_5575),
        (3, 0x000A_8000, 0x4A4A_0022, 1057, 0x0044_0200, 0x6767_6767),
        (4, 0x0016_C000, 0x4A48_0022, 129, 0x0000_0200, 0x0727_4767),
        (5, 0x0009_8000, 0x18C6_0055, 1057, 0x0044_0200, 0x4848_4848),
        (6, 0x0015_C000, 0x18C4_0055, 129, 0x0000_0200, 0x0E08_2848),
        (7, 0x000A_8000, 0x4A4A_0055, 1057, 0x0044_0200, 0x8585_8585),
        (8, 0x0016_C000, 0x4A48_0055, 129, 0x0000_0200, 0x2545_6585),
    ];
    for (mode, tx_fctrl, chan_ctrl, sfd_timeout, sys_cfg, tx_power) in modes {
        let config = Config::new(PhyConfig::evk1000_mode(mode).unwrap());
        let seen = [reg::TX_FCTRL, reg::CHAN_CTRL, reg::DRX_SFDTOC, reg::SYS_CFG, reg::TX_POWER]
            .map(|register| value(&config, register));
        assert_eq!(seen, [tx_fctrl, chan_ctrl, sfd_timeout, sys_cfg, tx_power], "mode {mode}: {seen:x?}");
    }
}
