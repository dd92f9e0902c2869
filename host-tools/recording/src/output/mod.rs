//! Outputs. A document is a [`Growing`] file: it is written completely or not at all. The files of an [`OutputFolder`]
//! appear together, in place of those of an earlier run. A [`Live`] file holds a stream that may end at any moment: it
//! has its name from the first byte. Standard output may be closed early.

mod folder;
mod growing;
mod live;
mod temporary;

use std::io::{self, ErrorKind, Write};
use std::path::Path;

use crate::UserError;

pub use folder::{Ours, OutputFolder, clear, refuse_existing};
pub use growing::Growing;
pub use live::Live;

/// Refuses an output file that cannot be written, before any work is done for it.
///
/// # Errors
/// The file is a folder, or its folder does not exist.
pub fn check(flag: &'static str, file: &Path) -> Result<(), UserError> {
    if file.as_os_str() == STANDARD {
        return Ok(());
    }
    if file.is_dir() {
        return Err(UserError::flag(flag, format!("{} is a folder", file.display())));
    }
    let folder = folder_of(file);
    if file.file_name().is_none() || !folder.is_dir() {
        return Err(UserError::flag(flag, format!("the folder {} does not exist", folder.display())));
    }
    Ok(())
}

/// The name of a file that stands for standard output, or for standard input.
pub const STANDARD: &str = "-";

/// Writes a complete file: see [`Growing`].
///
/// # Errors
/// The file system returns an error.
pub fn write_file(file: &Path, bytes: &[u8]) -> io::Result<()> {
    write_whole(Growing::create(file)?, bytes)
}

/// Writes a complete file that only its owner may read: see [`Growing`].
///
/// # Errors
/// The file system returns an error.
pub fn write_private_file(file: &Path, bytes: &[u8]) -> io::Result<()> {
    write_whole(Growing::create_private(file)?, bytes)
}

fn write_whole(mut growing: Growing, bytes: &[u8]) -> io::Result<()> {
    growing.write_all(bytes)?;
    growing.finish()
}

/// Writes to standard output. A reader that closed its end (`| head`) is not an error.
///
/// # Errors
/// Any other failure.
pub fn write_stdout(bytes: &[u8]) -> io::Result<()> {
    feed_stdout(bytes).map(drop)
}

/// Writes to standard output, and returns whether the reader still reads.
///
/// # Errors
/// Any failure except a reader that closed its end.
pub fn feed_stdout(bytes: &[u8]) -> io::Result<bool> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(bytes).and_then(|()| stdout.flush()) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
        Err(error) => Err(error),
    }
}

fn folder_of(file: &Path) -> &Path {
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        Some(_) | None => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn what_could_not_be_written_is_refused_before() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        assert!(check("--out", &folder.path().join("file")).is_ok());
        assert!(check("--out", folder.path()).is_err());
        assert!(check("--out", &folder.path().join("nowhere/file")).is_err());
    }
}
