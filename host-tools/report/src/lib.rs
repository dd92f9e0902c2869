//! Reports of results: [`Statistics`] of errors, a [`MarkdownTable`], and explanations of errors in TOML files
//! ([`explain`]).
#![forbid(unsafe_code)]

mod explain;
mod markdown;
mod statistics;

pub use explain::{Explained, explain, line_of, nearest};
pub use markdown::MarkdownTable;
pub use statistics::{Statistics, mean, median, percentile, rms};
