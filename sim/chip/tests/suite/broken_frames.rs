//! Frames whose sender stops in the middle: the effect on the receivers that follow them.

use crate::host::*;
use dw1000_sim::World;
use embedded_hal::digital::OutputPin;

const BODY: [u8; 10] = [0x41, 0x88, 7, 0xCA, 0xDE, 2, 0, 1, 0, 0x55];

#[derive(Clone, Copy, Debug)]
enum Cause {
    Trxoff,
    ResetLine,
    SupplyOff,
}

fn stop(sender: &mut Host, cause: Cause) {
    match cause {
        Cause::Trxoff => sender.command(TRXOFF),
        Cause::ResetLine => {
            let Ok(()) = sender.p.reset.set_low();
        }
        Cause::SupplyOff => sender.node.power_off(),
    }
}

/// A sender at 0 m, a receiver at 30 m that listens, and a third at 15 m.
fn three() -> (World, Host, Host, Host) {
    let world = World::new(9, quiet());
    let [a, b, c] = [0.0, 30.0, 15.0].map(|x| ready(&world, x, chip(1_000)));
    b.clear_status();
    b.command(RXENAB);
    b.after_us(20);
    (world, a, b, c)
}

#[test]
fn a_frame_cut_in_its_preamble_has_no_delimiter_and_ends_in_its_timeout() {
    for cause in [Cause::Trxoff, Cause::ResetLine, Cause::SupplyOff] {
        let (_, mut a, b, _) = three();
        a.prepare(&BODY);
        a.command(TXSTRT);
        a.after_us(60);
        stop(&mut a, cause);
        // The preamble is found after 14 symbols. DRX_SFDTOC is 4161 symbols of 993.59 ns after reset: 4134.3 µs.
        b.after_us(4_050);
        assert_eq!(b.status() & (RXPRD | RXSFDD | RXPHE | RXSFDTO), RXPRD, "{cause:?}");
        assert_eq!(b.read::<1>(0x19, 2), [5], "still receives");
        b.after_us(100);
        assert_eq!(b.status() & (RXPRD | RXSFDD | RXPHE | RXSFDTO), RXPRD | RXSFDTO, "{cause:?}");
        assert_eq!(b.read::<1>(0x19, 2), [1], "idle");
    }
}

#[test]
fn a_frame_that_begins_where_a_cut_one_would_have_had_its_header_is_no_matter() {
    // The RMARKER is 145 µs after the command and the end of the header 167 µs after it. Another frame begins in each
    // microsecond in between.
    for cause in [Cause::Trxoff, Cause::ResetLine, Cause::SupplyOff] {
        for begin_us in 40..90 {
            let (world, mut a, b, c) = three();
            a.prepare(&BODY);
            c.prepare(&BODY);
            a.command(TXSTRT);
            a.after_us(60);
            stop(&mut a, cause);
            c.after_us(begin_us);
            c.command(TXSTRT);
            c.after_us(400);
            assert_eq!(b.status() & (RXSFDD | RXPHE | RXFCG), 0, "{cause:?} {begin_us}: waits for the first delimiter");
            assert_eq!(world.statistics().frames_sent, 2);
            assert_eq!(world.statistics().lost_to_noise, 1, "the frame that was cut");
        }
    }
}

#[test]
fn a_preamble_that_ends_before_it_is_found_is_not_found() {
    // The preamble begins 10 µs after the command and takes 14 symbols to be found. It is cut after 5.
    let (_, a, b, c) = three();
    a.prepare(&BODY);
    c.prepare(&BODY);
    a.command(TXSTRT);
    a.after_us(10);
    a.command(TRXOFF);
    b.after_us(100);
    assert_eq!(b.status() & RXPRD, 0);
    c.send(&BODY);
    assert_ne!(b.status() & RXFCG, 0, "the receiver is free for the next");
}

#[test]
fn a_frame_cut_in_its_payload_is_damaged() {
    let (_, a, b, _) = three();
    a.prepare(&BODY);
    a.command(TXSTRT);
    // The payload lasts from 167 to 185 µs after the command.
    a.after_us(165);
    a.command(TRXOFF);
    a.after_us(400);
    assert_eq!(a.status() & TXFRS, 0);
    let status = b.status();
    assert_eq!(status & (RXSFDD | RXPHD | RXFCG), RXSFDD | RXPHD, "{status:x}");
    assert_ne!(status & (RXRFSL | RXFCE), 0, "{status:x}");
}

#[test]
fn a_cut_frame_disturbs_others_only_until_it_was_cut() {
    let (_, a, b, c) = three();
    b.command(TRXOFF);
    a.prepare(&BODY);
    c.prepare(&BODY);
    a.command(TXSTRT);
    a.after_us(60);
    a.command(TRXOFF);
    b.command(RXENAB);
    b.after_us(20);
    // The first frame would have lasted for another 90 µs. The third node is 15 m from the receiver, the first 30 m:
    // 6.02 dB.
    c.command(TXSTRT);
    c.after_us(400);
    assert_ne!(b.status() & RXFCG, 0);
}
