//! Fingerprints: makes maps and positions from surveys.
//!
//! A [`Survey`] has one RSSI a beacon and point. [`Process`] predicts the RSSI values between its points, and `chart`
//! makes of it the map that a node reads. [`Maps`] are the maps that a [`Comparison`] needs, or one from a file.
//! [`Solver`] runs the node's own comparisons over captures. [`held_out`] runs them over parts of a survey that are
//! not in the maps.

mod chart;
mod comparison;
mod held_out;
mod maps;
mod process;
mod solve;
mod survey;
mod trend;
mod windows;

pub use chart::Grid;
pub use comparison::Comparison;
pub use held_out::{HeldOut, held_out};
pub use maps::{Making, Maps, names_of};
pub use process::{Kernel, Process};
pub use solve::{Setup, Solver};
pub use survey::{Average, Spot, Survey, minor, scan, spread, to_bytes};
pub use trend::{Plan, Trend};
