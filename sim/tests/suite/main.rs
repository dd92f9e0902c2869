//! Tests of simulated nodes: their batteries, the life of a tag, and the DW1000 driver of `ranging` on simulated chips.

mod battery;
mod driver;
mod life;
