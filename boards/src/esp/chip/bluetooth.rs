//! Bluetooth: esp-radio's controller under trouble-host, for a tag that listens and a beacon that advertises.
//!
//! The controller's threads have priorities below the ranging thread's; the host is a task of the main thread.

mod advertiser;
mod scanner;

use bt_hci_esp::controller::ExternalController;
use esp_hal::peripherals::BT;
use esp_radio::ble::Config;
use esp_radio::ble::controller::{BleConnector, BleConnectorError, BleInitError};
use static_cell::StaticCell;
use trouble_host_esp::prelude::{Address, BleHostError, DefaultPacketPool, HostResources, Stack};

pub use advertiser::Advertiser;
pub use scanner::{Advertisement, Orders, Scanner};

/// The chip's radio, off.
pub struct Parts(pub(super) BT<'static>);

/// Why the controller did not start.
pub type StartError = BleInitError;

/// What a command failed with.
pub type Error = BleHostError<BleConnectorError>;

/// Commands under way at a time: one.
type Controller = ExternalController<BleConnector<'static>, 1>;
/// A host without links.
type Host = Stack<'static, Controller, DefaultPacketPool>;

/// Starts controller and host; once a program. `address` is a random one, as on the air, the lowest byte first.
fn start(parts: Parts, config: Config, address: [u8; 6]) -> Result<&'static Host, StartError> {
    static RESOURCES: StaticCell<HostResources<Controller, DefaultPacketPool, 0, 0>> = StaticCell::new();
    static HOST: StaticCell<Host> = StaticCell::new();
    let controller = Controller::new(BleConnector::new(parts.0, config)?);
    let resources = RESOURCES.init(HostResources::new());
    let host = trouble_host_esp::new(controller, resources).set_random_address(Address::random(address)).build();
    Ok(HOST.init(host))
}
