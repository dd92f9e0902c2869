//! What a result is reported with: [`Statistics`] of errors.
#![forbid(unsafe_code)]

mod statistics;

pub use statistics::{Statistics, percentile};
