//! `baliza import pans`: the shell of a DWM1001 with Decawave's software.

use std::path::PathBuf;

use anyhow::Result;
use recording::import::pans;

use crate::cli::numbers::finite;

/// Import what a DWM1001 tag with PANS has printed: the output of its shell's `lec` or `les`
///
/// Where most lines have seconds before them, these are the times, and lines without seconds are left out. Otherwise
/// rounds come at --rate-hz.
#[derive(clap::Args)]
pub struct Arguments {
    /// The text
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The folder for the recording; it is made where it does not exist
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Replace the recording that is there
    #[arg(long)]
    force: bool,
    /// How often the tag measured, where the lines have no times
    #[arg(long, value_name = "HZ", default_value = "10", value_parser = positive)]
    rate_hz: f64,
}

fn positive(text: &str) -> Result<f64, String> {
    finite(text).and_then(|number| if number > 0.0 { Ok(number) } else { Err("it must be above 0".to_owned()) })
}

/// Runs `baliza import pans`.
///
/// # Errors
/// The file has no range, or the folder cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { file, out, force, rate_hz } = arguments;
    super::write(&pans::read(file, *rate_hz)?, "pans", file, out, *force)
}
