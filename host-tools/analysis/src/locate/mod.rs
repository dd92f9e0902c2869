//! Positions from recordings: a fix for each epoch, a track, and positions from beacons.

pub mod advice;
pub mod ble;
pub mod residuals;
mod solve;
pub mod time_offset;
pub mod track;

pub(crate) use solve::middle_m;
pub use solve::{Setup, Solver};
