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

pub use board::{Board, Uwb, UwbPort, random};
pub use log::TelemetryChannel;
pub use spi::{Bus, Interrupt, Reset};
pub use watchdog::Watchdog;

/// The chip that this image is for.
#[cfg(feature = "esp32c3")]
mod this {
    pub const BOARD: node_record::Board = node_record::Board::Esp32C3;
    pub const PINS: node_record::Pins = crate::esp::pins::ESP32_C3;
    pub const KIND: telemetry::Board = telemetry::Board::Esp32C3;
}
#[cfg(feature = "esp32c6")]
mod this {
    pub const BOARD: node_record::Board = node_record::Board::Esp32C6;
    pub const PINS: node_record::Pins = crate::esp::pins::ESP32_C6;
    pub const KIND: telemetry::Board = telemetry::Board::Esp32C6;
}
#[cfg(feature = "esp32")]
mod this {
    pub const BOARD: node_record::Board = node_record::Board::Esp32;
    pub const PINS: node_record::Pins = crate::esp::pins::ESP32;
    pub const KIND: telemetry::Board = telemetry::Board::Esp32;
}

/// As telemetry calls it.
pub const KIND: telemetry::Board = this::KIND;

/// Microseconds since the node started.
pub fn uptime_us() -> u64 {
    embassy_time::Instant::now().as_micros()
}

/// Resets the chip, but not the memory in which a crash is left.
pub fn restart() -> ! {
    esp_hal::system::software_reset()
}

/// Makes a task the program: `esp_entry!(main)` with a task `main` that takes the main thread's `Spawner`.
#[macro_export]
macro_rules! esp_entry {
    ($main:path) => {
        #[cfg(target_arch = "riscv32")]
        #[unsafe(export_name = "main")]
        fn __entry(_: usize, _: usize, _: usize) -> ! {
            $crate::esp::start(|spawner| spawner.spawn($main(spawner).unwrap()))
        }
        #[cfg(target_arch = "xtensa")]
        #[unsafe(export_name = "main")]
        fn __entry() -> ! {
            $crate::esp::start(|spawner| spawner.spawn($main(spawner).unwrap()))
        }
    };
}

/// Runs the main thread's executor; see [`esp_entry`](crate::esp_entry).
pub fn start(main: impl FnOnce(Spawner)) -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    EXECUTOR.init(Executor::new()).run(main)
}
