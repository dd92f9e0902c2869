//! Tags that have a surveyed map and a model of rooms in flash.

use std::sync::Arc;

use positioning_core::ble::fingerprint::{Map, Receiver, locate};
use sim::scenario::{Scenario, What};
use system_tests::{Run, TAG};
use wire::config::{BeaconModel, MODELS_BYTES, StoredSiteModels, encode_models};
use wire::telemetry::{Condition, Message, RoomEstimate, RssiModelError, SiteModelPart};

use super::{by_beacons, errors};

const TEXT: &str = include_str!("../../../examples/fingerprints.toml");
const MAP: &[u8] = include_bytes!("../../../examples/fingerprints.map");
const ROOMS: &[u8] = include_bytes!("../../../examples/fingerprints.rooms");

/// The site models in flash: map and rooms of the beacons 1-1 to 1-6.
fn region(map: &[u8]) -> Vec<u8> {
    let beacons: Vec<u8> = (1..=6).flat_map(|minor| [1, 0, minor, 0]).collect();
    let model = positioning_core::ble::rooms::Model::decode(ROOMS).map(|(_, rest)| &ROOMS[..ROOMS.len() - rest.len()]);
    let models = StoredSiteModels {
        map: Some(BeaconModel { beacons: &beacons, model: map }),
        rooms: Some(BeaconModel { beacons: &beacons, model: model.expect("a model of rooms") }),
        room_names: "",
    };
    encode_models(&models, &mut [0; MODELS_BYTES]).expect("they fit").to_vec()
}

/// Runs the example with these site models in the tags' flash, and with receivers whose RSSI is too high by
/// `receiver_offset_db`.
fn run(rssis: Option<&[u8]>, receiver_offset_db: f64) -> Run {
    let mut scenario = Scenario::parse(TEXT).unwrap_or_else(|error| panic!("{error}"));
    scenario.tags[0].settings.site_models = rssis.map(Arc::from);
    scenario.bluetooth.receiver_offset_db = receiver_offset_db;
    Run::of(scenario)
}

/// The root mean square of the errors of the map's own kernel, metres. Each half second of the run's RSSI values is
/// solved by itself in `f64`.
fn kernel_alone(run: &Run) -> f64 {
    let (map, _) = Map::decode(MAP).expect("the example's map");
    let truth: Vec<(f64, [f64; 3])> = run.epochs(TAG).map(|(t_s, epoch)| (t_s, epoch.truth_m)).collect();
    let mut squares = Vec::new();
    for pair in truth.windows(2) {
        let mut powers = [(0.0, 0); 6];
        for record in run.records.iter().filter(|record| (pair[0].0..pair[1].0).contains(&record.t_s)) {
            if let What::Message(Message::Sighting(sighting)) = &record.what {
                let (sum, count) = &mut powers[usize::from(sighting.beacon.minor) - 1];
                *sum += 10.0_f64.powf(f64::from(sighting.rssi_dbm) / 10.0);
                *count += 1;
            }
        }
        let scan = powers.map(|(sum, count)| (count > 0).then(|| 10.0 * (sum / f64::from(count)).log10()));
        if let Ok(found) = locate(&map, &scan, &Receiver { noise_db2: 4.0, ..Receiver::default() }) {
            squares.push((0..2).map(|axis| (found.position[axis] - pair[1].1[axis]).powi(2)).sum::<f64>());
        }
    }
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn a_tag_with_a_map_beats_path_loss_and_is_as_good_as_the_map_lets_it_be() {
    let with = run(Some(&region(MAP)), 0.0);
    let without = run(None, 0.0);
    let ((rmse_m, normalised), (by_path_loss_m, _)) =
        (errors(&by_beacons(&with, 0.0, 120.0)), errors(&by_beacons(&without, 0.0, 120.0)));
    assert!(rmse_m < 0.9 * by_path_loss_m, "{rmse_m} m, by path loss {by_path_loss_m} m");
    let alone_m = kernel_alone(&with);
    // The tag smooths its RSSI values, which delays them by 0.3 m at its speed. Its track compensates most of that.
    assert!(rmse_m < 1.1 * alone_m, "{rmse_m} m, the kernel alone {alone_m} m");
    assert!((0.2..2.0).contains(&normalised), "{normalised}");
    // The offset of a receiver that reads 8 dB too low is estimated. It increases the error by a tenth at most.
    let (deaf_m, _) = errors(&by_beacons(&run(Some(&region(MAP)), -8.0), 0.0, 120.0));
    assert!(deaf_m < 1.1 * rmse_m, "{deaf_m} m, {rmse_m} m");
}

/// The changes of a tag's room estimate with their times.
fn rooms(run: &Run, tag: u16) -> Vec<(f64, RoomEstimate)> {
    let of_tag = run.records.iter().filter(|record| record.node == tag);
    let told = of_tag.filter_map(|record| match record.what {
        What::Message(Message::Room(room)) => Some((record.t_s, room.is)),
        What::Message(_) | What::Epoch(_) | What::Fault(_) => None,
    });
    let mut told: Vec<_> = told.collect();
    let numbers = |is: &RoomEstimate| is.rooms().iter().map(|likely| likely.room).collect::<Vec<_>>();
    // The estimate is repeated every five seconds.
    told.dedup_by(|(_, next), (_, before)| numbers(next) == numbers(before));
    told
}

#[test]
fn tags_that_stay_in_their_rooms_are_found_there() {
    let mut scenario = Scenario::parse(TEXT).unwrap_or_else(|error| panic!("{error}"));
    scenario.tags[0].settings.site_models = Some(region(MAP).into());
    scenario.seconds = 60.0;
    let first = scenario.tags.remove(0);
    let places = [[2.0, 4.0, 1.2], [10.0, 2.0, 1.2], [10.0, 6.5, 1.2]];
    scenario.tags = (first.address..)
        .zip(places)
        .map(|(address, place)| {
            let walk = sim::scenario::Walk::new(vec![place], 1.0, false).expect("a point");
            sim::scenario::Tag { address, walk, ..first.clone() }
        })
        .collect();
    let run = Run::of(scenario);
    for (tag, room) in (first.address..).zip(0..3) {
        let told = rooms(&run, tag);
        let last = told.last().map(|(_, is)| *is);
        assert!(matches!(last, Some(RoomEstimate::Room(likely)) if likely.room == room), "{room}: {told:?}");
        // After ten seconds nothing changes.
        assert!(told.iter().all(|(t_s, _)| *t_s < 10.0), "{room}: {told:?}");
    }
}

#[test]
fn a_tag_that_walks_through_doors_changes_rooms_and_does_not_flap() {
    let told = rooms(&run(Some(&region(MAP)), 0.0), TAG);
    // A lap takes about 50 s and goes through four doors. At each door the estimate may be *between* for a while: 2.4
    // laps, 4 doors, 2 changes.
    assert!((4..=22).contains(&told.len()), "{told:?}");
    let visited: std::collections::BTreeSet<u8> = told
        .iter()
        .filter_map(|(_, is)| if let RoomEstimate::Room(likely) = is { Some(likely.room) } else { None })
        .collect();
    assert!(visited.contains(&0) && visited.len() >= 2, "{told:?}");
}

#[test]
fn a_damaged_map_is_complained_of_once_and_path_loss_serves() {
    let mut damaged = MAP.to_vec();
    damaged[700] ^= 1;
    let with = run(Some(&region(&damaged)), 0.0);
    let complaints: Vec<Condition> = with.words(TAG).into_iter().map(|(_, condition)| condition).collect();
    assert_eq!(complaints, [Condition::Unused(SiteModelPart::Map, RssiModelError::Corrupt)]);
    let positions = |run: &Run| {
        let epochs = by_beacons(run, 0.0, 120.0);
        epochs.iter().map(|(t_s, epoch)| format!("{t_s} {:?}", epoch.fix)).collect::<Vec<_>>()
    };
    assert!(positions(&with) == positions(&run(None, 0.0)));
}
