//! The board on its chip.

mod board;
mod cipher;
pub mod crash;
pub mod log;
mod spi;
pub mod thread;
mod watchdog;

#[cfg(feature = "ble")]
pub mod bluetooth;
#[cfg(feature = "wifi")]
pub mod wifi;

#[cfg(feature = "wifi")]
use core::cell::Cell;

use baliza_dw1000::driver::Dw1000;
use embassy_executor::Spawner;
use embassy_time::Delay;
use esp_rtos::embassy::Executor;
use firmware_common::node::Node;
use static_cell::StaticCell;

#[cfg(feature = "ble")]
pub use board::models;
pub use board::{Board, Uwb, UwbPort, random};
pub use log::TelemetryChannel;
pub use spi::{Bus, Interrupt, Reset};
pub use watchdog::Watchdog;

/// The board's name in telemetry: the chip that this image is for.
pub const BOARD: wire::config::Board = if cfg!(feature = "esp32c3") {
    wire::config::Board::Esp32C3
} else if cfg!(feature = "esp32c6") {
    wire::config::Board::Esp32C6
} else {
    wire::config::Board::Esp32
};

/// The DW1000's driver.
pub type Radio = Dw1000<Bus, Interrupt, Reset, Delay>;

/// Microseconds since the node started.
pub fn uptime_us() -> u64 {
    embassy_time::Instant::now().as_micros()
}

/// Resets the chip, but not the memory with the crash record.
pub fn restart() -> ! {
    esp_hal::system::software_reset()
}

/// Makes a function the program's entry point: `entry!(start)` with a `fn(Spawner)` that spawns the tasks of the main
/// thread.
#[macro_export]
macro_rules! entry {
    ($start:path) => {
        #[cfg(target_arch = "riscv32")]
        #[unsafe(export_name = "main")]
        fn __entry(_: usize, _: usize, _: usize) -> ! {
            $crate::run($start)
        }
        #[cfg(target_arch = "xtensa")]
        #[unsafe(export_name = "main")]
        fn __entry() -> ! {
            $crate::run($start)
        }
    };
}

/// Runs the main thread's executor; see [`entry`](crate::entry).
pub fn run(start: fn(Spawner)) -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    EXECUTOR.init(Executor::new()).run(start)
}

/// The parts of the board that the supervisor uses.
pub struct Care {
    watchdog: Watchdog,
    telemetry: TelemetryChannel,
    /// The way to a station by Wi-Fi, once it is started.
    #[cfg(feature = "wifi")]
    pub gateway: Cell<Option<&'static wifi::Gateway>>,
}

/// Runs the supervisor: see [`Node::supervise`]. No pin is known to have a light.
#[embassy_executor::task]
pub async fn supervise(node: Node, care: Care) {
    let mut watchdog = care.watchdog;
    #[cfg(not(feature = "wifi"))]
    let telemetry = care.telemetry;
    #[cfg(feature = "wifi")]
    let telemetry = wifi::Both { cable: care.telemetry, gateway: care.gateway.get() };
    node.supervise(Delay, telemetry, |_| (), || watchdog.feed(), crash::leave).await;
}
