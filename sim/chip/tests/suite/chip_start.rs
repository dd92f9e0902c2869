//! Tests of a chip's state after power-up, resets and sleep, and of its one-time memory.

use crate::host::*;
use dw1000_sim::{BoardProfile, ChipConfig, NodeConfig, World};
use embedded_hal::digital::OutputPin;
use embedded_hal_async::spi::Operation;

fn word(host: &Host, address: u16) -> u32 {
    host.write(0x2D, 0x04, &address.to_le_bytes());
    host.write(0x2D, 0x06, &[0x03, 0]);
    host.write(0x2D, 0x06, &[0, 0]);
    host.read_u32(0x2D, 0x0A)
}

/// Everything that starts a chip.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Start {
    ResetLine,
    SoftReset,
    Supply,
    Sleep,
}

const STARTS: [Start; 4] = [Start::ResetLine, Start::SoftReset, Start::Supply, Start::Sleep];

/// Starts the chip again. Returns the microseconds since its registers or counter were reset.
fn start_again(host: &mut Host, start: Start) -> f64 {
    host.slow();
    match start {
        Start::ResetLine => {
            let Ok(()) = host.p.reset.set_low();
            host.after_us(10);
            let Ok(()) = host.p.reset.set_high();
        }
        Start::SoftReset => {
            host.write(0x36, 0, &[0x01]);
            host.write(0x36, 3, &[0x00]);
            host.write(0x36, 3, &[0xF0]);
        }
        Start::Supply => {
            host.node.power_off();
            host.after_us(10);
            host.node.power_on();
        }
        Start::Sleep => {
            host.write(0x2C, 0x00, &0x0840u16.to_le_bytes());
            host.write_u32(0x2C, 0x06, 1 | 1 << 2);
            host.write(0x2C, 0x02, &[0]);
            host.write(0x2C, 0x02, &[2]);
            host.transact(&mut [Operation::DelayNs(500_000)]);
        }
    }
    host.after_us(3_100);
    3_100.0
}

#[test]
fn the_counter_starts_anew_with_every_start_of_the_chip() {
    for start in STARTS {
        let world = World::new(1, quiet());
        let mut host = started(&world, 0.0, chip(5_000_000));
        host.after_us(100_000);
        let since = start_again(&mut host, start);
        let now = world.now();
        let counted = host.node.chip().counter(now) as f64;
        // The clock is ideal.
        assert!((counted - 5_000_000.0 - since * MICROSECOND).abs() < 2.0, "{start:?}: {counted}");
    }
}

#[test]
fn every_start_passes_through_init() {
    let world = World::new(1, quiet());
    let host = started(&world, 0.0, chip(0));
    assert_eq!(host.status() & (SLP2INIT | CPLOCK), SLP2INIT | CPLOCK, "power-up");
    for start in STARTS {
        let mut host = started(&world, 0.0, chip(0));
        host.clear_status();
        assert_eq!(host.status() & SLP2INIT, 0);
        start_again(&mut host, start);
        assert_eq!(host.status() & (SLP2INIT | CPLOCK), SLP2INIT | CPLOCK, "{start:?}");
    }
}

#[test]
fn the_identifier_is_loaded_at_every_start() {
    let world = World::new(1, quiet());
    let config = ChipConfig { eui: 0x1122_3344_5566_7788, ..chip(0) };
    let mut host = started(&world, 0.0, config);
    assert_eq!(host.read(0x01, 0), 0x1122_3344_5566_7788u64.to_le_bytes(), "power-up");
    for start in STARTS {
        if start != Start::Sleep {
            host.write(0x01, 0, &[0; 8]);
        }
        start_again(&mut host, start);
        assert_eq!(host.read(0x01, 0), 0x1122_3344_5566_7788u64.to_le_bytes(), "{start:?}");
    }
    let blank = started(&world, 0.0, chip(0));
    assert_eq!(blank.read(0x01, 0), 0xFFFF_FFFF_0000_0000u64.to_le_bytes());
}

#[test]
fn a_soft_reset_holds_the_chip_until_it_is_released() {
    let world = World::new(1, quiet());
    let host = ready(&world, 0.0, chip(0));
    host.write_u32(0x03, 0, 0x1234_5678);
    host.slow();
    host.write(0x36, 0, &[0x01]);
    host.write(0x36, 3, &[0x00]);
    host.after_us(10_000);
    assert_eq!(host.read_u32(0x36, 0), 0x0030_0200, "SOFTRESET reads as written");
    assert_eq!(host.status() & CPLOCK, 0, "no clock");
    assert_eq!(host.read_u32(0x03, 0), 0xFFFF_FFFF, "the registers are reset");
    host.write_u32(0x03, 0, 0x1234_5678);
    host.write(0x36, 3, &[0x70]);
    host.command(RXENAB);
    assert_eq!(host.read_u32(0x03, 0), 0xFFFF_FFFF, "nothing can be written");
    host.write(0x36, 3, &[0xF0]);
    host.after_us(100);
    assert_eq!(host.read_u32(0x36, 0), 0xF030_0200);
    assert_ne!(host.status() & CPLOCK, 0);
    host.write_u32(0x03, 0, 0x1234_5678);
    assert_eq!(host.read_u32(0x03, 0), 0x1234_5678);
    assert_eq!(host.read::<1>(0x19, 2), [1], "idle: the RXENAB was lost");
}

#[test]
fn waking_leaves_the_high_byte_of_the_receive_delay_in_the_transmit_delay() {
    // User manual, page 103.
    let world = World::new(1, quiet());
    let mut host = ready(&world, 0.0, chip(0));
    host.write(0x2E, 0x1804, &[0x34, 0x40]);
    host.write(0x18, 0, &[0x34, 0x40]);
    start_again(&mut host, Start::Sleep);
    assert_eq!(host.read(0x2E, 0x1804), [0x34, 0x40]);
    assert_eq!(host.read(0x18, 0), [0x40, 0x00]);
}

#[test]
fn some_registers_fit_the_mode_after_reset() {
    let world = World::new(1, quiet());
    let host = started(&world, 0.0, chip(0));
    // The user manual's 2.5.5 lists what must be changed for channel 5, 6.8 Mbit/s, PRF 16, 128 symbols. The registers
    // below are not in that list and have the values of tables 30, 31, 32, 34 and 7.2.36.6: DRX_TUNE0b, 1a, 1b, 4H and
    // AGC_TUNE3.
    assert_eq!(host.read(0x27, 0x02), [0x01, 0x00]);
    assert_eq!(host.read(0x27, 0x04), [0x87, 0x00]);
    assert_eq!(host.read(0x27, 0x06), [0x20, 0x00]);
    assert_eq!(host.read(0x27, 0x26), [0x28, 0x00]);
    assert_eq!(host.read(0x23, 0x12), [0x35, 0x00]);
}

#[test]
fn words_of_the_one_time_memory_are_a_tests_to_choose() {
    let world = World::new(1, quiet());
    // Transmit powers for channel 1, antenna delays, crystal trim, and calibrations of the converters that differ from
    // the model's own.
    let words = [(0x010, 0x1525_3545), (0x01C, 0x4034_4011), (0x01E, 0x12), (0x008, 0x90), (0x009, 0x70), (0x000, 7)];
    let config =
        ChipConfig { otp: words.to_vec(), trim: 5, eui: 0x1_0000_0001, temperature_c: 34.4, supply_v: 3.3, ..chip(0) };
    let host = started(&world, 0.0, config);
    for (address, value) in words {
        assert_eq!(word(&host, address), value, "{address:#x}");
    }
    assert_eq!(word(&host, 0x004), 0x8888_8888, "what is not chosen stays");
    assert_eq!(host.read(0x01, 0), 0x1_0000_0007u64.to_le_bytes(), "the identifier comes from there");
    host.write(0x28, 0x12, &[0x0F]);
    host.write(0x2A, 0x00, &[0x01]);
    // 3.3 V is the calibration point itself. 11.4 °C above 23 °C are ten steps of 1.14 °C.
    assert_eq!(host.read(0x2A, 0x03), [0x90, 0x70 + 10]);
}

#[test]
fn a_chip_added_later_starts_its_counter_then() {
    let world = World::new(1, quiet());
    world.run_for(std::time::Duration::from_secs(3));
    let node = world.add_node(NodeConfig { chip: chip(77), board: BoardProfile::INSTANT, ..NodeConfig::at([0.0; 3]) });
    assert_eq!(node.chip().counter(world.now()), 77);
}
