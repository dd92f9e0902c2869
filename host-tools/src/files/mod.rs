//! Files: rows of CSV, recordings, positions, captures of beacons, output files, and the error messages about wrong
//! files.

pub mod beacons;
mod diagnostics;
pub mod output;
pub mod positions;
mod recording;
mod table;
mod user_error;

pub use diagnostics::{DiagnosticColumns, Diagnostics};
pub use recording::{Anchor, Coordinates, Epoch, Files, Measured, Recording, by_time, read_anchors, read_truth};
pub use table::{Column, Row, Table};
pub use user_error::UserError;
