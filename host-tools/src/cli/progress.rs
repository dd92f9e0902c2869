//! A progress bar for work of more than a second. Without a terminal, `indicatif` shows nothing; with `--quiet`, this
//! module does not either.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::verbosity::is_quiet;

const PATIENCE: Duration = Duration::from_secs(1);

/// A bar that appears only after some time.
pub struct Progress {
    bar: ProgressBar,
    begun: Instant,
}

impl Progress {
    /// A bar for `steps` steps.
    pub fn new(steps: usize) -> Self {
        let bar = ProgressBar::with_draw_target(Some(steps as u64), ProgressDrawTarget::hidden());
        let style = ProgressStyle::with_template("{bar:40} {pos}/{len}, {eta} left");
        Self { bar: bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar())), begun: Instant::now() }
    }

    /// Counts one step as done.
    pub fn step(&self) {
        self.advance(1);
    }

    /// Counts `steps` steps as done.
    pub fn advance(&self, steps: u64) {
        if self.bar.is_hidden() && !is_quiet() && self.begun.elapsed() > PATIENCE {
            self.bar.set_draw_target(ProgressDrawTarget::stderr());
        }
        self.bar.inc(steps);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
