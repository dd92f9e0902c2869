//! Papers done again on drawn data: benchmarks that no node runs.

pub mod barral;
pub mod fusion;
pub mod garcia;
pub mod linde;
pub mod thesis;
