//! Tests of the charge that a chip draws from its supply. The expected values are products of times and currents,
//! calculated by hand.

use crate::host::*;
use dw1000_sim::{ChipConfig, Consumption, Currents, World};
use embedded_hal_async::spi::Operation;
use std::time::Duration;

const BODY: [u8; 10] = [0x41, 0x88, 7, 0xCA, 0xDE, 2, 0, 1, 0, 0x55];

/// The charge that `act` takes, microcoulombs.
fn drawn(host: &Host, act: impl FnOnce(&Host)) -> f64 {
    let before = host.node.consumption().charge_uc;
    act(host);
    host.node.consumption().charge_uc - before
}

#[track_caller]
fn assert_near(value: f64, expected: f64) {
    assert!((value - expected).abs() < 1e-3 * expected.max(1e-3), "{value} against {expected}");
}

#[test]
fn the_figures_quoted_from_the_data_sheet() {
    // Data sheet 2.17, page 30, as public energy accounting quotes it: channel 2, PRF 64, 128 symbols, 6.8 Mbit/s; and
    // its first page.
    let currents = Currents::TYPICAL;
    assert_eq!((currents.transmit_preamble_64_ma, currents.transmit_data_fast_ma), (83.0, 52.0));
    assert_eq!((currents.receive_preamble_ma, currents.receive_data_fast_ma), (113.0, 118.0));
    assert_eq!((currents.idle_ma, currents.sleep_ma, currents.deep_sleep_ma), (18.0, 0.001, 0.000_05));
}

#[test]
fn power_up_takes_the_crystals_start_and_the_plls_lock() {
    let world = World::new(1, quiet());
    let host = started(&world, 0.0, chip(0));
    let Consumption { charge_uc, wake_up_s, init_s, idle_s, .. } = host.node.consumption();
    // Of the 5 ms that have passed: 3 ms at 3 mA, 40 µs at 4 mA, 1.96 ms at 18 mA.
    assert_near(wake_up_s, 3e-3);
    assert_near(init_s, 40e-6);
    assert_near(idle_s, 1.96e-3);
    assert_near(charge_uc, 9.0 + 0.16 + 35.28);
}

#[test]
fn a_receiver_that_hears_nothing_draws_for_its_hunt() {
    let world = World::new(1, quiet());
    let host = ready(&world, 0.0, chip(0));
    host.command(RXENAB);
    // The receiver is on 16 µs after the command.
    host.after_us(20);
    // 100 ms at 113 mA.
    assert_near(drawn(&host, |h| h.after_us(100_000)), 11_300.0);
    host.command(TRXOFF);
    // 100 ms at 18 mA.
    assert_near(drawn(&host, |h| h.after_us(100_000)), 1_800.0);
}

#[test]
fn a_frame_draws_for_its_preamble_and_its_data() {
    let world = World::new(1, quiet());
    let (a, b) = (ready(&world, 0.0, chip(0)), ready(&world, 30.0, chip(0)));
    // PRF 64, preamble code 9: CHAN_CTRL, TX_FCTRL; 12 bytes at 6.8 Mbit/s, 128 symbols.
    for host in [&a, &b] {
        host.write_u32(0x1F, 0, 0x4A48_0055);
        host.write(0x09, 0, &BODY);
        host.write_u32(0x08, 0, 12 | 2 << 13 | 1 << 15 | 2 << 16 | 0b0101 << 18);
    }
    b.command(RXENAB);
    b.after_us(20);
    let (sent_before, heard_before) = (a.node.consumption(), b.node.consumption());
    a.command(TXSTRT);
    a.after_us(1_000);
    assert_ne!(b.status() & RXFCG, 0);
    let (sent, heard) = (a.node.consumption(), b.node.consumption());
    // 136 symbols of 1017.63 ns: 138.397 µs at 83 mA. 21 bits of 1025.64 ns and 96 + 48 bits of 128.205 ns: 40.0 µs at
    // 52 mA.
    assert_near(sent.transmit_preamble_s - sent_before.transmit_preamble_s, 138.397e-6);
    assert_near(sent.transmit_data_s - sent_before.transmit_data_s, 40.0e-6);
    let idle_s = sent.idle_s - sent_before.idle_s;
    assert_near(sent.charge_uc - sent_before.charge_uc, 11.487 + 2.080 + idle_s * 18_000.0);
    assert_near(sent.transmit_uc - sent_before.transmit_uc, 11.487 + 2.080);
    assert_near(sent.receive_uc, 0.0);
    // The receiver has the same 40 µs at 118 mA. Before, it searches and follows at 113 mA.
    assert_near(heard.receive_data_s - heard_before.receive_data_s, 40.0e-6);
    let hunt_s = heard.receive_preamble_s - heard_before.receive_preamble_s;
    let idle_s = heard.idle_s - heard_before.idle_s;
    assert_near(heard.charge_uc - heard_before.charge_uc, 4.720 + hunt_s * 113_000.0 + idle_s * 18_000.0);
    assert_near(heard.receive_uc - heard_before.receive_uc, 4.720 + hunt_s * 113_000.0);
}

#[test]
fn sleep_draws_a_thousandth_of_a_milliampere_and_deep_sleep_less() {
    let world = World::new(1, quiet());
    for (by_counter, microcoulombs) in [(true, 10.0), (false, 0.5)] {
        let host = ready(&world, 0.0, chip(0));
        // WAKE_CNT after 100 counts of 0.431 s, or WAKE_SPI.
        host.write_u32(0x2C, 0x06, 1 | if by_counter { 1 << 3 | 100 << 16 } else { 1 << 2 });
        host.write(0x2C, 0x02, &[0]);
        host.write(0x2C, 0x02, &[2]);
        // Ten seconds at 1 µA, or at 50 nA.
        assert_near(drawn(&host, |h| h.after_us(10_000_000)), microcoulombs);
        let slept = host.node.consumption();
        assert_near(if by_counter { slept.sleep_s } else { slept.deep_sleep_s }, 10.0);
    }
}

#[test]
fn without_supply_nothing_is_drawn() {
    let world = World::new(1, quiet());
    let host = ready(&world, 0.0, chip(0));
    host.node.power_off();
    assert_eq!(drawn(&host, |h| h.after_us(1_000_000)), 0.0);
    assert_near(host.node.consumption().off_s, 1.0);
}

#[test]
fn a_measured_board_brings_its_own_currents() {
    let world = World::new(1, quiet());
    let currents = Currents { idle_ma: 13.4, ..Currents::TYPICAL };
    let host = ready(&world, 0.0, ChipConfig { currents, ..chip(0) });
    // 1 s at 13.4 mA.
    assert_near(drawn(&host, |h| h.world.run_for(Duration::from_secs(1))), 13_400.0);
}

#[test]
fn the_times_add_up_to_all_time() {
    let world = World::new(1, quiet());
    let (a, b) = (ready(&world, 0.0, chip(0)), ready(&world, 30.0, chip(0)));
    b.command(RXENAB);
    b.after_us(500);
    a.send(&BODY);
    b.slow();
    b.write(0x36, 0, &[0x01]);
    b.after_us(700);
    b.transact(&mut [Operation::DelayNs(1_000)]);
    b.node.power_off();
    b.after_us(300);
    let Consumption {
        charge_uc: _,
        transmit_uc: _,
        receive_uc: _,
        off_s,
        deep_sleep_s,
        sleep_s,
        wake_up_s,
        init_s,
        idle_s,
        transmit_preamble_s,
        transmit_data_s,
        receive_preamble_s,
        receive_data_s,
    } = b.node.consumption();
    let sum = off_s + deep_sleep_s + sleep_s + wake_up_s + init_s + idle_s;
    let all = sum + transmit_preamble_s + transmit_data_s + receive_preamble_s + receive_data_s;
    // The chip was added 5 ms after the world's beginning, and after the first host's microcode was loaded.
    let since = world.now().as_secs_f64() - all;
    assert!((0.005..0.006).contains(&since), "{since}");
}
