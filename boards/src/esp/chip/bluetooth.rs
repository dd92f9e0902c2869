//! Bluetooth: esp-radio's controller, for a tag that listens and a beacon that advertises.
//!
//! The controller is told what to do by HCI commands, without a host in between: a scanner needs five of them, an advertiser seven,
//! and trouble-host, a host with links, would add 54 kB of code. The controller's threads have priorities below the ranging thread's.

mod advertiser;
mod scanner;

use core::cell::Cell;
use core::convert::Infallible;

use bt_hci_esp::cmd::controller_baseband::{Reset, SetEventMask};
use bt_hci_esp::cmd::le::LeSetEventMask;
use bt_hci_esp::cmd::{self, SyncCmd};
use bt_hci_esp::controller::{Controller as _, ControllerCmdSync, ExternalController};
use bt_hci_esp::event::EventKind;
use bt_hci_esp::event::le::{LeAdvertisingReport, LeEventParams};
use bt_hci_esp::param::{EventMask, LeEventMask};
use bt_hci_esp::{ControllerToHostPacket, FromHciBytes};
use embassy_time::{Duration, Timer, with_timeout};
use esp_hal::peripherals::BT;
use esp_radio::ble::Config;
use esp_radio::ble::controller::{BleConnector, BleConnectorError, BleInitError};

pub use advertiser::Advertiser;
pub use scanner::Scanner;

/// The chip's radio, off.
pub struct Parts(pub(super) BT<'static>);

/// Why the controller did not start.
pub type StartError = BleInitError;

/// What a command failed with.
#[derive(Debug, defmt::Format)]
pub enum Error {
    /// The controller refused, or could not be reached.
    Command(cmd::Error<BleConnectorError>),
    /// It did not answer.
    Silent,
}

/// An advertisement heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Advertisement<'a> {
    /// The sender's address, as on the air, lowest byte first.
    pub address: [u8; 6],
    /// dBm.
    pub rssi: i8,
    /// The advertising data: AD structures.
    pub data: &'a [u8],
}

/// The longest packet of HCI.
const PACKET: usize = 259;
/// A controller that answers does so within milliseconds.
const PATIENCE: Duration = Duration::from_secs(1);

/// The controller, running.
struct Controller {
    /// One command under way at a time.
    hci: ExternalController<BleConnector<'static>, 1>,
    /// It has been reset, and no command has failed since.
    is_ready: Cell<bool>,
}

impl Controller {
    /// Starts it; once a program.
    fn start(parts: Parts, config: Config) -> Result<Self, StartError> {
        let hci = ExternalController::new(BleConnector::new(parts.0, config)?);
        Ok(Self { hci, is_ready: Cell::new(false) })
    }

    /// Reads what it has to tell, for ever; without this no command ends.
    async fn listen(&self, mut heard: impl FnMut(Advertisement<'_>)) -> Infallible {
        let mut buffer = [0; PACKET];
        loop {
            match self.hci.read(&mut buffer).await {
                Ok(packet) => tell(packet, &mut heard),
                Err(error) => {
                    defmt::warn!("Bluetooth: {}", error);
                    Timer::after_millis(10).await;
                }
            }
        }
    }

    /// Executes a command; before the first one, and after a failure, the controller is reset.
    async fn command<C: SyncCmd>(&self, command: C) -> Result<C::Return, Error>
    where
        ExternalController<BleConnector<'static>, 1>: ControllerCmdSync<C>,
    {
        self.prepare().await?;
        let result = self.execute(command).await;
        self.is_ready.set(result.is_ok());
        result
    }

    async fn prepare(&self) -> Result<(), Error> {
        if !self.is_ready.get() {
            self.execute(Reset::new()).await?;
            self.execute(SetEventMask::new(EventMask::new().enable_le_meta(true))).await?;
            self.execute(LeSetEventMask::new(LeEventMask::new().enable_le_adv_report(true))).await?;
        }
        Ok(())
    }

    async fn execute<C: SyncCmd>(&self, command: C) -> Result<C::Return, Error>
    where
        ExternalController<BleConnector<'static>, 1>: ControllerCmdSync<C>,
    {
        match with_timeout(PATIENCE, command.exec(&self.hci)).await {
            Ok(result) => result.map_err(Error::Command),
            Err(_) => Err(Error::Silent),
        }
    }
}

/// Hands the advertisements of a packet over, if it has any.
fn tell(packet: ControllerToHostPacket<'_>, heard: &mut impl FnMut(Advertisement<'_>)) {
    let ControllerToHostPacket::Event(packet) = packet else { return };
    // All of HCI's events, parsed as such, would be 8 kB of code.
    let (EventKind::Le, Some((&LeAdvertisingReport::SUBEVENT_CODE, data))) = (packet.kind, packet.data.split_first())
    else {
        return;
    };
    let Ok(event) = LeAdvertisingReport::from_hci_bytes_complete(data) else { return };
    for report in event.reports.iter().flatten() {
        let mut address = [0; 6];
        address.copy_from_slice(report.addr.raw());
        heard(Advertisement { address, rssi: report.rssi, data: report.data });
    }
}
