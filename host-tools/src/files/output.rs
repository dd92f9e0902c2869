//! Where results go: whole files or none, and a standard output that may be closed early.

use std::fs::{self, File};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::UserError;

/// Refuses an output file that could not be written, before any work is done for it.
///
/// # Errors
/// It is a folder, or its folder does not exist.
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

/// Writes a file as a whole: see [`Growing`].
///
/// # Errors
/// The file system's.
pub fn write_file(file: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut growing = Growing::create(file)?;
    growing.write_all(bytes)?;
    growing.finish()
}

/// A file that is written beside its place, and put there once it is whole; until then, and if it never is, the place keeps
/// what it had. A symbolic link stays one; what is not a regular file (a pipe, a terminal) is written to directly.
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
    /// The file system's.
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
            // What any new file gets, less the process's mask: a temporary one would be its owner's alone.
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        let beside = builder.tempfile_in(folder_of(&target))?;
        Ok(Self { file: BufWriter::new(Target::Beside(beside, target)) })
    }

    /// Puts the file in its place.
    ///
    /// # Errors
    /// The file system's.
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

/// Writes to standard output. A reader that went away (`| head`) has what it wanted.
///
/// # Errors
/// Any other failure.
pub fn write_stdout(bytes: &[u8]) -> io::Result<()> {
    feed_stdout(bytes).map(drop)
}

/// Writes to standard output, and says whether anybody reads on.
///
/// # Errors
/// Any failure but a reader that went away.
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
