//! A survey of fingerprints: from the adverts at a point to rows of `fingerprints.csv`, or the reasons why they are none.
//!
//! [`read_points`] says where to go; a [`Dwell`] takes what a node hears there, in the node's own time, until it is long enough;
//! [`judge`] refuses what is biased; [`FingerprintFile`] is the file, which only ever grows.

mod checks;
mod dwell;
mod fingerprint_file;
mod points;
mod wizard;

pub use checks::{Bias, biases};
pub use dwell::{Advert, Dwell};
pub use fingerprint_file::FingerprintFile;
pub use points::{SurveyPoint, parse_point, read_points};
pub use wizard::{Person, Take, Typed, Visit, Wizard, each_advert};
