//! A small air for nodes that run in one image. Their whole apps run over radios with drifting 40-bit clocks, flight
//! times, noise, loss and collisions, in virtual time.
//!
//! The results are the same on every machine: all arithmetic is on integers, except for a few roundings that IEEE 754
//! prescribes. A Cortex-M4F, a RISC-V core without FPU and a desktop therefore agree bit for bit. There is no heap and
//! no executor: [`World::run`] polls one future. When nothing is left to do at the present time, it advances time to
//! the next event.
//!
//! The air of `ranging`'s tests steps bare protocols in `f64` with its own random numbers; `sim` has chips, walls and
//! powers. This crate is for what neither of them can do: it runs on the chip itself.
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
