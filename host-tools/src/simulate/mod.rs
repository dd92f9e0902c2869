//! A simulation as files: what `baliza simulate` writes beside its table.
//!
//! [`Logbook`] takes a simulation's records and makes the CSV files of a recording and of its positions, so that
//! `solve` reads what was simulated; [`Capture`] takes every frame on the air and makes a capture for Wireshark;
//! [`picture`] draws the tracks on the floor plan. [`load_site_models`] gives tags the maps and room models that a scenario names,
//! [`survey_csv`] makes the survey that they come from.

mod capture;
pub mod example;
mod logbook;
mod picture;
mod site_models;

pub use capture::Capture;
pub use logbook::{Logbook, position_header, position_row};
pub use picture::picture;
pub use site_models::{load_site_models, survey_csv};
