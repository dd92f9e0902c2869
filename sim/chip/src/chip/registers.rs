//! The register files: their places in the chip's memory, their lengths, and their contents after a reset.
//!
//! Identifiers, lengths and reset values: DW1000 user manual, 7.1 and 7.2.

/// Register file identifiers.
pub(super) mod file {
    pub const DEV_ID: u8 = 0x00;
    pub const EUI: u8 = 0x01;
    pub const PANADR: u8 = 0x03;
    pub const SYS_CFG: u8 = 0x04;
    pub const SYS_TIME: u8 = 0x06;
    pub const TX_FCTRL: u8 = 0x08;
    pub const TX_BUFFER: u8 = 0x09;
    pub const DX_TIME: u8 = 0x0A;
    pub const RX_FWTO: u8 = 0x0C;
    pub const SYS_CTRL: u8 = 0x0D;
    pub const SYS_MASK: u8 = 0x0E;
    pub const SYS_STATUS: u8 = 0x0F;
    pub const RX_FINFO: u8 = 0x10;
    pub const RX_BUFFER: u8 = 0x11;
    pub const RX_FQUAL: u8 = 0x12;
    pub const RX_TTCKI: u8 = 0x13;
    pub const RX_TTCKO: u8 = 0x14;
    pub const RX_TIME: u8 = 0x15;
    pub const TX_TIME: u8 = 0x17;
    pub const TX_ANTD: u8 = 0x18;
    pub const SYS_STATE: u8 = 0x19;
    pub const ACK_RESP_T: u8 = 0x1A;
    pub const TX_POWER: u8 = 0x1E;
    pub const CHAN_CTRL: u8 = 0x1F;
    pub const USR_SFD: u8 = 0x21;
    pub const ACC_MEM: u8 = 0x25;
    pub const DRX_CONF: u8 = 0x27;
    pub const RF_CONF: u8 = 0x28;
    pub const TX_CAL: u8 = 0x2A;
    pub const FS_CTRL: u8 = 0x2B;
    pub const AON: u8 = 0x2C;
    pub const OTP_IF: u8 = 0x2D;
    pub const LDE_IF: u8 = 0x2E;
    pub const DIG_DIAG: u8 = 0x2F;
    pub const PMSC: u8 = 0x36;
}

/// Identifier and length of each file that is kept in memory as written. The others are computed when they are read.
const KEPT: [(u8, u16); 28] = [
    (file::DEV_ID, 4),
    (file::EUI, 8),
    (file::PANADR, 4),
    (file::SYS_CFG, 4),
    (file::TX_FCTRL, 5),
    (file::TX_BUFFER, 1024),
    (file::DX_TIME, 5),
    (file::RX_FWTO, 2),
    (file::SYS_MASK, 4),
    (file::TX_TIME, 10),
    (file::TX_ANTD, 2),
    (file::ACK_RESP_T, 4),
    // RX_SNIFF
    (0x1D, 4),
    (file::TX_POWER, 4),
    (file::CHAN_CTRL, 4),
    (file::USR_SFD, 41),
    // AGC_CTRL
    (0x23, 33),
    // EXT_SYNC
    (0x24, 12),
    // GPIO_CTRL
    (0x26, 44),
    (file::DRX_CONF, 46),
    (file::RF_CONF, 58),
    (file::TX_CAL, 52),
    (file::FS_CTRL, 21),
    (file::AON, 12),
    (file::OTP_IF, 19),
    (file::LDE_IF, 0x2806),
    (file::DIG_DIAG, 42),
    (file::PMSC, 48),
];

const fn layout() -> ([(u16, u16); 64], usize) {
    let mut places = [(0u16, 0u16); 64];
    let (mut next, mut i) = (0u16, 0);
    while i < KEPT.len() {
        places[KEPT[i].0 as usize] = (next, KEPT[i].1);
        next += KEPT[i].1;
        i += 1;
    }
    (places, next as usize)
}

const LAYOUT: ([(u16, u16); 64], usize) = layout();

/// File, offset and bytes after a reset. Everything else is zero.
const RESET: [(u8, usize, &[u8]); 24] = [
    // 0xDECA0130.
    (file::DEV_ID, 0, &[0x30, 0x01, 0xCA, 0xDE]),
    (file::PANADR, 0, &[0xFF; 4]),
    // Active-high interrupt, one receive buffer.
    (file::SYS_CFG, 0, &[0x00, 0x12, 0x00, 0x00]),
    // 12 bytes, 6.81 Mbit/s, PRF 16, 128 symbols.
    (file::TX_FCTRL, 0, &[0x0C, 0x40, 0x15, 0x00, 0x00]),
    (file::TX_POWER, 0, &[0x22, 0x02, 0x08, 0x1E]),
    // Channel 5, PRF 16, preamble code 4.
    (file::CHAN_CTRL, 0, &[0x55, 0x00, 0x04, 0x21]),
    (0x23, 0x04, &[0x9B, 0x88]),
    // AGC_TUNE3, DRX_TUNE0b, DRX_TUNE1a, DRX_TUNE1b, DRX_TUNE4H: the manual's 2.5.5 does not list them among the
    // registers that must be changed. It is assumed that after a reset they fit the mode.
    (0x23, 0x12, &[0x35, 0x00]),
    (file::DRX_CONF, 0x02, &[0x01, 0x00, 0x87, 0x00, 0x20, 0x00]),
    // DRX_TUNE2: acquisition chunks of 8.
    (file::DRX_CONF, 0x08, &[0x35, 0x00, 0x1E, 0x31]),
    // DRX_SFDTOC: 4096 + 64 + 1; DRX_TUNE4H.
    (file::DRX_CONF, 0x20, &[0x41, 0x10, 0x00, 0x00, 0x00, 0x00, 0x28, 0x00]),
    (file::RF_CONF, 0x0B, &[0xD8]),
    (file::TX_CAL, 0x0B, &[0xC5]),
    (file::FS_CTRL, 0x07, &[0x1D, 0x04, 0x00, 0x08]),
    (file::FS_CTRL, 0x0B, &[0x46]),
    // FS_XTALT: near the middle of the trim; the upper three bits are 011.
    (file::FS_CTRL, 0x0E, &[0x71]),
    (file::AON, 0x06, &[0x00, 0xFF, 0x50, 0xFF]),
    (file::AON, 0x0A, &[0x07, 0x00]),
    (file::LDE_IF, 0x0806, &[0x6C]),
    (file::PMSC, 0x00, &[0x00, 0x02, 0x30, 0xF0]),
    (file::PMSC, 0x04, &[0x38, 0x07, 0x02, 0x81]),
    (file::PMSC, 0x0C, &[0x40, 0x00]),
    (file::PMSC, 0x26, &[0x74, 0x0B]),
    // PMSC_LEDC: a blink of 0x20 units. This value is from memory, not from a document.
    (file::PMSC, 0x28, &[0x20, 0x00, 0x00, 0x00]),
];

/// The memory behind the register files.
#[derive(Clone)]
pub(super) struct Memory(Box<[u8]>);

impl Memory {
    pub(super) fn reset() -> Self {
        let mut memory = Self(vec![0; LAYOUT.1].into_boxed_slice());
        memory.restore_defaults();
        memory
    }

    pub(super) fn restore_defaults(&mut self) {
        self.0.fill(0);
        for (file, offset, bytes) in RESET {
            self.write(file, offset, bytes);
        }
    }

    /// The bytes of a file.
    pub(super) fn file(&self, file: u8) -> &[u8] {
        let (start, length) = LAYOUT.0[usize::from(file & 0x3F)];
        &self.0[usize::from(start)..usize::from(start + length)]
    }

    /// Writes into a file. Bytes beyond its end are dropped.
    pub(super) fn write(&mut self, file: u8, offset: usize, bytes: &[u8]) {
        let (start, length) = LAYOUT.0[usize::from(file & 0x3F)];
        let target = &mut self.0[usize::from(start)..usize::from(start + length)];
        if let Some(room) = target.get_mut(offset..) {
            let count = room.len().min(bytes.len());
            room[..count].copy_from_slice(&bytes[..count]);
        }
    }

    pub(super) fn u8(&self, file: u8, offset: usize) -> u8 {
        self.file(file)[offset]
    }

    pub(super) fn u16(&self, file: u8, offset: usize) -> u16 {
        let f = self.file(file);
        u16::from_le_bytes([f[offset], f[offset + 1]])
    }

    pub(super) fn u32(&self, file: u8, offset: usize) -> u32 {
        let f = self.file(file);
        u32::from_le_bytes([f[offset], f[offset + 1], f[offset + 2], f[offset + 3]])
    }

    /// The first five bytes of a file.
    pub(super) fn u40(&self, file: u8) -> u64 {
        let f = self.file(file);
        u64::from_le_bytes([f[0], f[1], f[2], f[3], f[4], 0, 0, 0])
    }
}

/// Copies `image` from `offset` on to `out`, with zeros beyond its end.
pub(super) fn copy_out(image: &[u8], offset: usize, out: &mut [u8]) {
    let rest = image.get(offset..).unwrap_or(&[]);
    let count = rest.len().min(out.len());
    out[..count].copy_from_slice(&rest[..count]);
    out[count..].fill(0);
}
