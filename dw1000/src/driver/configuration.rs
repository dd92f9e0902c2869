//! The configuration of a node, and its register writes: once after reset, none for each frame.

use super::register::{self as reg, Register, status, sys_cfg};
use super::startup::Factory;
use super::tuning;
use radio::phy::{Channel, DataRate, PhyConfig, Prf, Sfd};

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

/// The frames that the chip accepts (DW1000 user manual, 5.2). Kinds are added with [`and`](Self::and). A frame of a
/// kind with a destination is accepted only if the destination is this node's PAN and address, or broadcast.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FrameFilter(u16);

impl FrameFilter {
    /// No filter: every frame is accepted.
    pub const OFF: Self = Self(0);
    /// Frames without a destination are accepted if their PAN is this node's: it is the coordinator.
    pub const COORDINATOR: Self = Self(1 << 1);
    /// Beacon frames.
    pub const BEACON: Self = Self(1 << 2);
    /// Data frames.
    pub const DATA: Self = Self(1 << 3);
    /// Acknowledgements.
    pub const ACKNOWLEDGEMENT: Self = Self(1 << 4);
    /// MAC command frames.
    pub const MAC_COMMAND: Self = Self(1 << 5);
    /// Frames of the reserved types.
    pub const RESERVED: Self = Self(1 << 6);
    /// Frames of type 4.
    pub const TYPE_4: Self = Self(1 << 7);
    /// Frames of type 5, which include blinks.
    pub const TYPE_5: Self = Self(1 << 8);

    /// Accepts both kinds.
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    const fn bits(self) -> u32 {
        if self.0 == 0 { 0 } else { self.0 as u32 | sys_cfg::FFEN }
    }
}

/// Transmit power.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TxPower {
    /// The values that the module's maker calibrated, or else those of the reference design. Short frames at 6.81
    /// Mbit/s are boosted, which is lawful below one frame a millisecond (smart power, DW1000 user manual, 7.2.31.2).
    Smart,
    /// The same without the boost.
    Constant,
    /// TX_POWER as calibrated for this board, with or without smart power.
    Calibrated {
        /// The register's value.
        register: u32,
        /// Whether its bytes are powers by frame length, the lowest without boost, or the powers of the frame's parts.
        /// At rates without a boost, the lowest byte of the former applies to the whole frame.
        smart: bool,
    },
}

/// The whole configuration of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// The radio configuration of the frames.
    pub phy: PhyConfig,
    /// Transmit power.
    pub tx_power: TxPower,
    /// From the chip's transmit timestamp to the antenna, ticks; `None`: the one measured by the module's maker, or
    /// [`default_antenna_delay`].
    pub tx_antenna_delay: Option<u16>,
    /// From the antenna to the chip's receive timestamp, ticks; likewise.
    pub rx_antenna_delay: Option<u16>,
    /// Crystal trim, 0 to 31; `None`: the one measured by the module's maker, or the middle.
    pub crystal_trim: Option<u8>,
    /// This node's network.
    pub pan: u16,
    /// This node's short address.
    pub short_address: u16,
    /// This node's EUI-64.
    pub eui: u64,
    /// Which frames are accepted.
    pub filter: FrameFilter,
    /// Whether the chip sleeps in waits in which its node's protocol does not need the clock.
    pub sleeps: bool,
}

impl Config {
    /// A node that receives every frame, with uncalibrated antennas.
    pub const fn new(phy: PhyConfig) -> Self {
        Self {
            phy,
            tx_power: TxPower::Smart,
            tx_antenna_delay: None,
            rx_antenna_delay: None,
            crystal_trim: None,
            pan: 0xFFFF,
            short_address: 0xFFFF,
            eui: 0,
            filter: FrameFilter::OFF,
            sleeps: false,
        }
    }

    /// SYS_CFG: filter, interrupt line active high, both receive buffers in use, smart power, rate; without the wait
    /// timeout.
    pub(super) const fn sys_cfg(&self) -> u32 {
        let mut bits = self.filter.bits() | sys_cfg::HIRQ_POL;
        if !self.smart_power() {
            bits |= sys_cfg::DIS_STXP;
        }
        if matches!(self.phy.data_rate(), DataRate::Kbps110) {
            bits |= sys_cfg::RXM110K;
        }
        bits
    }

    /// TX_FCTRL's first four bytes for a frame of `frame_bytes` with check bytes, marked as a ranging frame.
    pub(super) const fn tx_fctrl(&self, frame_bytes: u8) -> u32 {
        const TR: u32 = 1 << 15;
        frame_bytes as u32
            | tuning::rate_bits(self.phy.data_rate()) << 13
            | TR
            | tuning::prf_bits(self.phy.prf()) << 16
            | tuning::preamble_bits(self.phy.preamble_length()) << 18
    }

    const fn smart_power(&self) -> bool {
        let wanted = match self.tx_power {
            TxPower::Smart => true,
            TxPower::Constant => false,
            TxPower::Calibrated { smart, .. } => smart,
        };
        // The chip boosts at this rate only (7.2.31.2).
        wanted && matches!(self.phy.data_rate(), DataRate::Kbps6810)
    }

    /// TX_POWER (7.2.31).
    fn tx_power_register(&self, factory: &Factory) -> u32 {
        let by_length = match self.tx_power {
            TxPower::Smart | TxPower::Constant => {
                let (channel, prf) = (self.phy.channel(), self.phy.prf());
                factory.tx_power(channel, prf).unwrap_or(tuning::tx_power(channel, prf))
            }
            TxPower::Calibrated { register, smart: true } => register,
            TxPower::Calibrated { register, smart: false } => return register,
        };
        // Without smart power the bytes are the powers of the frame's parts: all have the value without boost.
        if self.smart_power() { by_length } else { (by_length & 0xFF) * 0x0101_0101 }
    }

    /// The calibrated antenna delays, from the chip's transmit timestamp to the antenna and from the antenna to the
    /// receive timestamp, ticks.
    pub(super) fn antenna_delays(&self, factory: &Factory) -> [u16; 2] {
        let prf = self.phy.prf();
        let of_module = factory.antenna_delay(prf).unwrap_or(default_antenna_delay(prf));
        [self.tx_antenna_delay, self.rx_antenna_delay].map(|delay| delay.unwrap_or(of_module))
    }

    /// CHAN_CTRL (7.2.32), with the delimiter's bits according to table 21.
    pub(super) const fn chan_ctrl(&self) -> u32 {
        const DWSFD: u32 = 1 << 17;
        const TNSSFD: u32 = 1 << 20;
        const RNSSFD: u32 = 1 << 21;
        let channel = self.phy.channel().number() as u32;
        let code = self.phy.preamble_code() as u32;
        let sfd = match (self.phy.sfd(), self.phy.data_rate()) {
            (Sfd::Standard, _) => 0,
            (Sfd::Decawave, DataRate::Kbps110) => DWSFD,
            (Sfd::Decawave, DataRate::Kbps850 | DataRate::Kbps6810) => DWSFD | TNSSFD | RNSSFD,
        };
        channel | channel << 4 | sfd | tuning::prf_bits(self.phy.prf()) << 18 | code << 22 | code << 27
    }

    /// Preamble and delimiter, minus the part that the receiver needs to detect the preamble (7.2.40.7).
    const fn sfd_timeout(&self) -> u16 {
        self.phy.preamble_length().symbols() + self.phy.sfd_symbols() + 1 - self.phy.pac().symbols()
    }

    /// The writes of this configuration to the chip, in any order.
    pub(super) fn writes(&self, factory: &Factory, [tx_delay, rx_delay]: [u16; 2]) -> [Write; 27] {
        let phy = &self.phy;
        let (channel, prf) = (phy.channel(), phy.prf());
        let panadr = u32::from(self.short_address) | u32::from(self.pan) << 16;
        [
            Write::new(reg::EUI, self.eui, 8),
            Write::new(reg::PANADR, panadr, 4),
            Write::new(reg::SYS_CFG, self.sys_cfg(), 4),
            Write::new(reg::SYS_MASK, status::INTERRUPTS, 4),
            Write::new(reg::TX_FCTRL, self.tx_fctrl(0), 4),
            Write::new(reg::TX_ANTD, tx_delay, 2),
            Write::new(reg::LDE_RXANTD, rx_delay, 2),
            Write::new(reg::TX_POWER, self.tx_power_register(factory), 4),
            Write::new(reg::CHAN_CTRL, self.chan_ctrl(), 4),
            Write::new(reg::SFD_LENGTH, phy.sfd_symbols(), 1),
            Write::new(reg::AGC_TUNE1, tuning::agc_tune1(prf), 2),
            Write::new(reg::AGC_TUNE2, tuning::AGC_TUNE2, 4),
            Write::new(reg::AGC_TUNE3, tuning::AGC_TUNE3, 2),
            Write::new(reg::DRX_TUNE0B, tuning::drx_tune0b(phy), 2),
            Write::new(reg::DRX_TUNE1A, tuning::drx_tune1a(prf), 2),
            Write::new(reg::DRX_TUNE1B, tuning::drx_tune1b(phy), 2),
            Write::new(reg::DRX_TUNE2, tuning::drx_tune2(prf, phy.pac()), 4),
            Write::new(reg::DRX_SFDTOC, self.sfd_timeout(), 2),
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
    pub(super) const fn ppm_per_carrier_step(&self) -> f32 {
        let samples = match self.phy.data_rate() {
            DataRate::Kbps110 => 8192.0,
            DataRate::Kbps850 | DataRate::Kbps6810 => 1024.0,
        };
        // All carriers are multiples of 499.2 MHz, half the sampling rate. A division of doubles would be 1.2 kB of
        // code.
        let multiple = match self.phy.channel() {
            Channel::Ch1 => 7.0,
            Channel::Ch2 | Channel::Ch4 => 8.0,
            Channel::Ch3 => 9.0,
            Channel::Ch5 | Channel::Ch7 => 13.0,
        };
        -1e6 / (131_072.0 * samples * multiple)
    }

    /// Samples in the accumulator.
    pub(super) const fn accumulator_samples(&self) -> u16 {
        match self.phy.prf() {
            Prf::Mhz16 => 992,
            Prf::Mhz64 => 1016,
        }
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
