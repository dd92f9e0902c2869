//! What receivers receive of devices, in time.

use super::*;
use crate::model::{EventKind, TagPosition, Zone, ZoneKind};
use crate::state::{StateLimits, Update};

const SITE: &str = "flat";

/// A time, in milliseconds after an instant of 2001.
fn at(ms: u64) -> Utc {
    Utc::clamped(1_000_000_000_000_000) + Duration::from_millis(ms)
}

fn report(t: Utc, what: ReportKind) -> SourceReport {
    SourceReport { t, site: SITE.to_owned(), what }
}

fn sighting(receiver: &str, device: &str, rssi_dbm: f64) -> ReportKind {
    ReportKind::ReceiverSighting {
        receiver: receiver.to_owned(),
        device: device.to_owned(),
        rssi_dbm,
        rssi_1m_dbm: None,
    }
}

/// A state with receivers `r0`, `r1` … at these places, and a locator, as the hub has them.
struct World {
    live: LiveState,
    locator: DeviceLocator,
}

impl World {
    fn new(places: &[[f64; 3]]) -> Self {
        let mut world = Self { live: LiveState::new(StateLimits::default()), locator: DeviceLocator::default() };
        for (k, place) in places.iter().enumerate() {
            world.place(&format!("r{k}"), Some(*place));
        }
        world
    }

    fn place(&mut self, receiver: &str, position_m: Option<[f64; 3]>) {
        let node = receiver.to_owned();
        self.live.apply(&report(at(0), ReportKind::Node { node, name: None, role: NodeRole::Receiver, position_m }));
    }

    /// Reports that arrive at `now`; the updates of the positions that they lead to.
    fn receive(&mut self, now: Utc, whats: impl IntoIterator<Item = ReportKind>) -> Vec<Update> {
        for what in whats {
            let (report, refused) = (report(now, what), self.live.refused());
            self.live.apply(&report);
            if self.live.refused() == refused {
                self.locator.take(now, report);
            }
        }
        self.locator.survey(&self.live);
        let reports = self.locator.solve(now);
        reports.iter().flat_map(|report| self.live.apply(report)).collect()
    }

    fn tick(&mut self, now: Utc) -> Vec<Update> {
        let mut updates = self.live.tick(now);
        for (site, tag) in self.locator.forget(now) {
            updates.extend(self.live.forget(&site, &tag));
        }
        updates
    }
}

fn positions(updates: Vec<Update>) -> Vec<TagPosition> {
    let position = |update| match update {
        Update::Position(position) => Some(position),
        Update::Event(_) | Update::Data(_) | Update::Changed => None,
    };
    updates.into_iter().filter_map(position).collect()
}

fn kinds(updates: Vec<Update>) -> Vec<EventKind> {
    let kind = |update| match update {
        Update::Event(event) => Some(event.kind),
        Update::Position(_) | Update::Data(_) | Update::Changed => None,
    };
    updates.into_iter().filter_map(kind).collect()
}

const CORNERS: [[f64; 3]; 4] = [[0.0, 0.0, 2.0], [8.0, 0.0, 2.0], [0.0, 8.0, 2.0], [8.0, 8.0, 2.0]];

const CELLS: [[f64; 2]; 9] =
    [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [0.0, 1.0], [1.0, 1.0], [2.0, 1.0], [0.0, 2.0], [1.0, 2.0], [2.0, 2.0]];

/// All four corners receive a device equally well.
fn equal(device: &str) -> impl Iterator<Item = ReportKind> {
    (0..4).map(move |k| sighting(&format!("r{k}"), device, -75.0))
}

#[test]
fn a_device_that_four_corners_hear_equally_is_in_the_middle_once_a_second() {
    let mut world = World::new(&CORNERS);
    let mut found = Vec::new();
    for step in 0..=20 {
        found.extend(positions(world.receive(at(250 * step), equal("phone"))));
    }
    let times: Vec<Utc> = found.iter().map(|position| position.t).collect();
    assert_eq!(times, [0, 1000, 2000, 3000, 4000, 5000].map(at));
    for position in found {
        assert!((position.x_m - 4.0).abs() < 0.05 && (position.y_m - 4.0).abs() < 0.05, "{position:?}");
        assert_eq!((position.tag.as_str(), position.used, position.z_m), ("phone", 4, None));
    }
    assert_eq!(world.live.tags().len(), 1);
}

#[test]
fn values_count_for_five_seconds() {
    let mut world = World::new(&CORNERS);
    world.receive(at(0), [sighting("r0", "phone", -50.0), sighting("r1", "phone", -80.0)]);
    let near = positions(world.receive(at(5000), [sighting("r1", "phone", -80.0)]));
    assert!(near[0].x_m < 4.0, "r0 received it best: {near:?}");
    let later = positions(world.receive(at(6000), [sighting("r1", "phone", -60.0)]));
    assert!(later[0].x_m > 4.0 && later[0].used == 1, "only r1 is left, with -70 dBm: {later:?}");
}

#[test]
fn what_passes_by_is_no_tag_and_what_comes_near_is_one() {
    let mut world = World::new(&CORNERS);
    world.place("nowhere", None);
    for step in 0..10 {
        let now = at(1000 * step);
        assert_eq!(world.receive(now, [sighting("r0", "street", -80.0)]), []);
        // Of a receiver whose place is not known, and of one that nobody knows.
        let whats = ["nowhere", "unknown"].map(|receiver| sighting(receiver, "street", -40.0));
        assert_eq!(world.receive(now, whats), []);
    }
    assert!(world.live.tags().is_empty());
    assert_eq!(positions(world.receive(at(11_000), [sighting("r0", "visitor", -60.0)])).len(), 1);
    assert_eq!(
        positions(world.receive(at(12_000), [sighting("r0", "two", -90.0), sighting("r1", "two", -90.0)])).len(),
        1
    );
    // A tag that only one receiver receives weakly has no position, and a reason.
    let lost = world.receive(at(20_000), [sighting("r0", "visitor", -85.0)]);
    assert_eq!(positions(lost), []);
    let tags = world.live.tags();
    assert_eq!(tags[1].tag, "visitor");
    assert_eq!((tags[1].last_seen, tags[1].reason.as_deref()), (at(20_000), Some("too-few-receivers")));
}

#[test]
fn a_device_that_nobody_hears_any_more_becomes_silent() {
    let mut world = World::new(&CORNERS);
    world.receive(at(0), equal("phone"));
    assert_eq!(kinds(world.tick(at(29_000))), []);
    assert_eq!(kinds(world.tick(at(31_000))), [EventKind::Silent]);
    assert!(kinds(world.receive(at(40_000), equal("phone"))).contains(&EventKind::Back));
}

#[test]
fn what_the_device_or_the_receiver_says_of_its_power_counts() {
    // One receiver; -70 dBm. With -70 dBm at one metre the device is at one metre, with -46 dBm at ten (2.4 · 10 dB).
    let sigma = |of_receiver, of_device| {
        let mut world = World::new(&[[0.0; 3], [30.0, 30.0, 0.0], [-30.0, -30.0, 0.0]]);
        let what = ReportKind::PathLoss { node: "r0".to_owned(), rssi_1m_dbm: of_receiver, path_loss_exponent: None };
        world.live.apply(&report(at(0), what));
        let what = ReportKind::ReceiverSighting {
            receiver: "r0".to_owned(),
            device: "phone".to_owned(),
            rssi_dbm: -70.0,
            rssi_1m_dbm: of_device,
        };
        positions(world.receive(at(0), [what]))[0].sigma_x_m
    };
    let [near, far] = [sigma(Some(-70.0), None), sigma(Some(-46.0), None)];
    assert!(near < 0.5 * far, "{near} {far}");
    assert_eq!([sigma(Some(-46.0), Some(-70.0)), sigma(Some(-70.0), Some(-46.0))], [near, far], "the device's counts");
}

#[test]
fn a_receiver_that_is_moved_counts_at_its_new_place() {
    let mut world = World::new(&CORNERS);
    world.receive(at(0), equal("phone"));
    for (k, [x, y, z]) in CORNERS.into_iter().enumerate() {
        world.place(&format!("r{k}"), Some([x + 100.0, y, z]));
    }
    let found = positions(world.receive(at(2000), equal("phone")));
    assert!((found[0].x_m - 104.0).abs() < 0.05, "{found:?}");
}

#[test]
fn wrong_values_and_times_change_nothing() {
    let mut world = World::new(&CORNERS);
    for wrong in [f64::NAN, f64::INFINITY, 200.0, 127.0, 0.0, -500.0] {
        assert_eq!(world.receive(at(0), [sighting("r0", "phone", wrong), sighting("r1", "phone", wrong)]), []);
    }
    assert_eq!(world.live.refused(), 12);
    // Values that are too old, and values of the future: those are of now.
    for (t, count) in [(at(4_000), 0), (at(999_000), 1)] {
        for k in 0..4 {
            world.locator.take(at(10_000), report(t, sighting(&format!("r{k}"), "phone", -75.0)));
        }
        world.locator.survey(&world.live);
        let reports = world.locator.solve(at(10_000));
        assert_eq!(reports.len(), count);
        assert!(reports.iter().all(|report| report.t == at(10_000)));
    }
    // The host's clock is set back by a day, and then a device goes on being found.
    let mut world = World::new(&CORNERS);
    let day = 86_400_000;
    assert_eq!(positions(world.receive(at(day), equal("phone"))).len(), 1);
    world.tick(at(0));
    assert_eq!(positions(world.receive(at(0), equal("phone"))).len(), 1);
    assert_eq!(positions(world.receive(at(1000), equal("phone"))).len(), 1);
}

/// Positions by RSSI deviate by metres even where they are as good as they can be, so that these metres are no alarm.
#[test]
fn a_device_between_near_receivers_is_no_alarm_and_one_between_far_ones_is() {
    // Mean and deviation of a distance d are proportional: ln(10) / (10 · 2.4) · 6 dB = 0.58 d, for one receiver.
    // In the middle of four that are 8 m apart: 0.58 · 5.7 m = 3.3 m; 60 m apart: 0.58 · 42 m = 24 m.
    for (side_m, rssi_dbm, expected) in [(8.0, -77.0, vec![]), (60.0, -98.0, vec![EventKind::Uncertain])] {
        let mut world = World::new(&CORNERS.map(|[x, y, z]| [x / 8.0 * side_m, y / 8.0 * side_m, z]));
        let mut found = Vec::new();
        for second in 0..20 {
            let whats = (0..4).map(|k| sighting(&format!("r{k}"), "phone", rssi_dbm));
            found.extend(world.receive(at(1000 * second), whats));
        }
        assert_eq!(kinds(found.clone()), expected);
        assert!(positions(found).iter().all(|position| position.sigma_x_m > 0.0));
    }
}

#[test]
fn receivers_at_one_place_give_a_position_about_it_or_a_reason() {
    let mut world = World::new(&[[5.0, 5.0, 2.0]; 4]);
    let found = positions(world.receive(at(0), equal("phone")));
    assert_eq!(found.len(), 1);
    assert!((found[0].x_m - 5.0).abs() < 0.1 && found[0].sigma_x_m > 1.0, "{found:?}");
}

#[test]
fn a_street_full_of_random_addresses_fills_no_memory_and_displaces_no_tag() {
    let mut world = World::new(&CORNERS);
    let mut now = at(0);
    for minute in 0..2_u64 {
        for k in 0..5_000_u64 {
            now = at(60_000 * minute + 12 * k);
            if k % 50 == 0 {
                world.receive(now, equal("phone"));
            }
            let street = format!("{minute} {k}");
            world.receive(now, [sighting("r1", &street, -88.0)]);
            assert!(world.locator.devices.len() <= DEVICES && world.locator.waiting.len() <= DEVICES);
        }
        world.tick(now);
    }
    let tags = world.live.tags();
    assert_eq!(tags.len(), 1);
    assert!(tags[0].last_seen + Duration::from_secs(2) > now, "{tags:?}");
    world.tick(now + Duration::from_secs(61));
    assert_eq!(world.locator.devices.len(), 1, "all others passed by");
    // A device that talks without end keeps its last values only.
    for k in 0..5_000_u64 {
        world.receive(now + Duration::from_micros(k), [sighting(&format!("r{}", k % 1000), "phone", -60.0)]);
    }
    assert!(world.locator.devices.values().all(|device| device.values.len() <= VALUES));
}

#[test]
fn tags_that_are_long_silent_make_room_and_leave_their_rooms() {
    let mut world = World::new(&CORNERS);
    let corners_m = vec![[-3.0, -3.0], [11.0, -3.0], [11.0, 11.0], [-3.0, 11.0]];
    let site = SITE.to_owned();
    world.live.set_zones(vec![Zone { site, name: "hall".to_owned(), kind: ZoneKind::Room, corners_m, alarm: false }]);
    for k in 0..DEVICES {
        world.receive(at(0), equal(&format!("guest {k}")));
    }
    assert_eq!(world.live.tags().len(), DEVICES);
    // All are tags, so a new one is ignored, and then the first one goes.
    assert_eq!(world.receive(at(599_000), equal("new")), []);
    assert_eq!(positions(world.receive(at(601_000), equal("new"))).len(), 1);
    let left = world.tick(at(601_000)).into_iter().filter(|update| {
        matches!(update, Update::Event(event) if event.kind == EventKind::Left && event.zone.as_deref() == Some("hall"))
    });
    assert_eq!(left.count(), 1);
    let tags = world.live.tags();
    assert!(tags.len() == DEVICES && tags.iter().any(|tag| tag.tag == "new"));
}

/// Uniform and Gaussian numbers.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        // Knuth's MMIX generator, the upper bits.
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn gaussian(&mut self) -> f64 {
        // Twelve uniform numbers minus six: mean 0, deviation 1.
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// The squared error in units of the covariance: 2 on average, if that is honest.
fn squared(position: &TagPosition, [x_m, y_m]: [f64; 2]) -> f64 {
    let [dx, dy] = [x_m - position.x_m, y_m - position.y_m];
    let (xx, yy, xy) = (position.sigma_x_m.powi(2), position.sigma_y_m.powi(2), position.cov_xy_m2);
    (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
}

/// The root of the covariance's greater eigenvalue λ: λ² - (xx + yy) λ + (xx yy - xy²) = 0.
fn greatest_sigma_m(position: &TagPosition) -> f64 {
    let (xx, yy, xy) = (position.sigma_x_m.powi(2), position.sigma_y_m.powi(2), position.cov_xy_m2);
    let (trace, determinant) = (xx + yy, xx * yy - xy * xy);
    (0.5 * trace + (0.25 * trace * trace - determinant).max(0.0).sqrt()).sqrt()
}

/// A flat of 12 m by 8 m with six receivers. Devices differ by 5 dB, shadows by 6 dB as in furnished flats, single
/// values by 4.4 dB; the path loss is not the one that the solver assumes. The solver counts half of the likelihood,
/// because real shadows depend on each other. Here they do not, so a NEES of about one half is expected.
#[test]
fn devices_in_a_simulated_flat_are_found_with_an_honest_deviation() {
    let places = [[0.5, 0.5], [6.0, 0.5], [11.5, 0.5], [0.5, 7.5], [6.0, 7.5], [11.5, 7.5]];
    let mut world = World::new(&places.map(|[x, y]| [x, y, 2.2]));
    let mut random = Random(7);
    let (mut errors, mut nees, trials) = (0.0, 0.0, 300);
    for trial in 0..trials {
        let [x, y] = [12.0 * random.uniform(), 8.0 * random.uniform()];
        let offset_db = 5.0 * random.gaussian();
        let means = places.map(|[rx, ry]| {
            let distance_m = ((x - rx).powi(2) + (y - ry).powi(2) + 1.2_f64.powi(2)).sqrt();
            -57.0 - 22.0 * distance_m.log10() + offset_db + 6.0 * random.gaussian()
        });
        let device = format!("device {trial}");
        let mut last = None;
        for second in 0..5 {
            let whats: Vec<ReportKind> = means
                .iter()
                .enumerate()
                .map(|(k, mean)| sighting(&format!("r{k}"), &device, mean + 4.4 * random.gaussian()))
                .collect();
            last = positions(world.receive(at(10_000 * trial + 1000 * second), whats)).pop();
        }
        let last = last.expect("a position");
        errors += (last.x_m - x).hypot(last.y_m - y);
        nees += squared(&last, [x, y]) / 2.0;
    }
    let (mean_m, nees) = (errors / trials as f64, nees / trials as f64);
    println!("simulated flat: {mean_m:.2} m, NEES {nees:.2}");
    assert!(mean_m < 2.5, "{mean_m} m");
    assert!((0.25..1.2).contains(&nees), "{nees}");
}

/// Devices among 3 × 3 receivers: the further apart these are, the less is known. Shadows and path loss are those that
/// the solver assumes, devices differ by 5 dB, and receivers receive down to -90 dBm.
#[test]
fn the_limit_of_uncertain_positions_is_between_receivers_8_m_and_15_m_apart() {
    let mut random = Random(11);
    let mut sigmas_m = |apart_m: f64| {
        let places = CELLS.map(|[column, row]| [apart_m * column, apart_m * row, 2.2]);
        let mut world = World::new(&places);
        let mut found = Vec::new();
        for trial in 0..300 {
            let [x, y] = [2.0 * apart_m * random.uniform(), 2.0 * apart_m * random.uniform()];
            let offset_db = 5.0 * random.gaussian();
            let means_dbm = places.map(|[rx, ry, _]| {
                let distance_m = ((x - rx).powi(2) + (y - ry).powi(2) + 1.2_f64.powi(2)).sqrt();
                -59.0 - 24.0 * distance_m.log10() + offset_db + 6.0 * random.gaussian()
            });
            let device = format!("device {trial}");
            let received = means_dbm.iter().enumerate().filter(|(_, dbm)| **dbm > -90.0);
            let whats = received.map(|(k, dbm)| sighting(&format!("r{k}"), &device, *dbm)).collect::<Vec<_>>();
            found.extend(positions(world.receive(at(10_000 * trial), whats)).iter().map(greatest_sigma_m));
        }
        assert!(found.len() > 250, "{}", found.len());
        found.sort_by(f64::total_cmp);
        [0.5, 0.99].map(|share| found[(share * (found.len() - 1) as f64) as usize])
    };
    let [near_m, far_m] = [8.0, 15.0].map(&mut sigmas_m);
    println!("8 m apart: half above {:.1} m, 1 % above {:.1} m", near_m[0], near_m[1]);
    println!("15 m apart: half above {:.1} m, 1 % above {:.1} m", far_m[0], far_m[1]);
    let limit_m = StateLimits::default().uncertain_rssi_m;
    assert!(near_m[1] < limit_m && far_m[0] > limit_m, "{near_m:?} {far_m:?}");
}

/// The robot of the recording `kolakowski` drives through a flat with six receivers (M. Kolakowski, CC BY 4.0).
/// `BALIZA_DATA` gives the folder of the recordings; without it, they are expected beside the repository.
#[test]
fn a_recorded_robot_is_found_better_than_by_the_nearest_receiver() {
    let beside = || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let folder = std::env::var_os("BALIZA_DATA").map_or_else(beside, Into::into).join("kolakowski");
    if !folder.is_dir() {
        eprintln!("{} is not there: not replayed", folder.display());
        return;
    }
    let rows = |file: &str| -> Vec<Vec<String>> {
        let text = std::fs::read_to_string(folder.join(file)).unwrap();
        text.lines().skip(1).map(|line| line.split(',').map(str::to_owned).collect()).collect()
    };
    let number = |text: &String| text.parse::<f64>().unwrap();
    let mut world = World::new(&[]);
    let mut places = BTreeMap::new();
    for row in rows("beacons.csv") {
        let place = [number(&row[1]), number(&row[2]), number(&row[3])];
        world.place(&row[0], Some(place));
        places.insert(row[0].clone(), place);
    }
    // Rows: point, room, x_m, y_m, beacon, rssi_dbm, t_s.
    let rows = rows("fingerprints.csv");
    let mut errors: [Vec<f64>; 3] = Default::default();
    let (mut nees, mut sigmas_m, mut alarms) = (Vec::new(), Vec::new(), Vec::new());
    for point in rows.chunk_by(|one, other| one[0] == other[0]) {
        let truth = [number(&point[0][2]), number(&point[0][3])];
        let now = at((1000.0 * number(&point[0][6])) as u64);
        let whats = point.iter().map(|row| sighting(&row[4], "robot", number(&row[5])));
        let updates = world.receive(now, whats);
        alarms.extend(kinds(updates.clone()).into_iter().filter(|kind| *kind == EventKind::Uncertain));
        for found in positions(updates) {
            let device = world.locator.devices.values().next().unwrap();
            let (means, _) = device.means(now, &world.live.known(SITE, NodeRole::Receiver));
            let nearest = means.iter().max_by(|(_, one), (_, other)| one.total_cmp(other)).unwrap().0;
            // The mean of the receivers' places, each by the inverse of its distance by the same path loss.
            let weights: Vec<([f64; 3], f64)> =
                means.iter().map(|(name, dbm)| (places[*name], 10_f64.powf((dbm + 59.0) / 24.0))).collect();
            let sum: f64 = weights.iter().map(|(_, weight)| weight).sum();
            let centroid = [0, 1].map(|axis: usize| weights.iter().map(|(at, w)| at[axis] * w).sum::<f64>() / sum);
            let [x, y, _] = places[*nearest];
            for (errors, [x, y]) in errors.iter_mut().zip([[found.x_m, found.y_m], [x, y], centroid]) {
                errors.push((x - truth[0]).hypot(y - truth[1]));
            }
            nees.push(squared(&found, truth) / 2.0);
            sigmas_m.push(greatest_sigma_m(&found));
        }
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let ([locator, nearest, centroid], nees) = (errors.each_ref().map(|errors| mean(errors)), mean(&nees));
    let count = errors[0].len();
    println!("{count} positions: {locator:.2} m (nearest {nearest:.2} m, centroid {centroid:.2} m), NEES {nees:.2}");
    assert!(count > 1000, "{count}");
    assert!(locator < 0.85 * nearest && locator < centroid, "{locator} {nearest} {centroid}");
    assert!((0.3..2.5).contains(&nees), "{nees}");
    sigmas_m.sort_by(f64::total_cmp);
    let [p95_m, most_m] = [0.95, 1.0].map(|share| sigmas_m[(share * (count - 1) as f64) as usize]);
    println!("deviation along the long axis: 95 % below {p95_m:.2} m, all below {most_m:.2} m");
    // The default limit is three times what is usual with enough receivers.
    assert!((p95_m - StateLimits::default().uncertain_rssi_m / 3.0).abs() < 0.3, "{p95_m}");
    assert_eq!(alarms, []);
}
