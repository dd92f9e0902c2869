//! Desktop simulation: whole nodes, with drifting clocks, on register-level DW1000s and the air between them. It also
//! has the error model of UWB ranges indoors, the room of the positioning benchmark, and an example recording.
//!
//! Chips, air and virtual time come from `dw1000-sim`, whose [`World`] this crate re-exports. This crate adds the
//! [`bluetooth`] air with beacons and scanners, and a motion sensor, [`lis2dh12`]. No code here reads a wall clock:
//! equal seeds give equal bytes.
#![forbid(unsafe_code)]

pub mod alavi_pahlavan;
pub mod bluetooth;
pub mod costs;
pub mod direct;
pub mod example_room;
pub mod lis2dh12;
pub mod scenario;

pub use dw1000_sim::{
    AirConfig, AirStatistics, BoardProfile, ChipConfig, ChipStatistics, ClockConfig, Consumption, Core, Currents,
    Interrupts, IrqPin, Material, Node, NodeConfig, PS_PER_US, Path, Peripherals, Processor, ProcessorTimes, ResetPin,
    SimDelay, SimSpi, Sleep, Sniffed, SpiClock, TaskId, TrueTime, Wall, World, air, board, chip, clock, random,
};
