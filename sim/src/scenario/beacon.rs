//! The beacons of a scenario on the Bluetooth air: the app of `firmware-beacon`, or a commercial beacon that sends
//! Eddystone.

use std::convert::Infallible;
use std::rc::Rc;
use std::time::Duration;

use embassy_futures::join::{join, join3};
use firmware_beacon::{Settings, TelemetrySink};
use rand::RngCore;
use wire::ble::{EddystoneUid, IBeacon};
use wire::config::Advertiser;
use wire::telemetry::Role;

use super::bluetooth_node::{BluetoothNode, introduced};
use super::telemetry::Outlet;
use super::{Format, Scenario};
use crate::World;
use crate::air::Path;
use crate::bluetooth::{Bluetooth, Sender};
use crate::random::{Purpose, stream};

/// A beacon.
#[derive(Clone, Debug, PartialEq)]
pub struct Beacon {
    /// Its number among the nodes, by which faults name it. It is not transmitted.
    pub address: u16,
    /// Its position, metres.
    pub at: [f64; 3],
    /// Its RSSI at 1 m in line of sight, dBm.
    pub rssi_1m_dbm: f64,
    /// The format of its advertisements.
    pub format: Format,
    /// What it advertises.
    pub advertiser: Advertiser,
    /// What tags have in their list about it; `None`: nothing.
    pub listed: Option<wire::config::Beacon>,
}

impl Beacon {
    /// Its major and minor number, as files and pictures name the beacon.
    pub fn name(&self) -> String {
        format!("{}-{}", self.advertiser.major, self.advertiser.minor)
    }
}

/// Starts a beacon, which can be switched.
pub(super) fn start(
    (world, air): (&World, &Bluetooth),
    beacon: &Beacon,
    beacon_key: Option<[u8; 16]>,
    outlet: Rc<Outlet>,
) -> BluetoothNode {
    let (around, beacon) = ((world.clone(), air.clone()), beacon.clone());
    BluetoothNode::start(world, move || live(around.clone(), beacon.clone(), beacon_key, outlet.clone()))
}

async fn live(
    (world, air): (World, Bluetooth),
    beacon: Beacon,
    beacon_key: Option<[u8; 16]>,
    outlet: Rc<Outlet>,
) -> Infallible {
    let number = beacon.address.into();
    let sender = Sender::new(air.medium(), world.seed(), number, Path::Fixed(beacon.at), beacon.rssi_1m_dbm);
    let radio = air.advertiser(sender);
    let advertiser = beacon.advertiser;
    let interval = Duration::from_millis(advertiser.interval_ms.into());
    let channels = std::array::from_fn(|channel| advertiser.channels >> channel & 1 == 1);
    match beacon.format {
        Format::Ibeacon => {
            let [low, high] = beacon.address.to_le_bytes();
            let reporter = outlet.boot(None);
            let record = Scenario::beacon_record(&beacon, beacon_key);
            let (hello, record) = introduced(&reporter, Role::Beacon, beacon.address, record);
            let settings = Settings::of(&record, [0xDE, 0xCA, 0, 0, high, low]);
            let Ok(settings) = settings else { unreachable!("the site was checked") };
            let mut draws = stream(world.seed(), Purpose::Birth, 1 << 32 | u64::from(beacon.address));
            let random = move |bytes: &mut [u8]| draws.fill_bytes(bytes);
            let app = firmware_beacon::run(radio.clone(), world.delay(), random, &settings, TelemetrySink(&reporter));
            join3(app, radio.serve(), reporter.keep_telling(hello, world.delay())).await.0
        }
        Format::EddystoneUid => {
            let Advertiser { uuid, major, minor, measured_power_dbm, .. } = advertiser;
            let ([a, b], [c, d]) = (major.to_be_bytes(), minor.to_be_bytes());
            let uid = EddystoneUid {
                namespace: std::array::from_fn(|i| uuid[i]),
                instance: [0, 0, a, b, c, d],
                power_0m_dbm: EddystoneUid::power_0m_of(measured_power_dbm),
            };
            radio.send(Some((&uid.emit(), interval, channels)));
            radio.serve().await
        }
        Format::Malformed => {
            let Advertiser { uuid, major, minor, measured_power_dbm, .. } = advertiser;
            let data = malformed(&IBeacon { uuid, major, minor, measured_power_dbm }.emit());
            let sending = async {
                for data in data.iter().cycle() {
                    radio.send(Some((data, interval, channels)));
                    world.sleep_until(world.now() + interval).await;
                }
            };
            join(sending, radio.serve()).await.1
        }
    }
}

/// The advertisement cut to every length, and with every wrong length of the structure that has its identity and begins
/// at byte 3.
fn malformed(whole: &[u8]) -> Vec<Vec<u8>> {
    let cut = (0..whole.len()).map(|length| whole[..length].to_vec());
    let wrong = (0..=u8::MAX).filter(|length| *length != whole[3]).map(|length| {
        let mut bytes = whole.to_vec();
        bytes[3] = length;
        bytes
    });
    cut.chain(wrong).collect()
}

/// The tags' list of beacons, as a record has it.
pub(super) fn listed(beacons: &[Beacon]) -> impl Iterator<Item = wire::config::Beacon> {
    beacons.iter().filter_map(|beacon| beacon.listed)
}
