//! Boards with a chip of Espressif (ESP32-C3, -C6, and the original ESP32) and a DW1000 on SPI.
//!
//! Boards differ, and so the pins are a default of the chip that the node record can change; no light is known to be on any pin,
//! so that the log tells the node's state. What needs no chip ([`frames`], [`pins`], [`reset_cause`]) builds on a desktop too.
//!
//! # Threads
//!
//! esp-rtos preempts by priority, and gives each thread a stack with a watchpoint at its end. Ranging has a thread of its own
//! above all others (`thread`); then come those of the Bluetooth controller; the main thread's executor, with the solver, the
//! commands to the controller, telemetry and the supervisor, has the least. (An executor in an interrupt would preempt as well,
//! but it would run on whichever stack it interrupts, the controller's among them.)

#![no_std]

#[cfg(target_os = "none")]
extern crate alloc;
#[cfg(test)]
extern crate std;

pub mod frames;
pub mod pins;
pub mod reset_cause;

#[cfg(target_os = "none")]
mod chip;

#[cfg(target_os = "none")]
pub use chip::*;
