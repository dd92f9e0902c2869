//! `baliza convert`: recordings in the formats of other programs.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::ValueEnum;
use recording::output;

/// Convert a recording for another program: MCAP, which Foxglove draws
///
/// Of a folder: anchors.csv, ranges.csv and, where they are there, positions.csv and truth.csv; of a stream of
/// telemetry: anchors, ranges and positions. Times are those of the host where telemetry.times.csv has them, else of
/// the recording.
#[derive(clap::Args)]
pub struct Arguments {
    /// A recording's folder, or a stream of telemetry
    #[arg(value_name = "RECORDING")]
    recording: PathBuf,
    /// The format
    #[arg(long, value_name = "FORMAT", default_value = "mcap")]
    format: Format,
    /// The file
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// `--format`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Format {
    /// MCAP, not compressed
    Mcap,
}

/// Runs `baliza convert`.
///
/// # Errors
/// The recording is wrong, or the file cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { recording, format: Format::Mcap, out } = arguments;
    output::check("--out", out)?;
    to_mcap(recording, out)
}

#[cfg(feature = "foxglove")]
fn to_mcap(recording: &Path, out: &Path) -> Result<()> {
    use anyhow::Context;
    use foxglove_scenes::{Clock, Converted, McapFile, View, convert, convert_stream};
    use node_link::recorder::TIMES;
    use recording::folder::Folder;

    let cannot = || format!("cannot write {}", out.display());
    let mut view = View::new(McapFile::new(output::Growing::create(out).with_context(cannot)?)?);
    let converted = if recording.is_dir() {
        let folder = Folder::open(recording)?;
        match folder.find("ranges.csv") {
            Some(_) => convert(&folder, &mut view)?,
            None => convert_stream(recording, &Clock::read(folder.find(TIMES).as_deref())?, &mut view)?,
        }
    } else {
        convert_stream(recording, &Clock::default(), &mut view)?
    };
    view.into_sink().finish()?.finish().with_context(cannot)?;
    let Converted { ranges, positions, timeless } = converted;
    super::note(&format!("{ranges} ranges, {positions} positions, in {}\n", out.display()));
    if timeless > 0 {
        super::note(&format!("{timeless} rows without t_s left out\n"));
    }
    Ok(())
}

#[cfg(not(feature = "foxglove"))]
fn to_mcap(_: &Path, _: &Path) -> Result<()> {
    Err(super::without("--format", "foxglove").into())
}
