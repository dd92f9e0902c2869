use super::*;
use crate::LocatorConfig;
use positioning_core::locator::AnchorPosition;
use positioning_core::nlos::{self, Kind, Model, Platt, Shape, Skewness};
use ranging::RadioInstant;
use ranging::exchange::{self, Difference};
use std::vec::Vec;

/// The tracker of a tag with Bluetooth.
type Tracker<'a> = super::Tracker<'a, { crate::MAX_LISTED }>;

/// Four anchors at the corners of a room of 3 m × 4 m, 2 m up. Their addresses are 1 to 4, in this order.
const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 2.0], [3.0, 0.0, 2.0], [3.0, 4.0, 2.0], [0.0, 4.0, 2.0]];
/// The corners are √(1+1+4), √(4+1+4), √(4+9+4), √(1+9+4) m away from the tag.
const TAG: [f32; 3] = [1.0, 1.0, 0.0];
const FROM_TAG: [f32; 4] = [2.449_489_7, 3.0, 4.123_105_6, 3.741_657_4];

fn ranges(positions: impl Fn(usize) -> Option<[f32; 3]>) -> [exchange::Range; 4] {
    core::array::from_fn(|i| exchange::Range {
        peer: i as u16 + 1,
        distance_m: FROM_TAG[i],
        deviation_m: 0.03,
        position_m: positions(i),
        diagnostics: Diagnostics::default(),
    })
}

fn round(ranges: &[exchange::Range]) -> Measured<'_> {
    Measured::Ranges(Round { number: 1, poll: RadioInstant::default(), asked: 4, ranges })
}

/// The differences of the other anchors to the first.
fn differences(places: [[f32; 3]; 4]) -> Vec<Difference> {
    let of = |i: usize| Difference {
        peer: i as u16 + 1,
        difference_m: FROM_TAG[i] - FROM_TAG[0],
        deviation_m: 0.04,
        position_m: places[i],
        diagnostics: Diagnostics::default(),
    };
    (1..4).map(of).collect()
}

fn heard(reference_m: [f32; 3], differences: &[Difference]) -> Measured<'_> {
    Measured::Differences(Differences {
        number: 1,
        poll: RadioInstant::default(),
        asked: 3,
        reference: 1,
        reference_m,
        reference_deviation_m: 0.03,
        reference_diagnostics: Diagnostics::default(),
        differences,
    })
}

fn table() -> [AnchorPosition; 4] {
    core::array::from_fn(|i| AnchorPosition { address: i as u16 + 1, position_m: CORNERS[i] })
}

fn at_floor(anchors: &[AnchorPosition]) -> Tracker<'_> {
    LocatorConfig::new(Some(0.0), anchors).tracker()
}

/// The position after twenty rounds, 50 ms apart.
fn settled(mut tracker: Tracker<'_>, measured: Measured<'_>) -> Position {
    let outcomes: Vec<_> = (1..=20).map(|k| tracker.follow(measured, None, 50_000 * k).outcome).collect();
    outcomes.last().copied().unwrap().unwrap()
}

fn near(found: [f32; 3], expected: [f32; 3]) -> bool {
    found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.01)
}

#[test]
fn a_tag_at_a_known_height_is_found_in_the_plane() {
    let heard = ranges(|i| Some(CORNERS[i]));
    let position = settled(at_floor(&[]), round(&heard));
    assert!(near(position.position_m, TAG), "{position:?}");
    assert_eq!((position.used, position.covariance_m2[2]), (0b1111, [0.0; 3]));
    assert!(position.covariance_m2[0][0] > 0.0);
}

#[test]
fn a_tag_without_bluetooth_finds_the_same_bits_and_ignores_advertisements() {
    let (heard, table) = (ranges(|i| Some(CORNERS[i])), table());
    let mut without: super::Tracker<'_, 0> = LocatorConfig::new(Some(0.0), &table).tracker();
    let mut with = at_floor(&table);
    for k in 1..=20 {
        let [found, reference] =
            [&mut without.follow(round(&heard), None, 50_000 * k), &mut with.follow(round(&heard), None, 50_000 * k)]
                .map(|epoch| epoch.outcome);
        assert_eq!(found, reference);
        assert!(k == 1 || found.is_ok_and(|position| near(position.position_m, TAG)), "{found:?}");
    }
    // A beacon that is listed at the tag's position.
    let beacons = [wire::config::Beacon {
        major: 1,
        minor: 2,
        position_m: TAG,
        rssi_1m_dbm: Some(-60.0),
        path_loss_exponent: None,
    }];
    let config = LocatorConfig::new(Some(0.0), &[]).with_beacons(KnownBeacons::new(&beacons, None));
    let mut without: super::Tracker<'_, 0> = config.clone().tracker();
    let mut with: Tracker<'_> = config.tracker();
    let ibeacon = wire::ble::IBeacon { uuid: [1; 16], major: 1, minor: 2, measured_power_dbm: -60 };
    let heard = ReceivedAdvertisement { t_us: 0, beacon: wire::ble::Advertised::IBeacon(ibeacon), rssi_dbm: -60 };
    assert!(with.receive(&heard).is_some() && with.window_end_us().is_some());
    assert!(without.receive(&heard).is_none() && without.window_end_us().is_none());
    assert!(without.window(10_000_000).is_none() && without.room().is_none() && without.beacon_condition().is_none());
}

#[test]
fn configured_places_count_more_than_those_from_the_air() {
    let heard = ranges(|_| Some([9.0, 9.0, 9.0]));
    let table = table();
    assert!(near(settled(at_floor(&table), round(&heard)).position_m, TAG));
}

#[test]
fn a_range_to_an_anchor_of_unknown_place_is_left_out_and_the_others_keep_their_bits() {
    let heard = ranges(|i| (i != 1).then_some(CORNERS[i]));
    let position = settled(at_floor(&[]), round(&heard));
    assert_eq!(position.used, 0b1101);
    // With three ranges nothing shows whether one of them is blocked, and too long: the mean over both is a little off.
    let off = position.position_m.iter().zip(TAG).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt();
    assert!(off < 0.05 && off < position.deviation_m()[0], "{position:?}");
}

#[test]
fn too_few_ranges_give_a_reason_until_there_is_a_track() {
    let heard = ranges(|i| Some(CORNERS[i]));
    let mut tracker = at_floor(&[]);
    assert_eq!(tracker.follow(round(&heard[..2]), None, 10_000).outcome, Err(SolveError::TooFewAnchors));
    assert!(tracker.follow(round(&heard), None, 60_000).outcome.is_ok());
    let one = tracker.follow(round(&heard[2..3]), None, 110_000).outcome.unwrap();
    assert_eq!(one.used, 0b1);
    assert_eq!(tracker.follow(round(&[]), None, 160_000).outcome, Err(SolveError::TooFewAnchors));
}

#[test]
fn a_tag_that_solves_each_round_by_itself_needs_three_ranges_in_each() {
    let heard = ranges(|i| Some(CORNERS[i]));
    for solver in Solver::ALL {
        let mut tracker: Tracker<'_> = LocatorConfig::new(Some(0.0), &[]).by(solver).tracker();
        for k in 1..=20 {
            let epoch = tracker.follow(round(&heard), None, 50_000 * k);
            let found = epoch.outcome.unwrap().position_m;
            // Squares intersect where circles do not: the bounding box is exact to a metre only.
            let [x, y, _] = [0, 1, 2].map(|axis| (found[axis] - TAG[axis]).abs());
            assert!(near(found, TAG) || solver == Solver::BoundingBox && x < 1.0 && y < 1.0, "{solver:?}: {found:?}");
            assert_eq!(epoch.solver, solver);
        }
        let two = tracker.follow(round(&heard[..2]), None, 1_050_000).outcome;
        match solver {
            Solver::Track => assert!(two.is_ok(), "{two:?}"),
            Solver::Robust | Solver::BWls | Solver::BWlsR | Solver::BoundingBox => {
                assert_eq!(two, Err(SolveError::TooFewAnchors), "{solver:?}");
            }
        }
    }
}

#[test]
fn a_position_by_anchors_nearly_on_a_line_has_its_mirror_image_beside_it() {
    // The tag at (4, 3) is 5, √(1 + 2.95²) = 3.1149 and √(36 + 9) m away; its mirror image is (4, −3).
    let places = [[0.0, 0.0, 0.0], [5.0, 0.05, 0.0], [10.0, 0.0, 0.0]];
    let mut heard = ranges(|i| places.get(i).copied());
    heard.iter_mut().zip([5.0, 3.114_883_6, 6.708_204]).for_each(|(range, metres)| range.distance_m = metres);
    for solver in [Solver::Track, Solver::Robust] {
        let mut tracker: Tracker<'_> = LocatorConfig::new(Some(0.0), &[]).by(solver).tracker();
        let found = tracker.follow(round(&heard[..3]), None, 50_000).outcome.unwrap();
        let Position { position_m: [x, y, z], flag, alternative_m: Some([other_x, other_y, other_z]), .. } = found
        else {
            panic!("{solver:?}: {found:?}")
        };
        assert_eq!((flag, z, other_z), (Some(positioning_core::Flag::Ambiguous), 0.0, 0.0));
        let is_near = |a: f32, b: f32| (a - b).abs() < 0.15;
        assert!([x, other_x].into_iter().all(|x| is_near(x, 4.0)), "{solver:?}: {found:?}");
        assert!(is_near(y.abs(), 3.0) && is_near(other_y, -y), "{solver:?}: {found:?}");
        // Four corners of a room leave no doubt.
        let heard = ranges(|i| Some(CORNERS[i]));
        let sure = tracker.follow(round(&heard), None, 9_050_000).outcome.unwrap();
        assert_eq!((sure.flag, sure.alternative_m), (None, None), "{solver:?}");
    }
}

#[test]
fn a_solver_is_the_method_of_its_name() {
    for solver in Solver::ALL {
        let name = crate::method(solver).map_or("track", |method| method.method().as_str());
        assert_eq!(name, solver.name());
    }
}

#[test]
fn ranges_that_cannot_belong_to_the_track_are_no_position() {
    let heard = ranges(|i| Some(CORNERS[i]));
    let mut tracker = at_floor(&[]);
    for k in 1..=20 {
        tracker.follow(round(&heard), None, 50_000 * k).outcome.unwrap();
    }
    let wild = heard.map(|range| exchange::Range { distance_m: 60.0, ..range });
    assert_eq!(tracker.follow(round(&wild), None, 1_050_000).outcome, Err(SolveError::RangesDisjoint));
}

#[test]
fn differences_find_a_tag_that_only_listens() {
    let all = differences(CORNERS);
    let position = settled(at_floor(&[]), heard(CORNERS[0], &all));
    assert!(near(position.position_m, TAG), "{position:?}");
    assert_eq!(position.used, 0b111);
    let first = at_floor(&[]).follow(heard(CORNERS[0], &all), None, 10_000).outcome.unwrap();
    assert_eq!(first.used, 0b111);
    let two = &all[..1];
    assert_eq!(at_floor(&[]).follow(heard(CORNERS[0], two), None, 10_000).outcome, Err(SolveError::TooFewAnchors));
}

#[test]
fn differences_between_anchors_that_tell_wrong_places_are_put_right() {
    // The second anchor reports a position that is 1 m too far away, 4 m instead of 3 m. So 1 m too much was
    // subtracted.
    let mut told = CORNERS;
    told[1] = [4.0, 0.0, 2.0];
    let mut all = differences(told);
    all[0].difference_m -= 1.0;
    let table = table();
    let position = settled(at_floor(&table), heard(told[0], &all));
    assert!(near(position.position_m, TAG), "{position:?}");
}

#[test]
fn a_weak_first_path_is_a_doubt() {
    // 10 dB mean a probability of one half, 20 dB mean 1/(1 + e^-3) = 0.953.
    let of = |rx_power_dbm, first_path_power_dbm| {
        let told = Diagnostics { rx_power_dbm, first_path_power_dbm, ..Diagnostics::default() };
        let Reception { features, power_dbm } = at_floor(&[]).reception(&told);
        let reception = nlos::Reception { features, range_m: 3.0, power_dbm, ends_m: None };
        nlos::NlosDetector::new(None).blocked(0, 1, &reception)
    };
    assert!((of(-80.0, -90.0).unwrap() - 0.5).abs() < 1e-5);
    assert!((of(-75.0, -95.0).unwrap() - 0.953).abs() < 1e-3);
    assert_eq!(of(f32::NAN, -80.0), None);
}

#[test]
fn what_the_impulse_response_tells_weighs_its_range() {
    let skewness = |los_mean, nlos_mean| Skewness { feature: Feature::Skewness, los_mean, nlos_mean, deviation: 0.5 };
    let model = Model { kind: Kind::Skewness(skewness(5.0, 0.0)), calibration: Platt::NONE };
    let mut tracker: Tracker<'_> = LocatorConfig::new(Some(0.0), &[]).with_model(Some(&model)).tracker();
    assert!(tracker.wants_response());
    // A single peak among 29 zeros: skewness (1 - 2/30)/√(1/30·29/30) = 5.2; its mirror image −5.2.
    let shape = |peak: bool| {
        let window: [u16; 30] = core::array::from_fn(|at| if (at == 16) == peak { 900 } else { 0 });
        Shape::of(&window, 16.0).unwrap()
    };
    // Four anchors, the range of the first half a metre too long. The ranges are the same each time, but the response
    // of the first indicates a direct or a blocked link.
    let mut heard = ranges(|i| Some(CORNERS[i]));
    heard[0].distance_m += 0.5;
    let mut error_m = |direct| {
        let sounding = Sounding { peer: 1, shape: shape(direct) };
        let mut outcome = Err(SolveError::TooFewAnchors);
        for k in 1..=20 {
            outcome = tracker.follow(round(&heard), Some(&sounding), 50_000 * k).outcome;
        }
        tracker = LocatorConfig::new(Some(0.0), &[]).with_model(Some(&model)).tracker();
        let [x, y, _] = outcome.unwrap().position_m;
        (x - TAG[0]).hypot(y - TAG[1])
    };
    let (believed, doubted) = (error_m(true), error_m(false));
    assert!(doubted < 0.7 * believed, "{believed} m with it, {doubted} m doubting it");
}
