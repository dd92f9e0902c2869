//! What a result is reported with: [`Statistics`] of errors, and a Markdown [`Table`].
#![forbid(unsafe_code)]

mod markdown;
mod statistics;

pub use markdown::Table;
pub use statistics::{Statistics, mean, percentile, rms};
