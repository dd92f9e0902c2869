//! A beacon's advertiser: not connectable, not scannable, legacy advertising, which all receivers understand.

use bt_hci_esp::cmd::le::{LeSetAdvEnable, LeSetRandomAddr};
use bt_hci_esp::param::{AdvChannelMap, BdAddr};
use embassy_executor::Spawner;
use embassy_time::{Duration, Timer};
use esp_radio::ble::Config;
#[cfg(not(feature = "esp32"))]
use esp_radio::ble::TxPower;
use trouble_host_esp::prelude::{self, AdvertisementParameters, DefaultPacketPool, Peripheral};

use super::{Controller, Error, Host, Parts, StartError};

/// An advertiser, its controller running.
pub struct Advertiser {
    host: &'static Host,
    peripheral: Peripheral<'static, Controller, DefaultPacketPool>,
    /// What is on the air; dropped, it stops.
    session: Option<prelude::Advertiser<'static, Controller, DefaultPacketPool>>,
}

impl Advertiser {
    /// Starts the controller, with the power level next below `tx_power_dbm` or the lowest; once a program. `spawner` is the main
    /// thread's, `address` the first that is used.
    pub fn start(parts: Parts, tx_power_dbm: i8, address: [u8; 6], spawner: Spawner) -> Result<Self, StartError> {
        let host = super::start(parts, config(tx_power_dbm), address)?;
        if let Ok(task) = serve(host) {
            spawner.spawn(task);
        }
        Ok(Self { host, peripheral: host.peripheral(), session: None })
    }

    /// Advertises `data` under the random `address`, in place of what was advertised before. `channels` are 37, 38, 39 as bits
    /// 0, 1, 2. The controller adds up to 10 ms to each interval, at random.
    pub async fn advertise(
        &mut self,
        data: &[u8],
        address: [u8; 6],
        interval_ms: u16,
        channels: u8,
    ) -> Result<(), Error> {
        self.stop().await?;
        self.host.command(LeSetRandomAddr::new(BdAddr::new(address))).await?;
        let interval = Duration::from_millis(interval_ms.into());
        let parameters = AdvertisementParameters {
            interval_min: interval,
            interval_max: interval,
            channel_map: Some(channel_map(channels)),
            ..Default::default()
        };
        let advertisement = prelude::Advertisement::NonconnectableNonscannableUndirected { adv_data: data };
        self.session = Some(self.peripheral.advertise(&parameters, advertisement).await?);
        Ok(())
    }

    /// Advertises nothing from now on.
    pub async fn stop(&mut self) -> Result<(), Error> {
        if self.session.take().is_some() {
            // The host stops it as well, but not before this returns: the address cannot be changed until then.
            self.host.command(LeSetAdvEnable::new(false)).await?;
        }
        Ok(())
    }
}

#[embassy_executor::task]
async fn serve(host: &'static Host) -> ! {
    let mut runner = host.runner();
    loop {
        if let Err(error) = runner.run().await {
            defmt::warn!("Bluetooth host: {}", error);
        }
        Timer::after_millis(100).await;
    }
}

fn channel_map(channels: u8) -> AdvChannelMap {
    AdvChannelMap::new()
        .enable_channel_37(channels & 1 << 0 != 0)
        .enable_channel_38(channels & 1 << 1 != 0)
        .enable_channel_39(channels & 1 << 2 != 0)
}

/// The levels of the controller.
#[cfg(not(feature = "esp32"))]
const LEVELS: [(i8, TxPower); 13] = [
    (-15, TxPower::N15),
    (-12, TxPower::N12),
    (-9, TxPower::N9),
    (-6, TxPower::N6),
    (-3, TxPower::N3),
    (0, TxPower::N0),
    (3, TxPower::P3),
    (6, TxPower::P6),
    (9, TxPower::P9),
    (12, TxPower::P12),
    (15, TxPower::P15),
    (18, TxPower::P18),
    (20, TxPower::P20),
];

#[cfg(not(feature = "esp32"))]
fn config(tx_power_dbm: i8) -> Config {
    let level = LEVELS.iter().rev().find(|(dbm, _)| *dbm <= tx_power_dbm);
    Config::default().with_default_tx_power(level.map_or(TxPower::N15, |(_, level)| *level))
}

/// The ESP32's controller has one level.
#[cfg(feature = "esp32")]
fn config(_: i8) -> Config {
    Config::default()
}
