//! Bluetooth: esp-radio's controller, for a tag that listens and a beacon that advertises.
//!
//! The controller is told what to do by HCI commands, without a host in between: a scanner needs five of them, an advertiser seven,
//! and trouble-host, a host with links, would add 54 kB of code. The controller's threads have priorities below the ranging thread's.

mod advertiser;
mod scanner;

use core::cell::Cell;
use core::convert::Infallible;

use bt_hci::cmd::controller_baseband::{Reset, SetEventMask};
use bt_hci::cmd::le::LeSetEventMask;
use bt_hci::cmd::{Cmd, Opcode};
use bt_hci::event::le::{LeAdvertisingReport, LeEventParams};
use bt_hci::event::{CommandComplete, CommandCompleteWithStatus, EventKind, EventPacket};
use bt_hci::param::{EventMask, LeEventMask, Status};
use bt_hci::transport::Transport;
use bt_hci::{ControllerToHostPacket, FromHciBytes, HostToControllerPacket, PacketKind, WriteHci};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
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
    /// The controller refused, with this number of HCI (Bluetooth Core 5.4, volume 1, part F).
    Refused(u8),
    /// It could not be reached.
    Unreachable(BleConnectorError),
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

/// The longest packet of HCI, bytes.
const PACKET: usize = 259;
/// The longest command here, bytes: the one that sets advertising data.
const COMMAND: usize = 3 + 32;
/// A controller that answers does so within milliseconds.
const PATIENCE: Duration = Duration::from_secs(1);

/// The controller, running.
struct Controller {
    connector: BleConnector<'static>,
    /// The opcode of the command that was answered last, and what became of it.
    answer: Signal<NoopRawMutex, (Opcode, Status)>,
    /// It has been reset, and no command has failed since.
    is_ready: Cell<bool>,
}

impl Controller {
    /// Starts it; once a program.
    fn start(parts: Parts, config: Config) -> Result<Self, StartError> {
        Ok(Self { connector: BleConnector::new(parts.0, config)?, answer: Signal::new(), is_ready: Cell::new(false) })
    }

    /// Reads what it has to tell, for ever; without this no command ends.
    async fn listen(&self, mut heard: impl FnMut(Advertisement<'_>)) -> Infallible {
        let mut buffer = [0; PACKET];
        loop {
            match self.connector.read(&mut buffer).await {
                Ok(ControllerToHostPacket::Event(event)) => self.take(event, &mut heard),
                // There are no links to send data.
                Ok(_) => {}
                Err(error) => {
                    defmt::warn!("Bluetooth: {}", error);
                    Timer::after_millis(10).await;
                }
            }
        }
    }

    /// Of all events there are two that matter; to parse each as what it is would be 8 kB of code.
    fn take(&self, event: EventPacket<'_>, heard: &mut impl FnMut(Advertisement<'_>)) {
        if event.kind == EventKind::CommandComplete {
            let complete =
                CommandComplete::from_hci_bytes_complete(event.data).map(CommandCompleteWithStatus::try_from);
            if let Ok(Ok(complete)) = complete {
                self.answer.signal((complete.cmd_opcode, complete.status));
            }
        } else if event.kind == EventKind::Le {
            tell(event.data, heard);
        }
    }

    /// Executes a command; before the first one, and after a failure, the controller is reset.
    async fn command(&self, command: impl Cmd) -> Result<(), Error> {
        let result = self.after_reset(&Bytes::of(&command)).await;
        self.is_ready.set(result.is_ok());
        result
    }

    async fn after_reset(&self, command: &Bytes) -> Result<(), Error> {
        if !self.is_ready.get() {
            self.execute(&Bytes::of(&Reset::new())).await?;
            self.execute(&Bytes::of(&SetEventMask::new(EventMask::new().enable_le_meta(true)))).await?;
            self.execute(&Bytes::of(&LeSetEventMask::new(LeEventMask::new().enable_le_adv_report(true)))).await?;
        }
        self.execute(command).await
    }

    async fn execute(&self, command: &Bytes) -> Result<(), Error> {
        self.answer.reset();
        let answered = async {
            self.connector.write(command).await.map_err(Error::Unreachable)?;
            loop {
                let (opcode, status) = self.answer.wait().await;
                // Another may be the late answer to a command given up.
                if opcode == command.opcode {
                    return match status {
                        Status::SUCCESS => Ok(()),
                        refused => Err(Error::Refused(refused.into_inner())),
                    };
                }
            }
        };
        with_timeout(PATIENCE, answered).await.unwrap_or(Err(Error::Silent))
    }
}

/// A command as its bytes: one type for all of them, so that there is the code to send one only once.
struct Bytes {
    opcode: Opcode,
    bytes: [u8; COMMAND],
    length: usize,
}

impl Bytes {
    fn of<C: Cmd>(command: &C) -> Self {
        const { assert!(size_of::<C::Params>() + 3 <= COMMAND) };
        let mut bytes = [0; COMMAND];
        let written = command.write_hci(bytes.as_mut_slice());
        // It fits: that has been asserted.
        debug_assert!(written.is_ok());
        Self { opcode: C::OPCODE, bytes, length: command.size().min(COMMAND) }
    }

    fn get(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }
}

impl WriteHci for Bytes {
    fn size(&self) -> usize {
        self.length
    }

    fn write_hci<W: embedded_io::Write>(&self, mut writer: W) -> Result<(), W::Error> {
        writer.write_all(self.get())
    }

    async fn write_hci_async<W: embedded_io_async::Write>(&self, mut writer: W) -> Result<(), W::Error> {
        writer.write_all(self.get()).await
    }
}

impl HostToControllerPacket for Bytes {
    const KIND: PacketKind = PacketKind::Cmd;
}

/// Hands the advertisements of a "meta event" over, if it has any.
fn tell(event: &[u8], heard: &mut impl FnMut(Advertisement<'_>)) {
    let Some((&LeAdvertisingReport::SUBEVENT_CODE, data)) = event.split_first() else { return };
    let Ok(event) = LeAdvertisingReport::from_hci_bytes_complete(data) else { return };
    for report in event.reports.iter().flatten() {
        let mut address = [0; 6];
        address.copy_from_slice(report.addr.raw());
        heard(Advertisement { address, rssi: report.rssi, data: report.data });
    }
}
