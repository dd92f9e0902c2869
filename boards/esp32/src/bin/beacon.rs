//! The beacon on a chip of Espressif. Everything except the controller runs in the main thread.
#![no_std]
#![no_main]

use baliza_board_esp32::bluetooth::{self, Advertiser, Parts};
use baliza_board_esp32::{Board, random, supervise};
use embassy_executor::Spawner;
use embassy_futures::join::join;
use embassy_time::Delay;
use firmware_beacon::{Advertise, Advertisement, Settings, SettingsError, TelemetrySink};
use firmware_common::node::{Node, Reporter, Tasks};
use static_cell::StaticCell;
use wire::telemetry::{Condition, RecordError, Role};

static REPORTER: StaticCell<Reporter> = StaticCell::new();

/// The advertiser of the beacon's program.
struct OnAir<'a>(&'a Advertiser);

impl Advertise for OnAir<'_> {
    type Error = bluetooth::Error;

    async fn start(&mut self, advertisement: &Advertisement) -> Result<(), Self::Error> {
        let Advertisement { data, address, interval_ms, channels, tx_power_dbm: _ } = advertisement;
        self.0.advertise(data, *address, *interval_ms, channels.bits()).await
    }

    async fn stop(&mut self) -> Result<(), Self::Error> {
        self.0.stop().await
    }
}

#[embassy_executor::task]
async fn advertise(parts: Parts, settings: Settings, reporter: &'static Reporter) {
    let advertiser = match Advertiser::start(parts, settings.tx_power_dbm()) {
        Ok(advertiser) => advertiser,
        Err(error) => {
            // The watchdog then resets the chip.
            defmt::error!("no Bluetooth: {}", error);
            return;
        }
    };
    join(
        advertiser.serve(),
        firmware_beacon::run(OnAir(&advertiser), Delay, random, &settings, TelemetrySink(reporter)),
    )
    .await;
}

/// Spawns all tasks. Without a usable record it only spawns the task that reports this.
fn start(spawner: Spawner) {
    let Board { care, start, address, bluetooth, .. } = Board::take(spawner);
    let (mut node, configured) = Node::start(&REPORTER, Role::Beacon, start);
    if let Some(configured) = configured {
        match Settings::of(&configured.record, address) {
            Ok(settings) => {
                // The program beats the heartbeat that ranging uses in other roles.
                node.tasks = Tasks::Ranging;
                spawner.spawn(advertise(bluetooth, settings, node.reporter).unwrap());
            }
            Err(SettingsError::OtherRole) => node.report(Condition::WrongRecord),
            Err(fault @ (SettingsError::Interval(_) | SettingsError::Channels(_) | SettingsError::NoKey)) => {
                defmt::error!("{}", fault);
                node.report(Condition::NoRecord(RecordError::Invalid));
            }
        }
    }
    spawner.spawn(supervise(node, care).unwrap());
}

baliza_board_esp32::entry!(start);
