//! `baliza monitor`: shows a node's messages as they arrive.

use std::io::{BufWriter, ErrorKind, Stdout, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressDrawTarget};
use node_link::decode::{Chunks, NodeStream, Waited, node_streams};
use node_link::monitor::{
    Event, Files, FindImage, Image, ImageFiles, Limits, Lines, Listener, NodeChannel, NodeOutput, Piped, Session,
    SessionCounts, Source, json, listen, summary,
};
use node_link::provision::SiteNames;
use node_link::recorder::{Recorder, Settings};
use recording::UserError;
use wire::telemetry::Table;

use super::flash::firmware_folders;
use super::live_view::{Address, LiveView};
use super::site_names::SiteNamesArgs;
use super::stream::{self, STOP, SourceArguments, catch_signals, refuse_interrupted, table_names};
use super::tell::{TellArguments, Telling};
use super::verbosity::is_quiet;

/// Show a node's output: its telemetry, and its log where that has more
///
/// By probe (the default), serial port, standard input or from files. The log is shown with the ELF file that was flashed,
/// which is looked for by the node's build; without it only telemetry. Of a simulation's folder, all nodes are shown, one
/// after the other, each line with its node (in CSV: tag). Monitoring continues after unplugging, resets and new images. Ctrl-C
/// ends it, with a count of what was received and what was lost.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The ELF file that was flashed, or a folder with it: the one of the node's build is taken [default: target/firmware,
    /// firmware, or the folder firmware of a release]
    #[arg(long, value_name = "FILE")]
    elf: Option<PathBuf>,
    #[command(flatten)]
    source: SourceArguments,
    #[command(flatten)]
    names: SiteNamesArgs,
    #[command(flatten)]
    tell: TellArguments,
    /// Reset the node first, to see it start
    #[arg(long, conflicts_with_all = ["serial", "stdin", "file"])]
    reset: bool,
    /// The log's stream beside --file, where it has a file of its own
    #[arg(long, value_name = "FILE", requires_all = ["file", "elf"])]
    defmt_file: Option<PathBuf>,
    /// The format of the output
    #[arg(long, value_name = "FORMAT", default_value = "text")]
    format: Format,
    /// Which messages are the rows (--format csv) [default: positions]
    #[arg(long, value_name = "TABLE", value_parser = table_names())]
    table: Option<Table>,
    /// Record as well, as `baliza record` does, into this folder
    #[arg(long, value_name = "FOLDER")]
    record: Option<PathBuf>,
    /// Replace the recording that is in that folder, at the first byte
    #[arg(long, requires = "record")]
    force: bool,
    /// Show the source location of each line of the log
    #[arg(long, alias = "places")]
    show_source: bool,
    /// Let Foxglove draw live: positions, ranges and anchors, on a WebSocket
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:8765", value_parser = Address::parse)]
    foxglove: Option<Address>,
    /// End after N positions
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    fixes: Option<u64>,
    /// Pass bytes from standard input on to the node: for the station (--format telemetry)
    #[arg(long, hide = true, conflicts_with_all = ["stdin", "file", "tell"])]
    to_node_from_stdin: bool,
}

/// The longest wait for a source, so that a signal is seen.
const PATIENCE: Duration = Duration::from_millis(100);

const EXAMPLES: &str = "Examples:
  baliza monitor
  baliza monitor --serial /dev/ttyACM0 --elf target/firmware/tag-esp32c3-ble.elf
  baliza monitor --serial /dev/ttyACM0 --tell 0x1001 --identify 30
  baliza monitor --file telemetry.bin --defmt-file log.bin --elf target/firmware/tag-dwm1001.elf";

/// `--format`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// A line for a person, in colours on a terminal
    Text,
    /// One object of JSON a line: messages as decode writes them, and lines of the log
    Jsonl,
    /// The rows of one table
    Csv,
    /// The node's telemetry as it comes, for another program: `baliza monitor --format telemetry | baliza serve -`
    Telemetry,
}

/// Runs `baliza monitor`.
///
/// # Errors
/// Flags or the ELF file are wrong, the source fails, or the recording or the output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    if arguments.table.is_some() && arguments.format != Format::Csv {
        return Err(UserError::flag("--table", "only with --format csv").into());
    }
    if let Some(streams) = several(arguments)? {
        return show_all(arguments, streams);
    }
    let images = images(arguments.elf.as_deref());
    let image = images.as_ref().map_or(Ok(None), ImageFiles::single)?;
    let (mut source, live) = source(arguments, image.as_ref())?;
    let file = arguments.source.file().filter(|_| !live);
    catch_signals()?;
    if arguments.format == Format::Telemetry {
        let to_node = arguments.to_node_from_stdin.then(|| Chunks::new(std::io::stdin()));
        let relayed = relay(source.as_mut(), to_node, arguments.source.seconds);
        return relayed.map_err(|error| arguments.source.or_by_serial(error));
    }
    let names = arguments.names.read(arguments.source.file())?;
    let recorder = match &arguments.record {
        Some(folder) => {
            let (file, force) = (file.map(Path::to_owned), arguments.force);
            let settings = Settings { file, force, ..Settings::of(names.clone(), &[])? };
            Some(Recorder::create("--record", folder, settings)?)
        }
        None => None,
    };
    let limits = Limits { time: arguments.source.seconds, fixes: arguments.fixes };
    let find = images.map(|images| -> FindImage { Box::new(move |build| images.find(build)) });
    let mut session = Session::new(image, find, live);
    if let Some(recorder) = recorder {
        session.record(recorder);
    }
    let view = arguments.foxglove.as_ref().map(LiveView::listen).transpose()?;
    let telling = arguments.tell.telling();
    let mut screen = Screen { view, telling, ..Screen::new(arguments, names, live) };
    let begun = Instant::now();
    let listened =
        screen.begin().and_then(|()| listen(source.as_mut(), &mut session, &mut screen, limits, &STOP).map(drop));
    let shown = screen.end();
    // The recording is completed even where the terminal is closed.
    let recorded = session.recorded().map(Recorder::finish).transpose();
    listened.map_err(|error| arguments.source.or_by_serial(error))?;
    recorded?;
    shown?;
    let counts = session.counts();
    if let Some(file) = file {
        refuse_interrupted()?;
        refuse_without_content(file, &counts)?;
    }
    if arguments.source.stdin && limits.time.is_none() && !STOP.load(Ordering::Relaxed) && is_without_content(&counts) {
        return Err(UserError::file(Path::new("standard input"), "it ended without telemetry and without a log").into());
    }
    super::note(&format!("{}\n", summary(&counts, begun.elapsed())));
    Ok(screen.telling.map_or(Ok(()), |telling| telling.result())?)
}

/// The streams of a folder with several nodes, where what is asked for may be of several. With what belongs to one
/// node (`--elf`, `--record`, …), a note says whose stream is read.
fn several(arguments: &Arguments) -> Result<Option<Vec<NodeStream>>, UserError> {
    let Some(folder) = arguments.source.file() else { return Ok(None) };
    let streams = node_streams(folder)?;
    let [_, next, ..] = &streams[..] else { return Ok(None) };
    let is_of_one = arguments.elf.is_some()
        || arguments.record.is_some()
        || arguments.foxglove.is_some()
        || arguments.format == Format::Telemetry;
    if is_of_one {
        let (folder, next) = (folder.display(), next.path.display());
        super::note(&format!("{folder} has several nodes, and this is the first tag: --file {next} is another\n"));
        return Ok(None);
    }
    Ok(Some(streams))
}

/// Shows one node of a folder after the other.
fn show_all(arguments: &Arguments, streams: Vec<NodeStream>) -> Result<()> {
    catch_signals()?;
    let names = arguments.names.read(arguments.source.file())?;
    let (begun, mut fixes) = (Instant::now(), 0);
    let mut screen = Screen { are_several: true, ..Screen::new(arguments, names.clone(), false) };
    screen.begin()?;
    let mut said = String::new();
    for NodeStream { path, node } in streams {
        let limits = Limits {
            time: arguments.source.seconds.map(|time| time.saturating_sub(begun.elapsed())),
            fixes: arguments.fixes.map(|most| most.saturating_sub(fixes)),
        };
        if limits.fixes == Some(0) {
            break;
        }
        let mut session = Session::new(None, None, false);
        screen.node = node;
        listen(&mut Files::open(&path, None)?, &mut session, &mut screen, limits, &STOP)?;
        refuse_interrupted()?;
        let counts = session.counts();
        refuse_without_content(&path, &counts)?;
        fixes += counts.fixes;
        let of = screen.node.as_deref().map_or("", |node| names.node(node));
        said += &format!("{of}: {}\n", summary(&counts, begun.elapsed()));
    }
    screen.end()?;
    super::note(&said);
    Ok(())
}

/// `--format telemetry`: writes the node's telemetry to standard output as it comes, until the end of the source, of
/// `time` or of the reader. What comes from `to_node` goes to the node; if it has no room, it is lost.
fn relay(source: &mut dyn Source, mut to_node: Option<Chunks>, time: Option<Duration>) -> Result<()> {
    let begun = Instant::now();
    let mut out = std::io::stdout();
    while !STOP.load(Ordering::Relaxed) && time.is_none_or(|time| begun.elapsed() < time) {
        match to_node.as_mut().map(|to_node| to_node.wait(Duration::ZERO)) {
            Some(Ok(Waited::Bytes(bytes))) => _ = source.send(&bytes),
            // Nobody sends any more.
            Some(Ok(Waited::End) | Err(_)) => to_node = None,
            Some(Ok(Waited::Nothing)) | None => {}
        }
        match source.next(PATIENCE)? {
            Some(Event::Bytes(NodeChannel::Telemetry, bytes)) => {
                if !read_on(out.write_all(&bytes).and_then(|()| out.flush()))? {
                    return Ok(());
                }
            }
            Some(Event::Connected(to)) => super::note(&format!("connected to {to}\n")),
            Some(Event::Lost(why)) => super::note(&format!("connection lost ({why}); trying to connect again\n")),
            Some(Event::Silent) => {
                super::note("the chip has no RTT control block: is a baliza image flashed and running?\n");
            }
            Some(Event::End) => return Ok(()),
            Some(Event::Bytes(NodeChannel::Log, _) | Event::Text(_) | Event::Restarted | Event::Flashed { .. })
            | None => {}
        }
    }
    Ok(())
}

/// Refuses a file that has neither telemetry nor a log.
fn refuse_without_content(file: &Path, counts: &SessionCounts) -> Result<(), UserError> {
    let is_empty = std::fs::metadata(file).is_ok_and(|metadata| metadata.len() == 0);
    if is_empty || !is_without_content(counts) {
        return Ok(());
    }
    Err(UserError::file(file, "this is no telemetry, and no log: there is no frame in it"))
}

fn is_without_content(counts: &SessionCounts) -> bool {
    let telemetry = &counts.telemetry;
    telemetry.frames + telemetry.newer() + counts.log_lines == 0
}

/// The source of the node's bytes, and whether it is live.
fn source(arguments: &Arguments, image: Option<&Image>) -> Result<(Box<dyn Source>, bool)> {
    if let Some(file) = arguments.source.file() {
        let files = Files::open(file, arguments.defmt_file.as_deref())?;
        let is_live = files.is_live();
        return Ok((Box::new(files), is_live));
    }
    if arguments.source.stdin {
        return Ok((Box::new(Piped::new(std::io::stdin())), true));
    }
    Ok((arguments.source.live(image, arguments.reset), true))
}

/// Where the node's ELF file is looked for.
fn images(given: Option<&Path>) -> Option<ImageFiles> {
    match given {
        Some(folder) if folder.is_dir() => Some(ImageFiles::Folders(vec![folder.to_owned()])),
        Some(file) => Some(ImageFiles::File(file.to_owned())),
        None => {
            let images = ImageFiles::Folders(firmware_folders());
            (!images.files().is_empty()).then_some(images)
        }
    }
}

/// The format of the node's output.
enum Writing {
    Text(Lines),
    Json,
    Csv(stream::Lines),
}

/// Writes the node's output to standard output, and everything else to standard error.
struct Screen {
    writing: Writing,
    out: BufWriter<Stdout>,
    /// Hidden unless standard error is a terminal.
    bar: ProgressBar,
    /// The number of positions, the time of counting, and the rate before that, positions per second.
    rate: (u64, Duration, f64),
    /// `--foxglove`.
    view: Option<LiveView>,
    /// `--tell`.
    telling: Option<Telling>,
    begun: Instant,
    /// Whether there are several nodes, and the address of the one that is shown.
    are_several: bool,
    node: Option<String>,
    names: SiteNames,
}

impl Screen {
    fn new(arguments: &Arguments, names: SiteNames, live: bool) -> Self {
        let lines = Lines::new(super::stdout_has_colours(), arguments.show_source);
        let writing = match arguments.format {
            Format::Text => Writing::Text(lines.named(names.clone())),
            Format::Jsonl => Writing::Json,
            // Telemetry has no screen.
            Format::Csv | Format::Telemetry => Writing::Csv(stream::Lines::csv(arguments.table)),
        };
        let bar = if live && !is_quiet() {
            ProgressBar::new_spinner()
        } else {
            ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden())
        };
        Self {
            writing,
            out: BufWriter::new(std::io::stdout()),
            bar,
            rate: (0, Duration::ZERO, 0.0),
            view: None,
            telling: None,
            begun: Instant::now(),
            are_several: false,
            node: None,
            names,
        }
    }

    fn begin(&mut self) -> Result<()> {
        match &self.writing {
            Writing::Csv(lines) => read_on(self.out.write_all(&lines.header(self.are_several)?)).map(drop),
            Writing::Text(_) | Writing::Json => Ok(()),
        }
    }

    fn end(&mut self) -> Result<()> {
        self.bar.finish_and_clear();
        read_on(self.out.flush()).map(drop)
    }

    /// The text of one item of the node's output; empty where the item is not shown.
    fn text(&mut self, output: &NodeOutput) -> Result<Vec<u8>> {
        match &mut self.writing {
            Writing::Text(lines) => {
                let of = self.node.as_ref().map_or_else(String::new, |node| format!("{} ", self.names.node(node)));
                Ok(lines.line(output).map_or_else(String::new, |line| of + &line).into_bytes())
            }
            Writing::Json => {
                let mut line = json(output, self.node.as_deref()).context("cannot write JSON")?;
                line.push(b'\n');
                Ok(line)
            }
            Writing::Csv(lines) => {
                let mut row = Vec::new();
                if let NodeOutput::Message(stamp, message) = output {
                    lines.append(&mut row, *stamp, message, self.node.as_deref())?;
                }
                Ok(row)
            }
        }
    }
}

/// Whether the reader still reads. A reader that closed its end (`| head`) is not an error.
fn read_on(written: std::io::Result<()>) -> Result<bool> {
    match written {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
        Err(error) => Err(error).context("cannot write to standard output"),
    }
}

impl Listener for Screen {
    fn output(&mut self, output: &NodeOutput) -> Result<bool> {
        if let Some(view) = &mut self.view {
            view.output(output)?;
        }
        let text = self.text(output)?;
        let (bar, out) = (&self.bar, &mut self.out);
        let reads = if bar.is_hidden() || text.is_empty() {
            read_on(out.write_all(&text))
        } else {
            // A line and the progress bar may be on the same terminal.
            read_on(bar.suspend(|| out.write_all(&text).and_then(|()| out.flush())))
        };
        let (NodeOutput::Message(_, message), Some(telling)) = (output, &mut self.telling) else { return reads };
        match telling.take(message, self.begun.elapsed()) {
            Some(answer) => {
                self.note(&answer);
                reads.map(|_| false)
            }
            None => reads,
        }
    }

    fn outgoing(&mut self, _: Duration) -> Option<Vec<u8>> {
        self.telling.as_mut()?.outgoing(self.begun.elapsed())
    }

    fn sent(&mut self) {
        self.telling.iter_mut().for_each(Telling::sent);
    }

    fn note(&mut self, note: &str) {
        let (bar, out) = (&self.bar, &mut self.out);
        bar.suspend(|| {
            // The next write reports an error.
            let _ = out.flush();
            super::note(&format!("{note}\n"));
        });
    }

    fn status(&mut self, session: &Session, elapsed: Duration) -> Result<bool> {
        let counts = session.counts();
        let (fixes, since, _) = self.rate;
        let span = elapsed.saturating_sub(since).as_secs_f64();
        if span >= 1.0 {
            self.rate = (counts.fixes, elapsed, (counts.fixes - fixes) as f64 / span);
        }
        let state = session.state().map_or_else(String::new, |state| format!(", {state}"));
        self.bar.set_message(format!(
            "{:.0} s, {} fixes, {:.1} fixes/s, {} frames lost{state}",
            elapsed.as_secs_f64(),
            counts.fixes,
            self.rate.2,
            counts.lost_frames() + counts.node_dropped
        ));
        self.bar.tick();
        read_on(self.out.flush())
    }
}
