//! Boards with a chip of Espressif (ESP32-C3, -C6, and the original ESP32) and a DW1000 on SPI.
//!
//! Boards differ. So the pins are a default of the chip, and the config record can change them. No pin is known to have
//! a light, so the log reports the node's state. The modules that need no chip ([`frames`], [`pins`], [`reset_cause`])
//! also build on a desktop.
//!
//! # Threads
//!
//! esp-rtos preempts by priority, and gives each thread a stack with a watchpoint at its end. Ranging has a thread of
//! its own with the highest priority (`thread`). The threads of the Bluetooth controller follow. The main thread's
//! executor has the lowest priority. It runs the solver, the commands to the controller, telemetry and the supervisor.
//! (An executor in an interrupt would preempt as well, but it would run on the stack that it interrupts, which may be
//! the controller's.)

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
