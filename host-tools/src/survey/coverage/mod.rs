//! What is heard where: RSSI values over an area, measured or simulated, and how well they would tell a position.
//!
//! Fingerprints, or beacons and walls, flow in; out flows a [`Map`], an RSSI a beacon in each cell of a [`Grid`]. [`bound`] has the least
//! error that those RSSI values, or ranges to anchors, allow; the search for places of beacons and anchors ([`crate::survey::plan`]) uses it too.

pub mod bound;
mod grid;
mod map;

pub use grid::Grid;
pub use map::{Fitted, Map, USUAL_WALL_DB, errors_m, fitted, walls_of};
