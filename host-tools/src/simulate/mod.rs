//! A simulation as files: what `baliza simulate` writes beside its table.
//!
//! [`SimulatedRecording`] makes the recording of the tags, and the true positions, from a simulation's records, so
//! that `solve`, `decode`, `monitor` and `replay` read the simulated data. [`Capture`] makes a capture for Wireshark
//! from every frame on the air. [`picture`] draws the tracks on the floor plan. [`load_site_models`] gives the tags
//! the maps and room models that a scenario names. [`survey_csv`] makes the survey for these maps and models.
//! [`Attempts`] says why there is no position.

mod capture;
pub mod example;
mod load;
mod no_position;
mod picture;
mod recorded;
mod site_models;

pub use capture::Capture;
pub use load::{load, read};
pub use no_position::Attempts;
pub use picture::picture;
pub use recorded::{SimulatedRecording, is_of_simulation, position_header, position_row};
pub use site_models::{load_site_models, survey_csv};
