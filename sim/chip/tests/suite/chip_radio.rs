//! Tests of the chip's transmitter and receiver at register level. The expected instants and values are calculated by
//! hand.

use crate::host::*;
use dw1000_sim::{AirConfig, ClockConfig, World};
use std::cell::RefCell;
use std::rc::Rc;

const BODY: [u8; 10] = [0x41, 0x88, 7, 0xCA, 0xDE, 2, 0, 1, 0, 0x55];

/// A sender at 0 m and a receiver at 30 m.
fn pair(air: AirConfig) -> (World, Host, Host) {
    let world = World::new(9, air);
    let sender = ready(&world, 0.0, chip(1_000));
    let receiver = ready(&world, 30.0, chip(MASK - 5_000));
    (world, sender, receiver)
}

fn listen(host: &Host) {
    host.clear_status();
    host.command(RXENAB);
    host.after_us(20);
}

#[test]
fn a_frame_goes_through_every_status_bit() {
    let (_, a, b) = pair(quiet());
    listen(&b);
    a.prepare(&BODY);
    a.command(TXSTRT);
    a.after_us(80);
    assert_eq!(a.status() & (TXFRB | TXPRS | TXFRS), TXFRB);
    assert_eq!(b.status() & (RXPRD | RXSFDD), RXPRD);
    a.after_us(80);
    assert_eq!(a.status() & (TXFRB | TXPRS | TXFRS), TXFRB | TXPRS);
    assert_eq!(b.status() & (RXPRD | RXSFDD | RXDFR), RXPRD | RXSFDD);
    a.after_us(40);
    assert_eq!(a.status() & (TXPHS | TXFRS), TXPHS | TXFRS);
    let all = RXPRD | RXSFDD | LDEDONE | RXPHD | RXDFR | RXFCG;
    assert_eq!(b.status() & (all | RXFCE | RXPHE | RXRFSL), all);
    assert_eq!(b.received(), BODY);
    // CRC-16/KERMIT over the ten bytes, computed bit by bit below; the chip uses a table.
    assert_eq!(b.received::<12>()[10..], kermit(&BODY).to_le_bytes());
    // RX_FINFO: 12 bytes, 6.81 Mbit/s, ranging bit, PRF 16, 128 symbols.
    let info = b.read_u32(0x10, 0);
    assert_eq!(info & 0x000F_FFFF, 12 | 1 << 11 | 2 << 13 | 1 << 15 | 1 << 16 | 1 << 18);
    // 128 symbols minus 14 to find the preamble, plus 5 of the delimiter.
    assert_eq!(info >> 20, 119);
    assert_eq!(b.read(0x27, 0x2C), 119u16.to_le_bytes());
}

/// Microseconds until the host's interrupt line rises.
fn until_interrupt_us(world: &World, host: &Host) -> f64 {
    let from = world.now();
    let mut irq = host.node.peripherals().irq;
    world.block_on(embedded_hal_async::digital::Wait::wait_for_high(&mut irq)).unwrap().unwrap();
    world.now().ps_since(from) as f64 / 1e6
}

/// Bit by bit, least significant first, polynomial 0x8408 (ITU-T V.41 as IEEE 802.15.4 uses it).
fn kermit(bytes: &[u8]) -> u16 {
    let mut crc = 0u16;
    for &byte in bytes {
        crc ^= u16::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 != 0 { crc >> 1 ^ 0x8408 } else { crc >> 1 };
        }
    }
    crc
}

#[test]
fn delayed_transmission_ignores_nine_bits_and_stamps_agree_with_the_distance() {
    let (_, a, b) = pair(quiet());
    a.write(0x18, 0, &16_436u16.to_le_bytes());
    b.write(0x2E, 0x1804, &16_436u16.to_le_bytes());
    listen(&b);
    a.prepare(&BODY);
    let at = (a.read_u40(0x06, 0) + (1000.0 * MICROSECOND) as u64 + 300) & MASK;
    a.write_u40(0x0A, at);
    a.command(TXSTRT | TXDLYS);
    a.after_us(2000);
    assert_eq!(a.status() & (HPDWARN | TXPUTE), 0);
    assert_eq!(a.read_u40(0x17, 5), at & !511, "TX_RAWST");
    assert_eq!(a.read_u40(0x17, 0), (at & !511) + 16_436, "TX_STAMP");
    // The counters were started 6 000 apart (across the wrap), at the same instant except for 5 ms and one transaction,
    // so take them from the chips themselves. 30 m are 6396.06 ticks.
    let now = a.world.now();
    let apart = b.node.chip().counter(now).wrapping_sub(a.node.chip().counter(now)) & MASK;
    let flight = b.read_u40(0x15, 0).wrapping_sub(a.read_u40(0x17, 0)).wrapping_sub(apart) & MASK;
    assert!(flight.abs_diff(6396) <= 1, "{flight}");
    // The raw time stamp: on the 125 MHz clock, without subtracting the antenna delay.
    let raw = b.read_u40(0x15, 9);
    assert_eq!(raw & 511, 0);
    assert!((b.read_u40(0x15, 0) + 16_436 - raw) & MASK < 512);
}

#[test]
fn a_late_start_warns_and_stays_silent_until_switched_off() {
    let (world, a, _) = pair(quiet());
    a.write_u32(0x2F, 0, 1);
    a.prepare(&BODY);
    // The RMARKER is due in 100 µs, but the preamble alone takes 135 µs.
    a.write_u40(0x0A, (a.read_u40(0x06, 0) + (120.0 * MICROSECOND) as u64) & MASK);
    a.command(TXSTRT | TXDLYS);
    assert_ne!(a.status() & HPDWARN, 0);
    assert_eq!(a.read(0x2F, 0x18), [1, 0], "EVC_HPW");
    a.after_us(5000);
    assert_eq!(a.status() & TXFRS, 0);
    assert_eq!(a.read::<1>(0x19, 2), [2], "PMSC_STATE: waits to send");
    a.command(TRXOFF);
    a.after_us(20_000_000);
    assert_eq!(world.statistics().frames_sent, 0);
}

#[test]
fn a_start_that_leaves_no_time_to_power_up_is_told() {
    let (world, a, _) = pair(quiet());
    a.prepare(&BODY);
    // 135.1 µs of preamble, a few microseconds of bus time for DX_TIME and SYS_CTRL (6 + 5 bytes, 11 µs) and 4 µs to
    // spare.
    a.write_u40(0x0A, (a.read_u40(0x06, 0) + (152.0 * MICROSECOND) as u64) & MASK);
    a.command(TXSTRT | TXDLYS);
    assert_eq!(a.status() & (TXPUTE | HPDWARN), TXPUTE);
    a.after_us(500);
    assert_eq!(world.statistics().frames_sent, 1);
}

#[test]
fn a_late_start_left_alone_goes_out_when_the_counter_comes_round() {
    let (world, a, _) = pair(quiet());
    a.prepare(&BODY);
    a.write_u40(0x0A, a.read_u40(0x06, 0));
    a.command(TXSTRT | TXDLYS);
    // 2⁴⁰ ticks are 17.2074 s.
    a.after_us(17_200_000);
    assert_eq!(world.statistics().frames_sent, 0);
    a.after_us(10_000);
    assert_eq!(world.statistics().frames_sent, 1);
}

#[test]
fn delayed_reception_hears_what_comes_after_its_start() {
    // Finding a preamble takes 14 of its 128 symbols: 28 are left at 1100 µs, 7 at 1120 µs.
    for (start_us, hears) in [(900.0, true), (1_100.0, true), (1_120.0, false)] {
        let (_, a, b) = pair(quiet());
        b.clear_status();
        let (now_a, now_b) = (a.read_u40(0x06, 0), b.read_u40(0x06, 0));
        b.write_u40(0x0A, (now_b + (start_us * MICROSECOND) as u64) & MASK);
        b.command(RXENAB | RXDLYE);
        a.prepare(&BODY);
        // RMARKER at 1135 µs: the preamble begins at 1000 µs.
        a.write_u40(0x0A, (now_a + (1_135.0 * MICROSECOND) as u64) & MASK);
        a.command(TXSTRT | TXDLYS);
        a.after_us(1_500);
        assert_eq!(b.status() & RXFCG != 0, hears, "{start_us}");
    }
}

#[test]
fn a_delayed_reception_in_the_past_warns() {
    let (_, _, b) = pair(quiet());
    b.write_u40(0x0A, (b.read_u40(0x06, 0).wrapping_sub(1_000_000)) & MASK);
    b.command(RXENAB | RXDLYE);
    assert_ne!(b.status() & HPDWARN, 0);
}

#[test]
fn wait_for_response_turns_the_receiver_on_after_its_delay() {
    // The answer's preamble begins 60 µs after the end of the first frame. A preamble of 128 symbols lasts 127 µs.
    for (turn_us, hears) in [(0u32, true), (40, true), (300, false)] {
        let (_, a, b) = pair(quiet());
        a.write_u32(0x1A, 0, turn_us);
        listen(&b);
        a.prepare(&BODY);
        b.prepare(&[1, 2, 3]);
        a.command(TXSTRT | WAIT4RESP);
        // 185.4 µs until the frame has left; the command's own 5 µs have passed.
        a.after_us(185);
        b.command(TRXOFF);
        a.after_us(50);
        b.command(TXSTRT);
        a.after_us(400);
        assert_eq!(a.status() & RXFCG != 0, hears, "{turn_us}");
    }
}

#[test]
fn frame_wait_timeout_in_units_of_1_0256_microseconds() {
    let (world, _, b) = pair(quiet());
    b.write(0x0C, 0, &1000u16.to_le_bytes());
    b.write_u32(0x04, 0, 0x1200 | 1 << 28);
    b.write_u32(0x0E, 0, RXRFTO as u32);
    b.clear_status();
    b.command(RXENAB);
    // 16 µs until the receiver is on and 1000 × 512 / 499.2 MHz = 1025.64 µs.
    let passed = until_interrupt_us(&world, &b);
    assert!((passed - 1041.64).abs() < 0.02, "{passed}");
    assert_ne!(b.status() & RXRFTO, 0);
    assert_eq!(b.read::<1>(0x19, 2), [1], "idle");
}

#[test]
fn preamble_timeout_counts_one_chunk_more() {
    let (world, a, b) = pair(quiet());
    b.write(0x27, 0x24, &9u16.to_le_bytes());
    b.write_u32(0x0E, 0, RXPTO as u32);
    b.clear_status();
    b.command(RXENAB);
    // 16 µs and (9 + 1) chunks of 8 symbols of 993.59 ns = 79.49 µs.
    let passed = until_interrupt_us(&world, &b);
    assert!((passed - 95.49).abs() < 0.02, "{passed}");
    // A preamble found in time stops it.
    b.clear_status();
    a.prepare(&BODY);
    a.command(TXSTRT);
    b.command(RXENAB);
    a.after_us(400);
    assert_eq!(b.status() & (RXPTO | RXFCG), RXFCG);
}

#[test]
fn another_delimiter_times_out() {
    let (_, a, b) = pair(quiet());
    // DWSFD with 8 symbols at the receiver only. The receiver waits for 200 symbols.
    b.write(0x21, 0, &[8]);
    b.write_u32(0x1F, 0, 0x2104_0055 | 1 << 17);
    b.write(0x27, 0x20, &200u16.to_le_bytes());
    listen(&b);
    a.send(&BODY);
    assert_eq!(b.status() & (RXPRD | RXSFDD | RXSFDTO), RXPRD | RXSFDTO);
}

#[test]
fn a_delimiter_must_come_within_its_timeout_which_zero_disables() {
    // 14 of 128 symbols to find the preamble: 114 and the delimiter's 8 are left.
    for (symbols, hears, times_out) in [(121u16, false, true), (123, true, false), (0, true, false)] {
        let (_, a, b) = pair(quiet());
        b.write(0x27, 0x20, &symbols.to_le_bytes());
        listen(&b);
        a.send(&BODY);
        assert_eq!(b.status() & RXFCG != 0, hears, "{symbols}");
        assert_eq!(b.status() & RXSFDTO != 0, times_out, "{symbols}");
    }
    // The timeout is disabled, and the delimiter is another one: the receiver waits for ever.
    let (_, a, b) = pair(quiet());
    b.write(0x21, 0, &[8]);
    b.write_u32(0x1F, 0, 0x2104_0055 | 1 << 17);
    b.write(0x27, 0x20, &[0, 0]);
    listen(&b);
    a.send(&BODY);
    b.after_us(10_000_000);
    assert_eq!(b.status() & RXSFDTO, 0);
    assert_eq!(b.read::<1>(0x19, 2), [5]);
}

#[test]
fn another_rate_channel_or_code_is_not_heard() {
    // At the receiver: RXM110K; channel 2; preamble code 3.
    for (config, channel) in [(1 << 22, 0x2104_0055), (0, 0x2104_0022), (0, 0x1904_0055)] {
        let (_, a, b) = pair(quiet());
        b.write_u32(0x04, 0, 0x1200 | config);
        b.write_u32(0x1F, 0, channel);
        listen(&b);
        a.send(&BODY);
        assert_eq!(b.status() & (RXSFDD | RXDFR), 0, "{config:x} {channel:x}");
    }
}

#[test]
fn a_header_in_another_mode_is_an_error() {
    let (_, a, b) = pair(quiet());
    a.write_u32(0x04, 0, 0x1200 | 3 << 16);
    listen(&b);
    a.send(&BODY);
    assert_eq!(b.status() & (RXSFDD | RXPHE | RXDFR), RXSFDD | RXPHE);
}

#[test]
fn long_frames_pass_in_long_mode() {
    // 302 bytes take more than 500 µs: no smart power, hence the short distance.
    let world = World::new(9, quiet());
    let (a, b) = (ready(&world, 0.0, chip(0)), ready(&world, 3.0, chip(0)));
    for host in [&a, &b] {
        host.write_u32(0x04, 0, 0x1200 | 3 << 16);
    }
    listen(&b);
    let body: Vec<u8> = (0..300).map(|i| i as u8).collect();
    a.send(&body);
    assert_eq!(b.received::<300>().to_vec(), body);
    assert_eq!(b.read_u32(0x10, 0) & 0x3FF, 302);
}

#[test]
fn wrong_check_bytes_are_told_and_offsets_work() {
    let (_, a, b) = pair(quiet());
    listen(&b);
    // SFCST: the last two bytes come from the buffer, here from offset 16 on (TXBOFFS).
    a.write(0x09, 16, &[9, 8, 7, 6, 5]);
    a.write_u32(0x08, 0, 0x0015_4000 | 5 | 16 << 22);
    a.command(TXSTRT | SFCST);
    a.after_us(400);
    assert_eq!(b.status() & (RXDFR | RXFCG | RXFCE), RXDFR | RXFCE);
    assert_eq!(b.received(), [9, 8, 7, 6, 5]);
    // RX_BUFFER too is read from any offset.
    assert_eq!(b.read(0x11, 2), [7, 6]);
}

#[test]
fn bytes_written_during_the_preamble_are_sent() {
    let (_, a, b) = pair(quiet());
    listen(&b);
    a.prepare(&[0; 4]);
    a.command(TXSTRT);
    a.after_us(60);
    a.write(0x09, 0, &[4, 3, 2, 1]);
    a.after_us(300);
    assert_eq!(b.received(), [4, 3, 2, 1]);
    assert_ne!(b.status() & RXFCG, 0);
}

#[test]
fn the_frame_filter_rejects_within_the_header_and_re_enables_if_told() {
    for (again, state) in [(0, 1), (1 << 29, 5)] {
        let (_, a, b) = pair(quiet());
        // The filter is on and allows data frames. PAN 0xDECA; our address is 3, the frame is for 2.
        b.write_u32(0x03, 0, 0xDECA_0003);
        b.write_u32(0x04, 0, 0x1200 | 1 | 1 << 3 | again);
        b.write_u32(0x2F, 0, 1);
        listen(&b);
        a.send(&BODY);
        // Being enabled again clears the event.
        assert_eq!(b.status() & (AFFREJ | RXDFR), if again == 0 { AFFREJ } else { 0 });
        assert_eq!(b.read(0x2F, 0x0C), [1, 0], "EVC_FFR");
        assert_eq!(b.read::<1>(0x19, 2), [state]);
        b.command(TRXOFF);
        b.write_u32(0x03, 0, 0xDECA_0002);
        listen(&b);
        a.send(&BODY);
        assert_eq!(b.status() & (AFFREJ | RXFCG), RXFCG);
    }
}

#[test]
fn two_buffers_take_two_frames_and_a_third_overruns() {
    let (_, a, b) = pair(quiet());
    // Double buffering, automatic re-enabling.
    b.write_u32(0x04, 0, 0x0200 | 1 << 29);
    listen(&b);
    a.send(&[1, 1, 1]);
    assert_eq!(b.status() & (RXFCG | HSRBP | ICRBP), RXFCG | ICRBP);
    a.send(&[2, 2, 2]);
    assert_eq!(b.status() & (RXFCG | HSRBP | ICRBP | RXOVRR), RXFCG);
    assert_eq!(b.received(), [1, 1, 1]);
    let first = b.read_u40(0x15, 0);
    b.command(HRBPT);
    assert_eq!(b.status() & (RXFCG | HSRBP | ICRBP), RXFCG | HSRBP);
    assert_eq!(b.received(), [2, 2, 2]);
    assert_ne!(b.read_u40(0x15, 0), first, "each set has its stamp");
    b.command(HRBPT);
    assert_eq!(b.status() & (RXFCG | RXDFR), 0, "nothing more");
    for byte in 3..6 {
        a.send(&[byte; 3]);
    }
    assert_ne!(b.status() & RXOVRR, 0);
    assert_eq!(b.received(), [3, 3, 3]);
}

#[test]
fn without_a_receiver_reset_after_a_timeout_the_next_stamp_is_wrong() {
    // User manual, 4.1.6.
    let flight = |reset: bool| {
        let (_, a, b) = pair(quiet());
        b.write(0x0C, 0, &10u16.to_le_bytes());
        b.write_u32(0x04, 0, 0x1200 | 1 << 28);
        listen(&b);
        b.after_us(100);
        assert_ne!(b.status() & RXRFTO, 0);
        b.write_u32(0x04, 0, 0x1200);
        if reset {
            b.write(0x36, 3, &[0xE0]);
            b.write(0x36, 3, &[0xF0]);
        }
        listen(&b);
        a.send(&BODY);
        let now = a.world.now();
        let apart = b.node.chip().counter(now).wrapping_sub(a.node.chip().counter(now));
        let raw = b.read_u40(0x15, 0).wrapping_sub(a.read_u40(0x17, 0)).wrapping_sub(apart) & MASK;
        (raw as f64 - 2.0 * 16_436.0) * METRES_PER_TICK
    };
    assert!((flight(true) - 30.0).abs() < 0.01);
    assert!((flight(false) - 30.0).abs() > 0.25);
}

#[test]
fn without_microcode_there_is_no_stamp() {
    let world = World::new(9, quiet());
    let (a, b) = (ready(&world, 0.0, chip(0)), started(&world, 30.0, chip(0)));
    listen(&b);
    a.send(&BODY);
    assert_eq!(b.status() & (RXFCG | LDEDONE | LDEERR), RXFCG | LDEERR);
    assert_eq!(b.read_u40(0x15, 0), 0);
    assert_ne!(b.read_u40(0x15, 9), 0);
    // If the crystal's clock ends after 100 of its 150 µs, the microcode is incomplete.
    b.write(0x36, 0, &[0x01, 0x03]);
    b.write(0x2D, 0x06, &[0x00, 0x80]);
    b.after_us(100);
    b.write(0x36, 0, &[0x00, 0x02]);
    listen(&b);
    a.send(&BODY);
    assert_eq!(b.status() & LDEDONE, 0);
}

#[test]
fn diagnostics_give_power_and_clock_offset_back() {
    let world = World::new(9, quiet());
    let mut fast = chip(0);
    fast.clock = ClockConfig { offset_ppm: 20.0, ..ClockConfig::IDEAL };
    let (a, b) = (ready(&world, 0.0, fast), ready(&world, 30.0, chip(0)));
    listen(&b);
    a.send(&BODY);
    let word = |file, offset| f64::from(u16::from_le_bytes(b.read(file, offset)));
    let n = f64::from(b.read_u32(0x10, 0) >> 20) - 5.0;
    let rx = 10.0 * (word(0x12, 6) * 131_072.0 / (n * n)).log10() - 113.77;
    let [f1, f2, f3] = [word(0x15, 7), word(0x12, 2), word(0x12, 4)];
    let fp = 10.0 * ((f1 * f1 + f2 * f2 + f3 * f3) / (n * n)).log10() - 113.77;
    // TX_POWER after reset, 0x1E080222, with smart power and 185 µs of frame: BOOSTP250 = 0x08 = 22 dB against the
    // recommended 0x48 = 16 dB: −8.3 dBm. Friis over 30 m at channel 5: 48.69 + 29.54 dB. −86.54 dBm reads as −88.27
    // dBm (figure 22).
    assert!((rx + 88.27).abs() < 0.1, "{rx}");
    assert!((fp - rx).abs() < 0.5, "{fp}");
    // The sender is 20 ppm fast, so our clock is 20 ppm slow against it: −20 × 10⁻⁶ × 6489.6 MHz / 3.71933 Hz per step
    // = −34 897 steps. Noise of 0.05 ppm is 87 steps. The value does not fit into 16 bits.
    let [c0, c1, c2] = b.read(0x27, 0x28);
    let carrier = i32::from_le_bytes([c0, c1, c2, 0]) << 11 >> 11;
    assert!((carrier + 34_897).abs() < 400, "{carrier}");
    // RXTOFS / RXTTCKI = −20 ppm, with 0.2 ppm of noise.
    let interval = f64::from(b.read_u32(0x13, 0));
    let offset = f64::from((b.read_u32(0x14, 0) << 13) as i32 >> 13);
    assert!((offset / interval * 1e6 + 20.0).abs() < 1.0);
}

#[test]
fn the_accumulator_needs_its_clock_begins_with_a_dummy_and_matches_the_diagnostics() {
    let (_, a, b) = pair(quiet());
    listen(&b);
    a.send(&BODY);
    let edge = u16::from_le_bytes(b.read(0x15, 5)) / 64;
    let at = 4 * (edge + 1);
    assert_eq!(b.read(0x25, at), [0u8; 13], "no clock, no samples");
    // RXCLKS from the PLL, FACE, AMCE.
    b.write(0x36, 0, &[0x48, 0x80]);
    let data: [u8; 13] = b.read(0x25, at);
    assert_eq!(data[0], 0);
    let magnitude = |k: usize| {
        let part = |i: usize| f64::from(i16::from_le_bytes([data[i], data[i + 1]]));
        part(1 + 4 * k).hypot(part(3 + 4 * k)).round()
    };
    let word = |file, offset| f64::from(u16::from_le_bytes(b.read(file, offset)));
    // One, two and three samples beyond the first path: FP_AMPL3, FP_AMPL2, FP_AMPL1.
    assert_eq!([magnitude(0), magnitude(1), magnitude(2)], [word(0x12, 4), word(0x12, 2), word(0x15, 7)]);
    let peak = word(0x2E, 0x1000) - f64::from(edge);
    assert!((1.0..=3.0).contains(&peak), "{peak}");
    // 992 samples at PRF 16. Beyond the last sample the accumulator reads as zero.
    assert_eq!(b.read(0x25, 4 * 992), [0u8; 5]);
}

#[test]
fn temperature_and_supply_move_a_range() {
    let stamp = |celsius: f64, volts: f64| {
        let world = World::new(9, quiet());
        let mut config = chip(0);
        (config.temperature_c, config.supply_v) = (celsius, volts);
        let (a, b) = (ready(&world, 0.0, chip(0)), ready(&world, 30.0, config));
        listen(&b);
        a.send(&BODY);
        b.read_u40(0x15, 0) as f64 * METRES_PER_TICK
    };
    let reference = stamp(23.0, 3.3);
    // Half of 20 °C × 2.15 mm, and half of 0.2 V × 5.35 cm. Time stamps are whole ticks of 4.7 mm.
    assert!((stamp(43.0, 3.3) - reference - 0.0215).abs() < 0.005);
    assert!((stamp(23.0, 3.5) - reference - 0.005_35).abs() < 0.005);
}

#[test]
fn starting_while_not_idle_is_ignored() {
    let (world, a, b) = pair(quiet());
    listen(&b);
    b.prepare(&BODY);
    b.command(TXSTRT);
    b.after_us(500);
    assert_eq!(world.statistics().frames_sent, 0);
    assert_eq!(b.node.chip_statistics().not_idle, 1);
    a.send(&BODY);
    assert_ne!(b.status() & RXFCG, 0, "it went on listening");
}

#[test]
fn a_sniffer_sees_bytes_with_their_check_and_the_marker() {
    let (world, a, _) = pair(quiet());
    let seen = Rc::new(RefCell::new(Vec::new()));
    let log = seen.clone();
    world.sniff(move |f| log.borrow_mut().push((f.marker, f.bytes.to_vec(), f.power_dbm)));
    let before = world.now();
    a.send(&BODY);
    let (marker, bytes, power) = seen.borrow()[0].clone();
    assert_eq!(bytes[..10], BODY);
    assert_eq!(bytes[10..], kermit(&BODY).to_le_bytes());
    assert!((power + 8.3).abs() < 1e-9, "{power}");
    // Three transactions of 11, 5 and 5 bytes at 8 MHz, 10 µs, 136 symbols, 257 ns of antenna delay, and up to 8 ns of
    // rounding.
    let passed = marker.ps_since(before) as f64 / 1e6;
    assert!((166.385..166.394).contains(&passed), "{passed}");
}
