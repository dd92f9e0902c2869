//! The common parts of the Cortex-M boards: the log's clock, the crash record, the critical section, and SPI to the
//! DW1000. The modules that need no chip ([`fault`], [`identity`], [`reset_cause`]) also build on a desktop, where they
//! are tested.
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
