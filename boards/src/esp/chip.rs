//! The board on its chip.

mod board;
pub mod crash;
pub mod log;
mod spi;
pub mod thread;
mod watchdog;

#[cfg(feature = "ble")]
pub mod bluetooth;

use embassy_executor::Spawner;
use esp_rtos::embassy::Executor;
use static_cell::StaticCell;

use crate::node::{self, Reporter, Tasks};

pub use board::{Board, Uwb, UwbPort, random};
pub use log::TelemetryChannel;
pub use spi::{Bus, Interrupt, Reset};
pub use watchdog::Watchdog;

/// The chip that this image is for, as telemetry calls it.
#[cfg(feature = "esp32c3")]
pub const KIND: wire::config::Board = wire::config::Board::Esp32C3;
#[cfg(feature = "esp32c6")]
pub const KIND: wire::config::Board = wire::config::Board::Esp32C6;
#[cfg(feature = "esp32")]
pub const KIND: wire::config::Board = wire::config::Board::Esp32;

/// Microseconds since the node started.
pub fn uptime_us() -> u64 {
    embassy_time::Instant::now().as_micros()
}

/// Resets the chip, but not the memory in which a crash is left.
pub fn restart() -> ! {
    esp_hal::system::software_reset()
}

/// Makes a function the program: `esp_entry!(start)` with a `fn(Spawner)` that spawns the tasks of the main thread.
#[macro_export]
macro_rules! esp_entry {
    ($start:path) => {
        #[cfg(target_arch = "riscv32")]
        #[unsafe(export_name = "main")]
        fn __entry(_: usize, _: usize, _: usize) -> ! {
            $crate::esp::run($start)
        }
        #[cfg(target_arch = "xtensa")]
        #[unsafe(export_name = "main")]
        fn __entry() -> ! {
            $crate::esp::run($start)
        }
    };
}

/// Runs the main thread's executor; see [`esp_entry`](crate::esp_entry).
pub fn run(start: fn(Spawner)) -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    EXECUTOR.init(Executor::new()).run(start)
}

/// What the supervisor takes care of.
pub struct Care {
    /// Runs already.
    pub watchdog: Watchdog,
    /// Telemetry's way out.
    pub telemetry: TelemetryChannel,
}

/// The supervisor: see [`node::supervise`]. No light is known to be on any pin.
#[embassy_executor::task]
pub async fn supervise(reporter: &'static Reporter, tasks: Tasks, care: Care) {
    let Care { mut watchdog, mut telemetry } = care;
    let (write, feed) = (|frame: &[u8]| telemetry.write(frame), || watchdog.feed());
    let alive = |reporter: &Reporter| tasks.alive(reporter);
    node::supervise(reporter, write, |_| (), feed, alive, crash::leave).await;
}
