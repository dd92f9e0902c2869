//! Reproductions of published benchmarks on simulated data, and the code that only they need and no node runs.
//!
//! | module | what is in it |
//! |---|---|
//! | [`fusion`] | the filter of patent ES 2 397 388, of ranges and powers; [`fusion::bench`] compares it with the
//! engine |
//! | [`garcia`] | E. García et al.: differences of arrival with detection of blocked paths by their skewness |
//! | [`barral`] | V. Barral et al.: classifiers and mitigators of blocked ranges |
//! | [`linde`] | A. Linde Cerezo's thesis: four Bluetooth beacons in a room |
//! | [`thesis`] | P. M. de Rojas Malpartida's thesis: every method on simulated ranges |
//!
//! Each benchmark draws its data from a seed and returns scores and a Markdown table; `baliza bench` prints them.
#![forbid(unsafe_code)]

pub mod barral;
pub mod fusion;
pub mod garcia;
pub mod linde;
pub mod thesis;
