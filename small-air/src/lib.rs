//! A small air for nodes that run in one image: their whole apps over radios with drifting 40-bit clocks, flight times, noise, loss
//! and collisions, in virtual time.
//!
//! In flow the nodes' futures, out flows the same on every machine: all arithmetic is on whole numbers, but for a few roundings
//! that IEEE 754 prescribes, so that a Cortex-M4F, a RISC-V core without FPU and a desktop agree bit for bit. There is no heap
//! and no executor: [`World::run`] polls one future, and where nothing is left to do now, moves time on to what comes next.
//!
//! The air of `ranging`'s tests steps bare machines in `f64` with random numbers of their own making; `sim` has chips, walls and
//! powers. This one is for what neither can do: run on the chip itself.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

mod air;
mod clock;
mod radio;
mod random;
pub mod room;
mod world;

pub use air::Path;
pub use clock::Crystal;
pub use radio::{ANTENNA_DELAY, AirDelay, AirRadio};
pub use world::{World, uptime_us};
