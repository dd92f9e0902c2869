//! The protocols' state machines, driven by any events and frames: what they ask of the radio is possible, and what
//! they report is finite.

use ranging::decaranging::{self, INIT_DELAY};
use ranging::exchange::{Action, Event, Protocol, Report};
use ranging::native::{self, Network, PollContent, Rate, ReplyDelay, Scheme};
use ranging::{Diagnostics, Pace, PhyConfig, RadioDuration, RadioInstant, RangeBias, RxFrame, StampModel, Start};
use wire::uwb::decaranging::Variant;

use crate::finite;

const NETWORK: Network = Network::new(0xBA1A, PhyConfig::FAST);
const ADDRESS: u16 = 0x0101;
const ANTENNA_DELAY: RadioDuration = RadioDuration::from_ticks(16_436);
const STAMPS: StampModel = StampModel {
    delayed_step: 512,
    antenna_delay: ANTENNA_DELAY,
    range_bias: RangeBias {
        table: &[-0.1, 0.0, 0.1],
        first_dbm: -61.0,
        step_db: 10.0,
        estimates: &[(-90.0, -90.0), (-77.5, -60.0)],
        first_metre_dbm: -63.0,
    },
};
/// Half a turn of the clock: no instant is farther away.
const HALF_TURN_US: i64 = 8_700_000;
/// The longest frame without its check bytes.
const LONGEST: usize = 125;

fn is_even(input: &[u8]) -> bool {
    input.first().is_some_and(|byte| byte & 1 == 0)
}

pub fn tag(input: &[u8]) {
    let every = Rate::Every(RadioDuration::from_micros(30_000));
    let scheme =
        if input.first().is_some_and(|byte| byte & 2 == 0) { Scheme::SingleSided } else { Scheme::DoubleSided };
    drive(
        native::Tag::new(native::TagConfig {
            address: ADDRESS,
            network: NETWORK,
            anchors: 8,
            rate: if is_even(input) { Rate::Greedy } else { every },
            scheme,
            tells: PollContent::Distances,
            blinks: input.first().is_some_and(|byte| byte & 12 == 12),
        }),
        input,
    );
}

pub fn anchor(input: &[u8]) {
    let mut anchor = native::Anchor::new(native::AnchorConfig {
        address: ADDRESS,
        network: NETWORK,
        antenna_delay: ANTENNA_DELAY,
        position_m: Some([1.0, 2.0, 3.0]),
        rounds: is_even(input).then_some(Rate::Greedy),
    }, native::AnchorTables::default());
    anchor.set_host(input.first().is_some_and(|byte| byte & 4 != 0));
    drive(anchor, input);
}

pub fn tdoa_tag(input: &[u8]) {
    drive(native::TdoaTag::new(native::TdoaTagConfig { network: NETWORK, period: None }), input);
}

pub fn decaranging_tag(input: &[u8]) {
    drive(
        decaranging::Tag::new(decaranging::TagConfig {
            eui: 7,
            variant: if is_even(input) { Variant::Standard } else { Variant::Fast },
            phy: PhyConfig::FAST,
            turnaround: ReplyDelay::START,
            antenna_delay: ANTENNA_DELAY,
            period: RadioDuration::from_micros(50_000),
        }),
        input,
    );
}

pub fn decaranging_anchor(input: &[u8]) {
    drive(
        decaranging::Anchor::new(decaranging::AnchorConfig {
            address: ADDRESS,
            eui: 7,
            phy: PhyConfig::FAST,
            turnaround: ReplyDelay::START,
            antenna_delay: ANTENNA_DELAY,
            init_delay: INIT_DELAY,
        }),
        input,
    );
}

/// Begins of frames of each protocol, after the first byte of an operation.
const HEADS: [&[u8]; 4] = [
    &[0x41, 0x88, 1, 0x1A, 0xBA, 0xFF, 0xFF],
    &[0x41, 0x88, 1, 0x1A, 0xBA, 1, 1],
    &[0x41, 0x88, 1, 0xCA, 0xDE, 1, 1],
    &[],
];

pub fn seeds() -> Vec<Vec<u8>> {
    let body = |kind: u8| [&[2, 1, kind][..], &[1; 60]].concat();
    let operation = |op: u8, kind: u8| [&[op, 0, 16, 63][..], &body(kind)].concat();
    (0..4_u8).map(|head| (0x30..0x37).flat_map(|kind| operation(head << 4, kind)).collect()).collect()
}

/// What the last action was, which decides what can follow it.
enum Last {
    Transmit,
    Receive,
    Report,
    Pause,
}

fn check(now: RadioInstant, action: Action<'_>) -> Last {
    match action {
        Action::Transmit { frame, start, listen: _ } => {
            assert!((1..=LONGEST).contains(&frame.len()));
            if let Start::At(at) = start {
                assert!(at.since(now).as_micros().abs() < HALF_TURN_US);
            }
            Last::Transmit
        }
        Action::Receive { start: _, window, keep_listening: _ } => {
            assert!((0..HALF_TURN_US).contains(&window.as_micros()), "{window:?}");
            Last::Receive
        }
        Action::Sleep { from: _, duration } => {
            assert!(duration.ticks() >= 0, "{duration:?}");
            Last::Pause
        }
        Action::WaitUntil(_) | Action::Compensate => Last::Pause,
        Action::Report(Report::Round(round)) => {
            for range in round.ranges {
                finite([range.distance_m, range.deviation_m].map(f64::from));
                finite(range.position_m.into_iter().flatten().map(f64::from));
                assert!(range.deviation_m >= 0.0);
            }
            Last::Report
        }
        Action::Report(Report::Differences(round)) => {
            for difference in round.differences {
                finite([difference.difference_m, difference.deviation_m].map(f64::from));
            }
            Last::Report
        }
        Action::Report(Report::Link(_) | Report::Polled(_) | Report::Arrival(_) | Report::Downlink(_)) => Last::Report,
    }
}

/// Each operation of the input is four bytes: what happens, how much later (two), and a length or a measurement.
fn drive(mut protocol: impl Protocol, input: &[u8]) {
    protocol.calibrate(&STAMPS);
    let first = input.first().copied().unwrap_or(0);
    let mut now = RadioInstant::from_ticks(u64::from(first) << 32);
    let mut last = check(now, protocol.step(now, Event::Started));
    let mut rest = input.get(1..).unwrap_or_default();
    while let Some((&[op, low, high, length], after)) = rest.split_first_chunk() {
        rest = after;
        let ticks = i64::from(u16::from_le_bytes([low, high])) << [0, 8, 16, 22][usize::from(op >> 6)];
        now = now.plus(RadioDuration::from_ticks(ticks));
        if op & 0x0F == 10 {
            protocol.pace(Pace { armed: Some(now), listening: Some(now), ready: Some(now) });
        }
        let mut frame = Vec::new();
        let event = match (&last, op & 0x0F) {
            (_, 15) => Event::Started,
            (_, 14) => Event::Late,
            (_, 13) => Event::NotSent,
            (_, 12) => Event::Corrupt,
            (_, 11) => Event::Timeout,
            (Last::Transmit, _) => Event::Sent(now),
            (Last::Pause, _) => Event::Woken,
            (Last::Report, _) => Event::Reported,
            (Last::Receive, _) => {
                let (body, after) = rest.split_at(usize::from(length % 126).min(rest.len()));
                rest = after;
                frame.extend(HEADS[usize::from(op >> 4 & 3)]);
                frame.extend(body);
                frame.truncate(LONGEST);
                let diagnostics = Diagnostics {
                    rx_power_dbm: [f32::NAN, -70.0, -90.0, f32::INFINITY][usize::from(length >> 6)],
                    clock_offset_ppm: [0.0, f32::NAN, 20.0, -90.0][usize::from(low & 3)],
                    ..Diagnostics::default()
                };
                Event::Received(RxFrame { bytes: &frame, rx_time: now, diagnostics })
            }
        };
        last = check(now, protocol.step(now, event));
    }
}
