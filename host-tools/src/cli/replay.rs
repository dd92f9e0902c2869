//! `baliza replay`: plays a recorded stream at its own pace.

use std::path::PathBuf;
use std::thread;

use anyhow::Result;
use node_link::decode::{Pacing, Stream};

use super::site_names::SiteNamesArgs;
use super::stream::{ByteInput, Writing, feed_stdout};

/// Play a recorded stream at its own pace
///
/// Each message is written at its recorded time. Messages go to standard output as decode writes them, or with --raw
/// as the bytes that the node sent. At the end, standard error has a count of what was received and what was lost.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The stream, or a folder that record made
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// How many times as fast as it was recorded
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = speed)]
    speed: f64,
    /// Write the bytes instead of the messages
    #[arg(long, conflicts_with_all = ["format", "table"])]
    raw: bool,
    #[command(flatten)]
    names: SiteNamesArgs,
    #[command(flatten)]
    writing: Writing,
}

const EXAMPLES: &str = "\
Examples:
  baliza replay recording --speed 10
  baliza replay telemetry.bin --raw | baliza monitor --stdin";

fn speed(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if (0.001..=1e6).contains(&number) => Ok(number),
        Ok(_) | Err(_) => Err(format!("{text:?} is not a number from 0.001 to 1000000")),
    }
}

/// Runs `baliza replay`.
///
/// # Errors
/// Flags are wrong, the stream cannot be read, or the output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let lines = arguments.writing.lines()?;
    let names = arguments.names.read(Some(&arguments.file))?;
    let input = ByteInput::open(Some(&arguments.file))?;
    let mut stream = Stream::default();
    let mut pacing = Pacing::new(arguments.speed);
    // The output that is due, followed by the bytes that are not a complete message yet.
    let mut due = if arguments.raw { Vec::new() } else { lines.header()? };
    let mut bytes = Vec::new();
    while let Some(chunk) = input.next()? {
        for byte in chunk {
            bytes.push(byte);
            let Some((stamp, message)) = stream.feed(byte) else { continue };
            if let Some(wait) = pacing.until(stamp.t_s) {
                if !feed_stdout(&due)? {
                    return Ok(());
                }
                due.clear();
                thread::sleep(wait);
            }
            if arguments.raw {
                due.append(&mut bytes);
            } else {
                lines.append(&mut due, stamp, &message)?;
                bytes.clear();
            }
        }
    }
    if arguments.raw {
        due.append(&mut bytes);
    }
    let summary = stream.summary();
    summary.is_of_telemetry(input.name())?;
    if feed_stdout(&due)? {
        super::note(&summary.text(&names));
    }
    Ok(())
}
