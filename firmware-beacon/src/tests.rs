//! Tests the beacon's program with an advertiser that records its commands and may fail.

use core::cell::RefCell;
use core::pin::pin;
use core::task::{Context, Poll, Waker};
use std::rc::Rc;
use std::vec;
use std::vec::Vec;

use wire::ble::{IBeacon, Revealed, RotatingId};
use wire::config::{Advertiser, Calibration, Identity, Mode, Network, Phy, Record, Role};

use super::*;

const KEY: [u8; 16] = *b"key of this site";
const CHIP: [u8; 6] = [0x60, 0x55, 0xF9, 0x01, 0x02, 0x03];
const ADVERTISER: Advertiser = Advertiser {
    uuid: [0x11; 16],
    major: 3,
    minor: 7,
    measured_power_dbm: -59,
    interval_ms: 100,
    tx_power_dbm: 0,
    channels: 0b111,
    rotate_s: 0,
};

fn record(role: Role, beacon_key: Option<[u8; 16]>) -> Record {
    Record {
        identity: Identity::default(),
        role,
        network: Network {
            pan: 0xDECA,
            mode: Mode::Native,
            phy: Phy { channel: 5, prf_mhz: 64, rate_kbps: 6810, preamble: 128, code: None },
            turnaround: None,
            region: None,
            key: None,
        },
        calibration: Calibration::default(),
        pins: None,
        anchors: Default::default(),
        beacons: Default::default(),
        beacon_key,
    }
}

fn settings(change: impl FnOnce(&mut Advertiser)) -> Result<Settings, SettingsError> {
    let mut advertiser = ADVERTISER;
    change(&mut advertiser);
    Settings::of(&record(Role::Advertiser(advertiser), Some(KEY)), CHIP)
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Seen {
    Started(Advertisement),
    Stopped,
    Waited(u32),
    Advertising,
    Failed(u32),
    Alive,
}

/// Everything that the program needs. All parts write into one list, and their futures never wait.
#[derive(Clone)]
struct Bench {
    seen: Rc<RefCell<Vec<Seen>>>,
    /// The number of calls of `start` that still fail.
    failures: Rc<RefCell<u32>>,
    /// The number of delays before the test ends.
    delays: Rc<RefCell<u32>>,
}

impl Advertise for Bench {
    type Error = &'static str;

    async fn start(&mut self, advertisement: &Advertisement) -> Result<(), Self::Error> {
        let mut failures = self.failures.borrow_mut();
        if *failures > 0 {
            *failures -= 1;
            return Err("busy");
        }
        self.seen.borrow_mut().push(Seen::Started(*advertisement));
        Ok(())
    }

    async fn stop(&mut self) -> Result<(), Self::Error> {
        self.seen.borrow_mut().push(Seen::Stopped);
        Ok(())
    }
}

impl Listener for Bench {
    fn advertising(&mut self, _: &Advertisement) {
        self.seen.borrow_mut().push(Seen::Advertising);
    }
    fn failed(&mut self, _: &impl core::fmt::Debug, failures: u32) {
        self.seen.borrow_mut().push(Seen::Failed(failures));
    }
    fn alive(&mut self) {
        self.seen.borrow_mut().push(Seen::Alive);
    }
}

impl DelayNs for Bench {
    async fn delay_ns(&mut self, _: u32) {
        unreachable!("the app waits milliseconds");
    }
    async fn delay_ms(&mut self, ms: u32) {
        self.seen.borrow_mut().push(Seen::Waited(ms));
        if *self.delays.borrow() == 0 {
            core::future::pending::<()>().await;
        }
        *self.delays.borrow_mut() -= 1;
    }
}

/// What the program does until its delay has been called `delays` times more. Each call of `random` fills its bytes
/// with the next number.
fn observe(settings: &Settings, failures: u32, delays: u32) -> Vec<Seen> {
    let bench = Bench { seen: Rc::default(), failures: Rc::new(failures.into()), delays: Rc::new(delays.into()) };
    let mut next = 0;
    let random = |bytes: &mut [u8]| {
        next += 1;
        bytes.fill(next);
    };
    let app = pin!(run(bench.clone(), bench.clone(), random, settings, bench.clone()));
    assert!(matches!(app.poll(&mut Context::from_waker(Waker::noop())), Poll::Pending));
    bench.seen.take()
}

fn starts(seen: &[Seen]) -> Vec<Advertisement> {
    seen.iter()
        .filter_map(|seen| if let Seen::Started(advertisement) = seen { Some(*advertisement) } else { None })
        .collect()
}

#[test]
fn an_open_beacon_starts_once_and_stays() {
    let settings = settings(|_| ()).expect("a beacon's");
    let seen = observe(&settings, 0, 100);
    let beacon = IBeacon { uuid: [0x11; 16], major: 3, minor: 7, measured_power_dbm: -59 };
    // Random static: the chip's 60:55:F9:01:02:03 with the two highest bits set, 0x60 | 0xC0 = 0xE0, the lowest byte
    // first.
    let expected = Advertisement {
        data: beacon.emit(),
        address: [0x03, 0x02, 0x01, 0xF9, 0x55, 0xE0],
        interval_ms: 100,
        channels: Channels::new(0b111).expect("three channels"),
        tx_power_dbm: 0,
    };
    assert_eq!(seen[..4], [Seen::Stopped, Seen::Started(expected), Seen::Advertising, Seen::Alive]);
    assert_eq!(starts(&seen).len(), 1);
    assert_eq!(seen.iter().filter(|&&seen| seen == Seen::Alive).count(), 101, "a sign of life each second");
}

#[test]
fn a_beacon_with_rotating_identifiers_changes_data_and_address_in_time_and_our_tags_know_it() {
    let settings = settings(|advertiser| advertiser.rotate_s = 3).expect("a beacon's");
    // Three seconds for each advertisement, in steps of one second: seven delays are two rotations and a second.
    let seen = observe(&settings, 0, 7);
    let starts = starts(&seen);
    assert_eq!(starts.len(), 3);
    for advertisement in &starts {
        let heard = IBeacon::parse(&advertisement.data).expect("an iBeacon");
        assert_eq!(
            RotatingId::new(&KEY).reveal(&heard),
            Some(Revealed { major: 3, minor: 7, measured_power_dbm: -59 })
        );
        assert_ne!((heard.uuid, heard.major, heard.minor), ([0x11; 16], 3, 7));
        assert_eq!(advertisement.address[5] >> 6, 0b00, "a non-resolvable private address");
    }
    for (one, next) in starts.iter().zip(&starts[1..]) {
        assert_ne!(one.address, next.address);
        assert_ne!(one.data[9..29], next.data[9..29]);
    }
    let rotation = [Seen::Alive, Seen::Waited(1000), Seen::Stopped, Seen::Started(starts[1]), Seen::Advertising];
    assert!(seen.windows(5).any(|window| window == rotation), "{seen:?}");
}

#[test]
fn an_address_is_never_all_zeros_or_all_ones() {
    let settings = settings(|advertiser| advertiser.rotate_s = 1).expect("a beacon's");
    for byte in [0x00, 0xFF] {
        let address = settings.advertisement(&[byte; RANDOM_BYTES]).address;
        assert_eq!(address, [1, 0, 0, 0, 0, 0]);
    }
}

#[test]
fn a_failing_controller_is_tried_again_ever_more_slowly() {
    let settings = settings(|_| ()).expect("a beacon's");
    let seen = observe(&settings, 7, 8);
    let failures: Vec<_> = seen.iter().filter(|seen| matches!(seen, Seen::Failed(_))).copied().collect();
    assert_eq!(failures, (1..=7).map(Seen::Failed).collect::<Vec<_>>());
    let waits: Vec<_> =
        seen.iter().filter_map(|seen| if let Seen::Waited(ms) = seen { Some(*ms) } else { None }).take(7).collect();
    let first_start = seen.iter().position(|seen| matches!(seen, Seen::Started(_))).expect("a start");
    assert!(!seen[..first_start].contains(&Seen::Alive), "no sign of life before it works");
    assert_eq!(waits, vec![50, 100, 200, 400, 800, 1000, 1000]);
    assert_eq!(starts(&seen).len(), 1);
}

#[test]
fn what_cannot_be_advertised_is_refused_with_the_reason() {
    let fault = |change: fn(&mut Advertiser)| settings(change).err();
    assert_eq!(fault(|a| a.interval_ms = 19), Some(SettingsError::Interval(19)));
    assert_eq!(fault(|a| a.interval_ms = 10_241), Some(SettingsError::Interval(10_241)));
    assert_eq!(fault(|a| a.interval_ms = 20), None);
    assert_eq!(fault(|a| a.interval_ms = 10_240), None);
    assert_eq!(fault(|a| a.channels = 0), Some(SettingsError::Channels(0)));
    assert_eq!(fault(|a| a.channels = 8), Some(SettingsError::Channels(8)));
    assert_eq!(fault(|a| a.channels = 0b100), None);
    let keyless = record(Role::Advertiser(Advertiser { rotate_s: 60, ..ADVERTISER }), None);
    assert_eq!(Settings::of(&keyless, CHIP).err(), Some(SettingsError::NoKey));
    let anchor = record(Role::Anchor { position_m: None }, Some(KEY));
    assert_eq!(Settings::of(&anchor, CHIP).err(), Some(SettingsError::OtherRole));
}
