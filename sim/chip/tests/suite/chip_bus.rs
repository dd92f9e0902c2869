//! Tests of the chip's bus, clocks, reset, sleep and slow converters, as the user manual describes them.

use crate::host::*;
use dw1000_sim::{BoardProfile, NodeConfig, TrueTime, World};
use embedded_hal::digital::OutputPin;
use embedded_hal_async::digital::Wait;
use embedded_hal_async::spi::Operation;
use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

#[test]
fn a_chip_answers_slowly_first_and_fast_once_the_pll_has_locked() {
    let world = World::new(1, quiet());
    let node = world.add_node(NodeConfig { chip: chip(0), board: BoardProfile::INSTANT, ..NodeConfig::at([0.0; 3]) });
    let host = Host { world: world.clone(), p: node.peripherals(), node };
    assert_eq!(host.read_u32(0x00, 0), 0, "the crystal has not started");
    world.run_until(TrueTime::from_micros(3_001));
    host.p.spi.clock().set_hz(3_000_000);
    assert_eq!(host.read_u32(0x00, 0), 0xDECA_0130);
    assert_eq!(host.status() & CPLOCK, 0);
    host.fast();
    assert_ne!(host.read_u32(0x00, 0), 0xDECA_0130);
    assert_eq!(host.node.chip_statistics().too_fast, 1);
    host.after_us(50);
    assert_eq!(host.read_u32(0x00, 0), 0xDECA_0130);
    assert_ne!(host.status() & CPLOCK, 0);
    host.p.spi.clock().set_hz(20_000_000);
    assert_eq!(host.read_u32(0x00, 0), 0xDECA_0130);
    host.p.spi.clock().set_hz(21_000_000);
    assert_ne!(host.read_u32(0x00, 0), 0xDECA_0130);
}

#[test]
fn on_the_crystals_clock_the_bus_is_slow_again_and_fast_writes_are_lost() {
    let world = World::new(1, quiet());
    let host = started(&world, 0.0, chip(0));
    host.write(0x36, 0, &[0x01]);
    host.fast();
    host.write_u32(0x03, 0, 0x1234_5678);
    host.slow();
    assert_eq!(host.read_u32(0x03, 0), 0xFFFF_FFFF);
    host.write_u32(0x03, 0, 0x1234_5678);
    assert_eq!(host.read_u32(0x03, 0), 0x1234_5678);
}

#[test]
fn values_after_reset() {
    let world = World::new(1, quiet());
    let host = started(&world, 0.0, chip(0));
    // User manual, 7.2: TX_FCTRL, SYS_CFG, PANADR, TX_POWER, CHAN_CTRL, PMSC_CTRL0, PMSC_CTRL1, DRX_SFDTOC.
    assert_eq!(host.read_u32(0x08, 0), 0x0015_400C);
    assert_eq!(host.read_u32(0x04, 0), 0x0000_1200);
    assert_eq!(host.read_u32(0x03, 0), 0xFFFF_FFFF);
    assert_eq!(host.read_u32(0x1E, 0), 0x1E08_0222);
    assert_eq!(host.read_u32(0x1F, 0), 0x2104_0055);
    assert_eq!(host.read_u32(0x36, 0), 0xF030_0200);
    assert_eq!(host.read_u32(0x36, 4), 0x8102_0738);
    assert_eq!(host.read(0x27, 0x20), [0x41, 0x10]);
}

#[test]
fn sub_addresses_reach_into_files_and_stop_at_their_end() {
    let world = World::new(1, quiet());
    let host = started(&world, 0.0, chip(0));
    host.write(0x01, 0, &[1, 2, 3, 4, 5, 6, 7, 8]);
    assert_eq!(host.read(0x01, 3), [4, 5]);
    host.write(0x01, 6, &[9, 9, 9, 9]);
    assert_eq!(host.read(0x01, 4), [5, 6, 9, 9, 0, 0]);
    assert_eq!(host.read_u32(0x03, 0), 0xFFFF_FFFF, "the next file is untouched");
    // A three-byte header: LDE_RXANTD.
    host.write(0x2E, 0x1804, &[0x34, 0x40]);
    assert_eq!(host.read(0x2E, 0x1804), [0x34, 0x40]);
    // One transfer of header and data at once.
    let mut both = [0x01, 0, 0];
    host.transact(&mut [Operation::TransferInPlace(&mut both)]);
    assert_eq!(both[1..], [1, 2]);
    // DEV_ID cannot be written.
    host.write(0x00, 0, &[0; 4]);
    assert_eq!(host.read_u32(0x00, 0), 0xDECA_0130);
}

#[test]
fn a_transaction_takes_eight_clocks_a_byte_and_the_setting_up_of_its_operations() {
    let world = World::new(1, quiet());
    let host = started(&world, 0.0, chip(0));
    host.fast();
    let before = world.now();
    let _: [u8; 9] = host.read(0x15, 0);
    // Ten bytes at 8 MHz.
    assert_eq!(world.now() - before, Duration::from_nanos(10_000));
    let node = world.add_node(NodeConfig::at([1.0, 0.0, 0.0]));
    let slow = Host { world: world.clone(), p: node.peripherals(), node };
    let before = world.now();
    slow.status();
    // Six bytes at 2 MHz, (20 + 2 · 40) instructions · 1.5 / 64 MHz, and twice half a microsecond for the operations of
    // the header and the status.
    assert_eq!(world.now() - before, Duration::from_nanos(24_000 + 2_343 + 1_000));
}

#[test]
fn the_counter_shows_multiples_of_512_ticks_at_63_9_gigahertz() {
    let world = World::new(1, quiet());
    let host = started(&world, 0.0, chip(MASK - 1_000_000));
    let first = host.read_u40(0x06, 0);
    host.after_us(1000);
    let second = host.read_u40(0x06, 0);
    assert_eq!((first & 511, second & 511), (0, 0));
    // 1 ms and one transaction of six bytes at 2 MHz: 1024 µs, across the wrap or after it.
    let passed = second.wrapping_sub(first) & MASK;
    assert!(passed.abs_diff((1024.0 * MICROSECOND) as u64) <= 512, "{passed}");
}

#[test]
fn status_bits_are_cleared_by_ones_and_masked_onto_the_pin() {
    let world = World::new(1, quiet());
    let host = ready(&world, 0.0, chip(0));
    assert_ne!(host.status() & CPLOCK, 0);
    assert!(!host.p.irq.is_high());
    host.write_u32(0x0E, 0, CPLOCK as u32);
    assert!(host.p.irq.is_high());
    assert_eq!(host.status() & 1, 1, "IRQS");
    host.write(0x0F, 0, &[0]);
    assert!(host.p.irq.is_high());
    host.write(0x0F, 0, &[CPLOCK as u8]);
    assert!(!host.p.irq.is_high());
    assert_eq!(host.status() & (CPLOCK | 1), 0);
    // Active low.
    host.write_u32(0x04, 0, 0x1000);
    assert!(host.p.irq.is_high());
}

#[test]
fn the_pin_wakes_its_task_after_the_boards_latency() {
    let world = World::new(1, quiet());
    let board = BoardProfile { interrupt_latency_ns: 4_000, ..BoardProfile::INSTANT };
    let node = world.add_node(NodeConfig { chip: chip(0), board, ..NodeConfig::at([0.0; 3]) });
    let mut p = node.peripherals();
    let host = Host { world: world.clone(), p: node.peripherals(), node };
    world.run_for(Duration::from_millis(5));
    host.write_u32(0x0E, 0, TXFRS as u32);
    let woken = Rc::new(Cell::new(TrueTime::ZERO));
    let (w, at) = (world.clone(), woken.clone());
    world.spawn(async move {
        p.irq.wait_for_high().await.unwrap();
        at.set(w.now());
    });
    host.prepare(&[0; 10]);
    host.command(TXSTRT);
    let started = world.now();
    host.after_us(1000);
    // 10 µs of start, 136 symbols of 993.59 ns, 21 bits of 1025.64 ns, 96 + 48 bits of 128.205 ns: 185.13 µs. The
    // RMARKER waits for a multiple of 512 ticks (8 ns), the antenna delay is 16 436 ticks (257.2 ns), and the latency
    // is 4 µs.
    let passed = woken.get().ps_since(started) as f64 / 1e6;
    let expected = 10.0 + 135.128 + 21.538 + 18.462 + 0.257 + 4.0;
    assert!((expected..expected + 0.009).contains(&passed), "{passed} {expected}");
}

#[test]
fn reset_line_and_soft_reset_restore_defaults_and_forget_the_microcode() {
    let world = World::new(1, quiet());
    let mut host = ready(&world, 0.0, chip(0));
    host.write_u32(0x03, 0, 0);
    host.p.reset.set_low().unwrap();
    host.after_us(10);
    assert_eq!(host.read_u32(0x00, 0), 0);
    host.p.reset.set_high().unwrap();
    host.after_us(3_100);
    assert_eq!(host.read_u32(0x03, 0), 0xFFFF_FFFF);
    // Soft reset: select the crystal's clock, then set SOFTRESET to 0, then to 15 (user manual, 7.2.50.1).
    host.write_u32(0x03, 0, 0);
    host.slow();
    host.write(0x36, 0, &[0x01]);
    host.write(0x36, 3, &[0x00]);
    host.after_us(100);
    host.write(0x36, 3, &[0xF0]);
    assert_eq!(host.read_u32(0x03, 0), 0xFFFF_FFFF);
}

#[test]
fn one_time_memory_temperature_and_supply() {
    let world = World::new(1, quiet());
    let mut config = chip(0);
    (config.temperature_c, config.supply_v, config.part, config.eui) = (47.0, 3.0, 0xBEEF, 0x1122_3344_5566_7788);
    let host = started(&world, 0.0, config);
    let word = |address: u16| {
        host.write(0x2D, 0x04, &address.to_le_bytes());
        host.write(0x2D, 0x06, &[0x03, 0]);
        host.write(0x2D, 0x06, &[0x01, 0]);
        let value = host.read_u32(0x2D, 0x0A);
        host.write(0x2D, 0x06, &[0, 0]);
        value
    };
    assert_eq!(word(0x006), 0xBEEF);
    assert_eq!((word(0x001), word(0x000)), (0x1122_3344, 0x5566_7788));
    // User manual, 6.4: switch on the biases, then convert.
    host.write(0x28, 0x11, &[0x80]);
    host.write(0x28, 0x12, &[0x0A]);
    host.write(0x28, 0x12, &[0x0F]);
    host.write(0x2A, 0x00, &[0x00]);
    host.write(0x2A, 0x00, &[0x01]);
    let [volts, celsius] = host.read(0x2A, 0x03);
    let celsius = (f64::from(celsius) - f64::from(word(0x009) as u8)) * 1.14 + 23.0;
    let volts = (f64::from(volts) - f64::from(word(0x008) as u8)) / 173.0 + 3.3;
    assert!((celsius - 47.0).abs() <= 0.57, "{celsius}");
    assert!((volts - 3.0).abs() <= 0.003, "{volts}");
}

#[test]
fn sleeping_chips_wake_on_chip_select_or_their_counter_and_remember() {
    let world = World::new(1, quiet());
    for by_counter in [false, true] {
        let host = ready(&world, 0.0, chip(0));
        host.write_u32(0x03, 0, 0xDECA_0001);
        host.write(0x18, 0, &[0x34, 0x40]);
        // ONW_LDC, ONW_LLDE; SLEEP_EN with WAKE_SPI, or with WAKE_CNT after 2 counts of 0.431 s.
        host.write(0x2C, 0x00, &0x0840u16.to_le_bytes());
        let wake: u32 = if by_counter { 1 << 3 | 2 << 16 } else { 1 << 2 };
        host.write_u32(0x2C, 0x06, 1 | wake);
        host.write(0x2C, 0x02, &[0]);
        host.write(0x2C, 0x02, &[1 << 1]);
        assert_eq!(host.read_u32(0x00, 0), 0, "asleep");
        if by_counter {
            host.after_us(850_000);
            assert_eq!(host.read_u32(0x00, 0), 0, "still asleep");
            host.after_us(20_000);
        } else {
            host.transact(&mut [Operation::DelayNs(400_000)]);
            host.after_us(5_000);
            assert_eq!(host.read_u32(0x00, 0), 0, "400 µs are not enough");
            host.transact(&mut [Operation::DelayNs(500_000)]);
            host.after_us(5_000);
        }
        assert_eq!(host.read_u32(0x00, 0), 0xDECA_0130);
        assert_eq!(host.status() & (SLP2INIT | CPLOCK), SLP2INIT | CPLOCK);
        assert_eq!(host.read_u32(0x03, 0), 0xDECA_0001);
        assert_eq!(host.read(0x18, 0), [0, 0], "the transmit antenna delay is lost");
    }
}

#[test]
fn the_crystal_trim_pulls_the_clock() {
    let world = World::new(1, quiet());
    let host = started(&world, 0.0, chip(0));
    // User manual, figure 29: +20 ppm at code 5, 0 at 17, −18 at 30. FS_XTALT's upper bits are 011.
    for (code, ppm) in [(17u8, 0.0), (5, 20.0), (30, -18.0)] {
        host.write(0x2B, 0x0E, &[0x60 | code]);
        assert!((host.node.chip().clock_ppm(world.now()) - ppm).abs() < 0.01, "{code}");
    }
}
