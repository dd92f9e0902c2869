//! `--quiet` and `--verbose`: how much goes to standard error, and the log.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{PoisonError, RwLock};

use log::{Level, LevelFilter, Log, Metadata, Record};

static QUIET: AtomicBool = AtomicBool::new(false);
static VERBOSE: AtomicBool = AtomicBool::new(false);

/// Takes a line that is logged.
type Diverted = Box<dyn Fn(&str) + Send + Sync>;

/// Where the log goes while a command draws on the terminal.
static DIVERTED: RwLock<Option<Diverted>> = RwLock::new(None);

/// What the station logs is for who runs it: what failed, and who changed what.
const STATION: [&str; 3] = ["station_core", "baliza_station", "audit"];
/// What `--verbose` adds: the tables and streams that are read.
const VERBOSELY: [&str; 5] = ["host_tools", "recording", "analysis", "node_link", "baliza_probe"];

/// The flags.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Verbosity {
    /// Print errors only: no progress, no summary
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Print the version, and the tables and streams that are read, too
    #[arg(short, long, global = true)]
    verbose: bool,
}

impl Verbosity {
    /// From now on, messages follow the flags.
    pub fn apply(self) {
        QUIET.store(self.quiet, Ordering::Relaxed);
        VERBOSE.store(self.verbose, Ordering::Relaxed);
        // There is no other logger.
        if log::set_logger(&StandardError).is_ok() {
            log::set_max_level(LevelFilter::Info);
        }
        if self.verbose {
            super::note(&format!("baliza {}\n", super::VERSION));
        }
    }
}

/// Whether `--quiet` was given.
pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// From now on, the log goes here and not to standard error.
pub fn divert(to: impl Fn(&str) + Send + Sync + 'static) {
    *DIVERTED.write().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(to));
}

/// From now on, the log goes to standard error again.
pub fn undivert() {
    *DIVERTED.write().unwrap_or_else(PoisonError::into_inner) = None;
}

/// What the library and the station log, a line each. What packages log is for their developers.
struct StandardError;

impl Log for StandardError {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        let is_of = |module: &str| metadata.target().starts_with(module);
        STATION.into_iter().any(is_of) || (VERBOSE.load(Ordering::Relaxed) && VERBOSELY.into_iter().any(is_of))
    }

    fn log(&self, record: &Record<'_>) {
        if !self.enabled(record.metadata()) {
            return;
        }
        if let Some(diverted) = DIVERTED.read().unwrap_or_else(PoisonError::into_inner).as_ref() {
            return diverted(&record.args().to_string());
        }
        let line = format!("{}\n", record.args());
        if record.level() <= Level::Warn { super::prompt(&line) } else { super::note(&line) }
    }

    fn flush(&self) {}
}
