//! The register writes of a node's configuration: once after reset, none for each frame.

use super::register::{self as reg, Register, status, sys_cfg};
use super::startup::Factory;
use super::tuning;
use radio::phy::{Channel, DataRate, Prf, Sfd};
use radio::{Config, FrameFilter, TxPower};

/// The antenna delay of a module before calibration, ticks in each direction. Decawave's software has 513.9067 ns at 16
/// MHz and 514.462 ns at 64 MHz for both directions together; a tick is 1/63.8976 ns.
pub const fn default_antenna_delay(prf: Prf) -> u16 {
    match prf {
        Prf::Mhz16 => 16_419,
        Prf::Mhz64 => 16_436,
    }
}

/// [`default_antenna_delay`] at 64 MHz.
pub const DEFAULT_ANTENNA_DELAY: u16 = default_antenna_delay(Prf::Mhz64);

/// SYS_CFG: filter, interrupt line active high, both receive buffers in use, smart power, rate; without the wait
/// timeout.
pub(super) const fn sys_cfg(config: &Config) -> u32 {
    let mut bits = filter_bits(config.filter) | sys_cfg::HIRQ_POL;
    if !smart_power(config) {
        bits |= sys_cfg::DIS_STXP;
    }
    if matches!(config.phy.data_rate(), DataRate::Kbps110) {
        bits |= sys_cfg::RXM110K;
    }
    bits
}

/// TX_FCTRL's first four bytes for a frame of `frame_bytes` with check bytes, marked as a ranging frame.
pub(super) const fn tx_fctrl(config: &Config, frame_bytes: u8) -> u32 {
    const TR: u32 = 1 << 15;
    frame_bytes as u32
        | tuning::rate_bits(config.phy.data_rate()) << 13
        | TR
        | tuning::prf_bits(config.phy.prf()) << 16
        | tuning::preamble_bits(config.phy.preamble_length()) << 18
}

const fn smart_power(config: &Config) -> bool {
    let wanted = match config.tx_power {
        TxPower::Smart => true,
        TxPower::Constant => false,
        TxPower::Calibrated { smart, .. } => smart,
    };
    // The chip boosts at this rate only (7.2.31.2).
    wanted && matches!(config.phy.data_rate(), DataRate::Kbps6810)
}

/// SYS_CFG's bits FFEN to FFA5 (DW1000 user manual, 5.2), in the order of [`FrameFilter::bits`].
const fn filter_bits(filter: FrameFilter) -> u32 {
    match filter.bits() {
        0 => 0,
        kinds => kinds as u32 | sys_cfg::FFEN,
    }
}

/// TX_POWER (7.2.31). A calibrated value with smart power has powers by frame length, the lowest byte without boost,
/// which applies to the whole frame at rates without a boost. One without smart power has the powers of the frame's
/// parts.
fn tx_power_register(config: &Config, factory: &Factory) -> u32 {
    let by_length = match config.tx_power {
        TxPower::Smart | TxPower::Constant => {
            let (channel, prf) = (config.phy.channel(), config.phy.prf());
            factory.tx_power(channel, prf).unwrap_or(tuning::tx_power(channel, prf))
        }
        TxPower::Calibrated { register, smart: true } => register,
        TxPower::Calibrated { register, smart: false } => return register,
    };
    // Without smart power the bytes are the powers of the frame's parts: all have the value without boost.
    if smart_power(config) { by_length } else { (by_length & 0xFF) * 0x0101_0101 }
}

/// The calibrated antenna delays, from the chip's transmit timestamp to the antenna and from the antenna to the
/// receive timestamp, ticks.
pub(super) fn antenna_delays(config: &Config, factory: &Factory) -> [u16; 2] {
    let prf = config.phy.prf();
    let of_module = factory.antenna_delay(prf).unwrap_or(default_antenna_delay(prf));
    [config.tx_antenna_delay, config.rx_antenna_delay].map(|delay| delay.unwrap_or(of_module))
}

/// CHAN_CTRL (7.2.32), with the delimiter's bits according to table 21.
pub(super) const fn chan_ctrl(config: &Config) -> u32 {
    const DWSFD: u32 = 1 << 17;
    const TNSSFD: u32 = 1 << 20;
    const RNSSFD: u32 = 1 << 21;
    let channel = config.phy.channel().number() as u32;
    let code = config.phy.preamble_code() as u32;
    let sfd = match (config.phy.sfd(), config.phy.data_rate()) {
        (Sfd::Standard, _) => 0,
        (Sfd::Decawave, DataRate::Kbps110) => DWSFD,
        (Sfd::Decawave, DataRate::Kbps850 | DataRate::Kbps6810) => DWSFD | TNSSFD | RNSSFD,
    };
    channel | channel << 4 | sfd | tuning::prf_bits(config.phy.prf()) << 18 | code << 22 | code << 27
}

/// Preamble and delimiter, minus the part that the receiver needs to detect the preamble (7.2.40.7).
const fn sfd_timeout(config: &Config) -> u16 {
    config.phy.preamble_length().symbols() + config.phy.sfd_symbols() + 1 - config.phy.pac().symbols()
}

/// The writes of this configuration to the chip, in any order.
pub(super) fn writes(config: &Config, factory: &Factory, [tx_delay, rx_delay]: [u16; 2]) -> [Write; 27] {
    let phy = &config.phy;
    let (channel, prf) = (phy.channel(), phy.prf());
    let panadr = u32::from(config.short_address) | u32::from(config.pan) << 16;
    [
        Write::new(reg::EUI, config.eui, 8),
        Write::new(reg::PANADR, panadr, 4),
        Write::new(reg::SYS_CFG, sys_cfg(config), 4),
        Write::new(reg::SYS_MASK, status::INTERRUPTS, 4),
        Write::new(reg::TX_FCTRL, tx_fctrl(config, 0), 4),
        Write::new(reg::TX_ANTD, tx_delay, 2),
        Write::new(reg::LDE_RXANTD, rx_delay, 2),
        Write::new(reg::TX_POWER, tx_power_register(config, factory), 4),
        Write::new(reg::CHAN_CTRL, chan_ctrl(config), 4),
        Write::new(reg::SFD_LENGTH, phy.sfd_symbols(), 1),
        Write::new(reg::AGC_TUNE1, tuning::agc_tune1(prf), 2),
        Write::new(reg::AGC_TUNE2, tuning::AGC_TUNE2, 4),
        Write::new(reg::AGC_TUNE3, tuning::AGC_TUNE3, 2),
        Write::new(reg::DRX_TUNE0B, tuning::drx_tune0b(phy), 2),
        Write::new(reg::DRX_TUNE1A, tuning::drx_tune1a(prf), 2),
        Write::new(reg::DRX_TUNE1B, tuning::drx_tune1b(phy), 2),
        Write::new(reg::DRX_TUNE2, tuning::drx_tune2(prf, phy.pac()), 4),
        Write::new(reg::DRX_SFDTOC, sfd_timeout(config), 2),
        Write::new(reg::DRX_TUNE4H, tuning::drx_tune4h(phy.preamble_length()), 2),
        Write::new(reg::RF_RXCTRLH, tuning::rf_rxctrlh(channel), 1),
        // Three bytes: the fourth is reserved.
        Write::new(reg::RF_TXCTRL, tuning::rf_txctrl(channel), 3),
        Write::new(reg::TC_PGDELAY, tuning::tc_pgdelay(channel), 1),
        Write::new(reg::FS_PLLCFG, tuning::fs_pllcfg(channel), 4),
        Write::new(reg::FS_PLLTUNE, tuning::fs_plltune(channel), 1),
        Write::new(reg::LDE_CFG1, tuning::LDE_CFG1, 1),
        Write::new(reg::LDE_REPC, tuning::lde_repc(phy), 2),
        Write::new(reg::LDE_CFG2, tuning::lde_cfg2(prf), 2),
    ]
}

/// Parts per million of clock difference for a step of the carrier integrator: positive if the sender is faster.
///
/// A step is 998.4 MHz/2 / 2¹⁷ over 1024 samples (8192 at 110 kbit/s), relative to the carrier. It is positive if
/// the receiver is faster (DW1000 user manual, 7.2.40.11).
pub(super) const fn ppm_per_carrier_step(config: &Config) -> f32 {
    let samples = match config.phy.data_rate() {
        DataRate::Kbps110 => 8192.0,
        DataRate::Kbps850 | DataRate::Kbps6810 => 1024.0,
    };
    // All carriers are multiples of 499.2 MHz, half the sampling rate. A division of doubles would be 1.2 kB of
    // code.
    let multiple = match config.phy.channel() {
        Channel::Ch1 => 7.0,
        Channel::Ch2 | Channel::Ch4 => 8.0,
        Channel::Ch3 => 9.0,
        Channel::Ch5 | Channel::Ch7 => 13.0,
    };
    -1e6 / (131_072.0 * samples * multiple)
}

/// Samples in the accumulator.
pub(super) const fn accumulator_samples(config: &Config) -> u16 {
    match config.phy.prf() {
        Prf::Mhz16 => 992,
        Prf::Mhz64 => 1016,
    }
}

/// A register and its new value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Write {
    pub register: Register,
    value: [u8; 8],
    length: usize,
}

impl Write {
    fn new(register: Register, value: impl Into<u64>, length: usize) -> Self {
        Self { register, value: value.into().to_le_bytes(), length }
    }

    pub fn bytes(&self) -> &[u8] {
        &self.value[..self.length]
    }
}
