//! `baliza import …`: recordings of other systems.

mod crazyflie;
mod pans;

use std::path::Path;

use anyhow::{Context, Result};
use node_link::recorder::is_of_recording;
use recording::import::Imported;
use recording::output::OutputFolder;

super::commands! {
    /// Make a recording of what another system has measured
    ///
    /// The folder gets anchors.csv, ranges.csv and, where the other system has found positions, positions.csv. Lines
    /// that are no measurements are left out and counted.
    pub enum Arguments {
        Pans(pans),
        Crazyflie(crazyflie),
    }
}

/// Writes the recording, with `force` in place of an earlier one, and says what it has.
fn write(imported: &Imported, method: &str, file: &Path, folder: &Path, force: bool) -> Result<()> {
    let output = OutputFolder::begin("--out", folder, is_of_recording, force)?;
    for (name, bytes) in imported.files(method)? {
        output.write(name, &bytes).with_context(|| format!("cannot write {}", folder.join(name).display()))?;
    }
    output.finish().with_context(|| format!("cannot write {}", folder.display()))?;
    let (rounds, ranges, anchors) = (imported.rounds.len(), imported.ranges(), imported.anchors.len());
    super::note(&format!("{rounds} rounds, {ranges} ranges to {anchors} anchors, in {}\n", folder.display()));
    if let Some((line, what)) = &imported.left_out.first {
        let lines = imported.left_out.lines;
        super::note(&format!("{lines} lines left out, the first: {}:{line}: {what}\n", file.display()));
    }
    Ok(())
}
