//! After any failure, and after a future was dropped before its end, the driver still works.

use core::future::Future;
use core::pin::pin;
use core::task::{Context, Waker};

use embassy_futures::block_on;

use super::double::*;
use crate::driver::{Error, Transceiver, Wake, WakeBy};
use embedded_hal::spi::ErrorKind;
use radio::{MAX_FRAME, Radio, RadioDuration, ReceiveError, ResponseWindow, Sample, Start, TransmitError};
use std::vec::Vec;

const WINDOW: RadioDuration = RadioDuration::from_micros(1000);

#[test]
fn the_bus_may_fail_anywhere() {
    let broken = Error::Bus(ErrorKind::Other);
    for transactions in 0..6 {
        let (mut radio, bus, _) = fast(true);
        bus.answer(SYS_STATUS, &[0x81]);
        bus.fail_after(Some(transactions));
        let sent = block_on(radio.transmit(&[1, 2, 3], Start::Now, false));
        assert_eq!(sent, Err(TransmitError::Radio(broken)), "after {transactions}");
        bus.fail_after(None);
        bus.seen();
        assert!(block_on(radio.transmit(&[1, 2, 3], Start::Now, false)).is_ok());
        // It begins by switching off the transceiver, whose state it does not know.
        assert_eq!(bus.seen()[0], write(&[0x8D, 0x40]));
    }
    for transactions in 0..10 {
        let (mut radio, bus, _) = fast(true);
        bus.answer(SYS_STATUS, &[0x01, 0x6F, 0x00, 0x80]);
        bus.answer(&[0x10], &[5, 0, 0, 0]);
        bus.fail_after(Some(transactions));
        let mut buffer = [0; MAX_FRAME];
        let heard = block_on(radio.receive(&mut buffer, Start::Now, WINDOW, true));
        assert_eq!(heard, Err(ReceiveError::Radio(broken)), "after {transactions}");
        bus.fail_after(None);
        bus.seen();
        assert!(block_on(radio.receive(&mut buffer, Start::Now, WINDOW, true)).is_ok());
        assert_eq!(bus.seen()[0], write(&[0x8D, 0x40]));
    }
}

#[test]
fn a_dropped_reception_is_stopped_before_the_next_operation() {
    let (mut radio, bus, _) = fast(false);
    {
        let mut buffer = [0; MAX_FRAME];
        let mut reception = pin!(radio.receive(&mut buffer, Start::Now, WINDOW, false));
        assert!(reception.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_pending());
    }
    bus.seen();
    // The chip had filled a buffer in between (ICRBP, bit 31): the host changes to it.
    bus.answer(&[0x4F, 0x03], &[0x80]);
    block_on(radio.idle()).unwrap();
    let seen = bus.seen();
    assert_eq!(seen[0], write(&[0x8D, 0x40]));
    assert_eq!(seen[4..], [read(&[0x4F, 0x03], 1), write(&[0xCD, 0x03, 0x01])]);
    block_on(radio.idle()).unwrap();
    assert_eq!(bus.seen(), [], "off is off");
}

#[test]
fn a_transmission_without_an_end_is_given_up() {
    let (mut radio, bus, _) = fast(false);
    assert_eq!(block_on(radio.transmit(&[1], Start::Now, false)), Err(TransmitError::NoConfirmation));
    // A transmission that lost only its interrupt is a success.
    bus.answer(SYS_STATUS, &[0x80]);
    assert!(block_on(radio.transmit(&[1], Start::Now, false)).is_ok());
}

#[test]
fn nothing_works_before_init_or_asleep() {
    let not_ready = Error::NotReady;
    let mut radio =
        crate::driver::Dw1000::new(Bus::default(), Line(true), (), Delay::default(), *fast(true).0.config());
    assert_eq!(block_on(radio.now()), Err(not_ready));
    assert_eq!(block_on(radio.idle()), Err(not_ready));
    assert_eq!(block_on(radio.transmit(&[1], Start::Now, false)), Err(TransmitError::Radio(not_ready)));

    let (mut radio, bus, _) = fast(true);
    block_on(radio.sleep(Wake::Outside(WakeBy::ChipSelect))).unwrap();
    assert_eq!(
        bus.seen(),
        [
            // Restore the configuration (bit 6), load the detector (bit 11).
            write(&[0xAC, 0x40, 0x08]),
            // Sleep, wake by SPI.
            write(&[0xEC, 0x06, 0x05]),
            write(&[0xEC, 0x02, 0x00]),
            write(&[0xEC, 0x02, 0x02]),
        ]
    );
    assert_eq!(block_on(radio.now()), Err(not_ready));
    assert_eq!(bus.seen(), []);

    // CHAN_CTRL: channel 5 twice, PRF 64, code 9 twice.
    bus.answer(&[0x1F], &(5 | 5 << 4 | 0b10 << 18 | 9 << 22 | 9_u32 << 27).to_le_bytes());
    bus.answer(SYS_STATUS, &[0x02, 0, 0, 0]);
    block_on(radio.wake()).unwrap();
    let seen = bus.seen();
    assert_eq!(seen[1], Seen::Hold(600_000));
    // The wait for the PLL's lock has its detection switched on.
    let detection = seen.iter().position(|s| *s == write(&[0xA4, 0x04])).unwrap();
    assert!(detection < seen.iter().position(|s| *s == read(&[0x0F], 4)).unwrap());
    // TX_ANTD is not kept in sleep: 16436 = 0x4034.
    assert!(seen.contains(&write(&[0x98, 0x34, 0x40])));
    assert!(block_on(radio.now()).is_ok());
}

#[test]
fn a_chip_that_lost_its_configuration_asleep_is_initialised() {
    let (mut radio, bus, _) = fast(true);
    block_on(radio.sleep(Wake::Outside(WakeBy::Pin))).unwrap();
    bus.seen();
    bus.answer(&[0x00], &[0x30, 0x01, 0xCA, 0xDE]);
    bus.answer(SYS_STATUS, &[0x02, 0, 0, 0]);
    block_on(radio.wake()).unwrap();
    // AGC_TUNE2 is part of the configuration.
    assert!(bus.seen().contains(&write(&[0xE3, 0x0C, 0x07, 0xA9, 0x02, 0x25])));
}

#[test]
fn impulse_response_is_read_around_the_first_path() {
    let (mut radio, bus, _) = fast(true);
    // Sample 747 at byte 2988 = 0xBAC: low seven bits 0x2C, rest 0x17. A dummy byte, then I = −2, Q = 515.
    bus.answer(&[0x65, 0xAC, 0x17], &[0xAA, 0xFE, 0xFF, 0x03, 0x02]);
    let mut samples = Vec::new();
    let window = ResponseWindow { first_path_index: 750.9, before: 3, count: 40 };
    assert_eq!(block_on(radio.impulse_response(window, |sample| samples.push(sample))), Ok(Some(747)));
    assert_eq!(samples.len(), 40);
    assert_eq!(samples[0], Sample { i: -2, q: 515 });
    assert_eq!(samples[1], Sample::default());
    let seen = bus.seen();
    assert_eq!(
        seen,
        [
            write(&[0xB6, 0x48]),
            write(&[0xF6, 0x01, 0x82]),
            read(&[0x65, 0xAC, 0x17], 129),
            // 32 samples on: byte 3116 = 0xC2C.
            read(&[0x65, 0xAC, 0x18], 33),
            write(&[0xB6, 0x00]),
            write(&[0xF6, 0x01, 0x02]),
        ]
    );
    // At the ends the window is moved inside the 1016 samples, and it is never longer than all of them.
    let mut read = |first_path_index, count| {
        let mut given = 0;
        let window = ResponseWindow { first_path_index, before: 3, count };
        let first = block_on(radio.impulse_response(window, |_| given += 1));
        (first, given)
    };
    assert_eq!(read(2.0, 40), (Ok(Some(0)), 40));
    assert_eq!(read(1015.0, 40), (Ok(Some(976)), 40));
    assert_eq!(read(f32::NAN, 1100), (Ok(Some(0)), 1016));
    assert_eq!(read(f32::INFINITY, u16::MAX), (Ok(Some(0)), 1016));
    assert_eq!(read(-5.0, 0), (Ok(Some(0)), 0));
    // The cost of a window for the features.
    let before = radio.traffic();
    let window = ResponseWindow { first_path_index: 750.9, before: 16, count: 152 };
    assert_eq!(block_on(radio.impulse_response(window, |_| ())), Ok(Some(734)));
    let after = radio.traffic();
    // Clocks on and off: 2 + 3 + 2 + 3 bytes; four reads of 3 + 1 + 128, one of 3 + 1 + 96.
    assert_eq!((after.transactions - before.transactions, after.bytes - before.bytes), (9, 638));
}

#[test]
fn a_receiver_that_is_on_again_or_was_never_on_has_no_impulse_response() {
    let (mut radio, bus, _) = fast(true);
    let window = ResponseWindow { first_path_index: 750.0, before: 3, count: 40 };
    radio.transceiver = Transceiver::Listening;
    assert_eq!(block_on(radio.impulse_response(window, |_| ())), Ok(None));
    radio.transceiver = Transceiver::NotReady;
    assert_eq!(block_on(radio.impulse_response(window, |_| ())), Err(Error::NotReady));
    assert_eq!(bus.seen(), []);
}
