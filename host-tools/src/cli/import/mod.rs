//! `baliza import …`: recordings of other systems.

mod crazyflie;
mod pans;

use std::path::Path;

use anyhow::{Context, Result};
use host_tools::UserError;
use host_tools::import::Imported;

super::commands! {
    /// Make a recording of what another system has measured
    ///
    /// The folder gets anchors.csv, ranges.csv and, where the other system has found positions, positions.csv. Lines that
    /// are no measurements are left out and counted.
    enum Arguments {
        Pans(pans),
        Crazyflie(crazyflie),
    }
}

/// Refuses a folder that has a recording already.
fn check(folder: &Path) -> Result<(), UserError> {
    let mut names = ["anchors.csv", "ranges.csv", "positions.csv"].into_iter();
    match names.find(|name| folder.join(name).exists()) {
        Some(name) => Err(UserError::flag("--out", format!("{} has {name} already", folder.display()))),
        None => Ok(()),
    }
}

/// Writes the recording, and says what it has.
fn write(imported: &Imported, method: &str, file: &Path, folder: &Path) -> Result<()> {
    let files = imported.files(method)?;
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    for (name, bytes) in files {
        super::write(&folder.join(name), &bytes)?;
    }
    let (rounds, ranges, anchors) = (imported.rounds.len(), imported.ranges(), imported.anchors.len());
    super::note(&format!("{rounds} rounds, {ranges} ranges to {anchors} anchors, in {}\n", folder.display()));
    if let Some((line, what)) = &imported.left_out.first {
        let lines = imported.left_out.lines;
        super::note(&format!("{lines} lines left out, the first: {}:{line}: {what}\n", file.display()));
    }
    Ok(())
}
