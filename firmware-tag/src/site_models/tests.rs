use positioning_core::Real;
use positioning_core::ble::fingerprint::{Point, encode};
use positioning_core::ble::rooms::{Kind, Model, Svm};
use std::vec::Vec;
use wire::ble::{Advertised, IBeacon};
use wire::config::{MODELS_BYTES, decode_models, encode_models};

use super::*;
use crate::channels::ReceivedAdvertisement;
use crate::{KnownBeacons, LocatorConfig};

/// The tracker of a tag with Bluetooth.
type Tracker<'a> = crate::Tracker<'a, { crate::MAX_LISTED }>;

/// The corners of a square of 6 m, at the tag's height: the positions of beacons 1-1 to 1-4.
const CORNERS: [[f32; 2]; 4] = [[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]];

/// The list has another order than the map. It has one beacon, 1-9, in the middle that the map does not know.
fn list() -> Vec<Beacon> {
    let beacon = |minor, [x, y]: [f32; 2]| Beacon {
        major: 1,
        minor,
        position_m: [x, y, 1.0],
        rssi_1m_dbm: Some(-60.0),
        path_loss_exponent: None,
    };
    [(4, CORNERS[3]), (9, [3.0, 3.0]), (1, CORNERS[0]), (2, CORNERS[1]), (3, CORNERS[2])]
        .map(|(m, at)| beacon(m, at))
        .into()
}

/// The RSSI of 1-1 to 1-4 at a position, dBm: −60 − 20 lg d. The first beacon is behind a wall that attenuates by 12
/// dB.
fn levels_at(place: [f32; 2]) -> [f64; 4] {
    core::array::from_fn(|beacon| {
        let [dx, dy] = [0, 1].map(|axis| f64::from(place[axis] - CORNERS[beacon][axis]));
        let wall = if beacon == 0 { 12.0 } else { 0.0 };
        -60.0 - 20.0 * f64::hypot(dx, dy).max(0.5).log10() - wall
    })
}

/// A lattice of 13 × 13 points, 0.5 m apart, of those RSSI values with deviations of 1.5 dB.
fn map_bytes() -> Vec<u8> {
    let places: Vec<[f32; 2]> = (0..169_u8).map(|k| [f32::from(k / 13) * 0.5, f32::from(k % 13) * 0.5]).collect();
    let levels: Vec<[Option<f64>; 4]> = places.iter().map(|place| levels_at(*place).map(Some)).collect();
    let points: Vec<Point> = places
        .iter()
        .zip(&levels)
        .map(|(place, rssis)| Point { position_m: place.map(f64::from), rssis, deviations: &[1.5; 4] })
        .collect();
    encode(&points, &[1, 2, 3, 4], &[-95.0; 4], Some(0.5), &mut [0; 4096]).expect("it fits").to_vec()
}

/// Two rooms, which the RSSI of 1-1 distinguishes: above −80 dBm the first. x = 5 · 0.2 · (RSSI + 80).
fn rooms_bytes() -> Vec<u8> {
    let bytes = |numbers: &[f32]| -> Vec<u8> { numbers.iter().flat_map(|n| n.to_le_bytes()).collect() };
    let (fallback, planes) = (bytes(&[-95.0]), bytes(&[16.0, 0.2]));
    let svm = Svm { rooms: 2, slope: 5.0, fallback_dbm: &fallback, planes: &planes };
    Model { kind: Kind::Svm(svm) }.encode(&mut [0; 64]).expect("it fits").to_vec()
}

fn numbers(minors: &[u8]) -> Vec<u8> {
    minors.iter().flat_map(|minor| [1, 0, *minor, 0]).collect()
}

/// A region with a map of these beacons, and with rooms.
fn region(minors: &[u8], map: &[u8], rooms: &[u8]) -> Vec<u8> {
    let (of_map, of_rooms) = (numbers(minors), numbers(&[1]));
    let models = StoredSiteModels {
        map: Some(BeaconModel { beacons: &of_map, model: map }),
        rooms: Some(BeaconModel { beacons: &of_rooms, model: rooms }),
        room_names: "",
    };
    encode_models(&models, &mut [0; MODELS_BYTES]).expect("they fit").to_vec()
}

/// What a tag uses of a region, and the faults that it reports.
fn taken<'r>(region: &'r [u8], list: &[Beacon]) -> (SiteModels<'r>, Vec<Condition>) {
    let mut complaints = Vec::new();
    let site_models = site_models(decode_models(region), list, |condition| complaints.push(condition));
    (site_models, complaints)
}

fn tracker<'a>(list: &'a [Beacon], models: &'a SiteModels<'a>) -> Tracker<'a> {
    let config = LocatorConfig::new(Some(1.0), &[]).with_beacons(KnownBeacons::new(list, None));
    config.with_site_models(models).tracker()
}

/// One window, in which ten advertisements of each beacon are received with its RSSI there. Returns the position.
fn window(tracker: &mut Tracker<'_>, from_us: u64, rssi_dbm: &[(u16, i8)]) -> Option<[f32; 3]> {
    for k in 0..10 {
        for (minor, rssi_dbm) in rssi_dbm {
            let ibeacon = IBeacon { uuid: [1; 16], major: 1, minor: *minor, measured_power_dbm: -60 };
            let heard = ReceivedAdvertisement {
                t_us: from_us + 50_000 * k,
                beacon: Advertised::IBeacon(ibeacon),
                rssi_dbm: *rssi_dbm,
            };
            assert!(tracker.receive(&heard).is_some());
        }
    }
    let end_us = tracker.window_end_us()?;
    tracker.window(end_us)?.outcome.ok().map(|position| position.position_m)
}

fn rounded(place: [f32; 2]) -> Vec<(u16, i8)> {
    (1..).zip(levels_at(place).map(|level| level.round() as i8)).collect()
}

fn off(found: [f32; 3], [x, y]: [f32; 2]) -> f32 {
    Real::sqrt((found[0] - x) * (found[0] - x) + (found[1] - y) * (found[1] - y))
}

#[test]
fn a_tag_with_a_map_knows_walls_that_path_loss_does_not() {
    let (list, region) = (list(), region(&[1, 2, 3, 4], &map_bytes(), &rooms_bytes()));
    let (models, complaints) = taken(&region, &list);
    assert!(complaints.is_empty(), "{complaints:?}");
    let place = [1.5, 2.0];
    let by_map = window(&mut tracker(&list, &models), 0, &rounded(place)).expect("a position");
    let nothing = SiteModels::default();
    let by_path_loss = window(&mut tracker(&list, &nothing), 0, &rounded(place)).expect("a position");
    // RSSI values are rounded to a decibel, those of the lattice to half a decibel: at 2 m from the nearest beacon a
    // decibel is 0.25 m.
    assert!(off(by_map, place) < 0.4, "{by_map:?}");
    assert!(off(by_path_loss, place) > 0.8, "{by_path_loss:?}");
}

#[test]
fn a_beacon_that_the_map_does_not_know_changes_nothing_and_alone_it_is_heeded_by_its_path_loss() {
    let (list, region) = (list(), region(&[1, 2, 3, 4], &map_bytes(), &rooms_bytes()));
    let (models, _) = taken(&region, &list);
    let place = [4.0, 2.0];
    let mut heard = rounded(place);
    let without = window(&mut tracker(&list, &models), 0, &heard).expect("a position");
    // The unknown beacon seems to be 10 m off.
    heard.push((9, -80));
    let mut with = tracker(&list, &models);
    assert_eq!(window(&mut with, 0, &heard), Some(without));
    // Fewer beacons are received than the map knows.
    let mut fewer = tracker(&list, &models);
    let found = window(&mut fewer, 0, &heard[1..4]).expect("a position");
    assert!(off(found, place) < 0.8, "{found:?}");
    let mut none = tracker(&list, &models);
    for t_us in [0, 1_000_000] {
        let found = window(&mut none, t_us, &heard[4..]);
        assert!(found.is_none_or(|found| found.iter().all(|metres| metres.is_finite())), "{found:?}");
    }
}

#[test]
fn levels_that_are_none_spoil_nothing() {
    let (list, region) = (list(), region(&[1, 2, 3, 4], &map_bytes(), &rooms_bytes()));
    let (models, _) = taken(&region, &list);
    for rssi_dbm in [127, 0, -128] {
        let mut tracker = tracker(&list, &models);
        let all: Vec<_> = (1..=4).map(|minor| (minor, rssi_dbm)).collect();
        assert_eq!(window(&mut tracker, 0, &all), None);
        let mut mixed = rounded([4.0, 2.0]);
        mixed[0].1 = rssi_dbm;
        let found = window(&mut tracker, 1_000_000, &mixed).expect("a position");
        assert!(off(found, [4.0, 2.0]) < 0.8, "{rssi_dbm}: {found:?}");
    }
}

#[test]
fn what_cannot_be_used_is_complained_of_once_and_the_rest_is_used() {
    use wire::telemetry::SiteModelPart::{All, Map, Rooms};
    let (list, map, rooms) = (list(), map_bytes(), rooms_bytes());
    let said = |region: &[u8]| taken(region, &list).1;
    assert_eq!(said(&[0xFF; 64]), [], "nothing is nothing to complain of");
    let whole = region(&[1, 2, 3, 4], &map, &rooms);
    let mut damaged = whole.clone();
    damaged[500] ^= 4;
    assert_eq!(said(&damaged), [Condition::Unused(All, RssiModelError::Corrupt)]);
    let mut flipped = map.clone();
    flipped[500] ^= 4;
    assert_eq!(said(&region(&[1, 2, 3, 4], &flipped, &rooms)), [Condition::Unused(Map, RssiModelError::Corrupt)]);
    let mut newer = map.clone();
    newer[2] = 9;
    assert_eq!(said(&region(&[1, 2, 3, 4], &newer, &rooms)), [Condition::Unused(Map, RssiModelError::Version(9))]);
    assert_eq!(said(&region(&[1, 2, 3, 7], &map, &rooms)), [Condition::Unused(Map, RssiModelError::OtherBeacons)]);
    assert_eq!(said(&region(&[1, 2, 3], &map, &rooms)), [Condition::Unused(Map, RssiModelError::Invalid)]);
    let point = Point { position_m: [0.0; 2], rssis: &[Some(-60.0)], deviations: &[] };
    let plain = encode(&[point], &[1], &[-95.0], None, &mut [0; 64]).expect("it fits").to_vec();
    assert_eq!(said(&region(&[1], &plain, &rooms)), [Condition::Unused(Map, RssiModelError::Invalid)]);
    let cut = region(&[1, 2, 3, 4], &map, &rooms[..20]);
    assert_eq!(said(&cut), [Condition::Unused(Rooms, RssiModelError::Corrupt)]);
    assert!(taken(&cut, &list).0.map.is_some() && taken(&cut, &list).0.rooms.is_none());
}

#[test]
fn a_room_is_told_when_it_changes_and_every_five_seconds() {
    let (list, region) = (list(), region(&[1, 2, 3, 4], &map_bytes(), &rooms_bytes()));
    let (models, _) = taken(&region, &list);
    let mut tracker = tracker(&list, &models);
    let mut told = Vec::new();
    // x = ± 10: certain within 10⁻⁴. Thirteen windows in the first room, then the second.
    for k in 0..40 {
        window(&mut tracker, 500_000 * k, &[(1, if k < 13 { -70 } else { -90 })]);
        told.extend(tracker.room().map(|told| (told.room.is, told.is_news)));
        assert!(tracker.room().is_none());
    }
    let rooms: Vec<_> =
        told.iter().map(|(is, news)| (is.rooms().iter().map(|l| l.room).collect::<Vec<_>>(), *news)).collect();
    assert_eq!(rooms[..2], [(std::vec![0], true), (std::vec![0], false)], "{rooms:?}");
    let news: Vec<_> = rooms.iter().filter(|(_, news)| *news).map(|(rooms, _)| rooms.clone()).collect();
    assert_eq!(news.first(), Some(&std::vec![0]));
    assert_eq!(news.last(), Some(&std::vec![1]), "{news:?}");
    assert!(
        told.iter().flat_map(|(is, _)| is.rooms().to_vec()).all(|likely| likely.probability_255ths > 10),
        "{told:?}"
    );
    // Nothing is received any more. The tag reports this after ten seconds, and then windows end.
    let mut last = None;
    for _ in 0..100 {
        let Some(end_us) = tracker.window_end_us() else { break };
        tracker.window(end_us);
        last = tracker.room().map(|told| told.room.is).or(last);
    }
    assert_eq!(last, Some(wire::telemetry::RoomEstimate::Unknown));
}
