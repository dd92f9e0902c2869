//! Desktop simulation: whole nodes, with drifting clocks, over register-level DW1000s and the air between them; and the error
//! model of UWB ranges indoors, the room of the positioning benchmark, an example recording.
//!
//! A [`World`] holds virtual time, the [`air`] and the nodes. A node's application is an `async` function over the
//! [`Peripherals`] of its board: an `embedded-hal-async` SPI device, the chip's IRQ and RSTn, a delay. Behind the SPI device is
//! a [`chip`] that behaves as the DW1000 user manual says. Beside it is the [`bluetooth`] air, of beacons and scanners. Nothing here reads a wall clock: equal seeds give equal bytes.
#![forbid(unsafe_code)]

pub mod air;
pub mod alavi_pahlavan;
pub mod bluetooth;
pub mod board;
pub mod chip;
pub mod clock;
pub mod direct;
pub mod example_room;
mod irq;
mod kernel;
mod pins;
pub mod random;
pub mod scenario;
mod spi;
mod time;
mod world;

pub use air::{AirConfig, AirStatistics, Material, Path, Sniffed, Wall};
pub use board::BoardProfile;
pub use chip::{ChipConfig, ChipStatistics};
pub use clock::ClockConfig;
pub use irq::IrqPin;
pub use kernel::{Sleep, TaskId};
pub use pins::{ResetPin, SimDelay};
pub use spi::{SimSpi, SpiClock};
pub use time::TrueTime;
pub use world::{Node, NodeConfig, Peripherals, World};
