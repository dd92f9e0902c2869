//! Recordings into positions: a fix for each epoch, a track, positions from beacons, and the statistics of their errors.

pub mod ble;
mod solve;
mod statistics;
pub mod track;

pub use solve::{Half, Height, NoPosition, Position, Setup, Solved, Solver, Space};
pub use statistics::Statistics;
