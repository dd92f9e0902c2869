//! A survey of fingerprints: makes rows of `fingerprints.csv` from the adverts at a point, or gives the reasons to
//! refuse them.
//!
//! [`read_points`] reads the points to visit. A [`Dwell`] collects what a node receives at a point, in the node's own
//! time, until it is long enough. [`biases`] refuses a biased dwell. [`FingerprintFile`] is the file, which only ever
//! grows.

mod checks;
mod dwell;
mod fingerprint_file;
mod points;

pub use checks::{Bias, biases};
pub use dwell::{Advert, Dwell};
pub use fingerprint_file::FingerprintFile;
pub use points::{SurveyPoint, parse_point, read_points};
