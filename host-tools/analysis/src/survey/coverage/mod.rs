//! Coverage: measured or simulated RSSI values over an area, and how accurate a position from them would be.
//!
//! The input is fingerprints, or beacons and walls. The output is a [`CoverageMap`]: one RSSI a beacon in each cell of a
//! [`Grid`]. [`bound`] has the least error that those RSSI values, or ranges to anchors, allow. The search for
//! positions of beacons and anchors ([`crate::survey::placement`]) uses it too.

pub mod bound;
mod grid;
mod rssi_grid;

pub use grid::Grid;
pub use rssi_grid::{CoverageMap, Fitted, USUAL_WALL_DB, errors_m, fitted, walls_of};
