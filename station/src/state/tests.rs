//! The state as a whole: reports in, updates out.

use std::collections::BTreeMap;
use std::time::Duration;

use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

use super::*;
use crate::model::{Doubt, HealthFigures, RangeMeasurement};
use crate::rssi::KnownNode;
use crate::{ReportKind, SolvedFrom, SourceReport};

const SITE: &str = "hall";

/// A time, in milliseconds after an instant of 2001.
fn at(ms: u64) -> Utc {
    Utc::clamped(1_000_000_000_000_000) + Duration::from_millis(ms)
}

fn report(t: Utc, what: ReportKind) -> SourceReport {
    SourceReport { t, site: SITE.to_owned(), what }
}

fn position(tag: &str, position_m: [f64; 2], sigma_m: f64) -> ReportKind {
    ReportKind::Position {
        tag: tag.to_owned(),
        round: None,
        position_m,
        z_m: Some(0.0),
        sigma_m: [sigma_m; 2],
        sigma_z_m: None,
        cov_xy_m2: 0.0,
        used: 4,
        solved_from: SolvedFrom::Ranges,
        doubt: None,
    }
}

fn range(anchor: &str, range_m: f64) -> ReportKind {
    ReportKind::Range {
        tag: "0x1001".to_owned(),
        anchor: anchor.to_owned(),
        round: None,
        range: RangeMeasurement {
            rx_power_dbm: Some(-80.0),
            first_path_power_dbm: Some(-84.0),
            clock_offset_ppm: Some(if range_m < 6.0 { 2.0 } else { -3.0 }),
            ..RangeMeasurement::of(range_m)
        },
    }
}

fn anchor(node: &str, position_m: [f64; 3]) -> ReportKind {
    ReportKind::Node { node: node.to_owned(), name: None, role: NodeRole::Anchor, position_m: Some(position_m) }
}

fn received(receiver: &str, device: &str, rssi_dbm: f64, rssi_1m_dbm: Option<f64>) -> ReportKind {
    ReportKind::ReceiverSighting { receiver: receiver.to_owned(), device: device.to_owned(), rssi_dbm, rssi_1m_dbm }
}

fn zone(name: &str, kind: ZoneKind, [x0, x1]: [f64; 2]) -> Zone {
    let corners_m = vec![[x0, 0.0], [x1, 0.0], [x1, 4.0], [x0, 4.0]];
    Zone { site: SITE.to_owned(), name: name.to_owned(), kind, corners_m, alarm: name == "danger" }
}

/// Two rooms of 4 m side by side, a zone about their door, and one in the second room where nobody should be.
fn live() -> LiveState {
    let mut live = LiveState::new(StateLimits::default());
    live.set_zones(vec![
        zone("kitchen", ZoneKind::Room, [0.0, 4.0]),
        zone("attic", ZoneKind::Room, [4.0, 8.0]),
        zone("door", ZoneKind::Zone, [3.0, 5.0]),
        zone("danger", ZoneKind::Zone, [6.0, 8.0]),
    ]);
    live
}

#[test]
fn two_positions_of_a_tag_have_two_milliseconds() {
    let mut live = live();
    let mut time = |us: u64| {
        let t = at(0) + Duration::from_micros(us);
        let updates = live.apply(&report(t, position("0x1001", [1.0, 2.0], 0.2)));
        let Some(Update::Position(position)) = updates.first() else { panic!("no position: {updates:?}") };
        position.t.since(at(0)).as_micros()
    };
    // A tag at full rate has 955 µs between two of them: the second one here is in the millisecond of the first one.
    assert_eq!([time(5_010), time(5_965), time(6_920)], [5_010, 6_000, 7_000]);
    // The estimate of its clock was corrected by 50 ms, and then the clock was set back.
    assert_eq!([time(107_000), time(57_500), time(106_900)], [107_000, 108_000, 109_000]);
    assert_eq!(time(3_000), 3_000);
}

#[test]
fn data_of_a_tags_user_go_out_once_also_when_they_come_late() {
    let mut live = live();
    let mut data = |ms, number, bytes: &[u8], is_late| {
        let what = ReportKind::Data { tag: "0x1001".to_owned(), number, data: bytes.to_vec() };
        let what = if is_late { ReportKind::Late(Box::new(what)) } else { what };
        let updates = live.apply(&report(at(ms), what));
        let told = updates.into_iter().filter_map(|update| match update {
            Update::Data(TagData { site, tag, t, number, data }) => {
                assert_eq!((&*site, &*tag), (SITE, "0x1001"));
                Some((t.since(at(0)).as_millis(), number, data))
            }
            Update::Position(_) | Update::Event(_) | Update::Changed => None,
        });
        told.collect::<Vec<_>>()
    };
    assert_eq!(data(1_000, 0, b"late", true), [], "of a tag that nobody knows");
    assert_eq!(data(1_000, 1, b"open", false), [(1_000, 1, "6F70656E".to_owned())]);
    // The next poll carries them again, another anchor receives both.
    assert_eq!([data(1_100, 1, b"open", false), data(1_010, 1, b"open", false)].concat(), []);
    assert_eq!(data(2_000, 2, &[0; 25], false), []);
    assert_eq!(data(900, 255, b"shut", true), [(900, 255, "73687574".to_owned())]);
    assert_eq!(live.refused(), 2);
}

type Short = (EventKind, Option<String>, Option<f64>);

fn events(updates: &[Update]) -> Vec<Short> {
    let event = |update: &Update| match update {
        Update::Event(event) => Some((event.kind, event.zone.clone(), event.dwell_s)),
        Update::Position(_) | Update::Data(_) | Update::Changed => None,
    };
    updates.iter().filter_map(event).collect()
}

fn entered(zone: &str) -> Short {
    (EventKind::Entered, Some(zone.to_owned()), None)
}

fn left(zone: &str, dwell_s: f64) -> Short {
    (EventKind::Left, Some(zone.to_owned()), Some(dwell_s))
}

fn room_of(updates: &[Update]) -> Option<String> {
    updates.iter().find_map(|update| match update {
        Update::Position(position) => Some(position.room.clone()),
        Update::Event(_) | Update::Data(_) | Update::Changed => None,
    })?
}

#[test]
fn a_walk_through_a_door_changes_rooms_once() {
    let mut live = live();
    let mut all = Vec::new();
    // 0.5 m/s from x = 1 m to 7 m in 12 s, ten positions a second that sway by 0.1 m; σ = 0.2 m.
    for k in 0..=120_u32 {
        let sway = if k % 2 == 0 { 0.1 } else { -0.1 };
        let x = 1.0 + 0.05 * f64::from(k) + sway;
        let updates = live.apply(&report(at(100 * u64::from(k)), position("0x1001", [x, 2.0], 0.2)));
        all.extend(events(&updates));
    }
    let order: Vec<(EventKind, &str)> =
        all.iter().map(|(kind, zone, _)| (*kind, zone.as_deref().unwrap_or_default())).collect();
    use EventKind::{Entered, Left};
    assert_eq!(
        order,
        [
            (Entered, "kitchen"),
            (Entered, "door"),
            (Left, "kitchen"),
            (Entered, "attic"),
            (Left, "door"),
            (Entered, "danger"),
        ]
    );
    // P(attic) ≥ 0.65 where x - 4 ≥ 0.385 σ = 0.077 m. With the sway of 0.1 m that is at k = 60, x = 4.1 m.
    assert_eq!(all[2], left("kitchen", 6.0));
    // P(door) ≥ 0.8 from x = 3.168 m, at k = 42 (3.2 m); ≤ 0.2 from x = 5.168 m, at k = 82 (5.2 m).
    assert_eq!(all[4], left("door", 4.0));
    let tags = live.tags();
    assert_eq!(
        (tags[0].zones.clone(), tags[0].last_position.clone().and_then(|at| at.room)),
        (vec!["danger".to_owned()], Some("attic".to_owned()))
    );
}

/// Rooms and receivers of a flat, metres.
type Flat = (&'static [(&'static str, [f64; 4])], &'static [[f64; 3]]);
/// The house of `examples/espresense`.
const HOUSE: Flat = (
    &[("Kitchen", [0.0, 0.0, 4.0, 6.0]), ("Living room", [4.0, 0.0, 9.0, 6.0])],
    &[[0.2, 0.2, 1.0], [8.8, 0.3, 0.5], [4.5, 5.8, 1.2]],
);
/// Four rooms, a receiver near each corner of two walls.
const FLAT: Flat = (
    &[
        ("A", [0.0, 0.0, 5.0, 4.0]),
        ("B", [5.0, 0.0, 10.0, 4.0]),
        ("C", [0.0, 4.0, 5.0, 8.0]),
        ("D", [5.0, 4.0, 10.0, 8.0]),
    ],
    &[
        [0.2, 0.2, 1.0],
        [9.8, 0.2, 1.0],
        [0.2, 7.8, 1.0],
        [9.8, 7.8, 1.0],
        [4.8, 0.2, 1.0],
        [5.2, 7.8, 1.0],
        [0.2, 4.2, 1.0],
        [9.8, 3.8, 1.0],
    ],
);

/// Devices at random places of a flat for eight seconds, and the shares of them of which the station says the right room,
/// a wrong one and none, and which the receiver that receives them best is in one room with. `device_db` is how much
/// devices differ.
fn in_rooms((rooms, receivers): Flat, shadowing_db: f64, device_db: f64) -> [f64; 4] {
    const DEVICES: usize = 400;
    let mut live = LiveState::new(StateLimits::default());
    let zone = |&(name, [x0, y0, x1, y1]): &(&str, [f64; 4])| Zone {
        site: SITE.to_owned(),
        name: name.to_owned(),
        kind: ZoneKind::Room,
        corners_m: vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]],
        alarm: false,
    };
    live.set_zones(rooms.iter().map(zone).collect());
    let room_at = |x: f64, y: f64| {
        let is_in = |[x0, y0, x1, y1]: [f64; 4]| x0 <= x && x <= x1 && y0 <= y && y <= y1;
        rooms.iter().find(|(_, room)| is_in(*room)).map(|(name, _)| *name)
    };
    let known: BTreeMap<String, KnownNode> = receivers
        .iter()
        .enumerate()
        .map(|(i, &position_m)| (i.to_string(), KnownNode { position_m, rssi_1m_dbm: None, path_loss_exponent: None }))
        .collect();
    let mut random = Pcg64::seed_from_u64(29);
    let mut normal = move |deviation: f64| deviation * random.sample::<f64, _>(StandardNormal);
    let mut places = Pcg64::seed_from_u64(28);
    let size = rooms.iter().fold([0.0_f64; 2], |size, (_, [.., x1, y1])| [size[0].max(*x1), size[1].max(*y1)]);
    let mut counts = [0; 4];
    for device in 0..DEVICES {
        let [x, y] = size.map(|end| places.random_range(0.0..end));
        let name = format!("device-{device}");
        let own_db = normal(device_db);
        let levels: Vec<f64> = receivers
            .iter()
            .map(|[rx, ry, _]| -59.0 - 27.0 * (rx - x).hypot(ry - y).max(0.3).log10() + own_db + normal(shadowing_db))
            .collect();
        let mut room = None;
        for second in 0..8 {
            let heard = levels.iter().map(|level| level + normal(2.0)).enumerate();
            let heard: Vec<(String, f64)> = heard.map(|(i, rssi_dbm)| (i.to_string(), rssi_dbm)).collect();
            let heard = heard.iter().map(|(receiver, rssi_dbm)| (receiver.as_str(), *rssi_dbm));
            let found = crate::rssi::solve(&known, heard, Some(-59.0)).expect("a position");
            room = room_of(&live.apply(&report(at(1_000 * second), found.of(name.clone()))));
        }
        let best = levels.iter().enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(i, _)| receivers[i]);
        let [near_x, near_y, _] = best.expect("receivers");
        let truth = room_at(x, y);
        let place = if room.is_none() { 2 } else { usize::from(room.as_deref() != truth) };
        counts[place] += 1;
        counts[3] += usize::from(room_at(near_x, near_y) == truth);
    }
    counts.map(|count| count as f64 / DEVICES as f64)
}

#[test]
fn a_device_that_receivers_receive_is_in_a_room_more_often_the_right_one_than_that_of_the_strongest() {
    for (flat, shadowing_db, device_db) in [(HOUSE, 4.0, 0.0), (FLAT, 4.0, 0.0), (HOUSE, 6.0, 5.0), (FLAT, 6.0, 5.0)] {
        let shares @ [right, wrong, none, strongest] = in_rooms(flat, shadowing_db, device_db);
        assert!(right > strongest + 0.02 && right > 0.62 && none < 0.2, "{shadowing_db} dB: {shares:?}");
        // Where none is likelier than all others together it says none, so what it says is right more often.
        assert!(right / (right + wrong) > 0.76, "{shadowing_db} dB: {shares:?}");
    }
}

#[test]
fn a_tag_that_rests_in_the_door_stays_where_it_was() {
    let mut live = live();
    assert_eq!(events(&live.apply(&report(at(0), position("0x1001", [2.0, 2.0], 0.1)))), [entered("kitchen")]);
    let mut all = Vec::new();
    for k in 1..200_u32 {
        // x - 4 is ±0.05 m at σ = 0.3 m: P = Φ(±0.167) = 0.566 and 0.434.
        let x = if k % 2 == 0 { 4.05 } else { 3.95 };
        let updates = live.apply(&report(at(100 * u64::from(k)), position("0x1001", [x, 2.0], 0.3)));
        assert_eq!(room_of(&updates).as_deref(), Some("kitchen"));
        all.extend(events(&updates));
    }
    assert_eq!(all, [entered("door")]);
}

#[test]
fn a_vague_position_changes_directly_to_the_room_that_is_clearly_more_probable() {
    let mut live = live();
    // σ = 1.8 m: in y P = 2 Φ(2/1.8) - 1 = 0.733, so at most 0.733² = 0.54 in a room: never 0.65 or 0.8.
    live.apply(&report(at(0), position("0x1001", [2.0, 2.0], 0.1)));
    assert_eq!(events(&live.apply(&report(at(100), position("0x1001", [6.0, 2.0], 1.8)))), [left("kitchen", 0.1)]);
    // σ = 1.4 m: Φ(2/1.4) = 0.9234, P = 0.8469² = 0.717 in the attic: not enough to enter, enough to change.
    let mut live = self::live();
    live.apply(&report(at(0), position("0x1001", [2.0, 2.0], 0.1)));
    let updates = live.apply(&report(at(100), position("0x1001", [6.0, 2.0], 1.4)));
    assert_eq!(events(&updates), [left("kitchen", 0.1), entered("attic")]);
    let mut live = self::live();
    assert_eq!(events(&live.apply(&report(at(0), position("0x1001", [6.0, 2.0], 1.4)))), []);
}

#[test]
fn an_exact_position_is_in_its_room_and_outside_of_all_it_has_none() {
    let mut live = live();
    let updates = live.apply(&report(at(0), position("0x1001", [2.0, 2.0], 0.0)));
    assert_eq!((room_of(&updates).as_deref(), events(&updates)), (Some("kitchen"), vec![entered("kitchen")]));
    let updates = live.apply(&report(at(2500), position("0x1001", [2.0, 9.0], 0.0)));
    assert_eq!((room_of(&updates), events(&updates)), (None, vec![left("kitchen", 2.5)]));
    let spot = Gaussian { mean_m: [5.0, 1.0], covariance_m2: [0.01, 0.0, 0.01] };
    assert_eq!(live.room_of(SITE, &spot).as_deref(), Some("attic"));
    assert_eq!(live.room_of(SITE, &Gaussian { mean_m: [5.0, 9.0], ..spot }), None);
    assert_eq!(live.room_of("elsewhere", &spot), None);
}

#[test]
fn an_alarm_is_raised_by_entering_a_zone_that_asks_for_it() {
    let mut live = live();
    let updates = live.apply(&report(at(0), position("0x1001", [7.0, 2.0], 0.1)));
    let alarms: Vec<(Option<&str>, bool)> = updates
        .iter()
        .filter_map(|update| match update {
            Update::Event(event) => Some((event.zone.as_deref(), event.alarm)),
            Update::Position(_) | Update::Data(_) | Update::Changed => None,
        })
        .collect();
    assert_eq!(alarms, [(Some("danger"), true), (Some("attic"), false)]);
}

#[test]
fn a_room_that_is_deleted_is_left_and_one_that_is_drawn_anew_is_not() {
    let mut live = live();
    live.tick(at(0));
    live.apply(&report(at(0), position("0x1001", [3.5, 2.0], 0.01)));
    live.tick(at(3000));
    let mut bigger = zone("kitchen", ZoneKind::Room, [-1.0, 4.0]);
    bigger.corners_m[0] = [-2.0, -1.0];
    live.set_zones(vec![zone("new", ZoneKind::Zone, [3.0, 4.0]), bigger]);
    let updates = live.tick(at(4000));
    assert_eq!(events(&updates), [left("door", 3.0)]);
    assert_eq!(updates.last(), Some(&Update::Changed));
    assert_eq!(live.tick(at(5000)), [], "only once");
    let updates = live.apply(&report(at(5000), position("0x1001", [3.5, 2.0], 0.01)));
    assert_eq!((room_of(&updates).as_deref(), events(&updates)), (Some("kitchen"), vec![entered("new")]));
}

#[test]
fn a_tag_that_does_not_report_is_silent_once_and_back_once() {
    let mut live = live();
    live.tick(at(0));
    live.apply(&report(at(0), position("0x1001", [2.0, 9.0], 0.1)));
    assert_eq!(events(&live.tick(at(30_000))), []);
    assert_eq!(events(&live.tick(at(30_001))), [(EventKind::Silent, None, None)]);
    assert_eq!(events(&live.tick(at(90_000))), []);
    assert!(live.tags()[0].silent);
    let what = ReportKind::NoPosition { tag: "0x1001".to_owned(), round: None, reason: "too-few-anchors".to_owned() };
    assert_eq!(events(&live.apply(&report(at(90_000), what.clone()))), [(EventKind::Back, None, None)]);
    assert_eq!(events(&live.apply(&report(at(90_100), what))), []);
    let tag = live.tags().remove(0);
    assert_eq!((tag.silent, tag.reason.as_deref(), tag.last_seen), (false, Some("too-few-anchors"), at(90_100)));
    live.apply(&report(at(90_200), position("0x1001", [2.0, 9.0], 0.1)));
    assert_eq!(live.tags()[0].reason, None);
}

#[test]
fn positions_are_uncertain_when_they_have_been_so_for_some_seconds() {
    let mut live = live();
    let mut step =
        |ms: u64, sigma_m: f64| events(&live.apply(&report(at(ms), position("0x1001", [0.0, 50.0], sigma_m))));
    for ms in [0, 2000, 4000, 4999] {
        assert_eq!(step(ms, 3.1), []);
    }
    assert_eq!(step(5000, 3.1), [(EventKind::Uncertain, None, None)]);
    assert_eq!(step(9000, 3.1), []);
    // 2.5 m is below the limit, and not below 80 % of it: the same uncertainty goes on.
    for ms in [10_000, 11_000, 17_000] {
        assert_eq!(step(ms, if ms == 10_000 { 2.5 } else { 3.1 }), []);
    }
    assert_eq!(step(18_000, 2.3), []);
    assert_eq!((step(19_000, 3.1), step(24_000, 3.1)), (vec![], vec![(EventKind::Uncertain, None, None)]));
}

#[test]
fn positions_by_rssi_have_a_limit_of_their_own() {
    let mut live = live();
    let mut step = |ms: u64, sigma_m: f64, from| {
        let mut what = position("0x1001", [0.0, 50.0], sigma_m);
        if let ReportKind::Position { solved_from, .. } = &mut what {
            *solved_from = from;
        }
        events(&live.apply(&report(at(ms), what))).into_iter().map(|(kind, ..)| kind).collect::<Vec<_>>()
    };
    let limit_m = StateLimits::default().uncertain_rssi_m;
    for ms in [0, 10_000, 20_000] {
        assert_eq!(step(ms, limit_m, SolvedFrom::Rssi), []);
    }
    assert_eq!(step(30_000, limit_m + 0.1, SolvedFrom::Rssi), []);
    assert_eq!(step(35_000, limit_m + 0.1, SolvedFrom::Rssi), [EventKind::Uncertain]);
    // Below 80 % of the limit they are certain again, and with ranges, the same deviation is uncertain.
    let again_m = 0.79 * limit_m;
    assert_eq!(step(40_000, again_m, SolvedFrom::Rssi), []);
    assert_eq!(step(41_000, again_m, SolvedFrom::Ranges), []);
    assert_eq!(step(46_000, again_m, SolvedFrom::Ranges), [EventKind::Uncertain]);
    // A tag that leaves the anchors and is located by beacons is certain again.
    assert_eq!(step(47_000, again_m, SolvedFrom::Rssi), []);
    assert_eq!(step(48_000, again_m, SolvedFrom::Ranges), []);
    assert_eq!(step(53_000, again_m, SolvedFrom::Ranges), [EventKind::Uncertain]);
}

#[test]
fn the_long_axis_of_the_ellipse_decides_whether_a_position_is_uncertain() {
    let mut live = live();
    let mut seen = Vec::new();
    for ms in [0, 6000] {
        // 2.5 m along each axis with a correlation of 0.6: along the diagonal √(6.25 + 3.75) = 3.16 m.
        let what = ReportKind::Position {
            tag: "0x1001".to_owned(),
            round: None,
            position_m: [0.0, 50.0],
            z_m: None,
            sigma_m: [2.5; 2],
            sigma_z_m: None,
            cov_xy_m2: 3.75,
            used: 3,
            solved_from: SolvedFrom::Ranges,
            doubt: None,
        };
        seen.extend(events(&live.apply(&report(at(ms), what))));
    }
    assert_eq!(seen, [(EventKind::Uncertain, None, None)]);
}

#[test]
fn a_position_that_two_anchors_bring_counts_once() {
    let mut live = live();
    let mut positions = |ms: u64, number: u16| {
        let mut what = position("0x1001", [1.0, 2.0], 0.1);
        let ReportKind::Position { round, .. } = &mut what else { panic!("a position") };
        *round = Some(number);
        live.apply(&report(at(ms), what)).iter().filter(|update| matches!(update, Update::Position(_))).count()
    };
    // Two anchors tell each round, the slower one after the next; then the tag starts again.
    let told = [(0, 65_535), (5, 65_535), (100, 0), (110, 1), (120, 0), (4000, 1), (9200, 1), (9300, 2)];
    assert_eq!(told.map(|(ms, round)| positions(ms, round)), [1, 0, 1, 1, 0, 0, 1, 1]);
}

#[test]
fn a_low_supply_is_an_alarm_of_its_tag_or_anchor() {
    let mut live = live();
    let supply = |node: &str, supply_v| ReportKind::Supply { node: node.to_owned(), supply_v };
    live.apply(&report(at(0), anchor("0x0101", [0.0, 0.0, 2.0])));
    for node in ["0x1001", "0x0101"] {
        assert_eq!(events(&live.apply(&report(at(0), supply(node, 3.3)))), []);
        assert_eq!(events(&live.apply(&report(at(60_000), supply(node, 2.8)))), [(EventKind::LowSupply, None, None)]);
        assert_eq!(events(&live.apply(&report(at(120_000), supply(node, 2.79)))), []);
    }
    assert_eq!((live.tags()[0].supply_v, live.tags().len()), (Some(2.79), 1));
    assert_eq!(live.nodes()[0].health.supply_v, Some(2.79));
    for nonsense in [0.0, -1.0, 60.0, f64::NAN] {
        live.apply(&report(at(121_000), supply("0x1001", nonsense)));
    }
    assert_eq!((live.refused(), live.tags()[0].supply_v), (4, Some(2.79)));
}

#[test]
fn each_kind_of_event_is_an_alarm_or_none_as_the_limits_say() {
    // A tag is uncertain after 5 s, its supply is low, an anchor is 1 m from its place for ten minutes, the tag is
    // silent.
    let kinds = [EventKind::Uncertain, EventKind::LowSupply, EventKind::Moved, EventKind::Silent, EventKind::Refusals];
    let alarms = |alarms: Alarms| {
        let mut live = LiveState::new(StateLimits { alarms, ..StateLimits::default() });
        live.apply(&report(at(0), anchor("0x0101", [3.0, 4.0, 0.0])));
        let mut updates = Vec::new();
        for second in 0..600 {
            let sigma_m = if second < 10 { 3.1 } else { 0.1 };
            updates.extend(live.apply(&report(at(1000 * second), range("0x0101", 6.0))));
            updates.extend(live.apply(&report(at(1000 * second), position("0x1001", [0.0, 0.0], sigma_m))));
        }
        let supply = ReportKind::Supply { node: "0x1001".to_owned(), supply_v: 2.8 };
        updates.extend(live.apply(&report(at(600_000), supply)));
        for (ms, frames) in [(600_000, 0), (605_000, 10)] {
            let refusals = ReportKind::Refusals { tag: "0x1001".to_owned(), frames };
            updates.extend(live.apply(&report(at(ms), refusals)));
        }
        updates.extend(live.tick(at(700_000)));
        kinds.map(|kind| {
            let of_kind = |update: &Update| match update {
                Update::Event(event) if event.kind == kind => Some(event.alarm),
                Update::Event(_) | Update::Position(_) | Update::Data(_) | Update::Changed => None,
            };
            updates.iter().find_map(of_kind).expect("an event of each kind")
        })
    };
    let all = Alarms::default();
    assert_eq!(alarms(all), [true; 5]);
    assert_eq!(alarms(Alarms { uncertain: false, ..all }), [false, true, true, true, true]);
    assert_eq!(alarms(Alarms { low_supply: false, ..all }), [true, false, true, true, true]);
    assert_eq!(alarms(Alarms { moved: false, ..all }), [true, true, false, true, true]);
    assert_eq!(alarms(Alarms { silent: false, ..all }), [true, true, true, false, true]);
    assert_eq!(alarms(Alarms { refusals: false, ..all }), [true, true, true, true, false]);
}

#[test]
fn residuals_are_ranges_minus_distances_in_space() {
    let mut live = live();
    live.apply(&report(at(0), anchor("0x0101", [3.0, 4.0, 0.0])));
    live.apply(&report(at(0), anchor("0x0102", [2.0, 3.0, 6.0])));
    live.apply(&report(at(0), range("0x0101", 5.25)));
    live.apply(&report(at(0), range("0x0102", 6.5)));
    live.apply(&report(at(0), range("0x0103", 1.0)));
    live.apply(&report(at(0), position("0x1001", [0.0, 0.0], 0.1)));
    let nodes = live.nodes();
    // Distances 5 (3, 4) and 7 (2, 3, 6); nobody knows where the third anchor is.
    let residuals: Vec<Option<f64>> = nodes.iter().map(|node| node.health.residual_mean_m).collect();
    assert_eq!(residuals, [Some(0.25), Some(-0.5), None]);
    assert!(nodes.iter().all(|node| node.health.first_path_minus_received_db == Some(-4.0)));
    assert_eq!(
        nodes.iter().map(|node| node.health.clock_offset_ppm).collect::<Vec<_>>(),
        [Some(2.0), Some(-3.0), Some(2.0)]
    );
    assert_eq!(nodes[0].last_seen, Some(at(0)));
    // A second value of 0.75: the mean is 0.5 and the deviation 0.25. Without z, and without a position, there is none.
    live.apply(&report(at(0), range("0x0101", 5.75)));
    live.apply(&report(at(0), position("0x1001", [0.0, 0.0], 0.1)));
    for z_m in [None, Some(0.0)] {
        live.apply(&report(at(0), range("0x0101", 9.0)));
        let end = match z_m {
            Some(_) => ReportKind::NoPosition { tag: "0x1001".to_owned(), round: None, reason: "diverged".to_owned() },
            None => ReportKind::Position {
                tag: "0x1001".to_owned(),
                round: None,
                position_m: [0.0; 2],
                z_m,
                sigma_m: [0.1; 2],
                sigma_z_m: None,
                cov_xy_m2: 0.0,
                used: 3,
                solved_from: SolvedFrom::Ranges,
                doubt: None,
            },
        };
        live.apply(&report(at(0), end));
    }
    live.apply(&report(at(0), position("0x1001", [0.0, 0.0], 0.1)));
    let node = live.nodes().remove(0);
    assert_eq!((node.health.residual_mean_m, node.health.residual_sigma_m), (Some(0.5), Some(0.25)));
}

#[test]
fn success_is_the_share_of_rounds_nearer_than_the_mean_range() {
    let mut live = live();
    live.apply(&report(at(0), anchor("0x0101", [10.0, 0.0, 0.0])));
    let mut round = |x: f64, has_range: bool| {
        if has_range {
            live.apply(&report(at(0), range("0x0101", 10.0 - x)));
        }
        live.apply(&report(at(0), range("0x0102", 3.0)));
        live.apply(&report(at(0), position("0x1001", [x, 0.0], 0.1)));
        live.nodes()[0].health.success_rate
    };
    // Ranges of 4 m and 6 m: the mean is 5 m.
    assert_eq!((round(6.0, true), round(4.0, true)), (Some(1.0), Some(1.0)));
    assert_eq!(round(4.0, false), Some(1.0), "farther than the mean");
    // 3 m away, and nothing: two of three, two of four.
    assert!((round(7.0, false).unwrap() - 2.0 / 3.0).abs() < 1e-12);
    assert!((round(7.0, false).unwrap() - 0.5).abs() < 1e-12);
    // A position without ranges is no round: its source does not report them.
    live.apply(&report(at(0), position("0x1001", [7.0, 0.0], 0.1)));
    assert_eq!(live.nodes()[0].health.success_rate, Some(0.5));
}

#[test]
fn the_health_of_a_node_is_taken_once_after_it_was_seen() {
    let mut live = live();
    live.apply(&report(at(0), anchor("0x0101", [0.0, 0.0, 0.0])));
    live.apply(&report(at(0), anchor("0x0102", [9.0, 0.0, 0.0])));
    assert_eq!(live.take_health(), []);
    // 5 Hz for 10 s; residuals of 5 - 4 = 1 m.
    for k in 0..50 {
        live.apply(&report(at(200 * k), range("0x0101", 5.0)));
        live.apply(&report(at(200 * k), position("0x1001", [4.0, 0.0], 0.1)));
    }
    live.apply(&report(at(9_900), ReportKind::Supply { node: "0x0101".to_owned(), supply_v: 3.25 }));
    live.tick(at(10_000));
    let health = live.take_health().remove(0);
    assert!(
        (health.health.residual_mean_m.unwrap() - 1.0).abs() < 1e-9 && health.health.residual_sigma_m.unwrap() < 1e-9
    );
    let expected = NodeHealth {
        site: SITE.to_owned(),
        node: "0x0101".to_owned(),
        t: at(10_000),
        health: HealthFigures {
            rate_hz: 5.0,
            success_rate: Some(1.0),
            first_path_minus_received_db: Some(-4.0),
            clock_offset_ppm: Some(2.0),
            moved: false,
            supply_v: Some(3.25),
            ..health.health
        },
    };
    assert_eq!(health, expected);
    assert_eq!(live.take_health(), []);
}

#[test]
fn an_anchor_that_was_moved_makes_one_event_and_is_well_again_when_it_is_surveyed() {
    let mut live = live();
    live.apply(&report(at(0), anchor("0x0101", [3.0, 4.0, 0.0])));
    live.apply(&report(at(0), anchor("0x0102", [0.0, 5.0, 0.0])));
    let mut now_s = 0;
    let mut walk = |live: &mut LiveState, seconds: u64, range_m: f64| {
        let mut moved = Vec::new();
        for _ in 0..seconds {
            now_s += 1;
            let noise_m = if now_s % 2 == 0 { 0.1 } else { -0.1 };
            live.apply(&report(at(1000 * now_s), range("0x0101", range_m + noise_m)));
            live.apply(&report(at(1000 * now_s), range("0x0102", 5.0 + noise_m)));
            for update in live.apply(&report(at(1000 * now_s), position("0x1001", [0.0, 0.0], 0.1))) {
                if let Update::Event(event) = update {
                    moved.push((event.kind, event.node, now_s));
                }
            }
        }
        moved
    };
    assert_eq!(walk(&mut live, 300, 5.0), []);
    // Moved by 1 m after 300 s. t later, the mean is (1 - q) / (1 - q e^-2.5) with q = e^(-t/120): 0.5 m for q = 0.521,
    // t = 78 s. Two minutes later the anchor counts as moved. (The noise has a mean of 0 over two seconds.)
    let moved = walk(&mut live, 600, 6.0);
    let [(EventKind::Moved, node, seconds)] = moved.as_slice() else { panic!("{moved:?}") };
    assert!(node == "0x0101" && (300 + 195..=300 + 215).contains(seconds), "{moved:?}");
    assert_eq!(live.nodes().iter().map(|node| node.health.moved).collect::<Vec<_>>(), [true, false]);
    // Surveyed at its new place, 6 m away.
    live.apply(&report(at(1000 * 900), anchor("0x0101", [3.6, 4.8, 0.0])));
    assert!(!live.nodes()[0].health.moved);
    assert_eq!(walk(&mut live, 300, 6.0), []);
}

#[test]
fn an_anchor_that_is_put_back_is_no_longer_moved() {
    let mut live = live();
    live.apply(&report(at(0), anchor("0x0101", [3.0, 4.0, 0.0])));
    for s in 0..1000_u64 {
        live.apply(&report(at(1000 * s), range("0x0101", if s < 400 { 6.0 } else { 5.0 })));
        live.apply(&report(at(1000 * s), position("0x1001", [0.0, 0.0], 0.1)));
        // Residuals of 1 m: after 34 s there are values of 30 seconds (120 (1 - e^(-t/120)) = 30), and two minutes
        // later the anchor counts as moved. It is put back after 400 s. t later, the mean is 0.964 q / (1 - 0.036 q)
        // with q = e^(-t/120): 0.25 m for q = 0.257, t = 163 s.
        let is_moved = live.nodes()[0].health.moved;
        match s {
            0..=150 => assert!(!is_moved, "{s}"),
            160..=560 => assert!(is_moved, "{s}"),
            566.. => assert!(!is_moved, "{s}"),
            _ => {}
        }
    }
}

#[test]
fn numbers_that_are_no_measurements_are_refused_and_counted() {
    let mut live = live();
    let mut expected = 0;
    let mut refuse = |live: &mut LiveState, site: &str, what: ReportKind| {
        let report = SourceReport { t: at(0), site: site.to_owned(), what };
        assert_eq!(live.apply(&report), [], "{report:?}");
        expected += 1;
        assert_eq!(live.refused(), expected, "{report:?}");
    };
    for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300] {
        refuse(&mut live, SITE, position("0x1001", [wrong, 0.0], 0.1));
        refuse(&mut live, SITE, position("0x1001", [0.0, wrong], 0.1));
        refuse(&mut live, SITE, position("0x1001", [0.0, 0.0], wrong));
        refuse(&mut live, SITE, range("0x0101", wrong));
        refuse(&mut live, SITE, anchor("0x0101", [0.0, wrong, 0.0]));
        let sighting = ReportKind::Sighting { tag: "0x1001".to_owned(), beacon: "1-7".to_owned(), rssi_dbm: wrong };
        refuse(&mut live, SITE, sighting);
        refuse(&mut live, SITE, received("hall", "phone", wrong, None));
        refuse(&mut live, SITE, received("hall", "phone", -60.0, Some(wrong)));
        let mut vague = position("0x1001", [0.0; 2], 0.1);
        if let ReportKind::Position { z_m, .. } = &mut vague {
            *z_m = Some(wrong);
        }
        refuse(&mut live, SITE, vague);
        let mut two_places = position("0x1001", [0.0; 2], 0.1);
        if let ReportKind::Position { doubt, .. } = &mut two_places {
            *doubt = Some(Doubt::Ambiguous { alternative_m: [0.0, wrong, 0.0] });
        }
        refuse(&mut live, SITE, two_places);
    }
    refuse(&mut live, SITE, position("0x1001", [0.0; 2], -0.1));
    refuse(&mut live, SITE, range("0x0101", -1.0));
    for name in [String::new(), "x".repeat(65), "a\nb".to_owned(), "\0".to_owned()] {
        refuse(&mut live, SITE, position(&name, [0.0; 2], 0.1));
        refuse(&mut live, SITE, range(&name, 1.0));
        refuse(&mut live, SITE, received(&name, "phone", -60.0, None));
        refuse(&mut live, SITE, received("hall", &name, -60.0, None));
        refuse(&mut live, SITE, anchor(&name, [0.0; 3]));
        refuse(&mut live, &name, position("0x1001", [0.0; 2], 0.1));
        refuse(&mut live, &name, anchor("0x0101", [0.0; 3]));
    }
    assert!(live.tags().is_empty() && live.nodes().is_empty(), "nothing came of it");
}

#[test]
fn a_covariance_beyond_the_deviations_is_that_of_a_line() {
    let mut live = live();
    let mut what = position("0x1001", [2.0, 2.0], 0.5);
    if let ReportKind::Position { cov_xy_m2, .. } = &mut what {
        *cov_xy_m2 = -7.0;
    }
    let updates = live.apply(&report(at(0), what));
    let Some(Update::Position(taken)) = updates.first() else { panic!("{updates:?}") };
    assert_eq!(taken.cov_xy_m2, -0.25);
}

#[test]
fn more_tags_and_nodes_than_the_limits_are_refused_and_the_others_go_on() {
    let mut live = LiveState::new(StateLimits { tags: 3, nodes: 2, ..StateLimits::default() });
    for k in 0..10 {
        live.apply(&report(at(0), position(&format!("tag {k}"), [0.0; 2], 0.1)));
        live.apply(&report(at(0), anchor(&format!("anchor {k}"), [0.0; 3])));
        let what = ReportKind::Node {
            node: format!("tag {k}"),
            name: Some("n".to_owned()),
            role: NodeRole::Tag,
            position_m: None,
        };
        live.apply(&report(at(0), what));
    }
    assert_eq!((live.tags().len(), live.nodes().len(), live.refused()), (3, 2, 7 + 8 + 8));
    assert_eq!(live.apply(&report(at(1), position("tag 2", [0.0; 2], 0.1))).len(), 1);
    assert_eq!(live.apply(&report(at(1), position("tag 3", [0.0; 2], 0.1))), []);
}

#[test]
fn a_round_that_never_ends_takes_no_more_memory() {
    let mut live = live();
    for k in 0..10_000 {
        live.apply(&report(at(k), range(&format!("0x{:04X}", k % 100), 3.0)));
    }
    assert!(live.sites[SITE].rounds.capacity("0x1001") <= 2 * rounds::MOST);
}

#[test]
fn a_report_from_the_future_is_taken_as_one_of_now() {
    let mut live = live();
    live.tick(at(0));
    let updates = live.apply(&report(Utc::clamped(i64::MAX), position("0x1001", [2.0, 9.0], 0.1)));
    let Some(Update::Position(taken)) = updates.first() else { panic!("{updates:?}") };
    assert_eq!(taken.t, at(0));
    assert_eq!(events(&live.tick(at(31_000))), [(EventKind::Silent, None, None)]);
}

#[test]
fn old_reports_keep_their_time_and_their_tag_is_not_silent() {
    let mut live = live();
    live.tick(at(86_400_000));
    let updates = live.apply(&report(at(0), position("0x1001", [2.0, 9.0], 0.1)));
    let Some(Update::Position(taken)) = updates.first() else { panic!("{updates:?}") };
    assert_eq!(taken.t, at(0));
    assert_eq!(events(&live.tick(at(86_400_000 + 1000))), []);
}

#[test]
fn late_positions_are_for_the_store_and_change_nothing_else() {
    let mut live = LiveState::new(StateLimits { tags: 2, ..StateLimits::default() });
    live.set_zones(vec![zone("danger", ZoneKind::Zone, [0.0, 4.0])]);
    live.apply(&report(at(60_000), position("0x1001", [9.0, 2.0], 0.1)));
    live.tick(at(60_000));
    let before = (live.tags(), live.nodes());
    let late = |what: ReportKind| report(at(1000), ReportKind::Late(Box::new(what)));
    // In the zone, of a tag that is known, and of others; and a range.
    for tag in ["0x1001", "0x1002", "0x1003", "0x1004", "0x1003"] {
        assert_eq!(live.apply(&late(position(tag, [2.0, 2.0], 0.1))), []);
    }
    assert_eq!(live.apply(&late(range("0x0101", 3.0))), []);
    assert_eq!((live.tags(), live.nodes()), before);
    assert_eq!(live.tick(at(60_000)), []);
    let taken: Vec<_> = live.take_late().into_iter().map(|late| (late.tag, late.t)).collect();
    let expected = ["0x1001", "0x1002", "0x1003", "0x1003"].map(|tag| (tag.to_owned(), at(1000)));
    assert_eq!(taken, expected, "two tags that nobody else knows, at most");
    assert_eq!((live.refused(), live.take_late().len()), (1, 0));
}

#[test]
fn a_host_clock_that_jumps_leaves_nothing_wrong() {
    let mut live = live();
    live.apply(&report(at(0), anchor("0x0101", [3.0, 4.0, 0.0])));
    let step = |live: &mut LiveState, t: Utc| {
        let mut updates = live.tick(t);
        updates.extend(live.apply(&report(t, range("0x0101", 5.0))));
        updates.extend(live.apply(&report(t, position("0x1001", [2.0, 2.0], 4.0))));
        events(&updates).into_iter().map(|(kind, ..)| kind).collect::<Vec<_>>()
    };
    for s in 0..10_u64 {
        let expected = if s == 5 { vec![EventKind::Uncertain] } else { vec![] };
        assert_eq!(step(&mut live, at(1000 * s)), expected);
    }
    // A hundred years on, and back again.
    let far = at(0) + Duration::from_secs(100 * 365 * 86_400);
    assert_eq!(step(&mut live, far), [EventKind::Silent, EventKind::Back]);
    for s in 10..40_u64 {
        assert_eq!(step(&mut live, at(1000 * s)), []);
    }
    let (tag, node) = (live.tags().remove(0), live.nodes().remove(0));
    assert_eq!((tag.rate_hz, node.health.rate_hz, node.health.success_rate), (1.0, 1.0, Some(1.0)));
    assert!(!tag.silent);
    assert_eq!(events(&live.tick(at(70_000))), [(EventKind::Silent, None, None)], "30 s after the last report");
}

#[test]
fn a_nodes_name_and_place_stay_when_it_says_nothing_of_them() {
    let mut live = live();
    let node = |name: Option<&str>, position_m| ReportKind::Node {
        node: "0x0101".to_owned(),
        name: name.map(str::to_owned),
        role: NodeRole::Anchor,
        position_m,
    };
    live.apply(&report(at(0), node(Some("by the door"), Some([1.0, 2.0, 3.0]))));
    assert_eq!(live.tick(at(0)), [Update::Changed]);
    live.apply(&report(at(0), node(None, None)));
    assert_eq!(live.tick(at(1)), [], "nothing new");
    let shown = live.nodes().remove(0);
    assert_eq!((shown.name.as_deref(), shown.position_m), (Some("by the door"), Some([1.0, 2.0, 3.0])));
    // A tag's name waits for the tag.
    let tag = ReportKind::Node {
        node: "0x1001".to_owned(),
        name: Some("Ada".to_owned()),
        role: NodeRole::Tag,
        position_m: None,
    };
    live.apply(&report(at(0), tag));
    assert!(live.tags().is_empty());
    live.apply(&report(at(0), position("0x1001", [2.0, 9.0], 0.1)));
    assert_eq!(live.tags()[0].name.as_deref(), Some("Ada"));
}

#[test]
fn a_long_reason_is_cut_at_a_character() {
    let mut live = live();
    // 2 bytes each: 200 bytes are 100 characters; with one byte before, 99 and a half.
    let reason = format!("a{}", "é".repeat(300));
    live.apply(&report(at(0), ReportKind::NoPosition { tag: "0x1001".to_owned(), round: None, reason }));
    assert_eq!(live.tags()[0].reason.as_deref().map(|reason| reason.chars().count()), Some(100));
}

#[test]
fn a_receiver_that_hears_a_device_is_listed_and_the_device_is_not() {
    let mut live = live();
    assert_eq!(live.apply(&report(at(0), received("hall", "phone", -60.0, Some(-59.0)))), []);
    let nodes = live.nodes();
    assert_eq!(nodes.len(), 1);
    assert_eq!((nodes[0].node.as_str(), nodes[0].role, nodes[0].last_seen), ("hall", NodeRole::Receiver, Some(at(0))));
    assert!(live.tags().is_empty());
}

#[test]
fn a_path_loss_is_that_of_a_known_node_and_must_be_possible() {
    let mut live = live();
    let path_loss = |node: &str, rssi_1m_dbm, path_loss_exponent| ReportKind::PathLoss {
        node: node.to_owned(),
        rssi_1m_dbm,
        path_loss_exponent,
    };
    live.apply(&report(at(0), path_loss("1-7", Some(-60.0), None)));
    assert_eq!(live.refused(), 1, "nobody knows it");
    let position_m = Some([1.0, 2.0, 3.0]);
    live.apply(&report(
        at(0),
        ReportKind::Node { node: "1-7".to_owned(), name: None, role: NodeRole::Beacon, position_m },
    ));
    let before = live.surveys();
    live.apply(&report(at(0), path_loss("1-7", Some(-60.0), Some(2.2))));
    assert!(live.surveys() > before);
    for wrong in [f64::NAN, f64::INFINITY, 200.0, 0.0, -1e300] {
        live.apply(&report(at(0), path_loss("1-7", Some(wrong), None)));
        live.apply(&report(at(0), path_loss("1-7", None, Some(wrong))));
    }
    assert_eq!(live.refused(), 11);
    let known = live.known(SITE, NodeRole::Beacon).remove("1-7").expect("it is placed");
    assert_eq!((known.rssi_1m_dbm, known.path_loss_exponent), (Some(-60.0), Some(2.2)));
    assert!(live.known(SITE, NodeRole::Receiver).is_empty() && live.known("other", NodeRole::Beacon).is_empty());
    live.apply(&report(at(0), path_loss("1-7", None, None)));
    assert_eq!(live.nodes()[0].rssi_1m_dbm, None, "back to the usual one");
}

#[test]
fn a_node_that_is_forgotten_leaves_the_others_as_they_are() {
    let mut live = live();
    for k in 0..3 {
        live.apply(&report(at(0), anchor(&format!("0x010{k}"), [f64::from(k), 0.0, 0.0])));
    }
    live.apply(&report(at(0), range("0x0102", 3.0)));
    live.forget_node(SITE, "0x0100");
    live.forget_node(SITE, "0x0100");
    // The range is of a round that was forgotten with it, and the last anchor has another index now.
    live.apply(&report(at(0), position("0x1001", [2.0, 0.0], 0.1)));
    live.apply(&report(at(1), range("0x0102", 3.0)));
    live.apply(&report(at(1), position("0x1001", [4.0, 0.0], 0.1)));
    let nodes = live.nodes();
    assert_eq!(nodes.iter().map(|node| node.node.as_str()).collect::<Vec<_>>(), ["0x0101", "0x0102"]);
    // The anchor is at 2 m, the tag at 4 m: 3 m are 1 m too much.
    assert_eq!(nodes[1].health.residual_mean_m, Some(1.0));
    assert_eq!(nodes[0].health.residual_mean_m, None);
}

#[test]
fn a_tag_that_is_forgotten_leaves_its_rooms_and_makes_room_for_another() {
    let mut live = LiveState::new(StateLimits { tags: 1, ..StateLimits::default() });
    live.set_zones(vec![zone("kitchen", ZoneKind::Room, [0.0, 4.0]), zone("door", ZoneKind::Zone, [0.0, 4.0])]);
    live.apply(&report(at(0), position("0x1001", [2.0, 2.0], 0.1)));
    live.apply(&report(at(7000), position("0x1002", [2.0, 2.0], 0.1)));
    assert_eq!(live.refused(), 1);
    let left = live.forget(SITE, "0x1001");
    let zone = |name: &str| (EventKind::Left, Some(name.to_owned()), Some(7.0));
    assert_eq!(events(&left), [zone("kitchen"), zone("door")]);
    assert_eq!(live.forget(SITE, "0x1001"), []);
    live.apply(&report(at(8000), position("0x1002", [2.0, 2.0], 0.1)));
    assert_eq!(live.tags().iter().map(|tag| tag.tag.as_str()).collect::<Vec<_>>(), ["0x1002"]);
}

/// The deviation of each anchor's residuals, metres, after a walk of two minutes along 20 m with ten rounds a second.
/// A range has an error of ±0.1 m, by turns of pseudorandom numbers. Positions are exact; `arrives` says which of them
/// arrive.
fn residual_sigmas_m(has_numbers: bool, arrives: impl Fn(u16) -> bool) -> Vec<f64> {
    let anchors_m = [[0.0, 0.0, 2.5], [10.0, 0.0, 2.5], [20.0, 0.0, 2.5], [0.0, 8.0, 2.5], [20.0, 8.0, 2.5]];
    let names: Vec<String> = (1..=anchors_m.len()).map(|k| format!("0x010{k}")).collect();
    let mut live = live();
    for (name, at_m) in names.iter().zip(anchors_m) {
        live.apply(&report(at(0), anchor(name, at_m)));
    }
    let mut random = 1_u32;
    for round in 0..1200_u16 {
        let t = at(100 * u64::from(round));
        let number = has_numbers.then_some(round);
        // To the end and back, 1 m/s.
        let x_m = 10.0 - ((f64::from(round) * 0.1) % 40.0 - 20.0).abs() + 10.0;
        for (name, [x, y, z]) in names.iter().zip(anchors_m) {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let error_m = if random & (1 << 31) == 0 { 0.1 } else { -0.1 };
            let distance_m = ((x - x_m).powi(2) + (y - 4.0_f64).powi(2) + z.powi(2)).sqrt();
            let ReportKind::Range { tag, anchor, range, .. } = range(name, distance_m + error_m) else { continue };
            live.apply(&report(t, ReportKind::Range { tag, round: number, anchor, range }));
        }
        if arrives(round) {
            let mut fix = position("0x1001", [x_m, 4.0], 0.1);
            if let ReportKind::Position { round, .. } = &mut fix {
                *round = number;
            }
            live.apply(&report(t, fix));
        }
    }
    live.nodes().iter().filter_map(|node| node.health.residual_sigma_m).collect()
}

#[test]
fn residuals_are_those_of_the_loss_free_run_when_half_of_the_positions_are_lost() {
    let whole = residual_sigmas_m(true, |_| true);
    assert!(whole.len() == 5 && whole.iter().all(|sigma_m| (sigma_m - 0.1).abs() < 0.002), "{whole:?}");
    // Every second one, and two of four.
    for arrives in [(|round: u16| round.is_multiple_of(2)) as fn(u16) -> bool, |round| round % 4 < 2] {
        for (lossy, whole) in residual_sigmas_m(true, arrives).iter().zip(&whole) {
            assert!((lossy / whole - 1.0).abs() < 0.1, "{lossy} against {whole}");
        }
    }
    // A source without numbers: the ranges of two rounds are taken for one.
    let guessed = residual_sigmas_m(false, |round| round.is_multiple_of(2));
    assert!(guessed.iter().zip(&whole).any(|(guessed, whole)| guessed / whole > 1.02), "{guessed:?}");
}

#[test]
fn measurements_of_a_round_whose_end_was_lost_have_the_time_of_their_last_one() {
    let mut live = live();
    live.keep_measurements();
    let numbered = |number, name: &str| match range(name, 3.0) {
        ReportKind::Range { tag, anchor, range, .. } => ReportKind::Range { tag, round: Some(number), anchor, range },
        other => other,
    };
    live.apply(&report(at(0), numbered(7, "0x0101")));
    live.apply(&report(at(2), numbered(7, "0x0102")));
    live.apply(&report(at(100), numbered(8, "0x0101")));
    let lost: Vec<_> = live.take_measurements().into_iter().map(|row| (row.node, row.t, row.round)).collect();
    assert_eq!(lost, [("0x0101".to_owned(), at(0), at(2)), ("0x0102".to_owned(), at(2), at(2))]);
    live.apply(&report(
        at(105),
        ReportKind::NoPosition { tag: "0x1001".to_owned(), round: Some(8), reason: "x".into() },
    ));
    let ended: Vec<_> = live.take_measurements().into_iter().map(|row| (row.node, row.t, row.round)).collect();
    assert_eq!(ended, [("0x0101".to_owned(), at(100), at(105))]);
}

/// A round of a tag with this range to each of three anchors.
fn round_of(live: &mut LiveState, tag: &str, range_m: f64) {
    for anchor in ["0x0101", "0x0102", "0x0103"] {
        let ReportKind::Range { round, range, .. } = range(anchor, range_m) else { panic!("a range") };
        let (tag, anchor) = (tag.to_owned(), anchor.to_owned());
        live.apply(&report(at(0), ReportKind::Range { tag, round, anchor, range }));
    }
    live.apply(&report(at(0), position(tag, [1.0, 1.0], 0.1)));
}

#[test]
fn recent_rounds_are_a_bounded_sample_spread_over_tags_and_time() {
    let mut live = live();
    // Ten tags with two rounds a second for ten minutes, of which five are kept: each tag gives one in ten seconds.
    for second in 0..600_u32 {
        for tag in 0..20 {
            round_of(&mut live, &format!("0x10{:02}", tag % 10), f64::from(second) / 10.0);
        }
        live.tick(at(0));
    }
    let rounds = &live.recent_rounds()[SITE];
    assert!((290..=300).contains(&rounds.len()), "{}", rounds.len());
    let seconds: Vec<f64> = rounds.iter().map(|round| (round.ranges[0].1 * 10.0).round()).collect();
    assert!(seconds.is_sorted() && seconds[0] >= 300.0 && seconds[seconds.len() - 1] >= 590.0, "{seconds:?}");
    for minute in 5..10 {
        let of_minute = seconds.iter().filter(|second| (**second / 60.0) as u32 == minute).count();
        assert!((50..=70).contains(&of_minute), "{of_minute} in minute {minute}");
    }
    assert_eq!((rounds[0].height_m, rounds[0].ranges.len(), rounds[0].ranges[2].0.as_str()), (Some(0.0), 3, "0x0103"));
    // After five minutes without rounds there are none.
    for _ in 0..301 {
        live.tick(at(0));
    }
    assert_eq!(live.recent_rounds()[SITE], []);
}

#[test]
fn a_thousand_tags_give_no_more_recent_rounds_than_the_bound() {
    let mut live = live();
    for tag in 0..1000 {
        round_of(&mut live, &format!("t{tag}"), f64::from(tag) / 100.0);
    }
    let rounds = &live.recent_rounds()[SITE];
    assert_eq!((rounds.len(), rounds[0].ranges[0].1), (300, 7.0));
}
