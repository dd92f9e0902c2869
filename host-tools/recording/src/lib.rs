//! Recordings in files: rows of CSV, recordings, positions, captures of beacons, output files, and the error messages about wrong
//! files. [`import`] reads recordings of other systems.
#![forbid(unsafe_code)]

pub mod beacons;
mod diagnostics;
mod differences;
mod epochs;
pub mod folder;
pub mod grouping;
pub mod import;
pub mod inputs;
mod interrupted;
mod limited;
mod live_epochs;
mod names;
pub mod output;
mod position;
pub mod positions;
mod recording;
mod rounds;
mod spelling;
mod table;
mod truth;
mod user_error;

pub use diagnostics::{DiagnosticColumns, Diagnostics};
pub use epochs::{Epoch, Epochs, Measured, MeasuredDifference};
pub use folder::MeasurementMode;
pub use interrupted::Interrupted;
pub use limited::{DOCUMENT_BYTES, IMAGE_BYTES, LOG_BYTES, limited_bytes, read_limited, read_text};
pub use live_epochs::LiveEpochs;
pub use position::{Half, Height, NoPosition, Position, Solved, Space};
pub use recording::{Anchor, Coordinates, Files, Recording, anchor_rows, by_time, read_anchors};
pub use rounds::{OpenRound, SingleRanges, drop_repeats, round_s, rounds};
pub use spelling::spelled;
pub use table::{Column, Row, Table};
pub use truth::{Joined, Truth, Truths};
pub use user_error::UserError;
