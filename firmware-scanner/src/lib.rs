//! The complete Bluetooth scanner. A board's binary provides a scanner, a delay and a [`Reporter`], and calls
//! [`Sightings::run`]; what the scanner receives goes to [`Sightings::receive`].
//!
//! Advertisement → beacon that the record knows (with an empty list: every beacon) → at most one [`Sighting`] of it in half
//! a second. The station locates the beacon by the sightings of several scanners.
//!
//! Advertisement → position of a tag of the record's network → [`TagFix`], as of an anchor that receives the tag's poll.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

use core::cell::{Cell, RefCell};
use core::convert::Infallible;
use core::future::pending;

use embassy_futures::join::join;
use embassy_sync::blocking_mutex::raw::RawMutex;
use embedded_hal_async::delay::DelayNs;
use firmware_common::Reporter;
use firmware_common::counts::Tally;
use firmware_tag::KnownBeacons;
use firmware_tag::scan::{Ears, Plan, Scanner, supervise};
use heapless::LinearMap;
use wire::ble::{Advertised, TagPosition};
use wire::config::Record;
use wire::telemetry::{BeaconId, Condition, Sighting, TagFix};
use wire::uwb::native::{MakeCode, software_code};

/// From one sighting of a beacon to its next, microseconds: a station uses no more.
const EVERY_US: u64 = 500_000;
/// Beacons whose last sightings are known. Another one takes the place of the one that was silent for longest.
const MOST_BEACONS: usize = 64;
/// From one heartbeat to the next, milliseconds.
const HEARTBEAT_MS: u32 = 1000;
/// It scans all the time; each second it is looked whether the scanner hangs.
const PLAN: Plan = Plan { interval_us: 1_000_000, window_us: 1_000_000 };

/// What a scanner receives, on its way to the station.
pub struct Sightings<'r, M: RawMutex, const BYTES: usize, C = fn() -> u64> {
    reporter: &'r Reporter<M, BYTES, C>,
    record: &'r Record,
    known: KnownBeacons<'r>,
    /// When each beacon was reported last.
    reported_us: RefCell<LinearMap<BeaconId, u64, MOST_BEACONS>>,
    /// The tag and the round of the last position.
    told: Cell<Option<(u16, u16)>>,
    received: Tally,
}

impl<'r, M: RawMutex, const BYTES: usize, C: Fn() -> u64> Sightings<'r, M, BYTES, C> {
    /// Those of a node with this record.
    pub fn new(reporter: &'r Reporter<M, BYTES, C>, record: &'r Record) -> Self {
        let known = KnownBeacons::of(record);
        Self {
            reporter,
            record,
            known,
            reported_us: RefCell::new(LinearMap::new()),
            told: Cell::new(None),
            received: Tally::new(),
        }
    }

    /// Takes the data of an advertisement that the scanner has just received.
    pub fn receive(&self, data: &[u8], rssi_dbm: i8) {
        self.received.add();
        // Most advertisements do not come from beacons.
        let Ok(advertised) = Advertised::parse(data) else { return self.receive_tag(data) };
        self.reporter.counts.sightings.add();
        let Some(known) = self.known.identify(&advertised) else { return };
        let (t_us, beacon) = (self.reporter.now_us(), known.id);
        if self.is_due(beacon, t_us) {
            let measured_power_dbm = advertised.rssi_1m_dbm();
            self.reporter.event_log.send(Sighting { t_us, beacon, rssi_dbm, measured_power_dbm });
        }
    }

    /// Takes the data of an advertisement of no beacon.
    fn receive_tag(&self, data: &[u8]) {
        let Record { network, beacon_key, .. } = self.record;
        let key = beacon_key.as_ref().map(|key| (key, software_code as MakeCode));
        let Some(TagPosition { tag, round, asked, position, .. }) =
            TagPosition::parse(data, key).filter(|found| found.pan == network.pan)
        else {
            return;
        };
        self.reporter.counts.sightings.add();
        // A scanner that changes its channel meanwhile receives it twice.
        if self.told.replace(Some((tag, round))) == Some((tag, round)) {
            return;
        }
        let t_us = self.reporter.now_us();
        self.reporter.event_log.send(TagFix { t_us, tag, round, asked, age_us: 0, position: position.0 });
    }

    /// Whether a beacon is reported now. It then counts as reported.
    fn is_due(&self, beacon: BeaconId, t_us: u64) -> bool {
        let mut reported = self.reported_us.borrow_mut();
        if reported.get(&beacon).is_some_and(|last_us| t_us.saturating_sub(*last_us) < EVERY_US) {
            return false;
        }
        if reported.is_full() && !reported.contains_key(&beacon) {
            let oldest = reported.iter().min_by_key(|(_, last_us)| **last_us).map(|(beacon, _)| *beacon);
            oldest.map(|oldest| reported.remove(&oldest));
        }
        // There is room, as made above.
        let _ = reported.insert(beacon, t_us);
        true
    }

    /// Runs the scanner for ever.
    pub async fn run(&self, scanner: impl Scanner, delay: impl DelayNs + Clone) -> Infallible {
        let mut beats = delay.clone();
        let beating = async {
            loop {
                self.reporter.ranging.beat(self.reporter.now_us());
                beats.delay_ms(HEARTBEAT_MS).await;
            }
        };
        join::<_, _>(supervise(PLAN, scanner, delay, self), beating).await.0
    }
}

impl<M: RawMutex, const BYTES: usize, C: Fn() -> u64> Ears for Sightings<'_, M, BYTES, C> {
    fn now_us(&self) -> u64 {
        self.reporter.now_us()
    }

    fn received(&self) -> u32 {
        self.received.get()
    }

    async fn next_quiet(&self) -> u64 {
        // There is no other radio.
        pending().await
    }

    fn restarted(&self, times: u32) {
        self.reporter.event_log.state(self.now_us(), Condition::ScannerRestarted(times));
    }
}

#[cfg(test)]
mod tests {
    use core::pin::pin;
    use core::task::{Context, Waker};
    use std::vec::Vec;

    use embassy_sync::blocking_mutex::raw::NoopRawMutex;
    use wire::ble::{Fresh, IBeacon, RotatingId};
    use wire::config::{Beacon, Calibration, Identity, Mode, Network, Phy, Role};
    use wire::telemetry::{Decoder, Message};
    use wire::uwb::native::PolledPosition;

    use super::*;

    const KEY: [u8; 16] = *b"key of this site";

    fn record() -> Record {
        Record {
            identity: Identity::default(),
            role: Role::Scanner,
            network: Network {
                pan: 0xBA12,
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
            beacon_key: Some(KEY),
        }
    }

    fn ibeacon(major: u16, minor: u16) -> IBeacon {
        IBeacon { uuid: [0xC2; 16], major, minor, measured_power_dbm: -59 }
    }

    /// What a scanner tells of advertisements that come at these times, microseconds.
    fn messages(record: &Record, heard: &[(u64, &[u8], i8)]) -> Vec<Message> {
        let now = Cell::new(0);
        let clock = || now.get();
        let reporter = Reporter::<NoopRawMutex, 4096, _>::new(clock);
        let sightings = Sightings::new(&reporter, record);
        let (mut decoder, mut told) = (Decoder::new(), Vec::new());
        for (t_us, data, rssi_dbm) in heard {
            now.set(*t_us);
            sightings.receive(data, *rssi_dbm);
            reporter.event_log.drain(|frame| {
                told.extend(frame.iter().filter_map(|byte| decoder.feed(*byte)).map(Result::unwrap));
                true
            });
        }
        assert_eq!(sightings.received() as usize, heard.len());
        told
    }

    fn told(record: &Record, heard: &[(u64, &[u8], i8)]) -> Vec<Sighting> {
        let of = |message| if let Message::Sighting(sighting) = message { sighting } else { panic!("{message:?}") };
        messages(record, heard).into_iter().map(of).collect()
    }

    #[test]
    fn positions_of_the_network_s_tags_are_told_as_an_anchor_tells_them() {
        let position = PolledPosition::new([1.0, 2.0, 0.5], [[0.01, 0.0, 0.0]; 3], false).unwrap();
        let own = TagPosition { pan: 0xBA12, tag: 0x1001, round: 300, asked: 4, position };
        let with = |key| Some((key, software_code as MakeCode));
        let (coded, other) = (own.emit(with(&KEY)), TagPosition { tag: 0x1002, ..own }.emit(with(&[7; 16])));
        let stranger = TagPosition { pan: 0xBA13, ..own }.emit(with(&KEY));
        let told = |record: &Record| {
            messages(record, &[(5, &coded, -60), (6, &coded, -60), (7, &other, -60), (8, &stranger, -60)])
        };
        let expected = |t_us, tag| {
            let told = TagFix { t_us, tag, round: 300, asked: 4, age_us: 0, position: position.0 };
            Message::TagFix(told)
        };
        assert_eq!(told(&record()), [expected(5, 0x1001)]);
        let without = told(&Record { beacon_key: None, ..record() });
        assert_eq!(without, [expected(5, 0x1001), expected(7, 0x1002)], "without a key");
    }

    #[test]
    fn a_beacon_is_told_twice_a_second_and_each_by_itself() {
        let (one, other) = (ibeacon(1, 7).emit(), ibeacon(1, 8).emit());
        let heard: Vec<(u64, &[u8], i8)> =
            (0..30).map(|i| (100_000 * i, if i % 10 == 5 { &other[..] } else { &one[..] }, -60 - i as i8)).collect();
        let told = told(&record(), &heard);
        let of = |minor: u16| {
            told.iter()
                .filter(|of| of.beacon.minor == minor)
                .map(|of| (of.t_us / 1000, of.rssi_dbm))
                .collect::<Vec<_>>()
        };
        // At 500 ms the other one is received, so the first one is reported 100 ms later, and each half second from then on.
        assert_eq!(of(7), [(0, -60), (600, -66), (1100, -71), (1600, -76), (2100, -81), (2600, -86)]);
        assert_eq!(of(8), [(500, -65), (1500, -75), (2500, -85)]);
        let beacon = BeaconId { network: 0xC2C2_C2C2, major: 1, minor: 7 };
        assert_eq!(told[0], Sighting { t_us: 0, beacon, rssi_dbm: -60, measured_power_dbm: -59 });
    }

    #[test]
    fn rotating_identifiers_are_known_by_the_key_and_strangers_by_the_list() {
        let rotated = RotatingId::new(&KEY).rotate(&ibeacon(3, 9), Fresh::new([7; 8])).emit();
        let known = told(&record(), &[(0, &rotated, -70)]);
        assert_eq!(known[0].beacon, BeaconId { network: 0, major: 3, minor: 9 });
        let listed = Beacon { major: 1, minor: 7, position_m: [0.0; 3], rssi_1m_dbm: None, path_loss_exponent: None };
        let listing = Record { beacons: [listed].into_iter().collect(), ..record() };
        let (one, other) = (ibeacon(1, 7).emit(), ibeacon(1, 8).emit());
        assert_eq!(told(&listing, &[(0, &one, -60), (1, &other, -60), (2, b"\x02\x01\x06", -60)]).len(), 1);
    }

    #[test]
    fn more_beacons_than_there_is_room_for_are_told_and_the_silent_ones_forgotten() {
        let data: Vec<_> = (0..100).map(|minor| ibeacon(1, minor).emit()).collect();
        let all = |from_us: u64| (0..100_u64).map(move |i| (from_us + i, i as usize));
        let twice: Vec<(u64, &[u8], i8)> =
            all(0).chain(all(1_000)).map(|(t_us, which)| (t_us, &data[which][..], -60)).collect();
        let told = told(&record(), &twice);
        // Of a hundred in turn, each is forgotten before it comes again.
        assert_eq!(told.len(), 200);
    }

    /// A scanner that counts its starts and hears nobody.
    struct Bench<'c>(&'c Cell<u32>);

    impl Scanner for Bench<'_> {
        async fn start(&mut self) {
            self.0.set(self.0.get() + 1);
        }

        async fn stop(&mut self) {}
    }

    #[derive(Clone)]
    struct Passing<'c>(&'c Cell<u64>);

    impl DelayNs for Passing<'_> {
        async fn delay_ns(&mut self, ns: u32) {
            let end_us = self.0.get() + u64::from(ns / 1000);
            core::future::poll_fn(|_| {
                let is_over = self.0.get() >= end_us;
                if is_over { core::task::Poll::Ready(()) } else { core::task::Poll::Pending }
            })
            .await;
        }
    }

    #[test]
    fn a_scanner_that_hears_nobody_is_restarted_and_the_program_is_alive() {
        let (now, starts) = (Cell::new(0), Cell::new(0));
        let clock = || now.get();
        let reporter = Reporter::<NoopRawMutex, 4096, _>::new(clock);
        let record = record();
        let sightings = Sightings::new(&reporter, &record);
        let mut running = pin!(sightings.run(Bench(&starts), Passing(&now)));
        let mut context = Context::from_waker(Waker::noop());
        for ms in 0..65_000 {
            now.set(1000 * ms);
            assert!(running.as_mut().poll(&mut context).is_pending());
            assert!(reporter.ranging.is_alive(now.get()));
        }
        // At the start, and after each thirty seconds.
        assert_eq!(starts.get(), 3);
    }
}
