//! Fingerprints: surveys in, maps and positions out.
//!
//! A [`Survey`] has an RSSI a beacon and point; [`Process`] says what the RSSI values are between its points, `chart` makes of that the map
//! that a node reads; [`Maps`] are those that a [`Comparison`] wants, or one from a file; [`Solver`] runs the node's own comparisons over
//! captures, and [`held_out`] over parts of a survey that the maps have not seen.

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
