//! The expected size of each image, as a file beside its board: `boards/<board>/expected/<image>.size`; and of images
//! that run in QEMU what they report, `<image>.log`. A change of an image so shows in the change that makes it.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use super::inspect::Sections;
use super::matrix::{self, NodeImage};
use crate::promises::first_difference;
use crate::{root, workspace};

/// How far an image may be off with the same compiler, percent: the folder of the sources decides the order of functions.
const SAME_COMPILER_PERCENT: u64 = 1;
/// How far an image may be off where another compiler than the file's has made it, percent.
const OTHER_COMPILER_PERCENT: u64 = 5;

/// The content of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Expected {
    /// The compiler's version, as it says it.
    pub compiler: String,
    pub sections: Sections,
}

impl Expected {
    fn text(&self) -> String {
        let Self { compiler, sections: Sections { text, data, bss } } = self;
        format!("text {text}\ndata {data}\nbss {bss}\nby {compiler}\n")
    }

    /// The content of a file; `None` where it is not understood.
    fn parse(text: &str) -> Option<Self> {
        let mut lines = text.lines();
        let mut value = |name: &str| Some(lines.next()?.strip_prefix(name)?.trim().to_owned());
        let [text, data, bss] = [value("text")?, value("data")?, value("bss")?];
        let sections = Sections { text: text.parse().ok()?, data: data.parse().ok()?, bss: bss.parse().ok()? };
        Some(Self { compiler: value("by")?, sections })
    }

    /// What is wrong with a built image; `None` if it is as expected.
    fn complaint(&self, built: &Self) -> Option<String> {
        let tolerance = if self.compiler == built.compiler { SAME_COMPILER_PERCENT } else { OTHER_COMPILER_PERCENT };
        let pairs = |of: &Sections| [("text", of.text), ("data", of.data), ("bss", of.bss)];
        let both = pairs(&self.sections).into_iter().zip(pairs(&built.sections));
        let is_off = |((_, old), (_, new)): &((&str, u64), (&str, u64))| 100 * old.abs_diff(*new) > tolerance * old;
        let changed = both.filter(is_off).map(|((name, old), (_, new))| format!("{name} {old} → {new}"));
        let changed = changed.collect::<Vec<_>>().join(", ");
        (!changed.is_empty()).then_some(changed)
    }
}

/// The file of an image with this ending.
fn file(image: &NodeImage, ending: &str) -> Result<PathBuf> {
    let packages = workspace::packages()?;
    let package = packages.iter().find(|package| package.name == image.package).context("an image without a crate")?;
    Ok(package.manifest_path.with_file_name("expected").join(format!("{}.{ending}", image.name)))
}

/// The file of the log of the image with this name.
fn log_file(name: &str) -> Result<PathBuf> {
    let images = matrix::images()?;
    file(images.iter().find(|image| image.name == name).with_context(|| format!("no image {name}"))?, "log")
}

/// Writes what an image reports.
///
/// # Errors
/// There is no such image, or the file cannot be written.
pub fn write_log(name: &str, log: &str) -> Result<()> {
    save(&log_file(name)?, log)
}

/// A log without its numbers: instants and ranges change with each build of an image, what is reported does not.
fn without_numbers(log: &str) -> String {
    let mut text = String::new();
    for letter in log.chars() {
        let is_number = letter.is_ascii_digit() || letter == '.' || letter == '-';
        if !is_number {
            text.push(letter);
        } else if !text.ends_with('#') {
            text.push('#');
        }
    }
    text
}

/// What is wrong with an image's log, in one line; `None` if it is as expected but for its numbers.
///
/// # Errors
/// There is no such image.
pub fn log_complaint(name: &str, log: &str) -> Result<Option<String>> {
    let file = log_file(name)?;
    let shown = file.strip_prefix(root()).unwrap_or(&file).display().to_string();
    let remedy = "`cargo xtask qemu network --document` writes it: say in the commit why it changes";
    let complaint = match fs::read_to_string(&file) {
        Err(_) => Some(format!("{shown} is missing; {remedy}")),
        Ok(expected) => first_difference(&without_numbers(&expected), &without_numbers(log))
            .map(|(line, old, new)| format!("{shown}:{line}: expected {old:?}, reported {new:?}; {remedy}")),
    };
    Ok(complaint)
}

fn save(file: &Path, text: &str) -> Result<()> {
    let folder = file.parent().unwrap_or(file);
    let written = fs::create_dir_all(folder).and_then(|()| fs::write(file, text));
    written.with_context(|| format!("cannot write {}", file.display()))
}

/// Writes the file of an image.
///
/// # Errors
/// It cannot be written.
pub fn write(image: &NodeImage, expected: &Expected) -> Result<()> {
    save(&file(image, "size")?, &expected.text())
}

/// Compares built images with their files.
///
/// # Errors
/// A file is missing, or an image has another size: one line for each.
pub fn compare<'r>(built: impl Iterator<Item = (&'r NodeImage, &'r Expected)>) -> Result<()> {
    let mut complaints = Vec::new();
    for (image, built) in built {
        let file = file(image, "size")?;
        let text = fs::read_to_string(&file).ok();
        let complaint = match text.as_deref().map(Expected::parse) {
            None => Some("is missing".to_owned()),
            Some(None) => Some("is not understood".to_owned()),
            Some(Some(expected)) => expected.complaint(built),
        };
        let name = file.strip_prefix(root()).unwrap_or(&file).display().to_string();
        complaints.extend(complaint.map(|complaint| format!("{name}: {complaint}")));
    }
    if complaints.is_empty() {
        return Ok(());
    }
    let remedy = "`cargo xtask firmware --document` writes these files: say in the commit why they change";
    bail!("images are not as expected:\n{}\n{remedy}", complaints.join("\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: u64, compiler: &str) -> Expected {
        Expected { compiler: compiler.to_owned(), sections: Sections { text, data: 16, bss: 800 } }
    }

    #[test]
    fn logs_are_compared_without_their_numbers() {
        assert_eq!(without_numbers("0.12 range 0x0101 -4.5 m"), without_numbers("0.9 range 0x0102 13.25 m"));
        assert_ne!(without_numbers("0.12 state joined"), without_numbers("0.12 state searching"));
    }

    #[test]
    fn a_file_is_read_as_it_is_written() {
        let expected = of(1000, "rustc 1.95.0 (abc 2026-01-01)");
        assert_eq!(expected.text(), "text 1000\ndata 16\nbss 800\nby rustc 1.95.0 (abc 2026-01-01)\n");
        assert_eq!(Expected::parse(&expected.text()), Some(expected));
        assert_eq!(Expected::parse("text 1\n"), None);
    }

    #[test]
    fn more_may_change_with_another_compiler() {
        assert_eq!(of(1000, "a").complaint(&of(1010, "a")), None);
        assert_eq!(of(1000, "a").complaint(&of(1011, "a")).as_deref(), Some("text 1000 → 1011"));
        assert_eq!(of(1000, "a").complaint(&of(1050, "b")), None);
        assert_eq!(of(1000, "a").complaint(&of(1051, "b")).as_deref(), Some("text 1000 → 1051"));
    }
}
