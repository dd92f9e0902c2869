//! The common parts of `monitor`, `record`, `decode` and `replay`: the source of a stream, the format of its messages,
//! and the signals that end the program.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use clap::ValueEnum;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use node_link::decode::{Chunks, Stamp, StreamFiles, Waited, node_streams, object, row};
use node_link::monitor::{Image, Pace, Port, Probed, Serial, Source, no_port, ports};
use node_link::probe::ProbeArguments;
use node_link::recorder::STREAM;
use recording::Interrupted;
use recording::UserError;
use recording::output;
use wire::telemetry::{Fix, Message, Table};

use crate::cli::note;
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
    #[arg(long, value_name = "N", default_value_t = Port::BAUD, requires = "serial", value_parser = clap::value_parser!(u32).range(1..))]
    baud: u32,
    /// Read standard input
    #[arg(long, group = "source", conflicts_with_all = BY_PROBE)]
    pub stdin: bool,
    /// Read a stream from a file, or from a folder that record or simulate made
    #[arg(long, value_name = "FILE", group = "source", conflicts_with_all = BY_PROBE)]
    file: Option<PathBuf>,
    /// End after N seconds
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = seconds)]
    pub seconds: Option<Duration>,
}

const BY_PROBE: [&str; 3] = ["probe", "chip", "speed"];

impl SourceArguments {
    /// The stream's file, if a file is to be read.
    pub fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }

    /// The file or standard input; `None` for a live node.
    ///
    /// # Errors
    /// The file cannot be opened.
    pub fn input(&self) -> Result<Option<ByteInput>, UserError> {
        match self.file() {
            Some(file) => ByteInput::open(Some(file)).map(Some),
            None if self.stdin => ByteInput::open(None).map(Some),
            None => Ok(None),
        }
    }

    /// Looks whether the live node is there, before the user does anything for it.
    ///
    /// # Errors
    /// There is no such port, or no probe.
    pub fn look(&self) -> Result<()> {
        match &self.serial {
            Some(name) if Path::new(name).exists() || cfg!(windows) => Ok(()),
            Some(name) => Err(no_port(name).into()),
            None if self.probe.is_connected()? => Ok(()),
            // Attaching says why it is impossible.
            None => self.probe.attach(None).map(drop),
        }
    }

    /// An error of the source. Where there is no probe, it names the serial ports, at one of which the node may be.
    pub fn or_by_serial(&self, error: anyhow::Error) -> anyhow::Error {
        let is_of_arguments = error.is::<UserError>();
        let is_by_probe = !is_of_arguments && self.serial.is_none() && self.file.is_none() && !self.stdin;
        let no_probe = || self.probe.is_connected().is_ok_and(|is_connected| !is_connected);
        with_ports(error, &if is_by_probe && no_probe() { ports() } else { Vec::new() })
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

/// The error of a probe, with the serial ports that may be used in its place.
fn with_ports(error: anyhow::Error, ports: &[String]) -> anyhow::Error {
    if ports.is_empty() {
        return error;
    }
    anyhow::anyhow!("{error:#}; a board on a serial port is read with --serial {}", ports.join(" or "))
}

/// Parses a duration in seconds.
fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| format!("\"{text}\" is not a number"))?;
    if seconds <= 0.0 {
        return Err("it must be above 0".to_owned());
    }
    Duration::try_from_secs_f64(seconds).map_err(|error| error.to_string())
}

/// A stream in a file or on standard input.
pub struct ByteInput {
    chunks: Chunks,
    /// The name of the input, for error messages.
    name: PathBuf,
    /// The file's length, bytes.
    length: usize,
    /// It is a pipe or a device: its bytes may come from a node now.
    is_live: bool,
}

impl ByteInput {
    /// Opens a file, or the folder of a recording; without a file, or with `-`, standard input.
    ///
    /// # Errors
    /// The file cannot be opened.
    pub fn open(file: Option<&Path>) -> Result<Self, UserError> {
        let Some(path) = file.filter(|file| file.as_os_str() != output::STANDARD) else {
            let (name, is_live) = ("standard input".into(), is_live_stdin());
            return Ok(Self { chunks: Chunks::new(std::io::stdin()), name, length: 0, is_live });
        };
        if let [first, next, ..] = &node_streams(path)?[..] {
            note(&format!(
                "{} has several nodes; this is {}: give the file of another, as {}, or let replay or monitor show all\n",
                path.display(),
                first.node.as_deref().unwrap_or(STREAM),
                next.path.display()
            ));
        }
        let file = StreamFiles::open(path)?;
        let (length, is_live) = (usize::try_from(file.length()).unwrap_or(usize::MAX), file.is_live());
        Ok(Self { chunks: Chunks::new(file), name: path.to_owned(), length, is_live })
    }

    /// Its name, where it is not live.
    pub fn finished_file(&self) -> Option<&Path> {
        (!self.is_live).then_some(&self.name)
    }

    /// Its name, for error messages.
    pub fn name(&self) -> &Path {
        &self.name
    }

    /// A progress bar for a complete file.
    pub fn progress(&self) -> Option<Progress> {
        (self.length > 0).then(|| Progress::new(self.length))
    }

    /// The next bytes; `None` at the end. A signal ends the stream of a live node.
    ///
    /// # Errors
    /// The input cannot be read, or a signal ends the reading of a file ([`Interrupted`]).
    pub fn next(&self) -> Result<Option<Vec<u8>>> {
        const PATIENCE: Duration = Duration::from_millis(50);
        loop {
            match self.wait(PATIENCE)? {
                Waited::Bytes(bytes) => return Ok(Some(bytes)),
                Waited::Nothing => {}
                Waited::End => return Ok(None),
            }
        }
    }

    /// As [`ByteInput::next`], but waits no longer than `patience`.
    ///
    /// # Errors
    /// As those of [`ByteInput::next`].
    pub fn wait(&self, patience: Duration) -> Result<Waited> {
        if STOP.load(Ordering::Relaxed) {
            return if self.is_live { Ok(Waited::End) } else { Err(Interrupted.into()) };
        }
        self.chunks.wait(patience).with_context(|| format!("cannot read {}", self.name.display()))
    }
}

/// Whether standard input is a pipe, a terminal or a device, and not a file.
pub(super) fn is_live_stdin() -> bool {
    #[cfg(unix)]
    {
        use std::os::fd::AsFd;
        let stdin = std::io::stdin().as_fd().try_clone_to_owned().map(std::fs::File::from);
        !stdin.and_then(|file| file.metadata()).is_ok_and(|metadata| metadata.is_file())
    }
    #[cfg(not(unix))]
    true
}

/// Whether a signal came that ends the program.
pub static STOP: AtomicBool = AtomicBool::new(false);

/// A terminal that is closed sends the same signal twice within this time.
const TWICE: Duration = Duration::from_secs(1);

/// From now on, the signals that end a program (Ctrl-C, a closed terminal, `kill`) end the work but not the program, so
/// that outputs are completed, or stay as they were. A second signal, a second later, ends the program.
///
/// # Errors
/// The handler cannot be installed.
pub fn catch_signals() -> Result<()> {
    catch_signals_and(|| {})
}

/// The same; a second signal does this before it ends the program.
///
/// # Errors
/// The handler cannot be installed.
pub fn catch_signals_and(before_end: impl Fn() + Send + 'static) -> Result<()> {
    static FIRST: OnceLock<Instant> = OnceLock::new();
    ctrlc::set_handler(move || {
        STOP.store(true, Ordering::Relaxed);
        if FIRST.get_or_init(Instant::now).elapsed() >= TWICE {
            before_end();
            std::process::exit(130);
        }
    })
    .context("cannot watch for Ctrl-C")
}

/// Ends the work where a signal came.
///
/// # Errors
/// A signal came.
pub fn refuse_interrupted() -> Result<(), Interrupted> {
    if STOP.load(Ordering::Relaxed) { Err(Interrupted) } else { Ok(()) }
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
    /// An object of JSON each.
    Json,
    /// The rows of a table.
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

    /// The text before all messages. Those of several nodes say of which each is.
    ///
    /// # Errors
    /// The CSV writer returns an error.
    pub fn header(&self, are_several: bool) -> Result<Vec<u8>> {
        match self {
            Self::Json => Ok(Vec::new()),
            Self::Csv(table) => {
                let mut columns = table.header();
                columns.extend(are_several.then_some("tag"));
                csv_row(&columns)
            }
        }
    }

    /// Appends a message. A message that does not belong to the table is left out. `node`: the address of the node,
    /// where there are several.
    ///
    /// # Errors
    /// The message cannot be serialized.
    pub fn append(&self, text: &mut Vec<u8>, stamp: Stamp, message: &Message, node: Option<&str>) -> Result<()> {
        match self {
            Self::Json => {
                serde_json::to_writer(&mut *text, &object(message, node)).context("cannot write JSON")?;
                text.push(b'\n');
            }
            Self::Csv(table) => {
                if let Some((_, mut fields)) = row(stamp, message).filter(|(of, _)| of == table) {
                    fields.extend(node.map(str::to_owned));
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

#[cfg(test)]
mod tests {
    use super::with_ports;

    #[test]
    fn without_a_probe_the_serial_ports_are_named() {
        let error = || anyhow::anyhow!("no debug probe found");
        assert_eq!(with_ports(error(), &[]).to_string(), "no debug probe found");
        let ports = ["/dev/ttyACM0".to_owned(), "/dev/ttyUSB1".to_owned()];
        let said = "no debug probe found; a board on a serial port is read with --serial /dev/ttyACM0 or /dev/ttyUSB1";
        assert_eq!(with_ports(error(), &ports).to_string(), said);
    }
}
