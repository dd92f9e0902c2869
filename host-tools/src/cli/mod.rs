//! The subcommands, one module each. A module has its arguments and `run`, which reads, computes and reports.
//!
//! A new command needs four changes: its module, its `mod` line and its line in [`Command`] here, its test, and the
//! test's `mod` line in `tests/baliza/main.rs`.

mod bench;
mod ble;
mod calibrate;
mod classify_rooms;
mod coverage;
mod decode;
mod example;
mod monitor;
mod nlos;
mod plan_anchors;
mod plot;
mod progress;
mod provision;
mod record;
mod recording_args;
mod replay;
mod report;
mod residuals;
mod simulate;
mod solve;
mod stream;
mod summary;
mod survey;
mod track;

use std::path::Path;

/// Declares the subcommands of one level. Each variant is a module with `Arguments`, which clap reads, and `run`, which
/// executes the command.
macro_rules! commands {
    ($(#[$about:meta])* enum $name:ident { $($(#[$kind:meta])* $variant:ident($module:ident),)* }) => {
        $(#[$about])*
        #[derive(clap::Subcommand)]
        pub enum $name {
            $($(#[$kind])* $variant($module::Arguments),)*
        }

        /// Runs the given command.
        ///
        /// # Errors
        /// The command returns an error.
        pub fn run(command: &$name) -> anyhow::Result<()> {
            match command {
                $($name::$variant(arguments) => $module::run(arguments),)*
            }
        }
    };
}
use commands;

commands! {
    /// What `baliza` can do.
    enum Command {
        Solve(solve),
        Track(track),
        #[command(subcommand)]
        Bench(bench),
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
        Monitor(monitor),
        Decode(decode),
        Record(record),
        Replay(replay),
    }
}

use anyhow::{Context, Result};
use host_tools::UserError;
use host_tools::files::output;
use host_tools::plot::Format;
use serde_json::Value;

/// The file of a picture. Its name is checked before the work, and the file is written after the work.
#[derive(Clone, Copy)]
struct PictureFile<'a> {
    file: &'a Path,
    format: Format,
}

impl<'a> PictureFile<'a> {
    /// The file that a flag names. Its format must be supported, and the file must be writable.
    fn of(flag: &'static str, file: &'a Path) -> Result<Self, UserError> {
        output::check(flag, file)?;
        Ok(Self { file, format: Format::of(flag, file)? })
    }

    /// The file of `--plot`, where it is given.
    fn plot(file: Option<&'a Path>) -> Result<Option<Self>, UserError> {
        file.map(|file| Self::of("--plot", file)).transpose()
    }

    /// Writes the picture.
    fn write(self, svg: String) -> Result<()> {
        write(self.file, &self.format.encode(svg)?)
    }

    /// Writes the picture, and prints its path.
    fn write_and_note(self, svg: String) -> Result<()> {
        self.write(svg)?;
        note(&format!("picture: {}\n", self.file.display()));
        Ok(())
    }
}

/// Writes a complete file.
fn write(file: &Path, bytes: &[u8]) -> Result<()> {
    output::write_file(file, bytes).with_context(|| format!("cannot write {}", file.display()))
}

/// Writes to standard output.
fn print(bytes: &[u8]) -> Result<()> {
    output::write_stdout(bytes).context("cannot write to standard output")
}

/// Prints one JSON document. Its numbers have six decimals, because a micrometre is finer than any error.
fn print_json(document: &impl serde::Serialize) -> Result<()> {
    let mut document = serde_json::to_value(document).context("cannot write JSON")?;
    round(&mut document);
    let mut text = serde_json::to_vec_pretty(&document).context("cannot write JSON")?;
    text.push(b'\n');
    print(&text)
}

/// Prints a message for the user, which is not part of the data.
fn note(text: &str) {
    use std::io::Write;
    // If standard error is closed, the message is dropped.
    let _ = std::io::stderr().write_all(text.as_bytes());
}

/// Prints warnings, each on a line of its own.
fn warn(warnings: impl IntoIterator<Item = String>) {
    warnings.into_iter().for_each(|warning| note(&format!("warning: {warning}\n")));
}

fn round(value: &mut Value) {
    match value {
        Value::Number(number) if number.is_f64() => {
            let rounded = number.as_f64().map(|exact| (exact * 1e6).round() / 1e6);
            *value = rounded.into();
        }
        Value::Array(values) => values.iter_mut().for_each(round),
        Value::Object(fields) => fields.values_mut().for_each(round),
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => {}
    }
}
