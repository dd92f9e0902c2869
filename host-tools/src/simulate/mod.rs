//! A simulation as files: what `baliza simulate` writes beside its table.
//!
//! [`SimulatedRecording`] takes a simulation's records and makes the recording of its tags and the truth beside it, so that
//! `solve`, `decode`, `monitor` and `replay` read what was simulated; [`Capture`] takes every frame on the air and makes a capture for Wireshark;
//! [`picture`] draws the tracks on the floor plan. [`load_site_models`] gives tags the maps and room models that a scenario names,
//! [`survey_csv`] makes the survey that they come from.

mod capture;
pub mod example;
mod picture;
mod recording;
mod site_models;

pub use capture::Capture;
pub use picture::picture;
pub use recording::{SimulatedRecording, position_header, position_row};
pub use site_models::{load_site_models, survey_csv};
