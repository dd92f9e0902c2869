//! A beacon's advertiser. It uses legacy advertising, not connectable and not scannable, which all receivers
//! understand.

use core::convert::Infallible;

use bt_hci::cmd::le::{LeSetAdvData, LeSetAdvEnable, LeSetAdvParams, LeSetRandomAddr};
use bt_hci::param::{AddrKind, AdvChannelMap, AdvFilterPolicy, AdvKind, BdAddr, Duration};
use esp_radio::ble::Config;
#[cfg(not(feature = "esp32"))]
use esp_radio::ble::TxPower;

use super::{Controller, Error, Parts, StartError};

/// The longest advertising data, bytes.
const MOST_BYTES: usize = 31;

/// An advertiser with a running controller.
pub struct Advertiser(Controller);

impl Advertiser {
    /// Starts the controller, with the highest power level that does not exceed `tx_power_dbm`, or with the lowest
    /// level. May be called once in a program's run.
    ///
    /// # Errors
    /// The controller does not start.
    pub fn start(parts: Parts, tx_power_dbm: i8) -> Result<Self, StartError> {
        Controller::start(parts, config(tx_power_dbm)).map(Self)
    }

    /// Processes the answers to commands, for ever. No command ends while this does not run.
    pub async fn serve(&self) -> Infallible {
        // Advertisements of others are ignored.
        self.0.listen(|_| ()).await
    }

    /// Advertises the first 31 bytes of `data` under the random `address`. Must be called after [`stop`](Self::stop).
    /// `channels` has a bit for each channel: 37, 38, 39 are bits 0, 1, 2. The controller adds up to 10 ms to each
    /// interval, at random.
    ///
    /// # Errors
    /// The controller refuses a command or does not answer.
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
            // The advertisement is not directed to a peer.
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

    /// Stops advertising.
    ///
    /// # Errors
    /// The controller refuses the command or does not answer.
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

/// The power levels of the controller.
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

/// The ESP32's controller has only one level.
#[cfg(feature = "esp32")]
fn config(_: i8) -> Config {
    Config::default()
}
