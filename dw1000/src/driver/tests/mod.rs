//! Tests of the driver by the bytes on the bus; on simulated chips it is tested in the `sim` crate.

mod double;
mod frames;
mod modes;
mod restart;
mod startup;
