//! Bits of the registers that have an effect.

/// SYS_STATUS (0x0F), 40 bits.
pub(super) mod status {
    pub const CPLOCK: u64 = 1 << 1;
    pub const TXFRB: u64 = 1 << 4;
    pub const TXPRS: u64 = 1 << 5;
    pub const TXPHS: u64 = 1 << 6;
    pub const TXFRS: u64 = 1 << 7;
    pub const RXPRD: u64 = 1 << 8;
    pub const RXSFDD: u64 = 1 << 9;
    pub const LDEDONE: u64 = 1 << 10;
    pub const RXPHD: u64 = 1 << 11;
    pub const RXPHE: u64 = 1 << 12;
    pub const RXDFR: u64 = 1 << 13;
    pub const RXFCG: u64 = 1 << 14;
    pub const RXFCE: u64 = 1 << 15;
    pub const RXRFSL: u64 = 1 << 16;
    pub const RXRFTO: u64 = 1 << 17;
    pub const LDEERR: u64 = 1 << 18;
    pub const RXOVRR: u64 = 1 << 20;
    pub const RXPTO: u64 = 1 << 21;
    pub const SLP2INIT: u64 = 1 << 23;
    pub const RXSFDTO: u64 = 1 << 26;
    pub const HPDWARN: u64 = 1 << 27;
    pub const AFFREJ: u64 = 1 << 29;
    pub const HSRBP: u64 = 1 << 30;
    pub const ICRBP: u64 = 1 << 31;
    pub const TXPUTE: u64 = 1 << 34;
    /// The bits that belong to a receive set and change with it.
    pub const OF_SET: u64 = LDEDONE | RXDFR | RXFCG | RXFCE;
    /// The bits that are not cleared by writing a one.
    pub const READ_ONLY: u64 = 1 | HPDWARN | HSRBP | ICRBP;
    /// The bits that are cleared when the transmitter is enabled next.
    pub const OF_TRANSMISSION: u64 = TXFRB | TXPRS | TXPHS | TXFRS;
    /// The bits that are cleared when the receiver is enabled next, also by RXAUTR. The manual says so of RXPRD and
    /// RXRSCS (pages 87 and 92); for the others it is assumed. RXOVRR is cleared by HRBPT (4.3.5).
    pub const OF_RECEPTION: u64 = RXPRD
        | RXSFDD
        | LDEDONE
        | RXPHD
        | RXPHE
        | RXDFR
        | RXFCG
        | RXFCE
        | RXRFSL
        | RXRFTO
        | LDEERR
        | RXPTO
        | RXSFDTO
        | AFFREJ;
}

/// SYS_CTRL (0x0D).
pub(super) mod control {
    pub const SFCST: u32 = 1 << 0;
    pub const TXSTRT: u32 = 1 << 1;
    pub const TXDLYS: u32 = 1 << 2;
    pub const TRXOFF: u32 = 1 << 6;
    pub const WAIT4RESP: u32 = 1 << 7;
    pub const RXENAB: u32 = 1 << 8;
    pub const RXDLYE: u32 = 1 << 9;
    pub const HRBPT: u32 = 1 << 24;
}

/// SYS_CFG (0x04).
pub(super) mod config {
    pub const FFEN: u32 = 1 << 0;
    pub const HIRQ_POL: u32 = 1 << 9;
    pub const DIS_DRXB: u32 = 1 << 12;
    pub const FCS_INIT2F: u32 = 1 << 15;
    pub const PHR_MODE: u32 = 0b11 << 16;
    pub const DIS_STXP: u32 = 1 << 18;
    pub const RXM110K: u32 = 1 << 22;
    pub const RXWTOE: u32 = 1 << 28;
    pub const RXAUTR: u32 = 1 << 29;
}

/// CHAN_CTRL (0x1F).
pub(super) mod channel {
    pub const DWSFD: u32 = 1 << 17;
    pub const TNSSFD: u32 = 1 << 20;
    pub const RNSSFD: u32 = 1 << 21;
}
