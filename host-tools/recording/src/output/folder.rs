//! The files of a run that appear in their folder together, in place of those of an earlier run.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use tempfile::TempDir;

use super::growing::sync_folder;
use super::temporary::{lock_replaced, new_folder, remove_stale, replaced_name};
use super::{folder_of, write_private_file};
use crate::UserError;

/// Which names the files of a command have. Files with other names belong to somebody else, and stay.
pub type Ours<'a> = dyn Fn(&str) -> bool + 'a;

/// Refuses a folder that cannot take the files of a run: with `force`, they may be there already.
///
/// # Errors
/// The path is not a folder, cannot be read, or has files of an earlier run.
pub fn refuse_existing(flag: &'static str, folder: &Path, ours: &Ours<'_>, force: bool) -> Result<(), UserError> {
    if folder.as_os_str() == super::STANDARD {
        return Err(UserError::flag(flag, "a folder is needed, not standard output"));
    }
    if !folder.exists() {
        return Ok(());
    }
    if !folder.is_dir() {
        return Err(UserError::flag(flag, format!("{} is not a folder", folder.display())));
    }
    let names = names(folder).map_err(|error| UserError::flag(flag, format!("{}: {error}", folder.display())))?;
    match names.iter().filter_map(|name| name.to_str()).find(|name| ours(name)) {
        Some(name) if !force => {
            Err(UserError::flag(flag, format!("{} has {name} already; --force replaces it", folder.display())))
        }
        Some(_) | None => Ok(()),
    }
}

/// Removes the files of an earlier run.
///
/// # Errors
/// The file system returns an error.
pub fn clear(folder: &Path, ours: &Ours<'_>) -> io::Result<()> {
    for name in names(folder)?.iter().filter(|name| name.to_str().is_some_and(ours)) {
        fs::remove_file(folder.join(name))?;
    }
    Ok(())
}

/// The names of everything in a folder, sorted.
fn names(folder: &Path) -> io::Result<Vec<OsString>> {
    let mut names =
        fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.file_name())).collect::<io::Result<Vec<_>>>()?;
    names.sort();
    Ok(names)
}

/// A folder of files that is being made. Until [`OutputFolder::finish`], its place keeps what it has.
pub struct OutputFolder {
    /// The folder, without symbolic links.
    place: PathBuf,
    /// The folder with the new files, beside its place; within it where the place cannot be exchanged.
    made: TempDir,
    ours: Box<Ours<'static>>,
    /// The lock of the new folder: it is released after the folder has its place, or is removed.
    _lock: Option<File>,
}

impl OutputFolder {
    /// Begins a folder whose files have names that `ours` knows.
    ///
    /// # Errors
    /// As [`refuse_existing`], or the file system returns an error.
    pub fn begin(
        flag: &'static str,
        folder: &Path,
        ours: impl Fn(&str) -> bool + 'static,
        force: bool,
    ) -> Result<Self> {
        refuse_existing(flag, folder, &ours, force)?;
        let cannot = || format!("cannot make the folder {}", folder.display());
        let place = fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
        let parent = folder_of(&place);
        fs::create_dir_all(parent).with_context(cannot)?;
        for folder in [parent, &place] {
            remove_stale(folder, &ours);
        }
        let made = if !place.exists() || is_exchangeable(&place) {
            new_folder(parent).or_else(|error| if place.exists() { new_folder(&place) } else { Err(error) })
        } else {
            new_folder(&place)
        };
        let (made, lock) = made.with_context(cannot)?;
        Ok(Self { place, made, ours: Box::new(ours), _lock: lock })
    }

    /// Where the files are written.
    pub fn path(&self) -> &Path {
        self.made.path()
    }

    /// Adds a file.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn write(&self, name: &str, bytes: &[u8]) -> io::Result<()> {
        fs::write(self.made.path().join(name), bytes)
    }

    /// Adds a file that only its owner may read.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn write_private(&self, name: &str, bytes: &[u8]) -> io::Result<()> {
        write_private_file(&self.made.path().join(name), bytes)
    }

    /// Writes the files to the disk, and lets them appear in place of those of an earlier run.
    ///
    /// In a new folder, and on Linux and macOS also in an existing one, all appear at one instant. Where the existing
    /// folder is the current one, has folders in it, or is on a file system that cannot exchange two folders, the files
    /// are moved one after another.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn finish(self) -> io::Result<()> {
        let new = names(self.made.path())?;
        for name in &new {
            File::open(self.made.path().join(name))?.sync_all()?;
        }
        sync_folder(self.made.path());
        if !self.place.exists() {
            // The folder has another name now, and must not be removed under it.
            fs::rename(self.made.path(), &self.place)?;
            let _ = self.made.keep();
        } else if !(self.is_beside() && self.exchange()?) {
            clear(&self.place, &|name| (self.ours)(name) && !new.iter().any(|new| new == name))?;
            for name in &new {
                fs::rename(self.made.path().join(name), self.place.join(name))?;
            }
        }
        sync_folder(folder_of(&self.place));
        Ok(())
    }

    fn is_beside(&self) -> bool {
        self.made.path().parent() == self.place.parent()
    }

    /// Exchanges the new folder for the old one, after the files of others are in both, and removes the old one. False
    /// where that is not possible.
    fn exchange(&self) -> io::Result<bool> {
        let mut linked = Vec::new();
        let mut others = names(&self.place)?.into_iter().filter(|name| !name.to_str().is_some_and(&self.ours));
        let all = others.all(|name| {
            let is_linked = fs::hard_link(self.place.join(&name), self.made.path().join(&name)).is_ok();
            linked.extend(is_linked.then_some(name));
            is_linked
        });
        if all {
            fs::set_permissions(self.made.path(), fs::metadata(&self.place)?.permissions())?;
            let _lock = lock_replaced(&self.place);
            let old = replaced_name(self.made.path());
            fs::rename(self.made.path(), &old)?;
            if exchange(&old, &self.place).is_ok() {
                remove_old(&old, &self.place, &self.ours)?;
                return Ok(true);
            }
            fs::rename(&old, self.made.path())?;
        }
        for name in linked {
            fs::remove_file(self.made.path().join(name))?;
        }
        Ok(false)
    }
}

/// Removes a folder that was exchanged. A file of others that came after the files were listed goes to the new folder.
fn remove_old(old: &Path, new: &Path, ours: &Ours<'_>) -> io::Result<()> {
    for name in names(old)? {
        let (from, to) = (old.join(&name), new.join(&name));
        if name.to_str().is_some_and(ours) || fs::symlink_metadata(&to).is_ok() {
            fs::remove_file(from)?;
        } else {
            fs::rename(from, to)?;
        }
    }
    fs::remove_dir(old)
}

/// Whether a folder can be replaced by another one: it is not a file system of its own, and the shell is not in it.
#[cfg(any(target_os = "linux", target_vendor = "apple"))]
fn is_exchangeable(place: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let device = |path: &Path| fs::metadata(path).map(|metadata| metadata.dev()).ok();
    let is_current = std::env::current_dir().is_ok_and(|current| current.starts_with(place));
    !is_current && device(place) == device(folder_of(place))
}

#[cfg(not(any(target_os = "linux", target_vendor = "apple")))]
fn is_exchangeable(_place: &Path) -> bool {
    false
}

#[cfg(any(target_os = "linux", target_vendor = "apple"))]
fn exchange(one: &Path, other: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, one, CWD, other, RenameFlags::EXCHANGE)?)
}

#[cfg(not(any(target_os = "linux", target_vendor = "apple")))]
fn exchange(_one: &Path, _other: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::*;

    fn ours(name: &str) -> bool {
        Path::new(name).extension().is_some_and(|extension| extension == "csv")
    }

    /// Writes these files by a run.
    fn run(folder: &Path, files: &[&str], force: bool) -> Result<()> {
        let output = OutputFolder::begin("--out", folder, ours, force)?;
        for name in files {
            fs::write(output.path().join(name), name.as_bytes())?;
        }
        Ok(output.finish()?)
    }

    fn listed(folder: &Path) -> Vec<String> {
        names(folder).expect("a folder").into_iter().map(|name| name.into_string().expect("UTF-8")).collect()
    }

    #[test]
    fn a_second_run_leaves_no_file_of_the_first_one_and_keeps_those_of_others() {
        let above = tempfile::tempdir().expect("a temporary folder");
        let folder = above.path().join("new/run");
        run(&folder, &["a.csv", "b.csv"], false).expect("a new folder");
        fs::write(folder.join("notes.txt"), b"mine").expect("written");
        let refused = run(&folder, &["b.csv", "c.csv"], false).expect_err("there already").to_string();
        assert_eq!(refused, format!("--out: {} has a.csv already; --force replaces it", folder.display()));
        run(&folder, &["b.csv", "c.csv"], true).expect("replaced");
        assert_eq!(listed(&folder), ["b.csv", "c.csv", "notes.txt"]);
        // With a folder of others in it, the folder cannot be exchanged.
        fs::create_dir(folder.join("others")).expect("made");
        run(&folder, &["d.csv"], true).expect("replaced");
        assert_eq!(listed(&folder), ["d.csv", "notes.txt", "others"]);
        assert_eq!(fs::read(folder.join("notes.txt")).expect("it is there"), b"mine");
        assert_eq!(listed(folder.parent().expect("it has one")), ["run"], "nothing hidden is left");
    }

    #[test]
    fn a_run_that_does_not_finish_leaves_all_as_it_was() {
        let above = tempfile::tempdir().expect("a temporary folder");
        let folder = above.path().join("run");
        run(&folder, &["a.csv"], false).expect("a new folder");
        let output = OutputFolder::begin("--out", &folder, ours, true).expect("begun");
        fs::write(output.path().join("b.csv"), b"half").expect("written");
        drop(output);
        assert_eq!((listed(&folder), listed(above.path())), (vec!["a.csv".to_owned()], vec!["run".to_owned()]));
    }
}
