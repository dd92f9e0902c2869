use super::*;
use crate::LocatorConfig;
use wire::ble::{Advertised, IBeacon};
use wire::config::Beacon;

/// The tracker of a tag with Bluetooth.
type Tracker<'a> = super::Tracker<'a, { crate::MAX_LISTED }>;

/// Beacons in the corners of a square of 6 m, at the tag's height.
fn corners() -> [Beacon; 4] {
    [[0.0, 0.0, 1.0], [6.0, 0.0, 1.0], [6.0, 6.0, 1.0], [0.0, 6.0, 1.0]].map(|position_m: [f32; 3]| Beacon {
        major: 1,
        minor: (position_m[0] + 2.0 * position_m[1]) as u16,
        position_m,
        rssi_1m_dbm: Some(-60.0),
        path_loss_exponent: None,
    })
}

fn heard(beacon: &Beacon, t_us: u64, rssi_dbm: i8) -> ReceivedAdvertisement {
    let ibeacon = IBeacon { uuid: [1; 16], major: beacon.major, minor: beacon.minor, measured_power_dbm: -60 };
    ReceivedAdvertisement { t_us, beacon: Advertised::IBeacon(ibeacon), rssi_dbm }
}

fn tracker(height_m: Option<f32>, list: &[Beacon]) -> Tracker<'_> {
    LocatorConfig::new(height_m, &[]).with_beacons(KnownBeacons::new(list, None)).tracker()
}

/// The result of the window after ten advertisements of each beacon.
fn after(
    tracker: &mut Tracker<'_>,
    list: &[Beacon],
    from_us: u64,
    rssi_dbm: impl Fn(usize) -> i8,
) -> Option<Result<[f32; 3], SolveError>> {
    for k in 0..10 {
        for (place, beacon) in list.iter().enumerate() {
            assert!(tracker.receive(&heard(beacon, from_us + 50_000 * k, rssi_dbm(place))).is_some());
        }
    }
    let end_us = tracker.window_end_us()?;
    tracker.window(end_us).map(|epoch| epoch.outcome.map(|position| position.position_m))
}

#[test]
fn levels_of_the_middle_are_found_there() {
    let list = corners();
    let mut tracker = self::tracker(Some(1.0), &list);
    // √18 m from each: −60 − 20 lg 4.243 = −72.55 dBm.
    let found = after(&mut tracker, &list, 0, |_| -73).expect("an epoch").expect("a position");
    assert!((found[0] - 3.0).abs() < 0.1 && (found[1] - 3.0).abs() < 0.1, "{found:?}");
    assert_eq!(found[2], 1.0);
}

#[test]
fn an_rssi_that_is_none_makes_no_position() {
    let list = corners();
    for rssi_dbm in [127, 0] {
        let mut tracker = self::tracker(Some(1.0), &list);
        assert_eq!(after(&mut tracker, &list, 0, |_| rssi_dbm), None);
        // Valid advertisements in between still count.
        let mixed = |place| if place == 3 { rssi_dbm } else { -73 };
        let found = after(&mut tracker, &list, 1_000_000, mixed).expect("an epoch").expect("a position");
        assert!((found[0] - 3.0).abs() < 1.0 && (found[1] - 3.0).abs() < 1.0, "{found:?}");
    }
}

#[test]
fn a_tag_that_hears_nothing_any_more_says_so_and_one_that_never_did_is_silent() {
    let list = corners();
    let mut tracker = self::tracker(Some(1.0), &list);
    assert!(tracker.window_end_us().is_none() && tracker.window(1_000_000).is_none());
    after(&mut tracker, &list, 0, |_| -73);
    let mut told = std::vec::Vec::new();
    for _ in 0..10 {
        let end_us = tracker.window_end_us().expect("windows go on");
        told.extend(tracker.window(end_us).map(|epoch| (end_us, epoch.outcome.err())));
    }
    // A scan may pause: windows without a position begin two and a half seconds after the last advertisement, which
    // came at 0.45 s.
    assert!(
        told.iter().all(|(end_us, reason)| *end_us >= 2_950_000 && *reason == Some(SolveError::TooFewAnchors)),
        "{told:?}"
    );
    assert!(told.len() >= 4, "{told:?}");
}

#[test]
fn in_space_beacons_are_told_and_make_no_positions() {
    let list = corners();
    let mut tracker = self::tracker(None, &list);
    assert_eq!(after(&mut tracker, &list, 0, |_| -73), None);
}
