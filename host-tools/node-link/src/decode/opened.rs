//! Opens the stream of a file, of a recording's folder, or of all parts of a rotated recording, one after the other.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use crate::recorder::{STREAM, folders};
use recording::UserError;
use recording::inputs::note_read;

/// A stream from files.
#[derive(Debug)]
pub struct StreamFiles {
    current: File,
    /// The files that follow.
    rest: VecDeque<PathBuf>,
    /// The number of bytes in all files; 0 where the file is a pipe or a device.
    length: u64,
    is_live: bool,
}

impl StreamFiles {
    /// Opens a stream's file, or the stream in the folder of a recording.
    ///
    /// # Errors
    /// A file cannot be opened.
    pub fn open(path: &Path) -> Result<Self, UserError> {
        let files = if path.is_dir() {
            folders(path).into_iter().map(|folder| folder.join(STREAM)).collect()
        } else {
            vec![path.to_owned()]
        };
        let mut length = 0;
        let mut is_live = false;
        for file in &files {
            let cannot = |error| UserError::file(file, format!("cannot open it: {error}"));
            let metadata = file.metadata().map_err(cannot)?;
            if metadata.is_dir() {
                return Err(UserError::file(file, "it is a folder"));
            }
            note_read(file);
            length += metadata.len();
            is_live |= !metadata.is_file();
        }
        let mut rest = VecDeque::from(files);
        let first = rest.pop_front().unwrap_or_else(|| path.join(STREAM));
        log::info!("reading {}, {length} bytes", path.display());
        let current =
            File::open(&first).map_err(|error| UserError::file(&first, format!("cannot open it: {error}")))?;
        Ok(Self { current, rest, length, is_live })
    }

    /// The number of bytes; 0 where it is a pipe or a device.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Whether it is a pipe or a device, whose bytes may come from a node now.
    pub fn is_live(&self) -> bool {
        self.is_live
    }
}

impl Read for StreamFiles {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            let count = self.current.read(buffer)?;
            if count > 0 || buffer.is_empty() {
                return Ok(count);
            }
            match self.rest.pop_front() {
                Some(next) => self.current = File::open(next)?,
                None => return Ok(0),
            }
        }
    }
}
