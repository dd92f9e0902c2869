use std::net::Ipv4Addr;

use wire::telemetry::{Board, Hello, MAX_FRAME, Outcome, Role, Solver, encode};
use wire::uwb::native::PolledPosition;

use super::*;

const NEAR: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 4000);
const FAR: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::new(10, 0, 0, 7)), 4000);

fn fix(t_us: u64, round: u16) -> Message {
    let outcome = Outcome::Position {
        position_tenth_mm: [i32::from(round) * 10_000, 20_000, 0],
        deviation_tenth_mm: [1_000; 3],
        correlation_127ths: [0; 3],
        used: 0b1111,
        quality_255ths: 255,
    };
    let doubt = wire::telemetry::Doubt::None;
    wire::telemetry::Fix { t_us, round, age_us: 0, asked: 4, outcome, solver: Solver::Track, doubt }.into()
}

fn frames(messages: &[Message]) -> Vec<u8> {
    messages.iter().flat_map(|message| encode(message, &mut [0; MAX_FRAME]).to_vec()).collect()
}

fn at(ms: i64) -> Utc {
    Utc::clamped(1_700_000_000_000_000 + ms * 1000)
}

fn us(ms: i64) -> u64 {
    at(ms).us().unsigned_abs()
}

/// A datagram of node 0x1001, sent and received at these times.
fn envelope<'f>(
    gateways: &Gateways<'_>,
    number: u32,
    [received_ms, sent_ms]: [i64; 2],
    frames: &'f [u8],
) -> Envelope<'f> {
    Envelope {
        gateway: 7,
        session: 1,
        number,
        station: gateways.run,
        is_repeated: false,
        sent_us: us(sent_ms),
        received_us: us(received_ms),
        node: 0x1001,
        frames,
    }
}

/// The bytes of a datagram, with the code of a key.
fn bytes(envelope: &Envelope<'_>, key: Option<&GatewayKey>) -> Vec<u8> {
    let mut out = [0; MAX_DATAGRAM];
    let length = envelope.emit(key.is_some(), &mut out).expect("it fits");
    let mut bytes = out[..length].to_vec();
    if let Some(key) = key {
        let code = Secret(key.secret).code(&bytes);
        bytes.extend(code);
    }
    bytes
}

/// What a datagram makes: reports and notes.
fn taken(
    gateways: &mut Gateways<'_>,
    bytes: &[u8],
    from: SocketAddr,
    arrived: Utc,
) -> (Vec<SourceReport>, Vec<String>) {
    let (mut reports, mut notes) = (Vec::new(), Vec::new());
    let mut send = |report| {
        reports.push(report);
        true
    };
    gateways.take(bytes, (from, arrived), &mut send, &mut |text| notes.push(text.to_owned()));
    (reports, notes)
}

/// Time in milliseconds, tag and round of positions; late ones have a minus before their round.
fn positions(reports: &[SourceReport]) -> Vec<(i64, String, i32)> {
    let of = |report: &SourceReport| {
        let (what, sign) = match &report.what {
            ReportKind::Late(what) => (&**what, -1),
            what => (what, 1),
        };
        let ReportKind::Position { tag, round, .. } = what else { panic!("{what:?}") };
        let ms = (report.t.us() - at(0).us() + 500).div_euclid(1000);
        (ms, tag.clone(), sign * i32::from(round.expect("a number")))
    };
    reports.iter().map(of).collect()
}

/// The receipts that are due.
fn receipts(gateways: &mut Gateways<'_>) -> Vec<(SocketAddr, Receipt)> {
    let mut sent = Vec::new();
    gateways.send_receipts(|bytes, to| {
        let Ok(Received { datagram: Datagram::Receipt(receipt), .. }) = parse(bytes) else { panic!("{bytes:?}") };
        sent.push((to, receipt));
    });
    sent
}

fn key(gateway: u64) -> GatewayKey {
    let folder = tempfile::tempdir().expect("a folder");
    let (made, _) = GatewayKey::read_or_make(&folder.path().join("key.toml"), "roof").expect("made");
    GatewayKey { gateway, ..made }
}

#[test]
fn nodes_of_one_gateway_keep_their_names_and_times() {
    let admission = Admission::default();
    let mut gateways = Gateways::new(&admission, "hall").expect("random numbers");
    // Two messages 80 ms apart, received together 2 ms after the second one; the datagram takes 3 ms.
    let two = frames(&[fix(1_000_000, 1), fix(1_080_000, 2)]);
    let of_1001 = envelope(&gateways, 0, [2, 5], &two);
    let other = frames(&[fix(500, 1)]);
    let of_1002 = Envelope { node: 0x1002, ..envelope(&gateways, 1, [4, 5], &other) };
    let (reports, notes) = taken(&mut gateways, &bytes(&of_1001, None), NEAR, at(8));
    let tag = |tag: &str| tag.to_owned();
    assert_eq!(positions(&reports), [(-78, tag("0x1001"), 1), (2, tag("0x1001"), 2)]);
    let (reports, _) = taken(&mut gateways, &bytes(&of_1002, None), NEAR, at(8));
    assert_eq!(positions(&reports), [(4, tag("0x1002"), 1)]);
    assert!(reports.iter().all(|report| report.site == "hall") && notes.is_empty());
    let told = receipts(&mut gateways);
    assert_eq!((told.len(), &told[0].1.numbers[..]), (1, &[0, 1][..]));
    assert_eq!(receipts(&mut gateways), []);
}

#[test]
fn what_comes_twice_counts_once_and_is_told_again() {
    let admission = Admission::default();
    let mut gateways = Gateways::new(&admission, "hall").expect("random numbers");
    let one = frames(&[fix(1_000_000, 1)]);
    let first = envelope(&gateways, 0, [0, 1], &one);
    let again = Envelope { is_repeated: true, ..first };
    assert_eq!(taken(&mut gateways, &bytes(&first, None), NEAR, at(1)).0.len(), 1);
    assert_eq!(taken(&mut gateways, &bytes(&again, None), NEAR, at(2)).0, []);
    assert_eq!(receipts(&mut gateways)[0].1.numbers[..], [0, 0]);
}

#[test]
fn what_is_old_or_was_sent_before_is_late_and_keeps_its_time() {
    let admission = Admission::default();
    let mut gateways = Gateways::new(&admission, "hall").expect("random numbers");
    let [live, repeated, old] = [3, 2, 1].map(|round: u16| frames(&[fix(u64::from(round) * 100_000, round)]));
    let live = envelope(&gateways, 2, [3_600_000, 3_600_010], &live);
    let repeated = Envelope { is_repeated: true, ..envelope(&gateways, 1, [3_599_900, 3_600_011], &repeated) };
    let old = envelope(&gateways, 0, [0, 3_600_012], &old);
    let mut of = |envelope: &Envelope<'_>, arrived_ms| {
        positions(&taken(&mut gateways, &bytes(envelope, None), NEAR, at(arrived_ms)).0)
    };
    assert_eq!(of(&live, 3_600_010), [(3_600_000, "0x1001".to_owned(), 3)]);
    assert_eq!(of(&repeated, 3_600_011), [(3_599_900, "0x1001".to_owned(), -2)]);
    assert_eq!(of(&old, 3_600_012), [(0, "0x1001".to_owned(), -1)]);
}

#[test]
fn a_wrong_clock_of_a_gateway_is_told_once_and_corrected() {
    let admission = Admission::default();
    let mut gateways = Gateways::new(&admission, "hall").expect("random numbers");
    // An hour behind, and 20 ms in the gateway.
    let one = frames(&[fix(1_000_000, 1)]);
    let of = |number, gateways: &mut Gateways<'_>| {
        let behind = envelope(gateways, number, [-3_600_020, -3_600_000], &one);
        taken(gateways, &bytes(&behind, None), NEAR, at(0))
    };
    let (reports, notes) = of(0, &mut gateways);
    assert_eq!(positions(&reports), [(-20, "0x1001".to_owned(), 1)]);
    assert!(notes.len() == 1 && notes[0].contains("3600 s behind"), "{notes:?}");
    assert_eq!(of(1, &mut gateways).1, Vec::<String>::new());
}

#[test]
fn only_who_has_the_key_sends_from_elsewhere() {
    let (right, wrong) = (key(7), key(7));
    let admission = Admission { keys: vec![GatewayKey { site: Some("roof".into()), ..right.clone() }], is_open: false };
    let mut gateways = Gateways::new(&admission, "hall").expect("random numbers");
    let one = frames(&[fix(1_000_000, 1)]);
    let envelope = envelope(&gateways, 0, [0, 1], &one);
    let stranger = Envelope { gateway: 8, ..envelope };
    let mut changed = bytes(&envelope, Some(&right));
    changed[40] ^= 1;
    for (bytes, expected) in [
        (bytes(&envelope, Some(&wrong)), "another key"),
        (bytes(&envelope, None), "no code"),
        (bytes(&stranger, Some(&wrong)), "not in --gateways"),
        (bytes(&stranger, None), "--open-udp"),
        (changed, "another key"),
        (vec![0, 1, 9], "unknown kind"),
        (vec![0, 1], "cut"),
    ] {
        assert_eq!(taken(&mut gateways, &bytes, FAR, at(1)).0, []);
        gateways.refused.noted = None;
        let mut notes = Vec::new();
        gateways.note_refused(&mut |text| notes.push(text.to_owned()));
        assert!(notes.len() == 1 && notes[0].contains(expected) && notes[0].contains("10.0.0.7"), "{notes:?}");
    }
    assert_eq!(receipts(&mut gateways), [], "a stranger gets no answer");
    // A bare datagram of this computer is taken, and one with the key from everywhere.
    assert_eq!(taken(&mut gateways, &bytes(&stranger, None), NEAR, at(1)).0.len(), 1);
    let (reports, _) = taken(&mut gateways, &bytes(&envelope, Some(&right)), FAR, at(1));
    assert!(reports.len() == 1 && reports[0].site == "roof");
    let open = Admission { is_open: true, ..Admission::default() };
    let mut gateways = Gateways::new(&open, "hall").expect("random numbers");
    let own = Envelope { station: gateways.run, ..envelope };
    assert_eq!(taken(&mut gateways, &bytes(&own, None), FAR, at(1)).0.len(), 1);
}

#[test]
fn datagrams_of_another_run_are_not_taken_and_told_the_run() {
    let known = key(7);
    let admission = Admission { keys: vec![known.clone()], is_open: false };
    let mut gateways = Gateways::new(&admission, "hall").expect("random numbers");
    let one = frames(&[fix(1_000_000, 1)]);
    let before = Envelope { station: gateways.run.wrapping_add(1), ..envelope(&gateways, 0, [0, 1], &one) };
    // Recorded from the air of the run before, and sent again.
    assert_eq!(taken(&mut gateways, &bytes(&before, Some(&known)), FAR, at(1)).0, []);
    let told = receipts(&mut gateways);
    let sent_us = told[0].1.sent_us;
    let expected = Receipt { gateway: 7, session: 1, station: gateways.run, sent_us, numbers: Default::default() };
    assert_eq!(told, [(FAR, expected)]);
    let now_us = Utc::now().us().unsigned_abs();
    assert!((sent_us..sent_us + 60_000_000).contains(&now_us), "its time is the present one");
}

#[test]
fn an_anchors_gateway_tells_the_positions_of_tags() {
    let admission = Admission::default();
    let mut gateways = Gateways::new(&admission, "hall").expect("random numbers");
    let PolledPosition(position) =
        PolledPosition::new([1.0, 2.0, 0.5], [[0.01, 0.0, 0.0]; 3], false).expect("a position");
    let hello = Hello {
        t_us: 1,
        eui: 1,
        address: 0x0101,
        role: Role::Anchor,
        board: Board::Dwm1001,
        build: [0; 8],
        keyed: false,
    };
    let told = wire::telemetry::TagFix { t_us: 2, tag: 0x1001, round: 9, asked: 4, age_us: 0, position };
    let both = frames(&[hello.into(), told.into()]);
    let sent = Envelope { node: 0x0101, ..envelope(&gateways, 0, [0, 0], &both) };
    let (reports, _) = taken(&mut gateways, &bytes(&sent, None), NEAR, at(0));
    assert!(matches!(reports[0].what, ReportKind::Node { .. }));
    assert_eq!(positions(&reports[1..]), [(0, "0x1001".to_owned(), 8)]);
}
