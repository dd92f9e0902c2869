//! A survey of a scenario's beacons: a receiver stays at one position after the other and records the beacons' RSSI
//! values, as in `baliza survey fingerprints`. The RSSI values are those that the scenario's tags will receive at these
//! positions: the seed is the same, and therefore the shadowing.

use std::cell::RefCell;
use std::rc::Rc;

use embassy_futures::block_on;
use firmware_tag::scan::Scanner;
use wire::ble::Advertised;

use super::telemetry::Outlet;
use super::{Beacon, Scenario, beacon};
use crate::air::Path;
use crate::bluetooth::{Bluetooth, BluetoothConfig};
use crate::{AirConfig, TrueTime, World};

/// An advertisement received at a surveyed position.
#[derive(Clone, Debug, PartialEq)]
pub struct SurveySample {
    /// The number of the position in the survey.
    pub place: usize,
    /// Time since the stay began, seconds.
    pub t_s: f64,
    /// The beacon's name, from [`Beacon::name`](super::Beacon::name).
    pub beacon: String,
    /// RSSI, dBm.
    pub rssi_dbm: i8,
}

/// The advertisements received during `seconds` at each of these positions (metres), in the order of time. The
/// receiver's RSSI has no offset.
pub fn survey(scenario: &Scenario, places: &[[f64; 3]], seconds: f64) -> Vec<SurveySample> {
    let world = World::new(scenario.seed, AirConfig::default());
    let config = BluetoothConfig { receiver_offset_db: 0.0, ..scenario.bluetooth.clone() };
    let air = Bluetooth::new(&world, config, &scenario.walls);
    let (of, log) = (Rc::new(scenario.clone()), Rc::default());
    let start = |beacon: &Beacon| {
        let outlet = Outlet::new((beacon.address, false), &world, &of, &log);
        beacon::start((&world, &air), beacon, scenario.beacon_key, outlet)
    };
    let _beacons: Vec<_> = scenario.beacons.iter().map(start).collect();
    let heard: Rc<RefCell<Vec<SurveySample>>> = Rc::default();
    // All stays are simulated at the same time: receivers do not disturb each other.
    let scanners = places.iter().enumerate().map(|(place, at)| {
        let (world, heard) = (world.clone(), heard.clone());
        let hear = move |data: &[u8], rssi_dbm: i8| {
            if let Ok(said) = Advertised::parse(data) {
                let (identity, t_s) = (said.identity(), world.now().as_secs_f64());
                let beacon = format!("{}-{}", identity.major, identity.minor);
                heard.borrow_mut().push(SurveySample { place, t_s, beacon, rssi_dbm });
            }
        };
        let mut scanner = air.scanner(place as u16, Path::Fixed(*at), hear);
        block_on(scanner.start());
        scanner
    });
    let scanners: Vec<_> = scanners.collect();
    world.run_until(TrueTime::from_secs_f64(seconds));
    drop(scanners);
    heard.take()
}
