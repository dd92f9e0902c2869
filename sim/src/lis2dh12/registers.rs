//! The registers of the LIS2DH12 that the model knows, with the data sheet's names.

/// Addresses.
pub mod address {
    pub const WHO_AM_I: u8 = 0x0F;
    pub const CTRL_REG0: u8 = 0x1E;
    pub const CTRL_REG1: u8 = 0x20;
    pub const CTRL_REG2: u8 = 0x21;
    pub const CTRL_REG3: u8 = 0x22;
    pub const CTRL_REG4: u8 = 0x23;
    pub const CTRL_REG5: u8 = 0x24;
    pub const CTRL_REG6: u8 = 0x25;
    pub const REFERENCE: u8 = 0x26;
    pub const STATUS_REG: u8 = 0x27;
    pub const OUT_X_L: u8 = 0x28;
    pub const OUT_Z_H: u8 = 0x2D;
    pub const FIFO_SRC_REG: u8 = 0x2F;
    pub const INT1_CFG: u8 = 0x30;
    pub const INT1_SRC: u8 = 0x31;
    pub const INT1_THS: u8 = 0x32;
    pub const INT1_DURATION: u8 = 0x33;
    pub const INT2_SRC: u8 = 0x35;
    pub const CLICK_SRC: u8 = 0x39;
    /// The last one.
    pub const ACT_DUR: u8 = 0x3F;
}

use address::*;

/// Whether a write to a register has no effect: it is read only, or reserved.
pub fn is_read_only(register: u8) -> bool {
    match register {
        STATUS_REG..=OUT_Z_H | FIFO_SRC_REG | INT1_SRC | INT2_SRC | CLICK_SRC => true,
        CTRL_REG0 | 0x1F..=REFERENCE | 0x2E..=ACT_DUR => false,
        _ => true,
    }
}

/// The contents after power-on (data sheet, table 21).
pub fn at_power_on() -> [u8; 0x40] {
    let mut registers = [0; 0x40];
    for (register, value) in [(WHO_AM_I, 0x33), (CTRL_REG0, 0x10), (CTRL_REG1, 0x07), (FIFO_SRC_REG, 0x20)] {
        registers[usize::from(register)] = value;
    }
    registers
}
