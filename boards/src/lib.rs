//! The boards, one module each: clocks, pins, buses, flash, watchdog, what a reset left behind.
//!
//! A board is taken once, at the start of a program; what it gives is what the node's tasks need: the UWB chip's bus, interrupt
//! and reset line, the record from flash, lights, the watchdog, the channel of telemetry. What needs no chip (`fault`,
//! `identity`, `lcd`, `panel`, `reset_cause`) builds on a desktop too, where it is tested.
#![no_std]

#[cfg(all(feature = "_esp", any(target_arch = "riscv32", target_arch = "xtensa")))]
extern crate alloc;
#[cfg(test)]
extern crate std;

pub mod esp;
pub mod fault;
pub mod identity;
pub mod lcd;
pub mod panel;
pub mod reset_cause;

#[cfg(all(feature = "_cortex-m", target_arch = "arm"))]
pub mod cortex;
#[cfg(all(feature = "dwm1001", target_arch = "arm"))]
pub mod dwm1001;
#[cfg(all(feature = "evk1000", target_arch = "arm"))]
pub mod evk1000;
#[cfg(all(feature = "_node", target_os = "none"))]
pub mod node;
#[cfg(all(any(feature = "_node", feature = "simulated"), not(feature = "log-serial"), target_os = "none"))]
mod rtt;
#[cfg(all(feature = "simulated", target_os = "none"))]
pub mod simulated;
#[cfg(all(feature = "wired", target_os = "none"))]
pub mod wired;
