//! EVB1000, the board of Decawave's EVK1000: STM32F105RC with a DW1000, switches, four lights and a display. The
//! modules that need no chip ([`lcd`], [`panel`]) also build on a desktop, where they are tested.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod lcd;
pub mod panel;

#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod cipher;
#[cfg(target_os = "none")]
mod display;
#[cfg(target_os = "none")]
mod role;
#[cfg(target_os = "none")]
mod uwb;

#[cfg(target_os = "none")]
pub use board::*;
#[cfg(target_os = "none")]
pub use display::{OnPanel, SharedPanel, Shown, display};
#[cfg(target_os = "none")]
pub use role::RoleListener;
#[cfg(target_os = "none")]
pub use uwb::{Bus, Interrupt, Reset};
