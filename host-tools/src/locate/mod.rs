//! Positions from recordings: a fix for each epoch, a track, and positions from beacons.

pub mod ble;
mod solve;
pub mod track;

pub use solve::{Half, Height, NoPosition, Position, Setup, Solved, Solver, Space};
