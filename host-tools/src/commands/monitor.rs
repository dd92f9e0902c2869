//! `baliza monitor`: what a node says, as it says it.

use std::io::{BufWriter, ErrorKind, IsTerminal, Stdout, Write};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Context, Result};
use host_tools::Wrong;
use host_tools::monitor::{
    Files, Image, Limits, Lines, Listener, Pace, Patience, Piped, Port, Probed, Reload, Said, Serial, Session, Source,
    listen, summary,
};
use host_tools::probe::ProbeArguments;
use indicatif::{ProgressBar, ProgressDrawTarget};

/// Show what a node says: its log and its telemetry, in the order of its clock
///
/// By probe (the default), serial port, standard input or from files. With --elf, the very ELF file that was flashed, the log is
/// shown too; without it telemetry alone. Unplugging, resets and new images are survived. Ctrl-C ends it, with a count of what
/// came and what was lost.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The ELF file that was flashed: target/<target>/firmware/<image>
    #[arg(long, value_name = "FILE")]
    elf: Option<PathBuf>,
    #[command(flatten)]
    probe: ProbeArguments,
    /// Reset the node first, to see it start
    #[arg(long)]
    reset: bool,
    /// Listen to a serial port: telemetry, or what an ESP image mixes on its USB port
    #[arg(long, value_name = "PORT", group = "source", conflicts_with_all = BY_PROBE)]
    serial: Option<String>,
    /// The serial port's bits a second
    #[arg(long, value_name = "N", default_value_t = 115_200, requires = "serial", value_parser = clap::value_parser!(u32).range(1..))]
    baud: u32,
    /// Read standard input
    #[arg(long, group = "source", conflicts_with_all = BY_PROBE)]
    stdin: bool,
    /// Read a file: telemetry, or a serial port's mixture
    #[arg(long, value_name = "FILE", group = "source", conflicts_with_all = BY_PROBE)]
    file: Option<PathBuf>,
    /// The log's stream beside --file, where it has a file of its own
    #[arg(long, value_name = "FILE", requires_all = ["file", "elf"])]
    defmt_file: Option<PathBuf>,
    /// Show where in the sources each line of the log is said
    #[arg(long)]
    places: bool,
    /// End after so many seconds
    #[arg(long, value_name = "N", value_parser = seconds)]
    seconds: Option<Duration>,
    /// End after so many positions
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    fixes: Option<u64>,
}

const BY_PROBE: [&str; 4] = ["probe", "chip", "speed", "reset"];

const EXAMPLES: &str = "Examples:
  baliza monitor --elf target/thumbv7em-none-eabihf/firmware/tag-dwm1001
  baliza monitor --serial /dev/ttyACM0 --elf target/riscv32imc-unknown-none-elf/firmware/tag-esp32c3
  baliza monitor --file telemetry.bin --defmt-file log.bin --elf target/thumbv7em-none-eabihf/firmware/tag-simulated";

static STOP: AtomicBool = AtomicBool::new(false);

pub fn run(arguments: &Arguments) -> Result<()> {
    let image = arguments.elf.as_deref().map(Image::read).transpose()?;
    let marks = image.as_ref().map(|image| image.marks.clone());
    let (mut source, patience): (Box<dyn Source>, _) = if let Some(name) = &arguments.serial {
        let port = Port { name: name.clone(), baud: arguments.baud };
        (Box::new(Serial::new(port, name.clone(), Pace::default())), Patience::LIVE)
    } else if let Some(file) = &arguments.file {
        let log = arguments.defmt_file.as_deref();
        (Box::new(Files::open(file, log)?), if log.is_some() { Patience::FILES } else { Patience::MIXTURE })
    } else if arguments.stdin {
        (Box::new(Piped::new(std::io::stdin())), Patience::LIVE)
    } else {
        let probe = arguments.probe.clone();
        (Box::new(Probed::new(probe, marks, arguments.reset, Pace::default())), Patience::LIVE)
    };
    ctrlc::set_handler(|| {
        // Who asks twice does not want to wait.
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    })
    .context("cannot watch for Ctrl-C")?;
    let limits = Limits { time: arguments.seconds, fixes: arguments.fixes };
    let mut session = Session::new(image, reload(arguments.elf.as_ref()), patience);
    let mut screen = Screen::new(arguments, patience.host.is_some());
    let begun = Instant::now();
    let heard = listen(source.as_mut(), &mut session, &mut screen, limits, &STOP);
    screen.close(&summary(&session.counts(), begun.elapsed()), heard.is_ok())?;
    heard.map(drop)
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| format!("\"{text}\" is not a number"))?;
    Duration::try_from_secs_f64(seconds).map_err(|error| error.to_string())
}

/// Reads the ELF file again, where it has changed since the last time.
fn reload(file: Option<&PathBuf>) -> Reload {
    let changed = |file: &PathBuf| -> Option<SystemTime> { std::fs::metadata(file).ok()?.modified().ok() };
    let file = file.cloned();
    let mut read = file.as_ref().and_then(changed);
    Box::new(move |image| -> Option<Result<Image, Wrong>> {
        let now = file.as_ref().and_then(changed);
        if now == read {
            return None;
        }
        read = now;
        Some(Image::read(&image.file))
    })
}

/// Standard output for what the node says, standard error for everything else.
struct Screen {
    lines: Lines,
    out: BufWriter<Stdout>,
    /// Hidden unless standard error is a terminal.
    bar: ProgressBar,
    /// Of the last second or more: positions counted, and when.
    rate: (u64, Duration, f64),
}

impl Screen {
    fn new(arguments: &Arguments, live: bool) -> Self {
        let colour =
            std::io::stdout().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
        let bar = if live {
            ProgressBar::new_spinner()
        } else {
            ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden())
        };
        Self {
            lines: Lines::new(colour, arguments.places),
            out: BufWriter::new(std::io::stdout()),
            bar,
            rate: (0, Duration::ZERO, 0.0),
        }
    }

    /// Whether someone reads on: a reader that went away (`| head`) has what it wanted.
    fn read_on(written: std::io::Result<()>) -> Result<bool> {
        match written {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
            Err(error) => Err(error).context("cannot write to standard output"),
        }
    }

    fn close(mut self, summary: &str, well: bool) -> Result<()> {
        self.bar.finish_and_clear();
        let flushed = Self::read_on(self.out.flush());
        // A failure is one line, and follows.
        if well {
            super::tell(&format!("{summary}\n"));
        }
        flushed.map(drop)
    }
}

impl Listener for Screen {
    fn said(&mut self, said: &Said) -> Result<bool> {
        let Some(line) = self.lines.line(said) else { return Ok(true) };
        let (bar, out) = (&self.bar, &mut self.out);
        if bar.is_hidden() {
            return Self::read_on(out.write_all(line.as_bytes()));
        }
        Self::read_on(bar.suspend(|| out.write_all(line.as_bytes()).and_then(|()| out.flush())))
    }

    fn note(&mut self, note: &str) {
        self.bar.suspend(|| super::tell(&format!("{note}\n")));
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
        Self::read_on(self.out.flush())
    }
}
