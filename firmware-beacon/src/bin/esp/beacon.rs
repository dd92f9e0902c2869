//! The beacon on a chip of Espressif: everything in the main thread, but the controller.

use boards::esp::bluetooth::{self, Advertiser, Parts};
use boards::esp::{self, Board};
use boards::node::{self, Reporter, Tasks};
use embassy_executor::Spawner;
use embassy_futures::join::join;
use embassy_time::Delay;
use firmware_beacon::{Advertise, Advertisement, Listener, Settings, SettingsError};
use wire::telemetry::{Condition, RecordError};

static REPORTER: Reporter = Reporter::new(esp::uptime_us);

/// The app's advertiser.
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

/// The app's listener.
struct TelemetryListener;

impl Listener for TelemetryListener {
    fn advertising(&mut self, advertisement: &Advertisement) {
        defmt::info!("on the air: {}", advertisement);
        REPORTER.event_log.state(REPORTER.now_us(), Condition::Advertising);
    }

    fn failed(&mut self, error: &impl core::fmt::Debug, failures: u32) {
        // No sign of life: where this goes on, the watchdog starts the chip anew.
        REPORTER.counts.radio_failures.add();
        REPORTER.event_log.state(REPORTER.now_us(), Condition::RadioFailed(failures));
        let _ = error;
    }

    fn alive(&mut self) {
        REPORTER.ranging.beat(REPORTER.now_us());
    }
}

#[embassy_executor::task]
async fn advertise(parts: Parts, settings: Settings) {
    let advertiser = match Advertiser::start(parts, settings.tx_power_dbm()) {
        Ok(advertiser) => advertiser,
        Err(error) => {
            // The watchdog starts the chip anew.
            defmt::error!("no Bluetooth: {}", error);
            return;
        }
    };
    join(
        advertiser.serve(),
        firmware_beacon::run(OnAir(&advertiser), Delay, esp::random, &settings, TelemetryListener),
    )
    .await;
}

/// Spawns all tasks; without a record to follow, only those that tell so.
pub fn start(spawner: Spawner) {
    let Board { care, start, address, bluetooth, .. } = Board::take(spawner);
    let (hello, followed) = node::introduce(&REPORTER, esp::KIND, wire::telemetry::Role::Beacon, start);
    let mut tasks = Tasks::None;
    if let Some((record, _)) = followed {
        let complain = |condition| REPORTER.event_log.state(REPORTER.now_us(), condition);
        match Settings::of(&record, address) {
            Ok(settings) => {
                // The app shows that it is alive as ranging does elsewhere.
                tasks = Tasks::Ranging;
                spawner.spawn(advertise(bluetooth, settings).unwrap());
            }
            Err(SettingsError::OtherRole) => complain(Condition::WrongRecord),
            Err(fault @ (SettingsError::Interval(_) | SettingsError::Channels(_) | SettingsError::NoKey)) => {
                defmt::error!("{}", fault);
                complain(Condition::NoRecord(RecordError::Invalid));
            }
        }
    }
    spawner.spawn(esp::supervise(&REPORTER, tasks, care).unwrap());
    spawner.spawn(node::keep_telling(&REPORTER, hello).unwrap());
}
