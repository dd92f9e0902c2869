//! Bytes from the air and from a node's stream: what was parsed and is written again is parsed as the same.

use firmware_gateway::{Gateway, GatewayIdentity};
use wire::ble::{Advertised, EddystoneUid, Fresh, IBeacon, RotatingId, TagPosition};
use wire::datagram::{self, Datagram, Envelope, MAX_DATAGRAM, Receipt};
use wire::telemetry::{Decoder, Hello, MAX_FRAME, Message, Role};
use wire::to_node::{self, FrameReader};
use wire::uwb::native::{Message as Native, PolledPosition};
use wire::uwb::{FrameBuffer, decaranging, native};

use crate::{finite, seal};

/// The longest frame without its check bytes.
const LONGEST: usize = 125;
/// Separates the bodies of an input of several frames.
const SEPARATOR: u8 = 0xA5;

pub fn frames(input: &[u8]) {
    if input.len() > LONGEST {
        return;
    }
    let mut out = FrameBuffer::new();
    if let Ok(frame) = native::Frame::parse(input) {
        frame.emit(&mut out);
        if let Some((_, code)) = native::split_code(input) {
            out.authenticate(|_| *code);
        }
        // A sync frame has a bit that is free: parsers ignore it.
        assert_eq!(out.bytes().len(), input.len());
        assert_eq!(native::Frame::parse(out.bytes()).as_ref(), Ok(&frame));
        match frame.message {
            Native::SyncFrame(sync) => {
                finite(sync.position.into_iter().flat_map(|position| position.metres()).map(f64::from));
            }
            _ => {}
        }
    }
    if let Ok(frame) = decaranging::Frame::parse(input) {
        frame.emit(&mut out);
        assert_eq!(out.bytes(), input);
    }
    if let Ok(blink) = decaranging::Blink::parse(input) {
        blink.emit(&mut out);
        assert!(input.starts_with(out.bytes()));
    }
}

pub fn frame_seeds() -> Vec<Vec<u8>> {
    let blink = decaranging::Blink { sequence: 1, tag: 0x0102_0304_0506_0708 };
    let mut out = FrameBuffer::new();
    blink.emit(&mut out);
    let head = |kind: u8| [&[0x41, 0x88, 1, 0x1A, 0xBA, 0xFF, 0xFF, 1, 1, kind][..], &[0; 60]].concat();
    (0x30..0x3F).map(head).chain([out.bytes().to_vec()]).collect()
}

pub fn datagrams(input: &[u8]) {
    // A node whose gateway, session and times are those of the seeds.
    let identity = GatewayIdentity { gateway: 1, secret: None, node: 7 };
    let mut gateway = Gateway::<4096>::new(identity, 2);
    for now_us in [0, 100_000, 200_000] {
        gateway.write(input.get(..MAX_FRAME).unwrap_or(input), now_us);
        let _ = gateway.next(now_us, &mut [0; MAX_DATAGRAM]);
        gateway.receive(input, now_us);
    }
    let Ok(received) = datagram::parse(input) else { return };
    let mut out = [0; MAX_DATAGRAM];
    let has_code = received.code.is_some();
    let written = match &received.datagram {
        Datagram::Telemetry(envelope) => envelope.emit(has_code, &mut out),
        Datagram::Receipt(receipt) => receipt.emit(has_code, &mut out),
        Datagram::ToNode(told) => told.emit(has_code, &mut out),
    };
    let Some(length) = written else {
        // Longer than those that are sent.
        assert!(input.len() > MAX_DATAGRAM - datagram::CODE_BYTES);
        return;
    };
    assert_eq!(&out[..length], received.signed);
}

pub fn datagram_seeds() -> Vec<Vec<u8>> {
    let (gateway, session, station) = (1, 2, 3);
    let envelope = Envelope {
        gateway,
        session,
        number: 4,
        station,
        is_repeated: true,
        sent_us: 5,
        received_us: 6,
        node: 7,
        frames: &[8; 40],
    };
    let receipt = Receipt { gateway, session, station, sent_us: 5, numbers: (0..9).collect() };
    let mut out = [0; MAX_DATAGRAM];
    let seed = |length: Option<usize>, out: &[u8]| out[..length.unwrap_or(0) + datagram::CODE_BYTES].to_vec();
    let of_envelope = envelope.emit(true, &mut out);
    let envelope = seed(of_envelope, &out);
    let of_receipt = receipt.emit(false, &mut out);
    vec![envelope, seed(of_receipt, &out)]
}

pub fn advertisements(input: &[u8]) {
    match Advertised::parse(input) {
        Ok(Advertised::IBeacon(beacon)) => {
            assert_eq!(IBeacon::parse(&beacon.emit()), Ok(beacon));
            let ids = RotatingId::new(&[7; 16]);
            let _ = ids.reveal(&beacon);
            let rotated = ids.rotate(&beacon, Fresh::new([1; 8]));
            let found = ids.reveal(&rotated).expect("of this key");
            assert_eq!((found.major, found.minor), (beacon.major, beacon.minor));
        }
        Ok(Advertised::EddystoneUid(uid)) => assert_eq!(EddystoneUid::parse(&uid.emit()), Ok(uid)),
        Err(_) => {}
    }
    for key in [None, Some((&[7; 16], native::software_code as native::MakeCode))] {
        if let Some(position) = TagPosition::parse(input, key) {
            let emitted = position.emit(key);
            assert_eq!(TagPosition::parse(&emitted, key), Some(position));
            assert_eq!(TagPosition::parse(&emitted, None), Some(position));
        }
    }
}

pub fn advertisement_seeds() -> Vec<Vec<u8>> {
    let ibeacon = IBeacon { uuid: [3; 16], major: 1, minor: 2, measured_power_dbm: -59 };
    let uid = EddystoneUid { namespace: [4; 10], instance: [5; 6], power_0m_dbm: -18 };
    let position = PolledPosition::new([1.0, 2.0, 3.0], [[0.1, 0.0, 0.0]; 3], false).expect("a position");
    let position = TagPosition { pan: 1, tag: 2, round: 3, asked: 4, position };
    vec![ibeacon.emit().to_vec(), uid.emit().to_vec(), position.emit(None).to_vec()]
}

/// The first byte decides whether the rest is a stream, or bodies of frames. Messages to nodes are framed alike.
pub fn telemetry(input: &[u8]) {
    let Some((mode, rest)) = input.split_first() else { return };
    let (mut decoder, mut messages, mut frame) = (Decoder::new(), FrameReader::new(), [0; to_node::MAX_FRAME]);
    let stream = if mode & 1 == 0 { rest.to_vec() } else { framed(rest) };
    for byte in stream {
        if let Some(Ok(message)) = decoder.feed(byte) {
            same_again(&message);
        }
        if let Some(message) = messages.feed(byte) {
            let encoded = to_node::encode(&message, &mut frame);
            assert_eq!(encoded.iter().filter_map(|byte| messages.feed(*byte)).last(), Some(message));
        }
    }
    let _ = (decoder.counts(), decoder.pending());
}

/// The stream of the bodies in an input.
pub fn framed(input: &[u8]) -> Vec<u8> {
    input.split(|byte| *byte == SEPARATOR).flat_map(seal::telemetry).collect()
}

fn same_again(message: &Message) {
    let mut buffer = [0; MAX_FRAME];
    let bytes = wire::telemetry::encode(message, &mut buffer).to_vec();
    assert_eq!(wire::telemetry::decode(&bytes).as_ref(), Ok(message));
    if let Message::Fix(fix) = message {
        finite(fix.position_m().into_iter().flatten());
        finite(fix.covariance_m2().into_iter().flatten().flatten());
        assert!(fix.deviation_m().into_iter().flatten().all(|sigma| sigma.is_finite() && sigma >= 0.0));
    }
    if let Message::Range(range) = message {
        finite([range.distance_m()].into_iter().chain(range.position_m().into_iter().flatten()));
    }
}

pub fn telemetry_seeds() -> Vec<Vec<u8>> {
    let hello = Hello {
        t_us: 1,
        eui: 2,
        address: 3,
        role: Role::Tag,
        board: wire::config::Board::Dwm1001,
        build: [4; 8],
        keyed: false,
    };
    let mut buffer = [0; MAX_FRAME];
    let stream = [&[0][..], wire::telemetry::encode(&Message::Hello(hello), &mut buffer)].concat();
    // Bodies that begin with the number of each message.
    let bodies = (0..Message::KINDS.len() as u8).map(|kind| [&[1, kind][..], &[1; 60]].concat());
    bodies.chain([stream]).collect()
}
