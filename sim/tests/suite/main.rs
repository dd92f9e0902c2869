//! Tests of simulated nodes: their batteries, and the DW1000 driver of `ranging` on simulated chips.

mod battery;
mod driver;
