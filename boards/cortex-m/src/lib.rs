//! What the Cortex-M boards share: the log's clock, what a crash leaves, the critical section, SPI to the DW1000. What needs no chip
//! ([`fault`], [`identity`], [`reset_cause`]) builds on a desktop too, where it is tested.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod fault;
pub mod identity;
pub mod reset_cause;

#[cfg(target_arch = "arm")]
mod chip;
#[cfg(target_arch = "arm")]
pub use chip::*;
