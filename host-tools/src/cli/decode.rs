//! `baliza decode`: decodes the telemetry in any stream of bytes.

use std::io::{IsTerminal, Write};
use std::path::PathBuf;

use anyhow::{Context, Result};
use node_link::decode::Stream;
use recording::output::{self, Growing};

use super::site_names::SiteNamesArgs;
use super::stream::{ByteInput, Writing, catch_signals, feed_stdout};

/// Decode telemetry: the messages of nodes, from any stream of bytes
///
/// Messages go to standard output or --out, a count of what was received and what was lost goes to standard error.
/// After any damaged bytes, the next complete frame is decoded. The stream may also contain other data (defmt frames, a
/// boot loader's text). docs/reference/wire-format.md has the format.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The stream, or a folder that record made
    #[arg(long, value_name = "FILE")]
    file: Option<PathBuf>,
    /// The same, without its flag
    #[arg(value_name = "FILE", conflicts_with = "file")]
    stream: Option<PathBuf>,
    /// Read standard input, which is what happens without a file too
    #[arg(long, conflicts_with_all = ["file", "stream"])]
    stdin: bool,
    #[command(flatten)]
    names: SiteNamesArgs,
    #[command(flatten)]
    writing: Writing,
    /// Write the messages here and not to standard output (-)
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print JSON and no messages: results has one object, with what came, by kind, and what was lost, by what was
    /// wrong with it
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  baliza decode telemetry.bin
  baliza decode telemetry.bin --format csv > positions.csv
  baliza decode telemetry.bin --json
  cat /dev/ttyACM0 | baliza decode";

/// The destination of the messages.
enum Sink {
    Nowhere,
    Stdout,
    File(Growing),
}

impl Sink {
    /// Writes bytes; false where the reader has closed its end.
    fn take(&mut self, bytes: &[u8]) -> Result<bool> {
        match self {
            Self::Nowhere => Ok(true),
            Self::Stdout => feed_stdout(bytes),
            Self::File(file) => file.write_all(bytes).map(|()| true).context("cannot write the messages"),
        }
    }
}

/// Runs `baliza decode`.
///
/// # Errors
/// Flags are wrong, the stream cannot be read, or an output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let lines = arguments.writing.lines()?;
    if let Some(file) = &arguments.out {
        output::check("--out", file)?;
    }
    let file = arguments.file.as_deref().or(arguments.stream.as_deref());
    let names = arguments.names.read(file)?;
    let input = ByteInput::open(file)?;
    // Before a file is begun: a signal leaves nothing of it.
    catch_signals()?;
    let out = arguments.out.as_ref().filter(|file| file.as_os_str() != output::STANDARD);
    let mut sink = match out {
        Some(file) => Sink::File(Growing::create(file).with_context(|| format!("cannot write {}", file.display()))?),
        None if arguments.json => Sink::Nowhere,
        None => Sink::Stdout,
    };
    // No progress bar between messages on a terminal.
    let shown = matches!(sink, Sink::Stdout) && std::io::stdout().is_terminal();
    let progress = if shown { None } else { input.progress() };

    let mut stream = Stream::default();
    let mut read_on = true;
    // The header waits for the first frame, because there may be none.
    let mut text = lines.header(false)?;
    while read_on && let Some(bytes) = input.next()? {
        for byte in &bytes {
            if let Some((stamp, message)) = stream.feed(*byte)
                && !matches!(sink, Sink::Nowhere)
            {
                lines.append(&mut text, stamp, &message, None)?;
            }
        }
        if stream.counts().frames > 0 {
            read_on = sink.take(&text)?;
            text.clear();
        }
        if let Some(progress) = &progress {
            progress.advance(bytes.len() as u64);
        }
    }
    drop(progress);
    let summary = stream.summary();
    summary.is_of_telemetry(input.name())?;
    if read_on {
        sink.take(&text)?;
    }

    if let (Sink::File(growing), Some(file)) = (sink, out) {
        growing.finish().with_context(|| format!("cannot write {}", file.display()))?;
    }
    if arguments.json {
        return super::print_json(&summary);
    }
    super::note(&summary.text(&names));
    Ok(())
}
