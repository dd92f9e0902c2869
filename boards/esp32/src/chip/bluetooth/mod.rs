//! Bluetooth: esp-radio's controller, for a tag that scans and for a beacon that advertises.
//!
//! HCI commands control the controller, without a host in between. A scanner needs five commands, an advertiser seven.
//! trouble-host, a host with links, would add 54 kB of code. The controller's threads have priorities below the ranging
//! thread's.

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

/// The chip's radio, switched off.
pub struct Parts(pub(super) BT<'static>);

/// Why the controller did not start.
pub type StartError = BleInitError;

/// Why a command failed.
#[derive(Debug, defmt::Format)]
pub enum Error {
    /// The controller refused, with this HCI error code (Bluetooth Core 5.4, volume 1, part F).
    Refused(u8),
    /// The controller could not be reached.
    Unreachable(BleConnectorError),
    /// The controller did not answer.
    Silent,
}

/// A received advertisement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Advertisement<'a> {
    /// The sender's address, as on the air, lowest byte first.
    pub address: [u8; 6],
    /// The RSSI, dBm.
    pub rssi: i8,
    /// The advertising data: AD structures.
    pub data: &'a [u8],
}

/// The longest HCI packet, bytes.
const PACKET: usize = 259;
/// The longest command used here, bytes: the one that sets the advertising data.
const COMMAND: usize = 3 + 32;
/// The time-out of a command. A working controller answers within milliseconds.
const PATIENCE: Duration = Duration::from_secs(1);

/// The running controller.
struct Controller {
    connector: BleConnector<'static>,
    /// The opcode of the command that was answered last, and its status.
    answer: Signal<NoopRawMutex, (Opcode, Status)>,
    /// The controller has been reset, and no command has failed since.
    is_ready: Cell<bool>,
}

impl Controller {
    /// Starts the controller. May be called once in a program's run.
    fn start(parts: Parts, config: Config) -> Result<Self, StartError> {
        Ok(Self { connector: BleConnector::new(parts.0, config)?, answer: Signal::new(), is_ready: Cell::new(false) })
    }

    /// Reads the controller's events for ever. No command ends while this does not run.
    async fn listen(&self, mut heard: impl FnMut(Advertisement<'_>)) -> Infallible {
        let mut buffer = [0; PACKET];
        loop {
            match self.connector.read(&mut buffer).await {
                Ok(ControllerToHostPacket::Event(event)) => self.take(event, &mut heard),
                // Data packets need links, and there are none.
                Ok(_) => {}
                Err(error) => {
                    defmt::warn!("Bluetooth: {}", error);
                    Timer::after_millis(10).await;
                }
            }
        }
    }

    /// Handles an event. Only two kinds of events matter. A parser for all kinds would take 8 kB of code.
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

    /// Executes a command. Before the first command, and after a failure, it resets the controller.
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
                // Another opcode may be the late answer to a command that timed out.
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

/// A command as bytes: one type for all commands, so that the code for sending exists only once.
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
        // It fits, as asserted above.
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

/// Passes the advertisements in a "meta event" to `heard`, if it has any.
fn tell(event: &[u8], heard: &mut impl FnMut(Advertisement<'_>)) {
    let Some((&LeAdvertisingReport::SUBEVENT_CODE, data)) = event.split_first() else { return };
    let Ok(event) = LeAdvertisingReport::from_hci_bytes_complete(data) else { return };
    for report in event.reports.iter().flatten() {
        let mut address = [0; 6];
        address.copy_from_slice(report.addr.raw());
        heard(Advertisement { address, rssi: report.rssi, data: report.data });
    }
}
