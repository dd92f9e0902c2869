//! The subcommands, one module each: arguments, and what is printed.

pub mod barral;
pub mod decode;
pub mod example;
pub mod garcia;
pub mod monitor;
pub mod nlos;
pub mod plot;
pub mod provision;
pub mod record;
mod recorded;
pub mod replay;
pub mod simulate;
pub mod solve;
mod stream;
pub mod thesis;
pub mod track;

use std::path::Path;

use anyhow::{Context, Result};
use host_tools::output;
use host_tools::plot::Format;

/// Writes a picture in the format that its name asks for.
fn write_picture(file: &Path, format: Format, svg: String) -> Result<()> {
    write(file, &format.encode(svg)?)
}

/// Writes a file as a whole.
fn write(file: &Path, bytes: &[u8]) -> Result<()> {
    output::write_file(file, bytes).with_context(|| format!("cannot write {}", file.display()))
}

/// Writes to standard output.
fn print(bytes: &[u8]) -> Result<()> {
    output::write_stdout(bytes).context("cannot write to standard output")
}

/// Prints one JSON document.
fn print_json(document: &impl serde::Serialize) -> Result<()> {
    let mut text = serde_json::to_vec_pretty(document).context("cannot write JSON")?;
    text.push(b'\n');
    print(&text)
}

/// Tells the user something beside the data.
fn tell(text: &str) {
    use std::io::Write;
    // Without standard error nobody listens.
    let _ = std::io::stderr().write_all(text.as_bytes());
}

/// A micrometre is finer than any error.
fn rounded(metres: f64) -> f64 {
    (metres * 1e6).round() / 1e6
}
