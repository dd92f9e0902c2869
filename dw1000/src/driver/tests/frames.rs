//! Sending and receiving: literal bytes on the bus, and the table of the module's documentation.

use embassy_futures::block_on;
use std::vec::Vec;

use super::double::*;
use crate::driver::{Traffic, Transceiver};
use radio::{MAX_FRAME, Pace, Radio, RadioDuration, RadioInstant, ReceiveError, Start, TransmitError};

/// SYS_STATUS after a good frame: RXPRD, RXSFDD, LDEDONE, RXPHD, RXDFR, RXFCG; the chip is one buffer ahead of the
/// host.
const GOOD: [u8; 4] = [0x01, 0x6F, 0x00, 0x80];
const WINDOW: RadioDuration = RadioDuration::from_micros(1000);

/// Puts the frame `41 88 07` with timestamp 0x0605040302 into the chip.
fn put_frame(bus: &Bus) {
    bus.answer(SYS_STATUS, &GOOD);
    // RX_FINFO: 5 bytes with check bytes, RXPACC 118 = 0x076.
    bus.answer(&[0x10], &[0x05, 0x00, 0x60, 0x07]);
    bus.answer(&[0x11], &[0x41, 0x88, 0x07]);
    bus.answer(&[0x15], &[0x02, 0x03, 0x04, 0x05, 0x06, 0xA0, 0xBB, 0xE0, 0x2E]);
    bus.answer(&[0x12], &[52, 0, 0xF8, 0x2A, 0x28, 0x23, 0x20, 0x4E]);
    bus.answer(&[0x67, 0x28], &[0x50, 0x88, 0x00, 0, 122, 0]);
}

#[test]
fn sends_now_and_reads_the_departure() {
    let (mut radio, bus, _) = fast(true);
    bus.answer(SYS_STATUS, &[0x81]);
    bus.answer(&[0x17], &[0x11, 0x22, 0x33, 0x44, 0x55]);
    let departed = block_on(radio.transmit(&[0x41, 0x88, 0x07], Start::Now, false)).unwrap();
    assert_eq!(departed.ticks(), 0x55_4433_2211);
    assert_eq!(
        bus.seen(),
        [
            write(&[0x89, 0x41, 0x88, 0x07]),
            // 5 bytes, 6.81 Mbit/s (10 from bit 13), ranging (bit 15): 0xC005.
            write(&[0x88, 0x05, 0xC0]),
            write(&[0x8D, 0x02]),
            read(&[0x0F], 1),
            write(&[0x8F, 0xF8]),
            read(&[0x17], 5),
        ]
    );
}

#[test]
fn sends_at_an_instant_and_knows_the_departure() {
    let (mut radio, bus, _) = fast(true);
    bus.answer(SYS_STATUS, &[0x81]);
    let at = RadioInstant::from_ticks(0x55_4433_23FF);
    // 0x23FF without its low nine bits is 0x2200; 16436 = 0x4034 later: 0x6234.
    assert_eq!(radio.departure(at).ticks(), 0x55_4433_6234);
    let departed = block_on(radio.transmit(&[1], Start::At(at), true)).unwrap();
    assert_eq!(departed.ticks(), 0x55_4433_6234);
    assert_eq!(
        bus.seen(),
        [
            write(&[0x89, 1]),
            write(&[0x88, 0x03, 0xC0]),
            write(&[0x8A, 0xFF, 0x23, 0x33, 0x44, 0x55]),
            // TXSTRT, TXDLYS, WAIT4RESP.
            write(&[0x8D, 0x86]),
            // The time of the command; HPDWARN, TXPUTE; then TXFRS.
            read(&[0x06], 5),
            read(&[0x0F], 5),
            read(&[0x0F], 1),
            write(&[0x8F, 0xF8]),
        ]
    );
}

/// The transactions that stop the transceiver: TRXOFF, status cleared, receiver reset and released, buffers compared.
fn stopping() -> [Seen; 5] {
    let [clear, reset, release] = resetting();
    [write(&[0x8D, 0x40]), clear, reset, release, read(&[0x4F, 0x03], 1)]
}

/// The transactions that make a switched-off receiver ready again: all five bytes of the status cleared, receiver reset
/// and released.
fn resetting() -> [Seen; 3] {
    [write(&[0x8F, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF]), write(&[0xF6, 0x03, 0xE0]), write(&[0xF6, 0x03, 0xF0])]
}

#[test]
fn a_late_start_sends_nothing() {
    // HPDWARN is bit 27: bit 3 of the fourth byte. TXPUTE is bit 34: bit 2 of the fifth.
    for late in [[0, 0, 0, 0x08, 0x00], [0, 0, 0, 0x00, 0x04]] {
        let (mut radio, bus, _) = fast(true);
        bus.answer(SYS_STATUS, &late);
        bus.answer(SYS_STATUS, &[0x81]);
        let at = Start::At(RadioInstant::from_ticks(512));
        assert_eq!(block_on(radio.transmit(&[1], at, true)), Err(TransmitError::Late));
        let seen = bus.seen();
        assert_eq!(seen[seen.len() - 5..], stopping());
        // The next frame needs no more than 5 transactions, because its length is known.
        assert!(block_on(radio.transmit(&[1], Start::Now, false)).is_ok());
        assert_eq!(bus.seen().len(), 5);
    }
}

#[test]
fn frames_without_a_place_are_refused() {
    let (mut radio, bus, _) = fast(true);
    assert_eq!(block_on(radio.transmit(&[0; MAX_FRAME + 1], Start::Now, false)), Err(TransmitError::TooLong));
    assert_eq!(bus.seen(), []);
    bus.answer(SYS_STATUS, &[0x81]);
    assert!(block_on(radio.transmit(&[0; MAX_FRAME], Start::Now, false)).is_ok());
    // Length 127 in TX_FCTRL.
    assert_eq!(bus.seen()[1], write(&[0x88, 0x7F, 0xC0]));
}

/// The transactions that release the buffer of a frame: LDEDONE, RXDFR, RXFCG, RXFCE cleared; HRBPT.
fn giving_back() -> [Seen; 2] {
    [write(&[0xCF, 0x01, 0xE4]), write(&[0xCD, 0x03, 0x01])]
}

#[test]
fn receives_with_time_and_quality() {
    let (mut radio, bus, delay) = fast(true);
    put_frame(&bus);
    let mut buffer = [0; MAX_FRAME];
    let frame = block_on(radio.receive(&mut buffer, Start::Now, WINDOW, false)).unwrap();
    assert_eq!((frame.bytes, frame.rx_time.ticks()), (&[0x41, 0x88, 0x07][..], 0x06_0504_0302));
    // The figures of the tests in `diagnostics`.
    assert!((frame.diagnostics.rx_power_dbm - -68.992).abs() < 0.002);
    assert!((frame.diagnostics.clock_offset_ppm - -20.0).abs() < 0.001);
    assert_eq!(frame.diagnostics.preamble_count, 118);
    assert_eq!(
        bus.seen(),
        [
            // 1000 µs in steps of 512 chips of 1/499.2 MHz: 975.
            write(&[0x8C, 0xCF, 0x03]),
            // RXWTOE, bit 28.
            write(&[0xC4, 0x03, 0x10]),
            write(&[0xCD, 0x01, 0x01]),
            read(&[0x0F], 4),
            read(&[0x67, 0x28], 6),
            read(&[0x10], 4),
            read(&[0x11], 3),
            read(&[0x15], 9),
            read(&[0x12], 8),
        ]
    );
    // The next operation releases its buffer.
    block_on(radio.idle()).unwrap();
    assert_eq!(bus.seen(), giving_back());
    // The delay's deadline is after the chip's.
    assert_eq!(*delay.waits.borrow(), [1200]);
}

#[test]
fn keep_listening_is_on_again_before_the_frame_is_read() {
    let (mut radio, bus, delay) = fast(true);
    put_frame(&bus);
    let mut buffer = [0; MAX_FRAME];
    block_on(radio.receive(&mut buffer, Start::Now, WINDOW, true)).unwrap();
    let seen = bus.seen();
    let on_again = seen.iter().rposition(|s| *s == write(&[0xCD, 0x01, 0x01])).unwrap();
    let place = |header: &[u8]| seen.iter().position(|s| matches!(s, Seen::Read(h, _) if h == header)).unwrap();
    assert!(place(&[0x67, 0x28]) < on_again, "the carrier integrator has one buffer");
    for double_buffered in [&[0x10], &[0x11], &[0x15], &[0x12]] {
        assert!(on_again < place(double_buffered));
    }
    // The first frame is one of those that are timed.
    assert_eq!(seen[on_again + 1], read(&[0x06], 5));
    // From the interrupt until the receiver is on: three transactions, 16 bytes.
    let first = seen.iter().position(|s| *s == read(&[0x0F], 4)).unwrap();
    let bytes = |s: &Seen| match s {
        Seen::Write(bytes) => bytes.len(),
        Seen::Read(header, length) => header.len() + length,
        Seen::Hold(_) | Seen::Clock(_) => 0,
    };
    assert_eq!(on_again - first + 1, 3);
    assert_eq!(seen[first..=on_again].iter().map(bytes).sum::<usize>(), 16);

    // At the next reception the receiver is already on: it releases the buffer and begins with the status, and only the
    // delay times it.
    put_frame(&bus);
    delay.waits.borrow_mut().clear();
    block_on(radio.receive(&mut buffer, Start::Now, WINDOW, false)).unwrap();
    let seen = bus.seen();
    assert_eq!((&seen[..2], &seen[2]), (&giving_back()[..], &read(&[0x0F], 4)));
    assert_eq!(*delay.waits.borrow(), [1000]);
}

#[test]
fn an_answer_goes_before_the_buffer_of_the_frame_that_it_answers() {
    let mut buffer = [0; MAX_FRAME];
    for (keep, start) in [(true, Start::At(RadioInstant::from_ticks(1 << 32))), (true, Start::Now), (false, Start::Now)]
    {
        let (mut radio, bus, _) = fast(true);
        put_frame(&bus);
        block_on(radio.receive(&mut buffer, Start::Now, WINDOW, keep)).unwrap();
        bus.seen();
        bus.forget_answers();
        bus.answer(SYS_STATUS, &[0x81]);
        block_on(radio.transmit(&[1], start, true)).unwrap();
        let seen = bus.seen();
        let command =
            seen.iter().position(|s| matches!(s, Seen::Write(b) if b[0] == 0x8D && b[1] & 0x02 != 0)).unwrap();
        let back = seen.windows(2).position(|two| *two == giving_back()).unwrap();
        let sent = seen.iter().position(|s| *s == read(&[0x0F], 1)).unwrap();
        assert!(command < back && back < sent, "{seen:x?}");
        // Once is enough.
        block_on(radio.idle()).unwrap();
        assert!(!bus.seen().contains(&giving_back()[1]));
    }
}

/// Traffic of an operation.
fn cost(radio: &mut Driver, operation: impl AsyncFnOnce(&mut Driver)) -> (u32, u32) {
    let Traffic { transactions, bytes } = radio.traffic();
    block_on(operation(radio));
    (radio.traffic().transactions - transactions, radio.traffic().bytes - bytes)
}

#[test]
fn costs_are_those_of_the_table() {
    let (mut radio, bus, _) = fast(true);
    let mut buffer = [0; MAX_FRAME];
    let far = Start::At(RadioInstant::from_ticks(1 << 32));
    async fn send(radio: &mut Driver, length: usize, start: Start) {
        radio.transmit(&[0; MAX_FRAME][..length], start, false).await.unwrap();
    }
    bus.answer(SYS_STATUS, &[0x81]);
    cost(&mut radio, async |r| send(r, 20, Start::Now).await);
    assert_eq!(cost(&mut radio, async |r| send(r, 20, Start::Now).await), (5, 20 + 13));
    assert_eq!(cost(&mut radio, async |r| send(r, 20, far).await), (7, 20 + 25));
    assert_eq!(cost(&mut radio, async |r| send(r, 25, far).await), (8, 25 + 25 + 3));

    bus.forget_answers();
    put_frame(&bus);
    let long = RadioDuration::from_micros(100_000);
    let mut hear = |radio: &mut Driver, start, window, keep| {
        cost(radio, async |r| assert!(r.receive(&mut buffer, start, window, keep).await.is_ok()))
    };
    // A first wait: timer and its enabling; a second, which releases the buffer of the first; another window; one that
    // the timer cannot hold, and back.
    assert_eq!(hear(&mut radio, Start::Now, WINDOW, false), (6 + 1 + 2, 3 + 38 + 3 + 6));
    assert_eq!(hear(&mut radio, Start::Now, WINDOW, false), (8 + 1, 3 + 44 + 3));
    assert_eq!(hear(&mut radio, Start::Now, RadioDuration::from_micros(900), false), (8 + 2, 3 + 44 + 6));
    assert_eq!(hear(&mut radio, Start::Now, long, false), (8 + 2, 3 + 44 + 6));
    assert_eq!(hear(&mut radio, Start::Now, long, false), (8 + 1, 3 + 44 + 3));
    assert_eq!(hear(&mut radio, far, long, false), (8 + 1 + 3, 3 + 44 + 3 + 15));
    // One frame in sixteen after which the receiver stays on is timed: the first.
    assert_eq!(hear(&mut radio, Start::Now, long, true), (9 + 1 + 1, 3 + 47 + 3 + 6));
    for _ in 1..16 {
        assert_eq!(hear(&mut radio, Start::Now, long, true), (9, 3 + 47));
    }
    assert_eq!(hear(&mut radio, Start::Now, long, true), (9 + 1, 3 + 47 + 6));
    // Switching it off, before a transmission and otherwise; the release of a buffer costs the same in whatever
    // operation follows.
    bus.forget_answers();
    bus.answer(SYS_STATUS, &[0x81]);
    assert_eq!(cost(&mut radio, async |r| r.idle().await.unwrap()), (2 + 2, 7 + 6));
    radio.transceiver = Transceiver::Listening;
    bus.forget_answers();
    bus.answer(SYS_STATUS, &[0x81]);
    assert_eq!(cost(&mut radio, async |r| send(r, 25, far).await), (7 + 1, 25 + 25 + 2));
    radio.transceiver = Transceiver::Listening;
    assert_eq!(cost(&mut radio, async |r| send(r, 25, Start::Now).await), (5 + 2, 25 + 13 + 8));
    radio.transceiver = Transceiver::Listening;
    assert_eq!(cost(&mut radio, async |r| r.idle().await.unwrap()), (2, 7));
    radio.transceiver = Transceiver::Unknown;
    assert_eq!(cost(&mut radio, async |r| r.idle().await.unwrap()), (5, 17));
    assert_eq!(cost(&mut radio, async |r| assert!(r.compensate().await.is_ok())), (7 + 2, 19 + 8));
    assert_eq!(cost(&mut radio, async |r| assert!(r.compensate().await.is_ok())), (7, 19));
    // The end of a window, by the chip's timer and by the delay.
    let mut miss = |radio: &mut Driver, flags| {
        bus.forget_answers();
        bus.answer(SYS_STATUS, flags);
        cost(radio, async |r| assert!(r.receive(&mut buffer, Start::Now, WINDOW, true).await.is_err()))
    };
    miss(&mut radio, &[0, 0, 0x02, 0]);
    assert_eq!(miss(&mut radio, &[0, 0, 0x02, 0]), (1 + 4, 3 + 17));
    radio.irq = Line(false);
    assert_eq!(miss(&mut radio, &[0; 4]), (1 + 6, 3 + 22));
}

#[test]
fn a_listening_receiver_is_only_switched_off_before_a_transmission() {
    let at = RadioInstant::from_ticks(1 << 32);
    // The status after the command, and the writes that follow from it: no flag; a frame in the buffer that the host
    // has not read (RXFCG, ICRBP): flags cleared, change to the other buffer; a frame that the filter rejected
    // (AFFREJ).
    let unseen = [write(&[0xCF, 0x01, 0xFF, 0xFF, 0xFF]), write(&[0xCD, 0x03, 0x01])];
    let cases: [([u8; 5], &[Seen]); 3] =
        [([0x01, 0, 0, 0, 0], &[]), ([0x01, 0x6F, 0, 0x80, 0], &unseen), ([0x01, 0, 0, 0x20, 0], &unseen[..1])];
    for (flags, cleared) in cases {
        for listen in [false, true] {
            let (mut radio, bus, _) = fast(true);
            radio.transceiver = Transceiver::Listening;
            bus.answer(SYS_STATUS, &flags);
            bus.answer(SYS_STATUS, &[0x81]);
            block_on(radio.transmit(&[1], Start::At(at), listen)).unwrap();
            let seen = bus.seen();
            assert_eq!(seen[..2], [write(&[0x8D, 0x40]), write(&[0x89, 1])]);
            let status = seen.iter().position(|s| *s == read(&[0x0F], 5)).unwrap();
            let sent = seen.iter().position(|s| *s == read(&[0x0F], 1)).unwrap();
            assert_eq!(seen[status + 1..sent], *cleared, "{flags:x?}");
            assert_eq!(seen[sent + 1..], [write(&[0x8F, 0xF8])]);
            let after = if listen { Transceiver::Listening } else { Transceiver::Off };
            assert_eq!(radio.transceiver, after);
        }
    }
}

#[test]
fn a_receiver_that_met_an_error_is_reset_once_the_frame_has_left() {
    // RXPHE, RXSFDTO, RXRFTO: after these the next timestamp may be wrong without a reset (4.1.6), which must not
    // disturb the transmission.
    for flags in [[0, 0x10, 0, 0, 0], [0, 0, 0, 0x04, 0], [0, 0, 0x02, 0, 0]] {
        for (listen, start) in
            [(false, Start::Now), (true, Start::Now), (true, Start::At(RadioInstant::from_ticks(1 << 32)))]
        {
            let (mut radio, bus, _) = fast(true);
            radio.transceiver = Transceiver::Listening;
            bus.answer(SYS_STATUS, &flags);
            bus.answer(SYS_STATUS, &[0x81]);
            block_on(radio.transmit(&[1], start, listen)).unwrap();
            let seen = bus.seen();
            let sent = seen.iter().position(|s| *s == write(&[0x8F, 0xF8])).unwrap();
            let reset = seen.iter().position(|s| *s == write(&[0xF6, 0x03, 0xE0])).unwrap();
            assert!(sent < reset, "{flags:x?}");
            let mut expected = Vec::from(stopping());
            if listen {
                expected.push(write(&[0xCD, 0x01, 0x01]));
            }
            assert_eq!(seen[seen.len() - expected.len()..], expected);
        }
    }
}

#[test]
fn what_a_node_takes_is_measured_in_the_chips_clock() {
    let (mut radio, bus, _) = fast(true);
    let mut buffer = [0; MAX_FRAME];
    let time = |ticks: u64| Some(RadioInstant::from_ticks(ticks));
    put_frame(&bus);
    bus.answer(&[0x06], &[0x00, 0x02, 0, 0, 0]);
    block_on(radio.receive(&mut buffer, Start::Now, WINDOW, true)).unwrap();
    assert_eq!(radio.pace(), Pace { armed: None, listening: time(0x200), ready: None });
    // The next frame is not timed, and the former measurement does not stay.
    block_on(radio.receive(&mut buffer, Start::Now, WINDOW, true)).unwrap();
    assert_eq!(radio.pace(), Pace::default());

    // In time, too late, and at once, which has no deadline.
    bus.forget_answers();
    bus.answer(SYS_STATUS, &[0x81]);
    bus.answer(&[0x06], &[0x00, 0x04, 0, 0, 0]);
    let at = Start::At(RadioInstant::from_ticks(1 << 32));
    block_on(radio.transmit(&[1], at, false)).unwrap();
    assert_eq!(radio.pace(), Pace { armed: time(0x400), listening: None, ready: None });
    block_on(radio.transmit(&[1], Start::Now, false)).unwrap();
    assert_eq!(radio.pace(), Pace::default());
    bus.forget_answers();
    bus.answer(SYS_STATUS, &[0, 0, 0, 0x08, 0]);
    bus.answer(&[0x06], &[0x00, 0x06, 0, 0, 0]);
    assert_eq!(block_on(radio.transmit(&[1], at, false)), Err(TransmitError::Late));
    assert_eq!(radio.pace(), Pace { armed: time(0x600), listening: None, ready: None });
}

#[test]
fn windows_end_by_the_chip_or_by_the_delay() {
    let mut buffer = [0; MAX_FRAME];
    // RXRFTO, bit 17.
    let (mut radio, bus, _) = fast(true);
    bus.answer(SYS_STATUS, &[0x01, 0x00, 0x02, 0x00]);
    assert_eq!(block_on(radio.receive(&mut buffer, Start::Now, WINDOW, true)), Err(ReceiveError::Timeout));
    let seen = bus.seen();
    // Its receiver is off then.
    assert_eq!(seen[seen.len() - 4], read(&[0x0F], 4));
    assert_eq!(seen[seen.len() - 3..], resetting());
    // No interrupt at all.
    let (mut radio, bus, _) = fast(false);
    assert_eq!(block_on(radio.receive(&mut buffer, Start::Now, WINDOW, true)), Err(ReceiveError::Timeout));
    let seen = bus.seen();
    assert_eq!(seen[seen.len() - 5..], stopping());
    // A lost interrupt loses no frame.
    put_frame(&bus);
    assert!(block_on(radio.receive(&mut buffer, Start::Now, WINDOW, false)).is_ok());
    // A window of zero ends too.
    bus.forget_answers();
    for window in [0, -1, i64::MIN, i64::MAX] {
        let window = RadioDuration::from_ticks(window);
        assert_eq!(block_on(radio.receive(&mut buffer, Start::Now, window, false)), Err(ReceiveError::Timeout));
    }
}

#[test]
fn a_late_reception_does_not_switch_the_receiver_on() {
    let (mut radio, bus, _) = fast(true);
    bus.answer(&[0x4F, 0x03], &[0x08]);
    bus.answer(&[0x4F, 0x03], &[0]);
    let mut buffer = [0; MAX_FRAME];
    let at = Start::At(RadioInstant::from_ticks(512));
    assert_eq!(block_on(radio.receive(&mut buffer, at, WINDOW, false)), Err(ReceiveError::Late));
    let seen = bus.seen();
    assert_eq!(seen[seen.len() - 5..], stopping());
}

#[test]
fn delayed_reception_waits_from_its_start() {
    let (mut radio, bus, delay) = fast(false);
    // Now 0; start in 638976000 ticks = 10 ms; 10 ms + 1 ms + margin.
    let at = Start::At(RadioInstant::from_ticks(638_976_000));
    let mut buffer = [0; MAX_FRAME];
    assert_eq!(block_on(radio.receive(&mut buffer, at, WINDOW, false)), Err(ReceiveError::Timeout));
    assert_eq!(*delay.waits.borrow(), [11_200]);
    // 638976000 = 0x2616_0000; RXENAB and RXDLYE.
    let seen = bus.seen();
    assert_eq!(seen[2..4], [write(&[0x8A, 0x00, 0x00, 0x16, 0x26, 0x00]), write(&[0xCD, 0x01, 0x03])]);
}

#[test]
fn lost_frames_reset_the_receiver() {
    // RXPHE, RXFCE, RXRFSL, LDEERR, RXOVRR, RXSFDTO; a good frame whose detector failed; one in the wrong buffer.
    let lost: [[u8; 4]; 8] = [
        [0, 0x10, 0, 0],
        [0, 0x80, 0, 0],
        [0, 0, 0x01, 0],
        [0, 0, 0x04, 0],
        [0, 0, 0x10, 0],
        [0, 0, 0, 0x04],
        [0, 0x6F, 0x04, 0x80],
        [0, 0x6F, 0, 0],
    ];
    let mut buffer = [0; MAX_FRAME];
    for flags in lost {
        for keep in [false, true] {
            let (mut radio, bus, _) = fast(true);
            bus.answer(SYS_STATUS, &flags);
            let heard = block_on(radio.receive(&mut buffer, Start::Now, WINDOW, keep));
            assert_eq!(heard, Err(ReceiveError::Corrupt), "{flags:x?}");
            let mut expected = Vec::from(stopping());
            if keep {
                expected.push(write(&[0xCD, 0x01, 0x01]));
            }
            let seen = bus.seen();
            assert_eq!(seen[seen.len() - expected.len()..], expected);
        }
    }
}

#[test]
fn a_detector_that_is_late_is_waited_for() {
    let (mut radio, bus, _) = fast(true);
    let unfinished = [0x01, 0x6B, 0x00, 0x80];
    bus.answer(SYS_STATUS, &unfinished);
    bus.answer(SYS_STATUS, &unfinished);
    put_frame(&bus);
    let mut buffer = [0; MAX_FRAME];
    assert!(block_on(radio.receive(&mut buffer, Start::Now, WINDOW, false)).is_ok());
    // A detector that never finishes gives no timestamp.
    let (mut radio, bus, _) = fast(true);
    bus.answer(SYS_STATUS, &unfinished);
    assert_eq!(block_on(radio.receive(&mut buffer, Start::Now, WINDOW, false)), Err(ReceiveError::Corrupt));
}

#[test]
fn frames_shorter_than_their_check_bytes_are_corrupt() {
    for length in [0, 1] {
        let (mut radio, bus, _) = fast(true);
        bus.answer(SYS_STATUS, &GOOD);
        bus.answer(&[0x10], &[length, 0, 0, 0]);
        let mut buffer = [0; MAX_FRAME];
        assert_eq!(block_on(radio.receive(&mut buffer, Start::Now, WINDOW, true)), Err(ReceiveError::Corrupt));
    }
}

#[test]
fn rejected_frames_leave_the_window_open() {
    let (mut radio, bus, delay) = fast(true);
    delay.polls.set(10);
    // AFFREJ, bit 29, twice.
    bus.answer(SYS_STATUS, &[0x01, 0, 0, 0x20]);
    bus.answer(SYS_STATUS, &[0x01, 0, 0, 0x20]);
    put_frame(&bus);
    let mut buffer = [0; MAX_FRAME];
    assert!(block_on(radio.receive(&mut buffer, Start::Now, WINDOW, false)).is_ok());
    assert_eq!(*delay.waits.borrow(), [1200], "one deadline for all");
    let seen = bus.seen();
    let again = [write(&[0x8D, 0x40]), write(&[0x8F, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF]), write(&[0xCD, 0x01, 0x01])];
    assert_eq!(seen.windows(3).filter(|three| *three == again).count(), 2);
}
