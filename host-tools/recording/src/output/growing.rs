//! A file that is written under another name in the same folder, and moved to its place when it is complete.

use std::fs::{self, File};
use std::io::{self, BufWriter, ErrorKind, Stdout, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::temporary::{new_file, without_path};
use super::{STANDARD, folder_of};
use crate::inputs::refuse_read;

/// A file in progress. Until it is complete, its place keeps the old content. It is on the disk before it is moved, so
/// that a loss of power leaves the old content or the new. A symbolic link stays a symbolic link. If the place is not a
/// regular file (a pipe, a terminal), or is called `-` (standard output), it is written to directly.
#[derive(Debug)]
pub struct Growing {
    file: BufWriter<Target>,
}

#[derive(Debug)]
enum Target {
    Standard(Stdout),
    Direct(File),
    Beside(NamedTempFile, PathBuf),
}

impl Growing {
    /// Begins a file with the permissions of any new file.
    ///
    /// # Errors
    /// The file is an input of this program, or the file system returns an error.
    pub fn create(file: &Path) -> io::Result<Self> {
        Self::with_mode(file, 0o666)
    }

    /// Begins a file that only its owner may read.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn create_private(file: &Path) -> io::Result<Self> {
        Self::with_mode(file, 0o600)
    }

    /// `mode`: the permissions on Unix, from which the mask of the process takes bits.
    fn with_mode(file: &Path, mode: u32) -> io::Result<Self> {
        if file.as_os_str() == STANDARD {
            return Ok(Self { file: BufWriter::new(Target::Standard(io::stdout())) });
        }
        refuse_read(file)?;
        let target = fs::canonicalize(file).unwrap_or_else(|_| file.to_owned());
        if fs::metadata(&target).is_ok_and(|metadata| !metadata.is_file()) {
            let direct = File::options().write(true).open(&target)?;
            return Ok(Self { file: BufWriter::new(Target::Direct(direct)) });
        }
        let beside = new_file(folder_of(&target), mode)?;
        Ok(Self { file: BufWriter::new(Target::Beside(beside, target)) })
    }

    /// Moves the file to its place.
    ///
    /// # Errors
    /// The file has become an input of this program, or the file system returns an error.
    pub fn finish(self) -> io::Result<()> {
        match self.file.into_inner().map_err(io::IntoInnerError::into_error)? {
            Target::Standard(mut stdout) => closed_is_done(stdout.flush()),
            Target::Direct(_) => Ok(()),
            Target::Beside(file, target) => {
                // What is named in an input is read after the output is begun.
                refuse_read(&target)?;
                file.as_file().sync_all()?;
                file.persist(&target).map_err(|error| without_path(error.error))?;
                sync_folder(folder_of(&target));
                Ok(())
            }
        }
    }
}

/// Writes the entries of a folder to the disk, on systems where a folder can be opened. A system that cannot do so
/// loses the entries only where it loses power within the next seconds.
pub(super) fn sync_folder(folder: &Path) {
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
}

/// A reader that closed its end (`| head`) needs no more.
fn closed_is_done(written: io::Result<()>) -> io::Result<()> {
    match written {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        other => other,
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
            Self::Standard(stdout) => closed_is_done(stdout.write_all(bytes)).map(|()| bytes.len()),
            Self::Direct(file) => file.write(bytes),
            Self::Beside(file, _) => file.as_file_mut().write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Standard(stdout) => closed_is_done(stdout.flush()),
            Self::Direct(file) => file.flush(),
            Self::Beside(file, _) => file.as_file_mut().flush(),
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::fs;
    use std::os::unix::fs::{PermissionsExt, symlink};

    use crate::output::{write_file, write_private_file};

    #[test]
    fn a_new_file_may_be_read_by_whom_any_new_file_may_and_a_private_one_by_its_owner() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let [usual, ours, private] = ["usual", "ours", "private"].map(|name| folder.path().join(name));
        fs::write(&usual, b"").expect("written");
        write_file(&ours, b"text").expect("written");
        // A file that others may read is replaced by one that they may not.
        fs::write(&private, b"").expect("written");
        write_private_file(&private, b"key").expect("written");
        let mode = |file| fs::metadata(file).expect("it is there").permissions().mode();
        assert_eq!(mode(&ours), mode(&usual));
        assert_eq!(mode(&private) & 0o777, 0o600);
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
}
