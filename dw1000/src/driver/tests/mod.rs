//! Tests of the driver by the bytes on the bus. Tests on simulated chips are in the `sim` crate.

mod double;
mod frames;
mod modes;
mod restart;
mod startup;
