//! `--quiet` and `--verbose`: how much goes to standard error.

use std::sync::atomic::{AtomicBool, Ordering};

use log::{LevelFilter, Log, Metadata, Record};

static QUIET: AtomicBool = AtomicBool::new(false);

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
        // There is no other logger.
        if self.verbose && log::set_logger(&StandardError).is_ok() {
            log::set_max_level(LevelFilter::Info);
            super::note(&format!("baliza {}\n", super::VERSION));
        }
    }
}

/// Whether `--quiet` was given.
pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// What the library logs, a line each. What packages log is for their developers.
struct StandardError;

impl Log for StandardError {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.target().starts_with("host_tools")
    }

    fn log(&self, record: &Record<'_>) {
        if self.enabled(record.metadata()) {
            super::note(&format!("{}\n", record.args()));
        }
    }

    fn flush(&self) {}
}
