//! The computations with RSSI values of Bluetooth beacons. A room of [`cases`](crate::cases) has beacons on its walls,
//! and a tag in it receives them with deviations of some dB. The computations are the same on chip and desktop.

use oorandom::Rand32;
use positioning_core::ble::fingerprint::{self, MAX_NODE_POINTS, Map, Motion, Nearest, Point, Receiver, Walk};
use positioning_core::ble::multilateration::{nonlinear, weighted_linear};
use positioning_core::ble::particles::{ON_NODE, ParticleFilter, Settings};
use positioning_core::ble::path_loss::PathLoss;
use positioning_core::ble::posterior::{PosteriorSettings, posterior};
use positioning_core::ble::rssi::{RssiLikelihood, RssiObservation};
use positioning_core::ble::signal::{BeaconSignals, WINDOW_US};
use positioning_core::{Area, Constraints, Real};

/// The number of received beacons.
pub const HEARD: usize = 6;
/// The number of beacons on the map.
const KNOWN: usize = 12;
/// The position of the tag, metres.
const TAG_M: [f32; 2] = [3.1, 4.2];
/// The room, metres.
const ROOM: Area<f32, 2> = Area { min: [0.0, 0.0], max: [9.5, 7.5] };
/// The distance between points of a map, metres.
const STEP_M: f64 = 0.6;
/// The RSSI at one metre that beacons report, dBm.
const POWER_DBM: i8 = -59;
/// From one advertisement of a beacon to its next, microseconds.
const INTERVAL_US: u64 = 100_000;
/// The number of rounds of advertisements before the measurements.
const WARM_UP: u64 = 20;

/// Measures a computation on a state, or only carries it out. The result is one number.
pub trait Measure {
    /// Carries out `call` on copies of `state`.
    fn call<S: Clone>(&mut self, what: &str, state: &S, call: impl Fn(&mut S) -> f32);
}

/// Calls `measure` with one advertisement, after others. Returns the beacons' state before it.
#[inline(never)]
pub fn for_advert(measure: &mut impl Measure) -> BeaconSignals<KNOWN> {
    let heard = heard();
    let mut beacons = BeaconSignals::<KNOWN>::new(WINDOW_US);
    for round in 0..WARM_UP {
        for (beacon, heard) in heard.iter().enumerate() {
            beacons.receive(round * INTERVAL_US + beacon as u64, beacon, heard.rssi_dbm, POWER_DBM);
        }
    }
    let (now_us, [first, ..]) = (WARM_UP * INTERVAL_US, &heard);
    measure.call("advert", &beacons, |beacons| advert(beacons, now_us, first.rssi_dbm - 3.0));
    beacons
}

/// Calls `measure` with every computation.
#[inline(never)]
pub fn for_each(measure: &mut impl Measure) {
    let heard = heard();
    let beacons = for_advert(measure);
    let now_us = WARM_UP * INTERVAL_US;
    measure.call("scan", &beacons, |beacons| scan(beacons, now_us));

    let mut filter = ParticleFilter::<f32, ON_NODE>::new(Settings::walking(), 1);
    filter.start_in(&ROOM);
    for round in 0..3 {
        step(&mut filter, round * 500_000, &heard);
    }
    // One step copies particles and one does not. The first is the more expensive one.
    let sir = Settings { resample_below: 1.0, ..Settings::walking() };
    let mut resampled = ParticleFilter::<f32, ON_NODE>::new(sir, 1);
    resampled.start_in(&ROOM);
    step(&mut resampled, 0, &heard);
    measure.call("particles", &resampled, |filter| step(filter, 500_000, &heard));
    measure.call("particles-kept", &filter, |filter| step(filter, 2_000_000, &heard));

    measure.call("posterior", &heard, |heard| {
        posterior(heard, &ROOM, &[], &PosteriorSettings::default()).map_or(f32::NAN, |found| found.fix.position[0])
    });
    measure.call("nonlinear", &heard, |heard| {
        nonlinear(heard, 2.0, &Constraints::default()).map_or(f32::NAN, |fix| fix.position[0])
    });
    measure.call("weighted-linear", &heard, |heard| weighted_linear(heard).map_or(f32::NAN, |fix| fix.position[0]));

    let surveyed = Prints::new(&[]);
    if let Some(map) = surveyed.map() {
        measure.call("nearest", &(), |()| nearest(&map, &surveyed.scan));
    }
    let mut charted = Prints::new(&[4.0; KNOWN]);
    let bytes = charted.bytes;
    if let Ok((map, _)) = Map::decode(&bytes) {
        measure.call("map", &(), |()| Map::decode(&bytes).map_or(f32::NAN, |(map, _)| map.points() as f32));
        measure.call("lattice", &(), |()| lattice(&map, &charted.scan));
        walk(&mut charted.walk, &map, &charted.scan, 0);
        measure.call("walk", &charted.walk, |state| walk(state, &map, &charted.scan, 500_000));
    }
}

/// A node's map with the greatest number of points, and with all beacons.
#[derive(Clone)]
struct Prints {
    bytes: [u8; 4096],
    scan: [Option<f32>; KNOWN],
    walk: Walk<f32>,
}

impl Prints {
    /// Points 0.6 m apart in the room, with or without deviations, and a scan near one of them. The RSSI values repeat
    /// every eight points.
    fn new(deviations: &[f64]) -> Self {
        let rssi = |row: usize, beacon: usize| -50.0 - ((row * 37 + beacon * 61) % 80) as f64 / 2.0;
        let rows: [[Option<f64>; KNOWN]; 8] =
            core::array::from_fn(|row| core::array::from_fn(|beacon| Some(rssi(row, beacon))));
        let points: [Point<'_>; MAX_NODE_POINTS] = core::array::from_fn(|at| Point {
            position_m: [(at / 13) as f64 * STEP_M, (at % 13) as f64 * STEP_M],
            rssis: rows.get(at % 8).map_or(&[], |row| row.as_slice()),
            deviations,
        });
        let mut bytes = [0; 4096];
        let fits = fingerprint::encode(&points, &[0; KNOWN], &[-95.0; KNOWN], Some(STEP_M), &mut bytes).is_ok();
        debug_assert!(fits, "the map fits");
        let scan =
            core::array::from_fn(|beacon| (beacon != 3).then(|| rssi(5, beacon) as f32 + (beacon % 3) as f32 - 1.0));
        Self { bytes, scan, walk: Walk::new() }
    }

    fn map(&self) -> Option<Map<'_>> {
        Map::decode(&self.bytes).ok().map(|(map, _)| map)
    }
}

/// Compares a scan with all surveyed points.
#[inline(never)]
fn nearest(map: &Map<'_>, scan: &[Option<f32>]) -> f32 {
    let nearest = Nearest { neighbours: 5, weighted: true, offset: 0.7 };
    nearest.locate(map, scan).map_or(f32::NAN, |found| found.position[0])
}

/// The posterior's mean over a lattice.
#[inline(never)]
fn lattice(map: &Map<'_>, scan: &[Option<f32>]) -> f32 {
    fingerprint::locate(map, scan, &Receiver::default()).map_or(f32::NAN, |found| found.position[0])
}

/// A step of the walk over the lattice.
#[inline(never)]
fn walk(walk: &mut Walk<f32>, map: &Map<'_>, scan: &[Option<f32>], now_us: u64) -> f32 {
    let step = walk.step(map, scan, &Receiver::default(), &Motion::default(), &[], now_us);
    step.map_or(f32::NAN, |found| found.position[0])
}

/// The cost of one advertisement: its RSSI is checked and smoothed.
#[inline(never)]
fn advert(beacons: &mut BeaconSignals<KNOWN>, now_us: u64, rssi_dbm: f32) -> f32 {
    beacons.receive(now_us, 0, rssi_dbm, POWER_DBM);
    rssi_dbm
}

#[inline(never)]
fn scan(beacons: &BeaconSignals<KNOWN>, now_us: u64) -> f32 {
    beacons.scan(now_us).rssi_dbm.iter().flatten().sum()
}

#[inline(never)]
fn step(filter: &mut ParticleFilter<f32, ON_NODE>, now_us: u64, heard: &[RssiObservation<f32, 2>; HEARD]) -> f32 {
    let rssis = RssiLikelihood::of(heard, 2.0, 0.25);
    filter.step(now_us, &[], &rssis).map_or(f32::NAN, |estimate| estimate.position[0])
}

fn heard() -> [RssiObservation<f32, 2>; HEARD] {
    let mut random = Rand32::new(9);
    core::array::from_fn(|beacon| {
        let place = crate::cases::on_perimeter(beacon as f32 / HEARD as f32);
        let path_loss = PathLoss { level_1m: -55.0 + beacon as f32, exponent: 2.4, deviation: 4.0 };
        let (x, y) = (place[0] - TAG_M[0], place[1] - TAG_M[1]);
        // 24 log₁₀ d.
        let rssi = path_loss.level_1m - 12.0 * core::f32::consts::LOG10_2 * (x * x + y * y).log2_about();
        let rssi_dbm = rssi + 8.0 * (random.rand_float() - 0.5);
        RssiObservation { beacon_m: place, above_m: 0.0, rssi_dbm, path_loss }
    })
}
