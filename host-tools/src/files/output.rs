//! Outputs: each file is written completely or not at all, and standard output may be closed early.

use std::fs::{self, File};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::UserError;

/// Refuses an output file that cannot be written, before any work is done for it.
///
/// # Errors
/// The file is a folder, or its folder does not exist.
pub fn check(flag: &'static str, file: &Path) -> Result<(), UserError> {
    if file.is_dir() {
        return Err(UserError::flag(flag, format!("{} is a folder", file.display())));
    }
    let folder = folder_of(file);
    if file.file_name().is_none() || !folder.is_dir() {
        return Err(UserError::flag(flag, format!("the folder {} does not exist", folder.display())));
    }
    Ok(())
}

/// Writes a complete file: see [`Growing`].
///
/// # Errors
/// The file system returns an error.
pub fn write_file(file: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut growing = Growing::create(file)?;
    growing.write_all(bytes)?;
    growing.finish()
}

/// A file that is written under another name in the same folder, and moved to its place when it is complete. Until then
/// the place keeps its old content. A symbolic link stays a symbolic link. If the place is not a regular file (a pipe,
/// a terminal), it is written to directly.
#[derive(Debug)]
pub struct Growing {
    file: BufWriter<Target>,
}

#[derive(Debug)]
enum Target {
    Direct(File),
    Beside(NamedTempFile, PathBuf),
}

impl Growing {
    /// Begins a file.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn create(file: &Path) -> io::Result<Self> {
        let target = fs::canonicalize(file).unwrap_or_else(|_| file.to_owned());
        if fs::metadata(&target).is_ok_and(|metadata| !metadata.is_file()) {
            let direct = File::options().write(true).open(&target)?;
            return Ok(Self { file: BufWriter::new(Target::Direct(direct)) });
        }
        let mut builder = tempfile::Builder::new();
        builder.prefix(".baliza-");
        #[cfg(unix)]
        {
            // The permissions of any new file, without the bits of the process's mask. A temporary file would be
            // readable by its owner only.
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        let beside = builder.tempfile_in(folder_of(&target))?;
        Ok(Self { file: BufWriter::new(Target::Beside(beside, target)) })
    }

    /// Moves the file to its place.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn finish(self) -> io::Result<()> {
        match self.file.into_inner().map_err(io::IntoInnerError::into_error)? {
            Target::Direct(_) => Ok(()),
            Target::Beside(file, target) => Ok(file.persist(target).map(drop)?),
        }
    }
}

impl Write for Growing {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Write for Target {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Direct(file) => file.write(bytes),
            Self::Beside(file, _) => file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Direct(file) => file.flush(),
            Self::Beside(file, _) => file.flush(),
        }
    }
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

#[cfg(all(test, unix))]
mod tests {
    use std::fs;
    use std::os::unix::fs::{PermissionsExt, symlink};

    use super::{check, write_file};

    #[test]
    fn a_new_file_may_be_read_by_whom_any_new_file_may() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (usual, ours) = (folder.path().join("usual"), folder.path().join("ours"));
        fs::write(&usual, b"").expect("written");
        write_file(&ours, b"text").expect("written");
        let mode = |file| fs::metadata(file).expect("it is there").permissions().mode();
        assert_eq!(mode(&ours), mode(&usual));
    }

    #[test]
    fn a_link_stays_a_link_to_the_file_that_is_replaced() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        fs::write(&file, b"before").expect("written");
        symlink(&file, &link).expect("linked");
        write_file(&link, b"after").expect("written");
        assert!(fs::symlink_metadata(&link).expect("it is there").is_symlink());
        assert_eq!(fs::read(&file).expect("it is there"), b"after");
    }

    #[test]
    fn what_could_not_be_written_is_refused_before() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        assert!(check("--out", &folder.path().join("file")).is_ok());
        assert!(check("--out", folder.path()).is_err());
        assert!(check("--out", &folder.path().join("nowhere/file")).is_err());
    }
}
