//! `baliza replay`: plays a recorded stream at its own pace.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::thread;

use anyhow::Result;
use node_link::decode::{NodeStream, Pacing, Stamp, Stream, node_streams};
use recording::UserError;
use wire::telemetry::Message;

use super::site_names::SiteNamesArgs;
use super::stream::{ByteInput, Writing, feed_stdout};

/// Play a recorded stream at its own pace
///
/// Each message is written at its recorded time; those of all nodes of a simulation's folder, with the address of the
/// node (in JSON: node, in CSV: tag). Messages go to standard output as decode writes them, or with --raw
/// as the bytes that the node sent. At the end, standard error has a count of what was received and what was lost.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The stream, or a folder that record or simulate made
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

/// The stream of one node, as far as it is read.
struct Playing {
    node: Option<String>,
    input: ByteInput,
    stream: Stream,
    /// Messages that are not due yet, each with the bytes since the message before it.
    ready: VecDeque<(Stamp, Message, Vec<u8>)>,
    /// The bytes since the last message.
    rest: Vec<u8>,
    has_ended: bool,
}

impl Playing {
    fn open(of: NodeStream) -> Result<Self, UserError> {
        let NodeStream { path, node } = of;
        let input = ByteInput::open(Some(&path))?;
        let (stream, ready, rest) = (Stream::default(), VecDeque::new(), Vec::new());
        Ok(Self { node, input, stream, ready, rest, has_ended: false })
    }

    /// The time of the next message, seconds; `None` at the end. It waits for the bytes of a pipe.
    fn next_s(&mut self) -> Result<Option<f64>> {
        while self.ready.is_empty() && !self.has_ended {
            let Some(chunk) = self.input.next()? else {
                self.has_ended = true;
                break;
            };
            for byte in chunk {
                self.rest.push(byte);
                if let Some((stamp, message)) = self.stream.feed(byte) {
                    self.ready.push_back((stamp, message, std::mem::take(&mut self.rest)));
                }
            }
        }
        Ok(self.ready.front().map(|(stamp, ..)| stamp.t_s))
    }
}

/// The number of the stream whose next message is the earliest, and its time, seconds.
fn earliest(playing: &mut [Playing]) -> Result<Option<(usize, f64)>> {
    let mut first: Option<(usize, f64)> = None;
    for (at, of) in playing.iter_mut().enumerate() {
        if let Some(t_s) = of.next_s()?.filter(|t_s| first.is_none_or(|(_, first_s)| *t_s < first_s)) {
            first = Some((at, t_s));
        }
    }
    Ok(first)
}

/// Runs `baliza replay`.
///
/// # Errors
/// Flags are wrong, a stream cannot be read, or the output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let lines = arguments.writing.lines()?;
    let names = arguments.names.read(Some(&arguments.file))?;
    let mut streams = node_streams(&arguments.file)?;
    if let (true, [first, next, ..]) = (arguments.raw, &streams[..]) {
        let (first, next) = (first.path.display(), next.path.display());
        super::note(&format!("a stream of bytes is of one node: {first}; {next} and others are files of their own\n"));
        streams.truncate(1);
    }
    let mut playing = streams.into_iter().map(Playing::open).collect::<Result<Vec<_>, _>>()?;
    let mut pacing = Pacing::new(arguments.speed);
    let mut due = if arguments.raw { Vec::new() } else { lines.header(playing.len() > 1)? };
    while let Some((at, t_s)) = earliest(&mut playing)? {
        if let Some(wait) = pacing.until(t_s) {
            if !feed_stdout(&due)? {
                return Ok(());
            }
            due.clear();
            thread::sleep(wait);
        }
        let Some(of) = playing.get_mut(at) else { break };
        let Some((stamp, message, bytes)) = of.ready.pop_front() else { break };
        if arguments.raw {
            due.extend(bytes);
        } else {
            lines.append(&mut due, stamp, &message, of.node.as_deref())?;
        }
    }
    let mut said = String::new();
    for of in &mut playing {
        if arguments.raw {
            due.append(&mut of.rest);
        }
        let summary = of.stream.summary();
        summary.is_of_telemetry(of.input.name())?;
        said += &summary.text(&names);
    }
    if feed_stdout(&due)? {
        super::note(&said);
    }
    Ok(())
}
