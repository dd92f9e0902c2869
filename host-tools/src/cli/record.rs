//! `baliza record`: records a node's telemetry in files.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use node_link::decode::{DecodeSummary, Waited};
use node_link::monitor::{Event, NodeChannel};
use node_link::provision::SiteNames;
use node_link::recorder::{Recorded, Recorder, Rotation, Settings, folders, make_tables};
use recording::read_anchors;
use wire::telemetry::Message;

use super::site_names::SiteNamesArgs;
use super::stream::{ByteInput, STOP, SourceArguments, catch_signals};

/// Record a node's telemetry, for solve, plot and replay
///
/// By probe (the default), serial port, standard input or from a file. The folder gets telemetry.bin, the received
/// bytes, from the first one on; telemetry.times.csv, when each frame of a live node was received (UTC); and the tables
/// anchors.csv, ranges.csv and positions.csv, rssi.csv where beacons were received, and tag-positions.csv where an
/// anchor received tags' positions, a second behind. Ctrl-C, `kill` or a closed terminal end a recording well. After a
/// loss of power, --finish makes the tables of what telemetry.bin has. Times continue where the node restarts, and an
/// epoch is a round.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES, group = clap::ArgGroup::new("folder").required(true).args(["out", "finish"]))]
pub struct Arguments {
    /// The folder for the files; it is made where it does not exist
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Make the tables of a recording again from its telemetry.bin: where it was cut short, or with other --anchors
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["source", "rotate", "force", "seconds", "probe", "chip", "speed"])]
    finish: Option<PathBuf>,
    #[command(flatten)]
    source: SourceArguments,
    /// The positions of anchors that do not report theirs, by their short addresses: CSV with anchor,x_m,y_m,z_m
    #[arg(long, value_name = "FILE")]
    anchors: Option<PathBuf>,
    #[command(flatten)]
    names: SiteNamesArgs,
    /// Begin another part after this time or size (30s, 15min, 1h, 1d; 100kB, 100MB, 1GB). Each part is a recording in
    /// a folder of its own: 000001, 000002 … in --out, after the parts that are there. decode, replay and monitor read
    /// --out as one stream; solve and plot read one part
    #[arg(long, value_name = "TIME|SIZE", value_parser = rotation)]
    rotate: Option<Rotation>,
    /// Replace the recording that is in the folder, at the first byte
    #[arg(long, conflicts_with = "rotate")]
    force: bool,
    /// Print JSON: results has one object, with what was received and what was lost, as decode prints it, and
    /// recorded: the rows that were recorded
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  baliza record --out walk --chip nRF52832_xxAA
  baliza record --out walk --serial /dev/ttyACM0 --seconds 60
  baliza record --out walk --file telemetry.bin --anchors surveyed.csv
  baliza record --out walk --serial /dev/ttyACM0 --site site.toml
  baliza record --out site --serial /dev/ttyACM0 --rotate 1h
  baliza record --finish walk
  baliza solve --anchors walk/anchors.csv --ranges walk/ranges.csv";

/// Parses a time or a size. Sizes are decimal, as those of disks.
fn rotation(text: &str) -> Result<Rotation, String> {
    let unit_at = text.find(|letter: char| letter.is_ascii_alphabetic()).unwrap_or(text.len());
    let (number, unit) = text.split_at(unit_at);
    let wrong = || format!("{text:?} is not a time or a size as 15min, 1h, 100MB");
    let number: u32 = number.trim().parse().map_err(|_| wrong())?;
    let seconds = |of_unit| Ok(Rotation::Time(Duration::from_secs(u64::from(number) * of_unit)));
    let bytes = |of_unit| Ok(Rotation::Bytes(u64::from(number) * of_unit));
    match unit {
        _ if number == 0 => Err(wrong()),
        "s" => seconds(1),
        "min" => seconds(60),
        "h" => seconds(3600),
        "d" => seconds(86_400),
        "kB" => bytes(1_000),
        "MB" => bytes(1_000_000),
        "GB" => bytes(1_000_000_000),
        _ => Err(wrong()),
    }
}

/// The output of `--json`.
#[derive(serde::Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    summary: &'a DecodeSummary,
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
    let names = arguments.names.read(arguments.finish.as_deref().or(arguments.source.file()))?;
    let settings = Settings { rotation: arguments.rotate, force: arguments.force, ..Settings::of(names, &anchors)? };
    match (&arguments.out, &arguments.finish) {
        (Some(folder), _) => record(arguments, folder, settings),
        (None, Some(folder)) => {
            catch_signals()?;
            let (summary, recorded) = make_tables(folder, &settings.anchors, &STOP)?;
            for part in folders(folder) {
                settings.site.write_into(&part).with_context(|| format!("cannot write into {}", part.display()))?;
            }
            report(arguments, folder, &settings.site, &summary, &recorded)
        }
        // One of them is required.
        (None, None) => Ok(()),
    }
}

/// `--out`: records what comes.
fn record(arguments: &Arguments, folder: &Path, settings: Settings) -> Result<()> {
    let input = arguments.source.input()?;
    let file = input.as_ref().and_then(ByteInput::finished_file).map(Path::to_owned);
    catch_signals()?;
    let names = settings.site.clone();
    let mut recorder = Recorder::create("--out", folder, Settings { file: file.clone(), ..settings })?;
    let until = Deadline { begun: Instant::now(), limit: arguments.source.seconds };
    let received = match input {
        Some(input) => read(&input, &mut recorder, &until),
        None => listen(&arguments.source, &mut recorder, &until),
    };
    let summary = recorder.summary();
    if summary.bytes == 0 && received.is_err() {
        return received;
    }
    if let (Some(file), true) = (file, received.is_ok()) {
        summary.is_of_telemetry(&file)?;
    }
    // What was received before a failure is still made into tables.
    match (received, recorder.finish()) {
        (received, Ok(recorded)) => {
            report(arguments, folder, &names, &summary, &recorded)?;
            received
        }
        (Err(first), Err(_)) => Err(first),
        (Ok(()), Err(error)) => Err(error),
    }
}

/// The interval between two looks at the time and at the signals.
const PATIENCE: Duration = Duration::from_millis(50);

/// Reads a file or a pipe to its end.
fn read(input: &ByteInput, recorder: &mut Recorder, until: &Deadline) -> Result<()> {
    let progress = input.progress();
    while !until.over() {
        match input.wait(PATIENCE)? {
            Waited::Bytes(bytes) => {
                recorder.take(&bytes)?;
                if let Some(progress) = &progress {
                    progress.advance(bytes.len() as u64);
                }
            }
            Waited::Nothing => recorder.tick()?,
            Waited::End => break,
        }
    }
    Ok(())
}

/// Listens to a live node until the deadline.
fn listen(source: &SourceArguments, recorder: &mut Recorder, until: &Deadline) -> Result<()> {
    let mut source = source.live(None, false);
    while !until.over() && !STOP.load(Ordering::Relaxed) {
        match source.next(PATIENCE)? {
            None => recorder.tick()?,
            Some(Event::Bytes(NodeChannel::Telemetry, bytes)) => recorder.take(&bytes)?,
            // The log and the boot loader's text are for `monitor`. The content of the flash does not matter here.
            Some(Event::Bytes(NodeChannel::Log, _) | Event::Text(_) | Event::Flashed { .. } | Event::Restarted) => {}
            Some(Event::Connected(to)) => super::note(&format!("listening to {to}\n")),
            Some(Event::Lost(why)) => {
                recorder.interrupted();
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

fn report(
    arguments: &Arguments,
    folder: &Path,
    names: &SiteNames,
    summary: &DecodeSummary,
    recorded: &Recorded,
) -> Result<()> {
    if arguments.json {
        return super::print_json(&Document { summary, recorded });
    }
    super::note(&summary_text(folder, names, summary, recorded));
    Ok(())
}

fn summary_text(folder: &Path, names: &SiteNames, summary: &DecodeSummary, recorded: &Recorded) -> String {
    let mut text = summary.text(names);
    let Recorded { rows, anchors, left_out } = recorded;
    let count = |name: &str| rows.get(name).copied().unwrap_or(0);
    let (positions, ranges, sightings) = (count("positions"), count("ranges"), count("sightings"));
    let _ = writeln!(
        text,
        "recorded: {positions} rounds, {ranges} ranges to {anchors} anchors, {sightings} sightings, in {}",
        folder.display()
    );
    for table in Message::tables().filter(|table| !["positions", "ranges", "rssi"].contains(&table.name)) {
        if count(table.rows) > 0 {
            let _ = writeln!(text, "recorded: {} {}", count(table.rows), table.counted);
        }
    }
    if !left_out.is_empty() {
        let count: u64 = left_out.values().sum();
        let who: Vec<_> = left_out.keys().map(|address| names.with_address(*address)).collect();
        let _ = writeln!(
            text,
            "left out: {count} ranges to {}, whose positions are unknown; --anchors FILE or --site FILE gives them",
            who.join(", ")
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_ends_after_a_time_or_a_size() {
        assert_eq!(rotation("15min"), Ok(Rotation::Time(Duration::from_secs(900))));
        assert_eq!(rotation("100MB"), Ok(Rotation::Bytes(100_000_000)));
        for wrong in ["", "h", "0h", "1", "-1h", "1.5h", "1 year"] {
            assert!(rotation(wrong).is_err(), "{wrong}");
        }
    }
}
