//! For any bytes and any order of events: nothing panics, and a parsed frame is written back unchanged.

use crate::air::Owned;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use ranging::exchange::{Event, Protocol};
use ranging::native::{Network, Rate, ReplyDelay, Scheme};
use ranging::{Diagnostics, PhyConfig, RadioDuration, RadioInstant, RxFrame, StampModel, Start};
use wire::uwb::decaranging::{self, Variant};
use wire::uwb::{FrameBuffer, native};

const NETWORK: Network = Network::new(0xBA1A, PhyConfig::FAST);
const ADDRESS: u16 = 0x0101;
const EUI: u64 = 0x1122_3344_5566_7788;

/// Random bytes, or heads of frames that pass the first checks followed by random bytes, cut at a random length.
fn bytes(rng: &mut Pcg64) -> Vec<u8> {
    let mut bytes: Vec<u8> = Vec::new();
    let [pan, other] = [NETWORK.pan.to_le_bytes(), 0xDECAu16.to_le_bytes()];
    let destination = if rng.random_bool(0.5) { [0xFF, 0xFF] } else { ADDRESS.to_le_bytes() };
    let source = [rng.random_range(0..4), 1];
    match rng.random_range(0..7) {
        0 => {}
        1 => {
            bytes.push(0xC5);
        }
        2 => {
            bytes.extend([0x41, 0x8C, rng.random()].into_iter().chain(other).chain(EUI.to_le_bytes()).chain(source));
            bytes.push(0x20);
        }
        3 => {
            bytes.extend([0x41, 0xCC, rng.random()].into_iter().chain(other).chain(EUI.to_le_bytes()));
            bytes.extend(source.into_iter().chain([0; 6]));
            bytes.push([0x20, 0x21, 0x10, 0x29, 0x2A][rng.random_range(0..5)]);
        }
        4 => {
            bytes
                .extend([0x41, 0x88, rng.random()].into_iter().chain(other).chain(ADDRESS.to_le_bytes()).chain(source));
            bytes.push([0x21, 0x10, 0x29, 0x2A, 0x61, 0x50, 0x69, 0x6A][rng.random_range(0..8)]);
        }
        _ => {
            bytes.extend([0x41, 0x88, rng.random()].into_iter().chain(pan).chain(destination).chain(source));
            bytes.push(rng.random_range(0x30..=0x33));
        }
    }
    let lengths = [0, 1, 2, 3, 4, 6, 8, 9, 11, 15, 42, 5 + bytes.len() % 3];
    let more =
        if rng.random_bool(0.7) { lengths[rng.random_range(0..lengths.len())] } else { rng.random_range(0..125) };
    bytes.extend((0..more).map(|_| if rng.random_bool(0.3) { 0 } else { rng.random::<u8>() }));
    bytes.truncate(125);
    bytes
}

#[test]
fn parsers_take_any_bytes_and_give_back_what_they_took() {
    let mut rng = Pcg64::seed_from_u64(1);
    let mut out = FrameBuffer::new();
    let mut parsed = [0; 3];
    for _ in 0..300_000 {
        let bytes = bytes(&mut rng);
        if let Ok(frame) = native::Frame::parse(&bytes) {
            frame.emit(&mut out);
            assert_eq!(out.bytes(), bytes);
            parsed[0] += 1;
        }
        if let Ok(frame) = decaranging::Frame::parse(&bytes) {
            frame.emit(&mut out);
            assert_eq!(out.bytes(), bytes);
            parsed[1] += 1;
        }
        if let Ok(blink) = decaranging::Blink::parse(&bytes) {
            blink.emit(&mut out);
            assert_eq!(out.bytes(), &bytes[..10]);
            parsed[2] += 1;
        }
    }
    assert!(parsed.iter().all(|count| *count > 1000), "{parsed:?}");
}

/// The longest wait, even with a clock that jumps: half a turn of the counter, and a superframe.
const LONGEST_WAIT_US: i64 = 8_800_000;
/// … and the longest sleep between a search's windows.
const LONGEST_SLEEP_US: i64 = 65_000_000;

/// Steps a protocol with any events at any times; its waits must be bounded.
fn torment(mut machine: impl Protocol, seed: u64) {
    machine.calibrate(&StampModel {
        delayed_step: 512,
        antenna_delay: RadioDuration::from_ticks(16_436),
        range_bias: baliza_dw1000::bias::of(&NETWORK.phy),
    });
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut now = RadioInstant::from_ticks(rng.random());
    let mut frame;
    let mut action: Owned = machine.step(now, Event::Started).into();
    for step in 0..100_000 {
        now = match rng.random_range(0..100) {
            0 => RadioInstant::from_ticks(rng.random()),
            1 => now.plus(RadioDuration::from_ticks(rng.random_range(-1_000_000_000..100_000_000_000))),
            _ => now.plus(RadioDuration::from_ticks(rng.random_range(0..100_000_000))),
        };
        let wild = rng.random_bool(0.1);
        let event = match (&action, rng.random_range(0..10)) {
            (_, 0) if wild => Event::Started,
            (_, 1) if wild => Event::Late,
            (_, 2) if wild => Event::NotSent,
            (_, 3) if wild => Event::Corrupt,
            (_, 4) if wild => Event::Timeout,
            (Owned::Transmit { .. }, _) => Event::Sent(now),
            // The radio slept: its clock restarted.
            (Owned::Sleep { .. }, 0..9) => Event::Started,
            (Owned::WaitUntil(_) | Owned::Sleep { .. } | Owned::Compensate, _) => Event::Woken,
            (
                Owned::Round { .. }
                | Owned::Differences { .. }
                | Owned::Polled
                | Owned::Arrival(_)
                | Owned::Downlink { .. }
                | Owned::Link(_),
                _,
            ) => Event::Reported,
            (Owned::Receive { .. }, 0) => Event::Timeout,
            (Owned::Receive { .. }, _) => {
                frame = bytes(&mut rng);
                let nonsense = [f32::NAN, f32::INFINITY, -70.0, 1e30, 0.0][rng.random_range(0..5)];
                let diagnostics =
                    Diagnostics { rx_power_dbm: nonsense, clock_offset_ppm: -nonsense, ..Diagnostics::default() };
                Event::Received(RxFrame { bytes: &frame, rx_time: now, diagnostics })
            }
        };
        action = machine.step(now, event).into();
        match &action {
            Owned::Transmit { frame, start, .. } => {
                assert!(!frame.is_empty() && frame.len() <= 125);
                if let Start::At(at) = start {
                    let ahead = at.since(now).as_micros();
                    assert!((-4_000_000..4_000_000).contains(&ahead), "step {step}: transmission in {ahead} µs");
                }
            }
            Owned::Receive { window, .. } => {
                let micros = window.as_micros();
                assert!((0..LONGEST_WAIT_US).contains(&micros), "step {step}: window of {micros} µs");
            }
            Owned::Sleep { duration, .. } => {
                let micros = duration.as_micros();
                assert!((0..LONGEST_SLEEP_US).contains(&micros), "step {step}: sleep of {micros} µs");
            }
            Owned::WaitUntil(instant) => {
                let ahead = instant.since(now).as_micros();
                assert!((0..LONGEST_WAIT_US).contains(&ahead), "step {step}: wait of {ahead} µs");
            }
            Owned::Round { ranges, .. } => assert!(ranges.len() <= 8),
            Owned::Differences { differences, .. } => assert!(differences.len() <= 8),
            Owned::Polled | Owned::Arrival(_) | Owned::Downlink { .. } | Owned::Link(_) | Owned::Compensate => {}
        }
    }
}

#[test]
fn a_native_tag_survives_anything() {
    use ranging::native::{PollContent, Tag, TagConfig};
    for seed in 0..5 {
        let tells = [PollContent::Distances, PollContent::Position][seed as usize % 2];
        let rate = if seed == 0 { Rate::Greedy } else { Rate::Every(RadioDuration::from_micros(30_000)) };
        let mut tag = Tag::new(TagConfig {
            address: ADDRESS,
            network: NETWORK,
            anchors: 8,
            rate,
            scheme: if seed < 3 { Scheme::DoubleSided } else { Scheme::SingleSided },
            tells,
            blinks: seed > 2,
        });
        if seed > 1 {
            tag.doze();
        }
        torment(tag, seed);
    }
}

#[test]
fn a_native_anchor_survives_anything() {
    use ranging::native::{Anchor, AnchorConfig, AnchorTables};
    for seed in 10..13 {
        let (antenna_delay, position_m) = (RadioDuration::from_ticks(16_436), Some([1.0, f32::NAN, 2.0]));
        torment(
            Anchor::new(
                AnchorConfig {
                    address: ADDRESS,
                    network: NETWORK,
                    antenna_delay,
                    position_m,
                    rounds: (seed == 11).then_some(Rate::Greedy),
                },
                AnchorTables::default(),
            ),
            seed,
        );
    }
}

#[test]
fn a_listening_tag_survives_anything() {
    use ranging::native::{TdoaTag, TdoaTagConfig};
    for (seed, period) in [(40, None), (41, Some(RadioDuration::from_micros(200_000)))] {
        torment(TdoaTag::new(TdoaTagConfig { network: NETWORK, period }), seed);
    }
}

#[test]
fn a_decaranging_tag_survives_anything() {
    use ranging::decaranging::{Tag, TagConfig};
    for (seed, variant) in [(20, Variant::Standard), (21, Variant::Fast)] {
        torment(
            Tag::new(TagConfig {
                eui: EUI,
                variant,
                phy: PhyConfig::FAST,
                turnaround: ReplyDelay::START,
                antenna_delay: RadioDuration::from_ticks(16_436),
                period: RadioDuration::from_micros(50_000),
            }),
            seed,
        );
    }
}

#[test]
fn a_decaranging_anchor_survives_anything() {
    use ranging::decaranging::{Anchor, AnchorConfig, INIT_DELAY};
    for seed in 30..32 {
        let (phy, turnaround) = (PhyConfig::FAST, ReplyDelay::START);
        let antenna_delay = RadioDuration::from_ticks(16_436);
        let init_delay = if seed == 30 { INIT_DELAY } else { RadioDuration::from_micros(1_000_000) };
        torment(
            Anchor::new(AnchorConfig { address: ADDRESS, eui: EUI, phy, turnaround, antenna_delay, init_delay }),
            seed,
        );
    }
}
