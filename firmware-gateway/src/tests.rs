use std::vec::Vec;

use wire::telemetry::{Condition, MAX_FRAME, State, encode};

use super::*;

const MS: u64 = 1000;
/// The station's clock when the node starts.
const START_US: u64 = 1_700_000_000_000_000;

fn identity(secret: Option<[u8; 32]>) -> GatewayIdentity {
    GatewayIdentity { gateway: 7, secret: secret.map(Secret), node: 0x0001 }
}

fn gateway(secret: Option<[u8; 32]>) -> Gateway<4096> {
    Gateway::new(identity(secret), 99)
}

fn frame(t_us: u64) -> Vec<u8> {
    encode(&State { t_us, is: Condition::Searching }.into(), &mut [0; MAX_FRAME]).to_vec()
}

/// What a gateway sends: its number, run, whether it is repeated, and its times.
#[derive(Debug, PartialEq)]
struct Seen {
    number: u32,
    run: u32,
    is_repeated: bool,
    sent_us: u64,
    received_us: u64,
    frames: Vec<u8>,
}

fn sent(gateway: &mut Gateway<4096>, now_us: u64) -> Option<Seen> {
    let mut out = [0; MAX_DATAGRAM];
    let bytes = gateway.next(now_us, &mut out)?;
    let Ok(Received { datagram: Datagram::Telemetry(envelope), signed, code }) = parse(bytes) else {
        panic!("{bytes:?}")
    };
    let secret = gateway.identity.secret;
    assert_eq!(code.is_some(), secret.is_some());
    assert!(secret.is_none_or(|secret| secret.is_code(signed, code.expect("a code"))));
    assert_eq!((envelope.gateway, envelope.session, envelope.node), (7, 99, 0x0001));
    let Envelope { number, station: run, is_repeated, sent_us, received_us, frames, .. } = envelope;
    Some(Seen { number, run, is_repeated, sent_us, received_us, frames: frames.to_vec() })
}

fn receipt(run: u32, at_us: u64, numbers: &[u32]) -> Receipt {
    let numbers = numbers.iter().copied().collect();
    Receipt { gateway: 7, session: 99, station: run, sent_us: START_US + at_us, numbers }
}

fn bytes(receipt: &Receipt, secret: Option<[u8; 32]>) -> Vec<u8> {
    let mut out = [0; MAX_DATAGRAM];
    let length = receipt.emit(secret.is_some(), &mut out).expect("it fits");
    sealed(secret.map(Secret).as_ref(), length, &mut out).to_vec()
}

/// A gateway that knows run 5 of its station since 10 ms, to the microsecond.
fn known() -> Gateway<4096> {
    let mut gateway = gateway(None);
    sent(&mut gateway, 10 * MS).expect("a question");
    assert!(gateway.receive(&bytes(&receipt(5, 10 * MS, &[]), None), 10 * MS));
    gateway
}

#[test]
fn telemetry_waits_for_the_stations_run_and_has_its_time() {
    let mut gateway = gateway(None);
    gateway.write(&frame(1), 2 * MS);
    assert!(!gateway.is_read(2 * MS));
    let question = sent(&mut gateway, 3 * MS).expect("a question");
    assert_eq!((question.run, question.frames.len()), (0, 0));
    assert_eq!(sent(&mut gateway, 900 * MS), None, "one a second");
    assert!(sent(&mut gateway, 1003 * MS).is_some());
    // The station's clock is 1 ms ahead of the middle.
    assert!(gateway.receive(&bytes(&receipt(5, 1005 * MS, &[]), None), 1005 * MS));
    let first = sent(&mut gateway, 1006 * MS).expect("the frame");
    assert_eq!((first.number, first.run, first.is_repeated, &first.frames), (0, 5, false, &frame(1)));
    // Nobody knows which question was answered: the receipt was sent from 3 to 1005 ms, which makes 501 ms.
    assert_eq!(first.sent_us - START_US, (1006 + 501) * MS);
    assert_eq!(first.received_us - START_US, (2 + 501) * MS);
    // The answer to this one is exact to half a millisecond.
    assert!(gateway.receive(&bytes(&receipt(5, 1006 * MS + 500, &[0]), None), 1007 * MS));
    gateway.write(&frame(2), 1100 * MS);
    let second = sent(&mut gateway, 1200 * MS).expect("the second");
    assert_eq!([second.received_us - START_US, second.sent_us - START_US], [1100 * MS, 1200 * MS]);
    assert!(gateway.is_read(1300 * MS));
    assert!(!gateway.is_read(1700 * MS), "the second one has no receipt");
}

#[test]
fn a_station_that_is_silent_reads_nothing_and_gets_one_datagram_a_second() {
    let mut gateway = known();
    assert!(gateway.is_read(9_990 * MS), "nothing waits");
    let mut times = Vec::new();
    for ms in (10_000..16_000).step_by(10) {
        if ms % 100 == 0 {
            gateway.write(&frame(ms), ms * MS);
        }
        if sent(&mut gateway, ms * MS).is_some() {
            times.push(ms);
        }
        // A network that is away sends nothing, which is the same.
        assert_eq!(gateway.is_read(ms * MS), ms < 10_600, "{ms} ms");
    }
    // Each tenth of a second a new one, and those before again after half a second; from 12.1 s on one a second.
    assert!(times.iter().filter(|ms| **ms < 12_100).count() >= 2 * WINDOW);
    let late: Vec<_> = times.iter().filter(|ms| **ms >= 12_100).map(|ms| ms / 1000).collect();
    assert_eq!(late, [13, 14, 15]);
    assert_eq!(gateway.silence_us(16_000 * MS), 5_900 * MS);
    for numbers in [0..30, 30..60] {
        while sent(&mut gateway, 17_000 * MS).is_some() {}
        let numbers: Vec<_> = numbers.collect();
        assert!(gateway.receive(&bytes(&receipt(5, 0, &numbers), None), 17_000 * MS));
    }
    while let Some(Seen { number, .. }) = sent(&mut gateway, 17_000 * MS) {
        assert!(gateway.receive(&bytes(&receipt(5, 0, &[number]), None), 17_000 * MS));
    }
    assert!(gateway.is_read(17_000 * MS) && gateway.is_empty());
}

#[test]
fn a_station_that_has_started_again_gets_again_what_it_may_have_lost() {
    let mut gateway = known();
    gateway.write(&frame(1), 20 * MS);
    let first = sent(&mut gateway, 120 * MS).expect("a frame");
    assert!(gateway.receive(&bytes(&receipt(5, 121 * MS, &[0]), None), 122 * MS));
    assert_eq!(sent(&mut gateway, 700 * MS), None, "it was taken");
    gateway.write(&frame(2), 700 * MS);
    assert_eq!(sent(&mut gateway, 800 * MS).map(|seen| seen.number), Some(1));
    // The receipt of another run has no numbers.
    assert!(gateway.receive(&bytes(&receipt(6, 801 * MS, &[]), None), 802 * MS));
    let again = sent(&mut gateway, 810 * MS).expect("the first one");
    assert_eq!((again.number, again.run, again.is_repeated, &again.frames), (0, 6, true, &first.frames));
    assert_eq!(again.received_us, first.received_us);
    assert_eq!(sent(&mut gateway, 811 * MS).map(|seen| (seen.number, seen.is_repeated)), Some((1, true)));
    assert_eq!(sent(&mut gateway, 812 * MS), None);
}

#[test]
fn a_datagram_keeps_its_time_when_the_clock_is_known_better() {
    let mut gateway = gateway(None);
    sent(&mut gateway, 0).expect("a question");
    // An answer after 400 ms: its time is 200 ms wrong.
    assert!(gateway.receive(&bytes(&receipt(5, 400 * MS, &[]), None), 400 * MS));
    gateway.write(&frame(1), 400 * MS);
    let first = sent(&mut gateway, 500 * MS).expect("a frame");
    assert_eq!(first.received_us - START_US, 600 * MS);
    // One that comes at once, from another run of the station.
    assert!(gateway.receive(&bytes(&receipt(6, 500 * MS, &[]), None), 500 * MS));
    let again = sent(&mut gateway, 510 * MS).expect("the same");
    assert_eq!((again.run, again.is_repeated), (6, true));
    assert_eq!((again.received_us, again.sent_us - START_US), (first.received_us, 510 * MS));
}

#[test]
fn what_is_no_receipt_for_this_gateway_changes_nothing() {
    let secret = Some([3; 32]);
    let right = receipt(5, 0, &[]);
    let mut gateway = gateway(secret);
    sent(&mut gateway, 0).expect("a question");
    let mut altered = bytes(&right, secret);
    *altered.last_mut().expect("bytes") ^= 1;
    let wrong = [
        bytes(&right, None),
        bytes(&right, Some([4; 32])),
        altered,
        bytes(&Receipt { gateway: 8, ..right.clone() }, secret),
        bytes(&Receipt { session: 98, ..right.clone() }, secret),
        bytes(&Receipt { station: 0, ..right.clone() }, secret),
        b"\0\x01\x02".to_vec(),
        Vec::new(),
    ];
    for bytes in wrong {
        assert!(!gateway.receive(&bytes, 10 * MS), "{bytes:?}");
    }
    assert!(!gateway.is_read(10 * MS));
    assert!(gateway.receive(&bytes(&right, secret), 10 * MS) && gateway.is_read(10 * MS));
    // What a station answers to its own datagrams is for nobody else.
    let mut out = [0; MAX_DATAGRAM];
    gateway.write(&frame(0), 10 * MS);
    let own = gateway.next(200 * MS, &mut out).expect("a frame").to_vec();
    assert!(!gateway.receive(&own, 200 * MS));
}

#[test]
fn any_bytes_and_any_times_are_survived() {
    let mut gateway = known();
    let mut random = 1_u64;
    let mut next = move || {
        // Knuth's MMIX.
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        random >> 33
    };
    for _ in 0..20_000 {
        let now_us = next() << (next() % 32);
        let mut receipt = receipt(next() as u32 % 3, next() << (next() % 40), &[next() as u32 % 100]);
        receipt.sent_us = receipt.sent_us.wrapping_mul(next());
        let mut bytes = bytes(&receipt, None);
        if next() % 2 == 0 {
            let at = next() as usize % bytes.len();
            bytes[at] ^= next() as u8;
            bytes.truncate(next() as usize % (bytes.len() + 1));
        }
        gateway.receive(&bytes, now_us);
        gateway.write(&frame(next()), now_us);
        let _ = gateway.next(now_us, &mut [0; MAX_DATAGRAM]);
    }
}
