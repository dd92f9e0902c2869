//! The subcommands, one module each: arguments, and what is printed.

mod answers;
pub mod bench;
pub mod ble;
pub mod calibrate;
pub mod coverage;
pub mod decode;
pub mod example;
pub mod monitor;
pub mod nlos;
pub mod place;
pub mod plot;
pub mod presence;
mod progress;
pub mod provision;
pub mod record;
mod recorded;
pub mod replay;
pub mod simulate;
pub mod solve;
mod stream;
pub mod survey;
pub mod track;

use std::path::Path;

use anyhow::{Context, Result};
use host_tools::UserError;
use host_tools::files::output;
use host_tools::plot::Format;
use serde_json::Value;

/// The file of a picture: its name is looked at before any work, it is written after all of it.
#[derive(Clone, Copy)]
struct PictureFile<'a> {
    file: &'a Path,
    format: Format,
}

impl<'a> PictureFile<'a> {
    /// The file that a flag names. It must be one that can be written, in a format that can be drawn.
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

    /// Writes the picture, and tells where it is.
    fn write_and_note(self, svg: String) -> Result<()> {
        self.write(svg)?;
        note(&format!("picture: {}\n", self.file.display()));
        Ok(())
    }
}

/// Writes a file as a whole.
fn write(file: &Path, bytes: &[u8]) -> Result<()> {
    output::write_file(file, bytes).with_context(|| format!("cannot write {}", file.display()))
}

/// Writes to standard output.
fn print(bytes: &[u8]) -> Result<()> {
    output::write_stdout(bytes).context("cannot write to standard output")
}

/// Prints one JSON document, its numbers to the sixth decimal: a micrometre is finer than any error.
fn print_json(document: &impl serde::Serialize) -> Result<()> {
    let mut document = serde_json::to_value(document).context("cannot write JSON")?;
    round(&mut document);
    let mut text = serde_json::to_vec_pretty(&document).context("cannot write JSON")?;
    text.push(b'\n');
    print(&text)
}

/// Tells the user something beside the data.
fn note(text: &str) {
    use std::io::Write;
    // Without standard error nobody listens.
    let _ = std::io::stderr().write_all(text.as_bytes());
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
