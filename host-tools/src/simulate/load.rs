//! The scenario of a file.

use std::path::Path;

use recording::{UserError, read_text};
use sim::scenario::Scenario;
use wire::telemetry::Address;

use super::load_site_models;

/// The scenario of a file, without the models that it names.
///
/// # Errors
/// The file is wrong.
pub fn read(file: &Path) -> Result<Scenario, UserError> {
    Scenario::parse(&read_text(file)?).map_err(|error| UserError::line(file, error.line as u64, error.message))
}

/// The scenario of a file as it is, with the models of its site.
///
/// # Errors
/// A file is wrong, or a node cannot run what the scenario says.
pub fn load(file: &Path) -> Result<Scenario, UserError> {
    let mut scenario = read(file)?;
    load_site_models(&mut scenario, file)?;
    let invalid = scenario.validate().err();
    let wrong = invalid.map(|(node, invalid)| UserError::file(file, format!("node {}: {invalid}", Address(node))));
    wrong.map_or(Ok(scenario), Err)
}
