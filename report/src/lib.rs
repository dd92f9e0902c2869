//! What a result is reported with: [`Statistics`] of errors, a [`MarkdownTable`], and what is wrong with a TOML file ([`explain`]).
#![forbid(unsafe_code)]

mod explain;
mod markdown;
mod statistics;

pub use explain::{Explained, explain, line_of, nearest};
pub use markdown::MarkdownTable;
pub use statistics::{Statistics, mean, percentile, rms};
