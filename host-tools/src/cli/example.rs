//! `baliza example`: writes the example recording of the project.

use std::path::PathBuf;

use crate::simulate::{example, is_of_simulation};
use anyhow::Result;
use recording::output::OutputFolder;

/// Write the example recording: a walk through a simulated room
///
/// Eight anchors, a metal cupboard that blocks some of the ranges, thirty seconds at ten epochs a second. The files are
/// those of `examples/room`: `anchors.csv`, `ranges.csv`, `truth.csv`.
#[derive(clap::Args)]
pub struct Arguments {
    /// The folder for the three files; it is made where it does not exist
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Replace the recording that is there
    #[arg(long)]
    force: bool,
}

/// Runs `baliza example`.
///
/// # Errors
/// The folder cannot be made, or a file cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let folder = &arguments.out;
    let output = OutputFolder::begin("--out", folder, is_of_simulation, arguments.force)?;
    for (name, bytes) in example::files()? {
        output.write(name, &bytes)?;
    }
    output.finish()?;
    super::note(&format!("anchors.csv, ranges.csv and truth.csv are in {}\n", folder.display()));
    Ok(())
}
