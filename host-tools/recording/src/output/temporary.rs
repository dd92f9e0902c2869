//! Outputs in progress: a file or a folder `.baliza-XXXXXX.tmp`, hidden beside the place where it will appear.
//!
//! It is locked while it is in use, and the system releases the locks of a program that is killed. So the next command
//! that writes to the same folder can recognise what such a program has left, and removes it ([`remove_stale`]).

use std::ffi::OsStr;
use std::fs::{self, DirEntry, File, Permissions};
use std::io;
use std::path::{Path, PathBuf};

use tempfile::{NamedTempFile, TempDir};

use super::Ours;

const PREFIX: &str = ".baliza-";
/// An output in progress. All that is in it was made by the program, or is also elsewhere.
const NEW: &str = ".tmp";
/// A folder that was replaced by another one. It may have a file of the user that is nowhere else.
const REPLACED: &str = ".old";
/// The number of random characters in a name.
const RANDOM: usize = 6;

/// Makes a file in progress. `mode`: the permissions on Unix, from which the mask of the process takes bits.
pub(super) fn new_file(folder: &Path, mode: u32) -> io::Result<NamedTempFile> {
    remove_stale(folder, &|_| false);
    loop {
        let made = builder(mode).tempfile_in(folder).map_err(without_path)?;
        if lock(made.as_file(), made.path()) {
            return Ok(made);
        }
    }
}

/// Makes a folder in progress. Returns it with its lock, on systems that can lock folders.
pub(super) fn new_folder(folder: &Path) -> io::Result<(TempDir, Option<File>)> {
    loop {
        let made = builder(0o777).tempdir_in(folder).map_err(without_path)?;
        match File::open(made.path()) {
            Ok(opened) if lock(&opened, made.path()) => return Ok((made, Some(opened))),
            // Another program has removed it.
            Ok(_) => {}
            Err(_) => return Ok((made, None)),
        }
    }
}

/// Locks a folder that is to be replaced, on systems that can lock folders.
pub(super) fn lock_replaced(folder: &Path) -> Option<File> {
    File::open(folder).ok().filter(|opened| opened.try_lock().is_ok())
}

/// The name of a folder in progress from the moment at which it may be the folder that was replaced.
pub(super) fn replaced_name(made: &Path) -> PathBuf {
    made.with_extension(&REPLACED[1..])
}

/// Removes what programs that were killed have left in a folder. What a running program has locked stays. Of a folder
/// that was replaced, only files that `ours` knows and files with a second name are removed.
///
/// A failure is no error: what is left over takes space, but does not stand in the way.
pub(super) fn remove_stale(folder: &Path, ours: &Ours<'_>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let removed = match kind(&entry.file_name()) {
            Some(NEW) => remove_new(&entry),
            Some(REPLACED) => remove_replaced(&entry.path(), ours),
            Some(_) | None => continue,
        };
        log::info!("{}, which a program that was killed has left: {removed:?}", entry.path().display());
    }
}

/// The extension of a temporary name; `None` for any other name.
fn kind(name: &OsStr) -> Option<&'static str> {
    let rest = name.to_str()?.strip_prefix(PREFIX)?;
    let (random, extension) = rest.split_at_checked(RANDOM)?;
    let is_random = random.bytes().all(|byte| byte.is_ascii_alphanumeric());
    [NEW, REPLACED].into_iter().find(|kind| is_random && *kind == extension)
}

fn remove_new(entry: &DirEntry) -> io::Result<()> {
    let (path, file_type) = (entry.path(), entry.file_type()?);
    if file_type.is_dir() {
        let opened = File::open(&path)?;
        opened.try_lock()?;
        fs::remove_dir_all(path)
    } else if file_type.is_file() {
        // Some network file systems lock only files that are open for writing.
        let opened = File::options().read(true).write(true).open(&path)?;
        opened.try_lock()?;
        fs::remove_file(path)
    } else {
        Ok(())
    }
}

fn remove_replaced(folder: &Path, ours: &Ours<'_>) -> io::Result<()> {
    let opened = File::open(folder)?;
    opened.try_lock()?;
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_name().to_str().is_some_and(ours) || has_second_name(&entry)? {
            fs::remove_file(entry.path())?;
        }
    }
    fs::remove_dir(folder)
}

#[cfg(unix)]
fn has_second_name(entry: &DirEntry) -> io::Result<bool> {
    use std::os::unix::fs::MetadataExt;
    entry.metadata().map(|metadata| metadata.is_file() && metadata.nlink() > 1)
}

#[cfg(not(unix))]
fn has_second_name(_entry: &DirEntry) -> io::Result<bool> {
    Ok(false)
}

/// Locks an output that was just made. False where another program has removed it before it was locked.
fn lock(opened: &File, path: &Path) -> bool {
    // On a file system without locks nobody removes it.
    opened.lock().is_err() || path.exists()
}

fn builder(mode: u32) -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX).suffix(NEW).rand_bytes(RANDOM);
    if let Some(permissions) = permissions(mode) {
        builder.permissions(permissions);
    }
    builder
}

/// The permissions of a mode, on systems that have modes.
#[cfg(unix)]
#[allow(clippy::unnecessary_wraps, reason = "other systems have no modes")]
fn permissions(mode: u32) -> Option<Permissions> {
    use std::os::unix::fs::PermissionsExt;
    Some(Permissions::from_mode(mode))
}

#[cfg(not(unix))]
fn permissions(_mode: u32) -> Option<Permissions> {
    None
}

/// The system's error, without the name of the temporary file, which the user does not know.
pub(super) fn without_path(error: io::Error) -> io::Error {
    let text = error.to_string();
    match text.split_once(" at path ") {
        Some((what, _)) => io::Error::new(error.kind(), what),
        None => error,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).expect("a folder");
        let mut names: Vec<_> =
            entries.map(|entry| entry.expect("an entry").file_name().into_string().expect("UTF-8")).collect();
        names.sort();
        names
    }

    #[test]
    fn the_next_output_removes_those_that_nobody_has_locked() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path();
        let running = new_file(path, 0o666).expect("made");
        let (running_folder, _lock) = new_folder(path).expect("made");
        // As a program that was killed leaves them.
        fs::write(path.join(".baliza-aB3dE6.tmp"), b"half").expect("written");
        fs::create_dir(path.join(".baliza-000000.tmp")).expect("made");
        fs::write(path.join(".baliza-000000.tmp/ranges.csv"), b"half").expect("written");
        // Other names.
        let others = [".baliza-backup", ".baliza-my own.tmp", "baliza-aB3dE6.tmp"];
        others.iter().for_each(|name| fs::write(path.join(name), b"mine").expect("written"));
        let next = new_file(path, 0o666).expect("made");
        let made = [running.path(), running_folder.path(), next.path()];
        let made = made.map(|made| made.file_name().expect("a name").to_str().expect("UTF-8").to_owned());
        let mut expected = [others.map(str::to_owned), made].concat();
        expected.sort();
        assert_eq!(names(path), expected);
    }

    #[cfg(unix)]
    #[test]
    fn of_a_folder_that_was_replaced_a_file_of_the_user_stays() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let old = folder.path().join(".baliza-aB3dE6.old");
        let ours = |name: &str| name == "ranges.csv";
        fs::create_dir(&old).expect("made");
        fs::write(old.join("ranges.csv"), b"replaced").expect("written");
        fs::write(old.join("late.txt"), b"mine").expect("written");
        fs::write(folder.path().join("notes.txt"), b"mine").expect("written");
        fs::hard_link(folder.path().join("notes.txt"), old.join("notes.txt")).expect("linked");
        remove_stale(folder.path(), &ours);
        assert_eq!(names(&old), ["late.txt"]);
        fs::rename(old.join("late.txt"), folder.path().join("late.txt")).expect("moved");
        remove_stale(folder.path(), &ours);
        assert_eq!(names(folder.path()), ["late.txt", "notes.txt"]);
    }
}
