//! `baliza example`: writes the example recording of the project.

use std::path::PathBuf;

use anyhow::{Context, Result};
use host_tools::simulate::example;

/// Write the example recording: a walk through a simulated room
///
/// Eight anchors, a metal cupboard that blocks some of the ranges, thirty seconds at ten epochs a second. The files are
/// those of `examples/room`: `anchors.csv`, `ranges.csv`, `truth.csv`.
#[derive(clap::Args)]
pub struct Arguments {
    /// The folder for the three files; it is made where it does not exist
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
}

/// Runs `baliza example`.
///
/// # Errors
/// The folder cannot be made, or a file cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let folder = &arguments.out;
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    for (name, bytes) in example::files()? {
        super::write(&folder.join(name), &bytes)?;
    }
    super::note(&format!("anchors.csv, ranges.csv and truth.csv are in {}\n", folder.display()));
    Ok(())
}
