//! DW1000 chips to test drivers with: registers behind SPI, interrupt and reset lines, drifting clocks, and the air
//! between chips.
//!
//! A [`World`] holds virtual time, the [`air`] and the nodes. A node's application is an `async` function over the
//! [`Peripherals`] of its board: an `embedded-hal-async` SPI device, the chip's IRQ and RSTn, and a delay. Behind the
//! SPI device is a [`chip`] that behaves as the DW1000 user manual says. No code here reads a wall clock: equal seeds
//! give equal bytes. The crate does not depend on any firmware: any driver, blocking or not, in any language, can run
//! on it.
#![forbid(unsafe_code)]

pub mod air;
pub mod board;
pub mod chip;
pub mod clock;
mod irq;
mod kernel;
mod pins;
pub mod processor;
pub mod random;
mod sleep;
mod spi;
mod time;
mod world;

pub use air::{AirConfig, AirStatistics, Material, Path, Sniffed, Wall};
pub use board::{BoardProfile, Core, Interrupts};
pub use chip::{ChipConfig, ChipStatistics, Consumption, Currents};
pub use clock::ClockConfig;
pub use irq::IrqPin;
pub use kernel::TaskId;
pub use pins::{ResetPin, SimDelay};
pub use processor::{Processor, ProcessorTimes};
pub use sleep::Sleep;
pub use spi::{SimSpi, SpiClock};
pub use time::{PS_PER_US, TrueTime};
pub use world::{Node, NodeConfig, Peripherals, World};
