//! What is heard where: levels over an area, measured or simulated, and how well they would tell a position.
//!
//! Fingerprints, or beacons and walls, flow in; out flows a [`Map`], a level a beacon in each cell of a [`Grid`]. [`bound`] has the least
//! error that those levels, or ranges to anchors, allow; the search for places of beacons and anchors ([`crate::survey::plan`]) uses it too.

pub mod bound;
mod grid;
mod map;

pub use grid::Grid;
pub use map::{Fitted, Map, USUAL_WALL_DB, errors_m, fitted, walls_of};
