//! A beacon's advertiser: not connectable, not scannable, legacy advertising, which all receivers understand.

use core::convert::Infallible;

use bt_hci::cmd::le::{LeSetAdvData, LeSetAdvEnable, LeSetAdvParams, LeSetRandomAddr};
use bt_hci::param::{AddrKind, AdvChannelMap, AdvFilterPolicy, AdvKind, BdAddr, Duration};
use esp_radio::ble::Config;
#[cfg(not(feature = "esp32"))]
use esp_radio::ble::TxPower;

use super::{Controller, Error, Parts, StartError};

/// The longest advertising data.
const MOST_BYTES: usize = 31;

/// An advertiser, its controller running.
pub struct Advertiser(Controller);

impl Advertiser {
    /// Starts the controller, with the power level next below `tx_power_dbm` or the lowest; once a program.
    pub fn start(parts: Parts, tx_power_dbm: i8) -> Result<Self, StartError> {
        Controller::start(parts, config(tx_power_dbm)).map(Self)
    }

    /// Carries commands, for ever; without it none ends.
    pub async fn serve(&self) -> Infallible {
        // Nobody is listened to.
        self.0.listen(|_| ()).await
    }

    /// Advertises the first 31 bytes of `data` under the random `address`, after [`stop`](Self::stop). `channels` are 37, 38, 39 as
    /// bits 0, 1, 2. The controller adds up to 10 ms to each interval, at random.
    pub async fn advertise(&self, data: &[u8], address: [u8; 6], interval_ms: u16, channels: u8) -> Result<(), Error> {
        let mut bytes = [0; MOST_BYTES];
        let mut length = 0;
        for (place, byte) in bytes.iter_mut().zip(data) {
            *place = *byte;
            length += 1;
        }
        let interval = Duration::from_millis(interval_ms.into());
        let parameters = LeSetAdvParams::new(
            interval,
            interval,
            AdvKind::AdvNonconnInd,
            AddrKind::RANDOM,
            // Of whom it is directed to: nobody.
            AddrKind::PUBLIC,
            BdAddr::default(),
            channel_map(channels),
            AdvFilterPolicy::default(),
        );
        self.0.command(LeSetRandomAddr::new(BdAddr::new(address))).await?;
        self.0.command(parameters).await?;
        self.0.command(LeSetAdvData::new(length, bytes)).await?;
        self.0.command(LeSetAdvEnable::new(true)).await
    }

    /// Advertises nothing from now on.
    pub async fn stop(&self) -> Result<(), Error> {
        self.0.command(LeSetAdvEnable::new(false)).await
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
