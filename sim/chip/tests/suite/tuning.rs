//! Tunings that differ from the user manual's are counted and named.

use crate::host::*;
use dw1000_sim::World;

#[test]
fn after_reset_the_manuals_list_of_defaults_to_be_changed_is_named() {
    let world = World::new(1, quiet());
    let host = started(&world, 0.0, chip(0));
    // User manual, 2.5.5.1 to 2.5.5.9, without NTM and TX_POWER, which may be chosen freely; and LDE_REPC, for which
    // the manual has no default.
    let expected =
        ["AGC_TUNE1", "AGC_TUNE2", "DRX_TUNE2", "FS_PLLTUNE", "LDE_CFG2", "LDE_REPC", "RF_TXCTRL", "TC_PGDELAY"];
    assert_eq!(host.node.chip().mistuned(), expected);
}

/// Channel 5, PRF 16, preamble code 4, 6.8 Mbit/s: user manual, 2.5.5, and table 51 for LDE_REPC.
fn tune(host: &Host) {
    host.write(0x23, 0x04, &0x8870u16.to_le_bytes());
    host.write_u32(0x23, 0x0C, 0x2502_A907);
    host.write_u32(0x27, 0x08, 0x311A_002D);
    host.write(0x2E, 0x1806, &0x1607u16.to_le_bytes());
    host.write(0x2E, 0x2804, &0x428Eu16.to_le_bytes());
    host.write_u32(0x28, 0x0C, 0x001E_3FE0);
    host.write(0x2A, 0x0B, &[0xC0]);
    host.write(0x2B, 0x0B, &[0xBE]);
}

#[test]
fn enabling_counts_what_the_direction_needs() {
    let world = World::new(1, quiet());
    let host = ready(&world, 0.0, chip(0));
    tune(&host);
    assert_eq!(host.node.chip().mistuned(), [""; 0]);
    host.send(&[1, 2, 3]);
    host.command(RXENAB);
    host.after_us(50);
    host.command(TRXOFF);
    assert_eq!(host.node.chip_statistics().mistuned, 0);
    // Only the receiver uses the replica coefficient.
    host.write(0x2E, 0x2804, &[0, 0]);
    host.send(&[1, 2, 3]);
    assert_eq!(host.node.chip_statistics().mistuned, 0);
    host.command(RXENAB);
    host.after_us(50);
    assert_eq!(host.node.chip_statistics().mistuned, 1);
    host.command(TRXOFF);
    tune(&host);
    // Only the transmitter uses the pulse generator's delay.
    host.write(0x2A, 0x0B, &[0xC5]);
    host.send(&[1, 2, 3]);
    assert_eq!(host.node.chip_statistics().mistuned, 2);
    assert_eq!(host.node.chip().mistuned(), ["TC_PGDELAY"]);
}

#[test]
fn another_mode_asks_for_other_values() {
    let world = World::new(1, quiet());
    let host = ready(&world, 0.0, chip(0));
    tune(&host);
    // 110 kbit/s: DRX_TUNE0b and 1b, an eighth of LDE_REPC.
    host.write_u32(0x04, 0, 0x1200 | 1 << 22);
    assert_eq!(host.node.chip().mistuned(), ["DRX_TUNE0b", "DRX_TUNE1b", "LDE_REPC"]);
    host.write_u32(0x04, 0, 0x1200);
    // PRF 64 with code 9.
    host.write_u32(0x1F, 0, 0x4A48_0055);
    assert_eq!(host.node.chip().mistuned(), ["AGC_TUNE1", "DRX_TUNE1a", "DRX_TUNE2", "LDE_CFG2", "LDE_REPC"]);
}
