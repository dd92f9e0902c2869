//! The commands, one module each, and what the programs of the project share. A command has its arguments and `run`,
//! which reads, computes and reports.
//!
//! `docs/build/extend.md` says what a new command needs. An argument of the type `PathBuf` is an input, unless
//! [`paths`] knows it as an output. `--json` needs a schema in `docs/reference/schema`.

mod ble;
mod boards;
mod calibrate;
mod check;
mod classify_rooms;
pub mod companion;
mod completions;
mod convert;
mod coverage;
mod decode;
mod example;
mod flash;
mod floor_plan;
mod folder;
pub mod help;
mod import;
pub mod json;
pub mod live_view;
mod man;
mod monitor;
mod nlos;
pub mod numbers;
pub mod paths;
mod piped;
mod plan_anchors;
mod plot;
mod program;
pub mod progress;
mod provision;
mod record;
mod recording_args;
mod recording_values;
mod replay;
mod report;
mod residuals;
mod simulate;
mod site_names;
mod solve;
pub mod stream;
mod summary;
mod survey;
pub mod tell;
mod track;
pub mod verbosity;

use std::path::Path;

/// Declares the subcommands of one level. Each variant is a module with `Arguments`, which clap reads, and `run`, which
/// executes the command.
#[macro_export]
macro_rules! commands {
    ($(#[$about:meta])* $visible:vis enum $name:ident { $($(#[$kind:meta])* $variant:ident($module:ident),)* }) => {
        $(#[$about])*
        #[derive(clap::Subcommand)]
        #[allow(missing_docs, reason = "the help of a command is that of its arguments")]
        $visible enum $name {
            // In a box: the arguments of commands differ much in size.
            $($(#[$kind])* $variant(Box<$module::Arguments>),)*
        }

        /// Runs the given command.
        ///
        /// # Errors
        /// The command returns an error.
        $visible fn run(command: &$name) -> anyhow::Result<()> {
            match command {
                $($name::$variant(arguments) => $module::run(arguments),)*
            }
        }
    };
}
pub use commands;

commands! {
    /// What `baliza` can do.
    pub enum Command {
        Solve(solve),
        Track(track),
        Check(check),
        Plot(plot),
        #[command(subcommand)]
        Nlos(nlos),
        #[command(subcommand)]
        Survey(survey),
        Coverage(coverage),
        #[command(alias = "place")]
        PlanAnchors(plan_anchors),
        #[command(alias = "presence")]
        ClassifyRooms(classify_rooms),
        #[command(subcommand)]
        Ble(ble),
        #[command(subcommand)]
        Calibrate(calibrate),
        Simulate(simulate),
        Example(example),
        Provision(provision),
        Flash(flash),
        Monitor(monitor),
        Decode(decode),
        Record(record),
        Replay(replay),
        #[command(subcommand)]
        Import(import),
        Convert(convert),
        Completions(completions),
        Man(man),
    }
}

use anyhow::{Context, Result};
use clap::CommandFactory;
use pictures::{Drawing, PictureFormat};
pub use program::{Program, program};
use recording::UserError;
use recording::output::{self, Growing};
use verbosity::Verbosity;

/// The version, and the commit where it is known.
pub const VERSION: &str = env!("BALIZA_VERSION");

/// Positions from UWB ranges and the RSSI values of Bluetooth beacons, with honest uncertainty.
#[derive(clap::Parser)]
#[command(name = "baliza", version = VERSION, max_term_width = 120, after_help = EXIT_CODES)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    verbosity: Verbosity,
}

/// What `--help` ends with.
pub const EXIT_CODES: &str = "Exit code: 0 done; 2 the input or the arguments are wrong, one line on standard error says where and \
                          how; 130 interrupted; 1 anything else.\nWith --json, standard output is one object with schema, \
                          command, and results (a list) or error (file, line, message).";

impl Program for Arguments {
    fn grouped() -> clap::Command {
        help::grouped(companion::with_names(Self::command()))
    }

    fn verbosity(&self) -> Verbosity {
        self.verbosity
    }

    fn run(&self) -> Result<()> {
        run(&self.command)
    }
}

/// The file of a picture. Its name is checked before the work, and the file is written after the work.
#[derive(Clone, Copy)]
pub struct PictureFile<'a> {
    file: &'a Path,
    format: PictureFormat,
}

impl<'a> PictureFile<'a> {
    /// The file that a flag names. Its format must be supported, and the file must be writable.
    pub fn of(flag: &'static str, file: &'a Path) -> Result<Self, UserError> {
        output::check(flag, file)?;
        Ok(Self { file, format: PictureFormat::of(flag, file)? })
    }

    /// The file of `--plot`, where it is given.
    pub fn plot(file: Option<&'a Path>) -> Result<Option<Self>, UserError> {
        file.map(|file| Self::of("--plot", file)).transpose()
    }

    /// Writes the picture.
    pub fn write(self, picture: &Drawing) -> Result<()> {
        write(self.file, &self.format.encode(picture)?)
    }

    /// Writes the picture, and prints its path.
    pub fn write_and_note(self, picture: &Drawing) -> Result<()> {
        self.write(picture)?;
        note(&format!("picture: {}\n", self.file.display()));
        Ok(())
    }
}

/// A flag needs a feature that this program was built without: how to install the program with it.
fn without(flag: &'static str, feature: &str) -> UserError {
    let install = format!("cargo install --path host-tools --features {feature}");
    UserError::flag(flag, format!("this baliza was built without its feature {feature}: {install}"))
}

/// Writes a complete file.
pub fn write(file: &Path, bytes: &[u8]) -> Result<()> {
    output::write_file(file, bytes).with_context(|| format!("cannot write {}", file.display()))
}

/// Writes a complete file, or standard output without one, piece by piece.
pub fn write_with(file: Option<&Path>, content: impl FnOnce(&mut Growing) -> Result<()>) -> Result<()> {
    let written = || -> Result<()> {
        let mut growing = Growing::create(file.unwrap_or(Path::new(output::STANDARD)))?;
        content(&mut growing)?;
        Ok(growing.finish()?)
    };
    written().with_context(|| match file {
        Some(file) => format!("cannot write {}", file.display()),
        None => "cannot write to standard output".to_owned(),
    })
}

pub use self::json::print_results as print_json;

/// Writes to standard output.
pub fn print(bytes: &[u8]) -> Result<()> {
    output::write_stdout(bytes).context("cannot write to standard output")
}

/// Prints a message for the user, which is not part of the data. With `--quiet` it is not printed.
pub fn note(text: &str) {
    if !verbosity::is_quiet() {
        prompt(text);
    }
}

/// Prints what the user must do, also with `--quiet`.
pub fn prompt(text: &str) {
    use std::io::Write;
    // If standard error is closed, the message is dropped.
    let _ = std::io::stderr().write_all(text.as_bytes());
}

/// Prints warnings, each on a line of its own. The document of `--json` has them too.
pub fn warn(warnings: impl IntoIterator<Item = String>) {
    for warning in warnings {
        json::warned(&warning);
        note(&format!("warning: {warning}\n"));
    }
}

/// Whether standard output shows colours: it is a terminal that can, and `NO_COLOR` is not set.
pub fn stdout_has_colours() -> bool {
    anstream::AutoStream::choice(&std::io::stdout()) != anstream::ColorChoice::Never
}

#[cfg(test)]
mod tests {
    use super::without;

    #[test]
    fn what_is_not_built_in_says_how_to_install_it() {
        assert_eq!(
            without("--format", "parquet").to_string(),
            "--format: this baliza was built without its feature parquet: cargo install --path host-tools --features \
             parquet"
        );
    }
}
