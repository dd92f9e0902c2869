//! Which files this program has read. No output replaces one of them, by whatever path, link or other file it was
//! named.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use crate::UserError;

static READ: Mutex<BTreeSet<FileIdentity>> = Mutex::new(BTreeSet::new());

/// What is the same for all paths that lead to one file or folder. The time at which the file was made is part of it,
/// because the number of a file that is gone is used again.
#[cfg(unix)]
pub type FileIdentity = (u64, u64, Option<std::time::SystemTime>);

/// What is the same for all paths that lead to one file or folder.
#[cfg(not(unix))]
pub type FileIdentity = std::path::PathBuf;

/// The identity of a file or folder. A pipe, a terminal and `/dev/null` have none: they may be both input and output.
pub fn identity(path: &Path) -> Option<FileIdentity> {
    let metadata = fs::metadata(path).ok().filter(|metadata| metadata.is_file() || metadata.is_dir())?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        Some((metadata.dev(), metadata.ino(), metadata.created().ok()))
    }
    #[cfg(not(unix))]
    {
        let _ = metadata;
        fs::canonicalize(path).ok()
    }
}

/// Notes that a file is read.
pub fn note_read(file: &Path) {
    READ.lock().unwrap_or_else(PoisonError::into_inner).extend(identity(file));
}

/// Notes that a file that was read is continued: its output has what was read.
pub fn continue_read(file: &Path) {
    if let Some(identity) = identity(file) {
        READ.lock().unwrap_or_else(PoisonError::into_inner).remove(&identity);
    }
}

/// Refuses to write a file that was read.
///
/// # Errors
/// It was read: a [`UserError`] within the error.
pub(crate) fn refuse_read(file: &Path) -> io::Result<()> {
    let read = READ.lock().unwrap_or_else(PoisonError::into_inner);
    if identity(file).is_some_and(|identity| read.contains(&identity)) {
        return Err(io::Error::other(UserError::file(
            file,
            "it is an input as well; name another file for the output",
        )));
    }
    Ok(())
}
