//! The chip's registers and their bits, with the names of the DW1000 user manual, chapter 7, and the header that
//! addresses them on the bus (2.2.1.2).

/// A place in the register map: a register file and an offset in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Register {
    file: u8,
    offset: u16,
}

const fn at(file: u8, offset: u16) -> Register {
    Register { file, offset }
}

impl Register {
    /// The register `bytes` further on in the same file.
    pub const fn plus(self, bytes: u16) -> Self {
        at(self.file, self.offset + bytes)
    }

    /// The header of a read or a write, and its length in bytes: one without an offset, two for an offset below 128,
    /// three for a greater one.
    pub const fn header(self, write: bool) -> ([u8; 3], usize) {
        let command = self.file | if write { 0x80 } else { 0 };
        let low = (self.offset & 0x7F) as u8;
        let high = (self.offset >> 7) as u8;
        match self.offset {
            0 => ([command, 0, 0], 1),
            1..=0x7F => ([command | 0x40, low, 0], 2),
            _ => ([command | 0x40, low | 0x80, high], 3),
        }
    }
}

pub(super) const DEV_ID: Register = at(0x00, 0);
pub(super) const EUI: Register = at(0x01, 0);
pub(super) const PANADR: Register = at(0x03, 0);
pub(super) const SYS_CFG: Register = at(0x04, 0);
pub(super) const SYS_TIME: Register = at(0x06, 0);
pub(super) const TX_FCTRL: Register = at(0x08, 0);
pub(super) const TX_BUFFER: Register = at(0x09, 0);
pub(super) const DX_TIME: Register = at(0x0A, 0);
pub(super) const RX_FWTO: Register = at(0x0C, 0);
pub(super) const SYS_CTRL: Register = at(0x0D, 0);
pub(super) const SYS_MASK: Register = at(0x0E, 0);
pub(super) const SYS_STATUS: Register = at(0x0F, 0);
pub(super) const RX_FINFO: Register = at(0x10, 0);
pub(super) const RX_BUFFER: Register = at(0x11, 0);
pub(super) const RX_FQUAL: Register = at(0x12, 0);
pub(super) const RX_TIME: Register = at(0x15, 0);
pub(super) const TX_TIME: Register = at(0x17, 0);
pub(super) const TX_ANTD: Register = at(0x18, 0);
pub(super) const TX_POWER: Register = at(0x1E, 0);
pub(super) const CHAN_CTRL: Register = at(0x1F, 0);
pub(super) const SFD_LENGTH: Register = at(0x21, 0);
pub(super) const AGC_TUNE1: Register = at(0x23, 0x04);
pub(super) const AGC_TUNE2: Register = at(0x23, 0x0C);
pub(super) const AGC_TUNE3: Register = at(0x23, 0x12);
pub(super) const EC_CTRL: Register = at(0x24, 0);
pub(super) const ACC_MEM: Register = at(0x25, 0);
pub(super) const DRX_TUNE0B: Register = at(0x27, 0x02);
pub(super) const DRX_TUNE1A: Register = at(0x27, 0x04);
pub(super) const DRX_TUNE1B: Register = at(0x27, 0x06);
pub(super) const DRX_TUNE2: Register = at(0x27, 0x08);
pub(super) const DRX_SFDTOC: Register = at(0x27, 0x20);
pub(super) const DRX_TUNE4H: Register = at(0x27, 0x26);
pub(super) const DRX_CAR_INT: Register = at(0x27, 0x28);
pub(super) const RF_RXCTRLH: Register = at(0x28, 0x0B);
pub(super) const RF_TXCTRL: Register = at(0x28, 0x0C);
/// Biases of the temperature and voltage sensors: the manual gives no name (6.4).
pub(super) const RF_SENSOR_BIAS: Register = at(0x28, 0x11);
pub(super) const TC_SARC: Register = at(0x2A, 0);
pub(super) const TC_SARL: Register = at(0x2A, 0x03);
pub(super) const TC_PGDELAY: Register = at(0x2A, 0x0B);
pub(super) const FS_PLLCFG: Register = at(0x2B, 0x07);
pub(super) const FS_PLLTUNE: Register = at(0x2B, 0x0B);
pub(super) const FS_XTALT: Register = at(0x2B, 0x0E);
pub(super) const AON_WCFG: Register = at(0x2C, 0);
pub(super) const AON_CTRL: Register = at(0x2C, 0x02);
pub(super) const AON_CFG0: Register = at(0x2C, 0x06);
pub(super) const AON_CFG1: Register = at(0x2C, 0x0A);
pub(super) const OTP_ADDR: Register = at(0x2D, 0x04);
pub(super) const OTP_CTRL: Register = at(0x2D, 0x06);
pub(super) const OTP_RDAT: Register = at(0x2D, 0x0A);
pub(super) const OTP_SF: Register = at(0x2D, 0x12);
pub(super) const LDE_CFG1: Register = at(0x2E, 0x0806);
pub(super) const LDE_RXANTD: Register = at(0x2E, 0x1804);
pub(super) const LDE_CFG2: Register = at(0x2E, 0x1806);
pub(super) const LDE_REPC: Register = at(0x2E, 0x2804);
pub(super) const PMSC_CTRL0: Register = at(0x36, 0);
pub(super) const PMSC_CTRL1: Register = at(0x36, 0x04);

/// SYS_CFG (7.2.6).
pub(super) mod sys_cfg {
    pub const FFEN: u32 = 1 << 0;
    pub const HIRQ_POL: u32 = 1 << 9;
    pub const DIS_STXP: u32 = 1 << 18;
    pub const RXM110K: u32 = 1 << 22;
    pub const RXWTOE: u32 = 1 << 28;
}

/// SYS_CTRL (7.2.15), byte by byte, because no command needs more than one.
pub(super) mod sys_ctrl {
    /// First byte.
    pub const TXSTRT: u8 = 1 << 1;
    pub const TXDLYS: u8 = 1 << 2;
    pub const TRXOFF: u8 = 1 << 6;
    pub const WAIT4RESP: u8 = 1 << 7;
    /// Second byte.
    pub const RXENAB: u8 = 1 << 0;
    pub const RXDLYE: u8 = 1 << 1;
    /// Fourth byte.
    pub const HRBPT: u8 = 1 << 0;
}

/// SYS_STATUS (7.2.17), its first four bytes; SYS_MASK has the same bits.
pub(super) mod status {
    pub const CPLOCK: u32 = 1 << 1;
    pub const TXFRS: u32 = 1 << 7;
    pub const LDEDONE: u32 = 1 << 10;
    pub const RXPHE: u32 = 1 << 12;
    pub const RXFCG: u32 = 1 << 14;
    pub const RXFCE: u32 = 1 << 15;
    pub const RXRFSL: u32 = 1 << 16;
    pub const RXRFTO: u32 = 1 << 17;
    pub const LDEERR: u32 = 1 << 18;
    pub const RXOVRR: u32 = 1 << 20;
    pub const RXPTO: u32 = 1 << 21;
    pub const RXSFDTO: u32 = 1 << 26;
    pub const HPDWARN: u32 = 1 << 27;
    pub const AFFREJ: u32 = 1 << 29;
    pub const HSRBP: u32 = 1 << 30;
    pub const ICRBP: u32 = 1 << 31;
    /// Second byte: LDEDONE, RXDFR, RXFCG, RXFCE; each receive buffer has its own (4.3.3).
    pub const RECEIVED_IN_BYTE_1: u8 = 0xE4;
    /// Fifth byte, bit 2: the transmitter had no time to power up.
    pub const TXPUTE_IN_BYTE_4: u8 = 1 << 2;

    /// Errors of a reception.
    pub const RX_ERRORS: u32 = RXPHE | RXFCE | RXRFSL | LDEERR | RXOVRR | RXSFDTO;
    /// Timeouts of a reception.
    pub const RX_TIMEOUTS: u32 = RXRFTO | RXPTO;
    /// All possible ends of a reception.
    pub const RECEPTIONS: u32 = RXFCG | AFFREJ | RX_ERRORS | RX_TIMEOUTS;
    /// The flags that raise the interrupt line.
    pub const INTERRUPTS: u32 = TXFRS | RECEPTIONS;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_one_two_or_three_bytes() {
        // User manual, 2.2.1.2, figures 3 to 5: bit 7 means a write; bit 6 means that an offset follows; bit 7 of the
        // offset means that it has a second byte, which holds its bits 7 to 14.
        assert_eq!(DEV_ID.header(false), ([0x00, 0, 0], 1));
        assert_eq!(SYS_STATUS.header(true), ([0x8F, 0, 0], 1));
        assert_eq!(DRX_TUNE2.header(true), ([0xE7, 0x08, 0], 2));
        assert_eq!(DRX_CAR_INT.header(false), ([0x67, 0x28, 0], 2));
        // 0x1804 = 0b1_1000_0000_0100: low seven bits 0x04, the rest 0x30.
        assert_eq!(LDE_RXANTD.header(true), ([0xEE, 0x84, 0x30], 3));
        // 0x2804: low seven bits 0x04, the rest 0x50.
        assert_eq!(LDE_REPC.header(false), ([0x6E, 0x84, 0x50], 3));
        // An even offset past the second sample of the accumulator, which the published driver reads from 0.
        assert_eq!(ACC_MEM.plus(748).header(false), ([0x65, 0xEC, 0x05], 3));
        assert_eq!(ACC_MEM.plus(0x7F).header(false), ([0x65, 0x7F, 0], 2));
        assert_eq!(ACC_MEM.plus(0x80).header(false), ([0x65, 0x80, 0x01], 3));
    }
}
