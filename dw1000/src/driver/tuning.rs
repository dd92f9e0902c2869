//! The values that the DW1000 user manual (2.11 and later) recommends for each channel, rate, pulse frequency and
//! preamble, as functions of a [`PhyConfig`]. The tests compare them with those of the published `dw1000` crate.

use radio::phy::{Channel, DataRate, Pac, PhyConfig, PreambleLength, Prf, Sfd};

/// AGC_TUNE2 (table 25) and AGC_TUNE3 (7.2.36.6).
pub(super) const AGC_TUNE2: u32 = 0x2502_A907;
pub(super) const AGC_TUNE3: u16 = 0x0035;
/// LDE_CFG1: noise threshold multiplier 13, peak multiplier 3 (2.5.5.4).
pub(super) const LDE_CFG1: u8 = 0x6D;

/// AGC_TUNE1, table 24.
pub(super) const fn agc_tune1(prf: Prf) -> u16 {
    match prf {
        Prf::Mhz16 => 0x8870,
        Prf::Mhz64 => 0x889B,
    }
}

/// DRX_TUNE0b, table 30.
pub(super) const fn drx_tune0b(phy: &PhyConfig) -> u16 {
    match (phy.data_rate(), phy.sfd()) {
        (DataRate::Kbps110, Sfd::Standard) => 0x000A,
        (DataRate::Kbps110, Sfd::Decawave) => 0x0016,
        (DataRate::Kbps850, Sfd::Standard) => 0x0001,
        (DataRate::Kbps850, Sfd::Decawave) => 0x0006,
        (DataRate::Kbps6810, Sfd::Standard) => 0x0001,
        (DataRate::Kbps6810, Sfd::Decawave) => 0x0002,
    }
}

/// DRX_TUNE1a, table 31.
pub(super) const fn drx_tune1a(prf: Prf) -> u16 {
    match prf {
        Prf::Mhz16 => 0x0087,
        Prf::Mhz64 => 0x008D,
    }
}

/// DRX_TUNE1b, table 32. At 110 kbit/s Decawave's own software has 0x0064 for 1024 symbols too.
pub(super) const fn drx_tune1b(phy: &PhyConfig) -> u16 {
    match (phy.data_rate(), phy.preamble_length()) {
        (DataRate::Kbps110, _) => 0x0064,
        (DataRate::Kbps850 | DataRate::Kbps6810, PreambleLength::Symbols64) => 0x0010,
        (DataRate::Kbps850 | DataRate::Kbps6810, _) => 0x0020,
    }
}

/// DRX_TUNE2, table 33.
pub(super) const fn drx_tune2(prf: Prf, pac: Pac) -> u32 {
    match (prf, pac) {
        (Prf::Mhz16, Pac::Symbols8) => 0x311A_002D,
        (Prf::Mhz16, Pac::Symbols16) => 0x331A_0052,
        (Prf::Mhz16, Pac::Symbols32) => 0x351A_009A,
        (Prf::Mhz16, Pac::Symbols64) => 0x371A_011D,
        (Prf::Mhz64, Pac::Symbols8) => 0x313B_006B,
        (Prf::Mhz64, Pac::Symbols16) => 0x333B_00BE,
        (Prf::Mhz64, Pac::Symbols32) => 0x353B_015E,
        (Prf::Mhz64, Pac::Symbols64) => 0x373B_0296,
    }
}

/// DRX_TUNE4H, table 34.
pub(super) const fn drx_tune4h(preamble: PreambleLength) -> u16 {
    match preamble {
        PreambleLength::Symbols64 => 0x0010,
        PreambleLength::Symbols128
        | PreambleLength::Symbols256
        | PreambleLength::Symbols512
        | PreambleLength::Symbols1024
        | PreambleLength::Symbols1536
        | PreambleLength::Symbols2048
        | PreambleLength::Symbols4096 => 0x0028,
    }
}

/// RF_RXCTRLH, table 37.
pub(super) const fn rf_rxctrlh(channel: Channel) -> u8 {
    if channel.is_wide() { 0xBC } else { 0xD8 }
}

/// RF_TXCTRL, table 38.
pub(super) const fn rf_txctrl(channel: Channel) -> u32 {
    match channel {
        Channel::Ch1 => 0x0000_5C40,
        Channel::Ch2 => 0x0004_5CA0,
        Channel::Ch3 => 0x0008_6CC0,
        Channel::Ch4 => 0x0004_5C80,
        Channel::Ch5 => 0x001E_3FE0,
        Channel::Ch7 => 0x001E_7DE0,
    }
}

/// TC_PGDELAY, table 40.
pub(super) const fn tc_pgdelay(channel: Channel) -> u8 {
    match channel {
        Channel::Ch1 => 0xC9,
        Channel::Ch2 => 0xC2,
        Channel::Ch3 => 0xC5,
        Channel::Ch4 => 0x95,
        Channel::Ch5 => 0xC0,
        Channel::Ch7 => 0x93,
    }
}

/// FS_PLLCFG, table 43.
pub(super) const fn fs_pllcfg(channel: Channel) -> u32 {
    match channel {
        Channel::Ch1 => 0x0900_0407,
        Channel::Ch2 | Channel::Ch4 => 0x0840_0508,
        Channel::Ch3 => 0x0840_1009,
        Channel::Ch5 | Channel::Ch7 => 0x0800_041D,
    }
}

/// FS_PLLTUNE, table 44.
pub(super) const fn fs_plltune(channel: Channel) -> u8 {
    match channel {
        Channel::Ch1 => 0x1E,
        Channel::Ch2 | Channel::Ch4 => 0x26,
        Channel::Ch3 => 0x56,
        Channel::Ch5 | Channel::Ch7 => 0xBE,
    }
}

/// LDE_CFG2, table 50.
pub(super) const fn lde_cfg2(prf: Prf) -> u16 {
    match prf {
        Prf::Mhz16 => 0x1607,
        Prf::Mhz64 => 0x0607,
    }
}

/// LDE_REPC, table 51: by the receiver's preamble code; at 110 kbit/s an eighth of the value.
pub(super) fn lde_repc(phy: &PhyConfig) -> u16 {
    const BY_CODE: [u16; 20] = [
        0x5998, 0x5998, 0x51EA, 0x428E, 0x451E, 0x2E14, 0x8000, 0x51EA, 0x28F4, 0x3332, 0x3AE0, 0x3D70, 0x3AE0, 0x35C2,
        0x2B84, 0x35C2, 0x3332, 0x35C2, 0x35C2, 0x47AE,
    ];
    // A code is 1 to 20: the constructor of the configuration checks this.
    let coefficient = BY_CODE.get(usize::from(phy.preamble_code()).wrapping_sub(1)).copied().unwrap_or(0x5998);
    match phy.data_rate() {
        DataRate::Kbps110 => coefficient / 8,
        DataRate::Kbps850 | DataRate::Kbps6810 => coefficient,
    }
}

/// TX_POWER for reference hardware with smart power (table 20). Its low byte is the power without the boost of short
/// frames, and applies to the whole frame if smart power is off.
pub(super) const fn tx_power(channel: Channel, prf: Prf) -> u32 {
    match (prf, channel) {
        (Prf::Mhz16, Channel::Ch1 | Channel::Ch2) => 0x1535_5575,
        (Prf::Mhz16, Channel::Ch3) => 0x0F2F_4F6F,
        (Prf::Mhz16, Channel::Ch4) => 0x1F1F_3F5F,
        (Prf::Mhz16, Channel::Ch5) => 0x0E08_2848,
        (Prf::Mhz16, Channel::Ch7) => 0x3252_7292,
        (Prf::Mhz64, Channel::Ch1 | Channel::Ch2) => 0x0727_4767,
        (Prf::Mhz64, Channel::Ch3) => 0x2B4B_6B8B,
        (Prf::Mhz64, Channel::Ch4) => 0x3A5A_7A9A,
        (Prf::Mhz64, Channel::Ch5) => 0x2545_6585,
        (Prf::Mhz64, Channel::Ch7) => 0x5171_B1D1,
    }
}

/// The TXPSR and PE bits of a preamble length, four bits as in TX_FCTRL from bit 18 (table 16).
pub(super) const fn preamble_bits(preamble: PreambleLength) -> u32 {
    let (txpsr, pe) = match preamble {
        PreambleLength::Symbols64 => (0b01, 0b00),
        PreambleLength::Symbols128 => (0b01, 0b01),
        PreambleLength::Symbols256 => (0b01, 0b10),
        PreambleLength::Symbols512 => (0b01, 0b11),
        PreambleLength::Symbols1024 => (0b10, 0b00),
        PreambleLength::Symbols1536 => (0b10, 0b01),
        PreambleLength::Symbols2048 => (0b10, 0b10),
        PreambleLength::Symbols4096 => (0b11, 0b00),
    };
    txpsr | pe << 2
}

/// The two bits of a pulse frequency, as in TX_FCTRL and CHAN_CTRL.
pub(super) const fn prf_bits(prf: Prf) -> u32 {
    match prf {
        Prf::Mhz16 => 0b01,
        Prf::Mhz64 => 0b10,
    }
}

/// The two bits of a data rate, as in TX_FCTRL.
pub(super) const fn rate_bits(rate: DataRate) -> u32 {
    match rate {
        DataRate::Kbps110 => 0b00,
        DataRate::Kbps850 => 0b01,
        DataRate::Kbps6810 => 0b10,
    }
}
