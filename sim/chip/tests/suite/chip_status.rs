//! Tests of how long the bits of SYS_STATUS and SYS_CTRL stay set, as the user manual (version 2.12) specifies: pages
//! 79, 81, 87, 91, 92 and 4.3.5.

use crate::host::*;
use dw1000_sim::World;
use embedded_hal_async::digital::Wait;

const BODY: [u8; 10] = [0x41, 0x88, 7, 0xCA, 0xDE, 2, 0, 1, 0, 0x55];
const TRANSMITTED: u64 = TXFRB | TXPRS | TXPHS | TXFRS;
const RECEIVED: u64 = RXPRD | RXSFDD | LDEDONE | RXPHD | RXDFR | RXFCG;

fn pair() -> (World, Host, Host) {
    let world = World::new(9, quiet());
    let [sender, receiver] = [0.0, 30.0].map(|x| ready(&world, x, chip(1_000)));
    (world, sender, receiver)
}

fn listen(host: &Host) {
    host.command(RXENAB);
    host.after_us(20);
}

/// A frame whose check bytes are wrong.
fn send_damaged(host: &Host) {
    host.prepare(&BODY);
    host.command(TXSTRT | SFCST);
    host.after_us(600);
}

/// Sets DX_TIME to `micros` microseconds from now.
fn aim(host: &Host, micros: f64) {
    host.write_u40(0x0A, (host.read_u40(0x06, 0) + (micros * MICROSECOND) as u64) & MASK);
}

/// Runs the world until a bit of SYS_STATUS is set.
fn until_set(host: &Host, bit: u64) {
    let mut irq = host.node.peripherals().irq;
    host.write_u32(0x0E, 0, bit as u32);
    host.world.block_on(irq.wait_for_high()).expect("it comes").expect("and cannot fail");
}

#[test]
fn the_next_transmitter_enable_clears_the_transmitters_events() {
    let (_, a, _) = pair();
    a.send(&BODY);
    assert_eq!(a.status() & TRANSMITTED, TRANSMITTED);
    a.command(TXSTRT);
    assert_eq!(a.status() & TRANSMITTED, 0);
    a.after_us(50);
    assert_eq!(a.status() & TRANSMITTED, TXFRB);
}

#[test]
fn a_delayed_start_clears_them_when_it_goes_out() {
    let (_, a, _) = pair();
    a.send(&BODY);
    aim(&a, 2_000.0);
    a.command(TXSTRT | TXDLYS);
    a.after_us(1_000);
    assert_eq!(a.status() & TRANSMITTED, TRANSMITTED);
    // The preamble begins 135 µs before the RMARKER.
    a.after_us(900);
    assert_eq!(a.status() & TRANSMITTED, TXFRB);
}

#[test]
fn preamble_and_header_are_sent_when_they_are() {
    // User manual, page 87. 110 kbit/s, PRF 16, 1024 symbols, 12 bytes. After the command: 10 µs of start and 0.26 µs
    // of antenna delay, 1024 symbols of 993.59 ns, a delimiter of 64 symbols, 21 bits of 8.2051 µs, 96 + 48 bits, and
    // up to 8 ns of rounding.
    let preamble = 10.257 + 1024.0 * 0.993_59;
    let header = preamble + 64.0 * 0.993_59 + 21.0 * 8.205_128;
    let frame = header + 144.0 * 8.205_128;
    for (bit, expected) in [(TXPRS, preamble), (TXPHS, header), (TXFRS, frame)] {
        let (world, a, _) = pair();
        a.prepare(&BODY);
        a.write_u32(0x08, 0, 12 | 1 << 15 | 1 << 16 | 0b0010 << 18);
        a.command(TXSTRT);
        let started = world.now();
        until_set(&a, bit);
        let passed = world.now().ps_since(started) as f64 / 1e6;
        assert!((passed - expected).abs() < 0.02, "{bit:x}: {passed} {expected}");
    }
}

#[test]
fn the_next_receiver_enable_clears_the_receivers_events() {
    let (_, a, b) = pair();
    listen(&b);
    a.send(&BODY);
    assert_eq!(b.status() & RECEIVED, RECEIVED);
    b.command(RXENAB);
    assert_eq!(b.status() & RECEIVED, 0);
    // An enabling by the end of a transmission has the same effect.
    b.command(TRXOFF);
    b.after_us(10);
    listen(&b);
    a.send(&BODY);
    b.prepare(&BODY);
    b.command(TXSTRT | WAIT4RESP);
    b.after_us(100);
    assert_eq!(b.status() & RXFCG, RXFCG, "until then it stays");
    b.after_us(200);
    assert_eq!(b.status() & RECEIVED, 0);
}

#[test]
fn automatic_re_enabling_clears_the_error_before_the_next_frame() {
    let (_, a, b) = pair();
    // One buffer, RXAUTR.
    b.write_u32(0x04, 0, 0x1200 | 1 << 29);
    b.write_u32(0x2F, 0, 1);
    listen(&b);
    send_damaged(&a);
    assert_eq!(b.read(0x2F, 0x0A), [1, 0], "EVC_FCE counted it");
    assert_eq!(b.status() & (RXDFR | RXFCE), 0);
    a.send(&BODY);
    assert_eq!(b.status() & (RXDFR | RXFCG | RXFCE), RXDFR | RXFCG);
}

#[test]
fn a_frame_that_the_host_has_yet_to_take_keeps_its_events() {
    let (_, a, b) = pair();
    // Two buffers.
    b.write_u32(0x04, 0, 0x0200);
    listen(&b);
    a.send(&BODY);
    listen(&b);
    assert_eq!(b.status() & (RXDFR | RXFCG | LDEDONE), RXDFR | RXFCG | LDEDONE);
    assert_eq!(b.status() & RXPRD, 0, "which does not belong to the buffer");
    b.command(HRBPT);
    assert_eq!(b.status() & (RXDFR | RXFCG | LDEDONE), 0);
}

#[test]
fn the_half_period_warning_cannot_be_written_away_and_goes_with_the_start() {
    let (_, a, _) = pair();
    a.prepare(&BODY);
    aim(&a, 50.0);
    a.command(TXSTRT | TXDLYS);
    assert_ne!(a.status() & HPDWARN, 0);
    a.clear_status();
    assert_ne!(a.status() & HPDWARN, 0, "read only");
    a.command(TRXOFF);
    assert_eq!(a.status() & HPDWARN, 0, "cancelled");
    aim(&a, 2_000.0);
    a.command(TXSTRT | TXDLYS);
    assert_eq!(a.status() & HPDWARN, 0, "in time");
    a.after_us(3_000);
    assert_ne!(a.status() & TXFRS, 0);
}

#[test]
fn the_half_period_warning_goes_when_half_a_period_is_left() {
    let (world, a, b) = pair();
    a.prepare(&BODY);
    for (host, command) in [(&a, TXSTRT | TXDLYS), (&b, RXENAB | RXDLYE)] {
        // The preamble begins 135 µs before its instant. The receiver is aimed about 30 µs later than the sender.
        aim(host, if command & TXSTRT != 0 { 10_000_000.0 } else { 9_999_800.0 });
        host.write_u32(0x0E, 0, HPDWARN as u32);
        host.command(command);
        assert_ne!(host.status() & HPDWARN, 0);
    }
    // Half a period is 2³⁹ ticks, 8.603720 s. That is 1.396280 s from here, minus about 200 µs.
    a.after_us(1_396_000);
    for host in [&a, &b] {
        assert!(host.p.irq.is_high());
        assert_ne!(host.status() & HPDWARN, 0);
    }
    a.after_us(1_000);
    for host in [&a, &b] {
        assert_eq!(host.status() & HPDWARN, 0);
        assert!(!host.p.irq.is_high());
    }
    a.after_us(8_610_000);
    assert_eq!(world.statistics().frames_sent, 1);
    assert_ne!(b.status() & RXPRD, 0, "switched on in time for it");
}

#[test]
fn the_power_up_error_belongs_to_its_start() {
    let (world, a, _) = pair();
    a.prepare(&BODY);
    // 135.1 µs of preamble, 11 µs of bus and 4 µs to spare, where 10 are needed.
    let near = || {
        aim(&a, 152.0);
        a.command(TXSTRT | TXDLYS);
        assert_eq!(a.status() & (TXPUTE | HPDWARN), TXPUTE);
    };
    near();
    a.command(TRXOFF);
    assert_eq!(a.status() & TXPUTE, 0, "cancelled");
    near();
    a.after_us(500);
    assert_eq!(a.status() & (TXPUTE | TXFRS), TXFRS, "sent all the same");
    near();
    a.clear_status();
    assert_eq!(a.status() & TXPUTE, 0, "written away");
    a.after_us(500);
    aim(&a, 2_000.0);
    a.command(TXSTRT | TXDLYS);
    assert_eq!(a.status() & (TXPUTE | HPDWARN), 0);
    a.after_us(3_000);
    assert_ne!(a.status() & TXFRS, 0);
    // The cancelled frame had begun.
    assert_eq!(world.statistics().frames_sent, 4);
}

#[test]
fn a_receiver_enabled_during_a_transmission_goes_on_after_it() {
    for command in [TXSTRT, TXSTRT | TXDLYS] {
        let (_, a, b) = pair();
        aim(&a, 400.0);
        a.prepare(&BODY);
        a.command(command);
        a.command(RXENAB);
        a.after_us(700);
        assert_ne!(a.status() & TXFRS, 0, "the frame is not disturbed");
        assert_eq!(a.read::<1>(0x19, 2), [5], "receives");
        b.send(&BODY);
        assert_ne!(a.status() & RXFCG, 0);
        assert_eq!(a.node.chip_statistics().not_idle, 0);
    }
}

#[test]
fn switching_off_forgets_a_receiver_that_was_to_follow() {
    let (_, a, _) = pair();
    a.prepare(&BODY);
    a.command(TXSTRT);
    a.command(RXENAB);
    a.command(TRXOFF);
    a.after_us(500);
    assert_eq!(a.read::<1>(0x19, 2), [1], "idle");
    a.send(&BODY);
    assert_eq!(a.read::<1>(0x19, 2), [1], "idle");
}

#[test]
fn starts_to_come_read_back_from_sys_ctrl() {
    let (_, a, b) = pair();
    assert_eq!(a.read_u32(0x0D, 0), 0);
    a.prepare(&BODY);
    aim(&a, 2_000.0);
    a.command(TXSTRT | TXDLYS | WAIT4RESP);
    assert_eq!(a.read_u32(0x0D, 0), TXSTRT | TXDLYS);
    a.after_us(2_000);
    assert_eq!(a.read_u32(0x0D, 0), 0, "cleared when the frame begins");
    aim(&b, 1_000.0);
    b.command(RXENAB | RXDLYE);
    assert_eq!(b.read_u32(0x0D, 0), RXENAB | RXDLYE);
    b.after_us(1_100);
    assert_eq!(b.read_u32(0x0D, 0), 0);
    b.command(TRXOFF);
    aim(&b, 1_000.0);
    b.command(RXENAB | RXDLYE);
    b.command(TRXOFF);
    assert_eq!(b.read_u32(0x0D, 0), 0, "cancelled");
}

#[test]
fn an_overrun_aborts_looks_for_the_next_preamble_if_told_and_goes_with_the_hosts_toggle() {
    for (again, state) in [(1 << 29, 5), (0, 1)] {
        let (_, a, b) = pair();
        b.write_u32(0x2F, 0, 1);
        b.write_u32(0x04, 0, 0x0200 | again);
        for byte in 1..=2 {
            listen(&b);
            a.send(&[byte; 3]);
        }
        let stamp = b.read_u40(0x15, 0);
        listen(&b);
        a.send(&[3; 3]);
        assert_eq!(b.status() & RXOVRR, RXOVRR);
        assert_eq!(b.read(0x2F, 0x0E), [1, 0], "EVC_OVR");
        assert_eq!(b.read::<1>(0x19, 2), [state]);
        assert_eq!(b.received(), [1, 1, 1], "the buffers are not overwritten");
        assert_ne!(b.read_u40(0x15, 0), stamp, "but the stamp is corrupt");
        b.command(HRBPT);
        assert_eq!(b.status() & RXOVRR, 0);
        assert_eq!(b.received(), [2, 2, 2]);
    }
}

#[test]
fn an_overrun_aborts_at_the_end_of_the_header() {
    let (_, a, b) = pair();
    b.write_u32(0x04, 0, 0x0200);
    for byte in 1..=2 {
        listen(&b);
        a.send(&[byte; 3]);
    }
    listen(&b);
    a.prepare(&[0; 100]);
    a.command(TXSTRT);
    // The header ends 167 µs after the command, the payload of 102 bytes 120 µs later.
    a.after_us(175);
    assert_ne!(b.status() & RXOVRR, 0);
    assert_eq!(b.read::<1>(0x19, 2), [1]);
}

/// Microseconds from the first enabling of the receiver to its frame wait timeout of 2000 units. After 1 ms, `disturb`
/// sends something.
fn timeout_with(b_config: u32, disturb: impl Fn(&Host)) -> f64 {
    let (world, a, b) = pair();
    b.write(0x0C, 0, &2_000u16.to_le_bytes());
    // RXWTOE and RXAUTR.
    b.write_u32(0x04, 0, b_config | 1 << 28 | 1 << 29);
    b.command(RXENAB);
    let from = world.now();
    a.after_us(1_000);
    disturb(&a);
    until_set(&b, RXRFTO);
    world.now().ps_since(from) as f64 / 1e6
}

#[test]
fn what_brings_no_data_does_not_stop_the_frame_wait_timer() {
    // 16 µs until it is on, 2000 units of 1.025641 µs.
    let whole = 16.0 + 2_051.282;
    let header_error = timeout_with(0x1200, |a| {
        a.write_u32(0x04, 0, 0x1200 | 3 << 16);
        a.send(&BODY);
    });
    assert!((header_error - whole).abs() < 0.02, "{header_error}");
    // User manual, page 79: frames that the filter rejects. This frame is for another node.
    let rejected = timeout_with(0x1200 | 1 | 1 << 3, |a| a.send(&BODY));
    assert!((rejected - whole).abs() < 0.02, "{rejected}");
}

#[test]
fn a_frame_with_wrong_check_bytes_has_brought_data_and_the_timer_begins_anew() {
    let waited = timeout_with(0x1200, send_damaged);
    // From the frame's end, about 1.2 ms after the beginning, and after the receiver's turn-around: another 2051 µs.
    assert!((3_200.0..3_400.0).contains(&waited), "{waited}");
}
