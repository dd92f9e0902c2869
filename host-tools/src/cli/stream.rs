//! The common parts of `monitor`, `record`, `decode` and `replay`: the source of a stream, the format of its messages,
//! and Ctrl-C.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, Result};
use clap::ValueEnum;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use host_tools::UserError;
use host_tools::files::output;
use host_tools::node::decode::{Chunks, Stamp, open_stream, row};
use host_tools::node::monitor::{Image, Pace, Port, Probed, Serial, Source};
use host_tools::node::probe::ProbeArguments;
use wire::telemetry::{Fix, Message, Table};

use crate::cli::progress::Progress;

/// The source of a node's bytes. The default is a probe.
#[derive(Clone, Debug, clap::Args)]
pub struct SourceArguments {
    #[command(flatten)]
    probe: ProbeArguments,
    /// Listen to a serial port: telemetry, or what an ESP image mixes on its USB port
    #[arg(long, value_name = "PORT", group = "source", conflicts_with_all = BY_PROBE)]
    serial: Option<String>,
    /// The serial port's bits a second
    #[arg(long, value_name = "N", default_value_t = 115_200, requires = "serial", value_parser = clap::value_parser!(u32).range(1..))]
    baud: u32,
    /// Read standard input
    #[arg(long, group = "source", conflicts_with_all = BY_PROBE)]
    pub stdin: bool,
    /// Read a stream from a file, or from a folder that record made
    #[arg(long, value_name = "FILE", group = "source", conflicts_with_all = BY_PROBE)]
    file: Option<PathBuf>,
    /// End after N seconds
    #[arg(long, value_name = "N", value_parser = seconds)]
    pub seconds: Option<Duration>,
}

const BY_PROBE: [&str; 3] = ["probe", "chip", "speed"];

impl SourceArguments {
    /// The stream's file, if a file is to be read.
    pub fn file(&self) -> Option<PathBuf> {
        self.file.as_deref().map(stream_of)
    }

    /// The file or standard input; `None` for a live node.
    ///
    /// # Errors
    /// The file cannot be opened.
    pub fn input(&self) -> Result<Option<Input>, UserError> {
        match self.file() {
            Some(file) => Input::open(Some(&file)).map(Some),
            None if self.stdin => Input::open(None).map(Some),
            None => Ok(None),
        }
    }

    /// The live node, by serial port or probe. With a probe, its image is compared with the content of the flash, and
    /// the node can be reset first.
    pub fn live(&self, image: Option<&Image>, reset: bool) -> Box<dyn Source> {
        match &self.serial {
            Some(name) => {
                Box::new(Serial::new(Port { name: name.clone(), baud: self.baud }, name.clone(), Pace::default()))
            }
            None => {
                let marks = image.map(|image| image.marks.clone());
                Box::new(Probed::new(self.probe.clone(), marks, reset, Pace::default()))
            }
        }
    }
}

/// Parses a duration in seconds.
fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| format!("\"{text}\" is not a number"))?;
    Duration::try_from_secs_f64(seconds).map_err(|error| error.to_string())
}

/// A stream in a file or on standard input.
pub struct Input {
    chunks: Chunks,
    /// The name of the input, for error messages.
    name: String,
    /// The file's length, bytes.
    length: usize,
}

impl Input {
    /// Opens a file; without a file, standard input.
    ///
    /// # Errors
    /// The file cannot be opened.
    pub fn open(file: Option<&Path>) -> Result<Self, UserError> {
        let Some(path) = file else {
            let chunks = Chunks::new(std::io::stdin());
            return Ok(Self { chunks, name: "standard input".to_owned(), length: 0 });
        };
        let (file, length) = open_stream(path)?;
        let length = usize::try_from(length).unwrap_or(usize::MAX);
        Ok(Self { chunks: Chunks::new(file), name: path.display().to_string(), length })
    }

    /// A progress bar for a complete file.
    pub fn progress(&self) -> Option<Progress> {
        (self.length > 0).then(|| Progress::new(self.length))
    }

    /// The next bytes; `None` at the end, or after Ctrl-C.
    ///
    /// # Errors
    /// The input cannot be read.
    pub fn next(&self) -> Result<Option<Vec<u8>>> {
        self.chunks.next(&STOP).with_context(|| format!("cannot read {}", self.name))
    }
}

/// Whether Ctrl-C was pressed.
pub static STOP: AtomicBool = AtomicBool::new(false);

/// From now on, Ctrl-C ends the reading but not the program, so that the received data is written. A second Ctrl-C ends
/// the program.
///
/// # Errors
/// The handler cannot be installed.
pub fn catch_ctrl_c() -> Result<()> {
    ctrlc::set_handler(|| {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    })
    .context("cannot watch for Ctrl-C")
}

/// The format of the messages.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Writing {
    /// How messages are written
    #[arg(long, value_name = "FORMAT", default_value = "jsonl")]
    format: Format,
    /// Which messages are the rows (--format csv) [default: positions]
    #[arg(long, value_name = "TABLE", value_parser = table_names())]
    table: Option<Table>,
}

/// `--format`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// One object of JSON a line, every message
    Jsonl,
    /// The rows of one table
    Csv,
}

/// The names of the tables, each with a description of its message.
pub fn table_names() -> impl TypedValueParser<Value = Table> {
    PossibleValuesParser::new(Message::tables().map(|table| PossibleValue::new(table.name).help(table.about)))
        .try_map(|name| Message::tables().find(|table| table.name == name).ok_or("no such table"))
}

/// Formats messages as text.
pub enum Lines {
    Json,
    Csv(Table),
}

impl Writing {
    /// The format that the flags select.
    ///
    /// # Errors
    /// The flags cannot be combined.
    pub fn lines(self) -> Result<Lines, UserError> {
        match (self.format, self.table) {
            (Format::Jsonl, Some(_)) => Err(UserError::flag("--table", "only with --format csv")),
            (Format::Jsonl, None) => Ok(Lines::Json),
            (Format::Csv, table) => Ok(Lines::csv(table)),
        }
    }
}

impl Lines {
    /// The rows of a table; those of positions where no table is given.
    pub fn csv(table: Option<Table>) -> Self {
        Self::Csv(table.unwrap_or(Fix::POSITIONS))
    }

    /// The text before all messages.
    ///
    /// # Errors
    /// The CSV writer returns an error.
    pub fn header(&self) -> Result<Vec<u8>> {
        match self {
            Self::Json => Ok(Vec::new()),
            Self::Csv(table) => csv_row(&table.header()),
        }
    }

    /// Appends a message. A message that does not belong to the table is left out.
    ///
    /// # Errors
    /// The message cannot be serialized.
    pub fn append(&self, text: &mut Vec<u8>, stamp: Stamp, message: &Message) -> Result<()> {
        match self {
            Self::Json => {
                serde_json::to_writer(&mut *text, &message.json()).context("cannot write JSON")?;
                text.push(b'\n');
            }
            Self::Csv(table) => {
                if let Some((_, fields)) = row(stamp, message).filter(|(of, _)| of == table) {
                    text.extend(csv_row(&fields)?);
                }
            }
        }
        Ok(())
    }
}

fn csv_row<T: AsRef<[u8]>>(fields: &[T]) -> Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(fields)?;
    writer.into_inner().map_err(|error| anyhow::Error::from(error.into_error()))
}

/// Writes to standard output; false where the reader has closed its end.
///
/// # Errors
/// Standard output cannot be written for another reason.
pub fn feed_stdout(bytes: &[u8]) -> Result<bool> {
    output::feed_stdout(bytes).context("cannot write to standard output")
}

/// The stream's file: for a folder that `record` made, the file in it.
pub fn stream_of(path: &Path) -> PathBuf {
    if path.is_dir() { path.join("telemetry.bin") } else { path.to_owned() }
}
