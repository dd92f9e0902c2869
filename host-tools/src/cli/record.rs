//! `baliza record`: records a node's telemetry in files.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use host_tools::node::decode::{Stream, Summary};
use host_tools::node::monitor::{Channel, Event};
use host_tools::node::recorder::{Recorded, Recorder};
use host_tools::read_anchors;
use wire::telemetry::Message;

use super::stream::{Input, STOP, SourceArguments, catch_ctrl_c};

/// Record a node's telemetry, for solve, plot and replay
///
/// By probe (the default), serial port, standard input or from a file. The folder gets anchors.csv, ranges.csv and
/// positions.csv, rssi.csv where beacons were received, and telemetry.bin, the received bytes. Ctrl-C ends a recording;
/// the files appear at its end. Times continue where the node restarts, and an epoch is a round.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The folder for the files; it is made where it does not exist
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    #[command(flatten)]
    source: SourceArguments,
    /// The positions of anchors that do not report theirs, by their short addresses: CSV with anchor,x_m,y_m,z_m
    #[arg(long, value_name = "FILE")]
    anchors: Option<PathBuf>,
    /// Print JSON: what came and what was lost, as decode prints it, and the rows that were recorded
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  baliza record --out walk --chip nRF52832_xxAA
  baliza record --out walk --serial /dev/ttyACM0 --seconds 60
  baliza record --out walk --file telemetry.bin --anchors surveyed.csv
  baliza solve --anchors walk/anchors.csv --ranges walk/ranges.csv";

/// The output of `--json`.
#[derive(serde::Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    summary: &'a Summary,
    recorded: &'a Recorded,
}

/// Runs `baliza record`.
///
/// # Errors
/// Flags or a file are wrong, the source fails, or the recording cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let anchors = match &arguments.anchors {
        Some(file) => read_anchors(file)?,
        None => Vec::new(),
    };
    let input = arguments.source.input()?;
    let recorder = Recorder::create(&arguments.out, &anchors)?;
    catch_ctrl_c()?;
    let mut recording = Recording { recorder, stream: Stream::default() };
    let until = Deadline { begun: Instant::now(), limit: arguments.source.seconds };
    let heard = match input {
        Some(input) => read(&input, &mut recording, &until),
        None => listen(&arguments.source, &mut recording, &until),
    };
    let summary = recording.stream.summary();
    // Data received before a failure is still written to the files.
    if summary.bytes == 0 && heard.is_err() {
        return heard;
    }
    let written = || format!("cannot write the recording into {}", arguments.out.display());
    let recorded = recording.recorder.finish().with_context(written)?;
    if arguments.json {
        super::print_json(&Document { summary: &summary, recorded: &recorded })?;
    } else {
        super::note(&told(arguments, &summary, &recorded));
    }
    heard
}

/// Reads a file or a pipe to its end.
fn read(input: &Input, recording: &mut Recording, until: &Deadline) -> Result<()> {
    let progress = input.progress();
    while !until.over()
        && let Some(bytes) = input.next()?
    {
        recording.take(&bytes)?;
        if let Some(progress) = &progress {
            progress.advance(bytes.len() as u64);
        }
    }
    Ok(())
}

/// Listens to a live node until the deadline.
fn listen(source: &SourceArguments, recording: &mut Recording, until: &Deadline) -> Result<()> {
    const PATIENCE: Duration = Duration::from_millis(50);
    let mut source = source.live(None, false);
    while !until.over() && !STOP.load(Ordering::Relaxed) {
        match source.next(PATIENCE)? {
            None => {}
            Some(Event::Bytes(Channel::Telemetry, bytes)) => recording.take(&bytes)?,
            // The log and the boot loader's text are for `monitor`. The content of the flash does not matter here.
            Some(Event::Bytes(Channel::Log, _) | Event::Text(_) | Event::Flashed { .. } | Event::Restarted) => {}
            Some(Event::Connected(to)) => super::note(&format!("listening to {to}\n")),
            Some(Event::Lost(why)) => {
                recording.stream.interrupted();
                super::note(&format!("connection lost: {why}\n"));
            }
            Some(Event::Silent) => super::note("the node runs, but has no RTT rings: is it one of our images?\n"),
            Some(Event::End) => break,
        }
    }
    Ok(())
}

/// The time at which a recording ends.
struct Deadline {
    begun: Instant,
    limit: Option<Duration>,
}

impl Deadline {
    fn over(&self) -> bool {
        self.limit.is_some_and(|limit| self.begun.elapsed() >= limit)
    }
}

struct Recording {
    recorder: Recorder,
    stream: Stream,
}

impl Recording {
    fn take(&mut self, bytes: &[u8]) -> Result<()> {
        self.recorder.bytes(bytes).context("cannot write telemetry.bin")?;
        for byte in bytes {
            if let Some((stamp, message)) = self.stream.feed(*byte) {
                self.recorder.message(stamp, &message).context("cannot write a row")?;
            }
        }
        Ok(())
    }
}

fn told(arguments: &Arguments, summary: &Summary, recorded: &Recorded) -> String {
    let mut text = summary.told();
    let Recorded { rows, anchors, left_out } = recorded;
    let count = |name: &str| rows.get(name).copied().unwrap_or(0);
    let (positions, ranges, sightings) = (count("positions"), count("ranges"), count("sightings"));
    let _ = writeln!(
        text,
        "recorded: {positions} rounds, {ranges} ranges to {anchors} anchors, {sightings} sightings, in {}",
        arguments.out.display()
    );
    for table in Message::tables().filter(|table| !["positions", "ranges", "rssi"].contains(&table.name)) {
        if count(table.rows) > 0 {
            let _ = writeln!(text, "recorded: {} {}", count(table.rows), table.counted);
        }
    }
    if !left_out.is_empty() {
        let count: u64 = left_out.values().sum();
        let who: Vec<_> = left_out.keys().map(u16::to_string).collect();
        let _ = writeln!(
            text,
            "left out: {count} ranges to {}, whose places nobody told; --anchors FILE gives them",
            who.join(", ")
        );
    }
    text
}
