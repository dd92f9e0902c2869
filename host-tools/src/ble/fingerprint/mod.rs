//! Fingerprints: surveys in, maps and positions out.
//!
//! A [`Survey`] has a level a beacon and point; [`Process`] says what the levels are between its points, [`chart`] makes of that the map
//! that a node reads, and [`Solver`] runs the node's own comparisons over captures.

mod chart;
mod process;
mod solve;
mod survey;
mod trend;
mod windows;

pub use chart::{Grid, chart};
pub use process::{Kernel, Process};
pub use solve::{Comparison, HeldOut, Setup, Solver, held_out, process};
pub use survey::{Average, Spot, Survey, minor, scan, spread, to_bytes};
pub use trend::{Plan, Trend};
