//! The scanners of a scenario: the app of `firmware-scanner` on the Bluetooth air.

use std::convert::Infallible;
use std::rc::Rc;

use embassy_futures::join::join;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::channel::Channel;
use firmware_scanner::Sightings;
use wire::config::Record;
use wire::telemetry::Role;

use super::bluetooth_node::{BluetoothNode, introduced};
use super::telemetry::Outlet;
use crate::World;
use crate::air::Path;
use crate::bluetooth::Bluetooth;

/// A scanner.
#[derive(Clone, Debug, PartialEq)]
pub struct Scanner {
    /// Short address, unique among all nodes.
    pub address: u16,
    /// Its position, metres.
    pub at: [f64; 3],
    /// What a station knows of what it receives: RSSI at one metre, dBm, and path-loss exponent; `None`: the usual ones.
    pub path_loss: [Option<f64>; 2],
}

/// Advertisements that can wait for the program.
const WAITING: usize = 16;

/// Starts a scanner, which can be switched.
pub(super) fn start(
    (world, air): (&World, &Bluetooth),
    scanner: &Scanner,
    record: Record,
    outlet: Rc<Outlet>,
) -> BluetoothNode {
    let (around, scanner) = ((world.clone(), air.clone()), scanner.clone());
    BluetoothNode::start(world, move || live(around.clone(), scanner.clone(), record.clone(), outlet.clone()))
}

async fn live((world, air): (World, Bluetooth), scanner: Scanner, record: Record, outlet: Rc<Outlet>) -> Infallible {
    let reporter = outlet.boot(None);
    let (hello, record) = introduced(&reporter, Role::Scanner, scanner.address, record);
    let sightings = Sightings::new(&reporter, &record);
    // The air calls it from other tasks.
    let received = Rc::new(Channel::<NoopRawMutex, _, WAITING>::new());
    let (from_air, to_program) = (Rc::clone(&received), received);
    let heard = move |data: &[u8], rssi_dbm| {
        // A full channel loses it, as a controller does.
        let _ = from_air.try_send((data.to_vec(), rssi_dbm));
    };
    let radio = air.scanner(scanner.address, Path::Fixed(scanner.at), heard);
    let receiving = async {
        loop {
            let (data, rssi_dbm) = to_program.receive().await;
            sightings.receive(&data, rssi_dbm);
        }
    };
    join(join(sightings.run(radio, world.delay()), receiving), reporter.keep_telling(hello, world.delay())).await.1
}
