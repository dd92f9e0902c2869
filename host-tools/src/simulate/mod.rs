//! A simulation as files: what `baliza simulate` writes beside its table.
//!
//! [`SimulatedRecording`] makes the recording of the tags, and the true positions, from a simulation's records, so
//! that `solve`, `decode`, `monitor` and `replay` read the simulated data. [`Capture`] makes a capture for Wireshark
//! from every frame on the air. [`picture`] draws the tracks on the floor plan. [`read_scenario`] reads a
//! site with the files that it names. [`survey_csv`] makes the survey for its maps and room models. [`Attempts`] says
//! why there is no position.

mod capture;
pub mod example;
mod no_position;
mod picture;
mod recorded;
mod site;

pub use self::site::{read_scenario, survey_csv};
pub use capture::Capture;
pub use no_position::Attempts;
pub use picture::picture;
pub use recorded::{SimulatedRecording, is_of_simulation, position_header, position_row};
