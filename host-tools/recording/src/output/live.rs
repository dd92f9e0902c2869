//! A file of a stream, which has its name from the first byte, because the stream may end at any moment.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// The interval between two writes to the disk: a loss of power loses no more.
const SYNC_EVERY: Duration = Duration::from_secs(10);

/// A file of a stream. Each write goes to the system at once, so that an end of the program loses nothing that was
/// written. A thread writes the file to the disk every ten seconds; a slow disk does not hold up the stream.
pub struct Live {
    file: File,
    written: u64,
    /// Ends the thread when it is dropped.
    more: Option<Sender<()>>,
    syncing: Option<JoinHandle<io::Result<()>>>,
}

impl Live {
    /// Begins a file, which must not exist.
    ///
    /// # Errors
    /// The file exists, or the file system returns an error.
    pub fn create(path: &Path) -> io::Result<Self> {
        let file = File::options().append(true).create_new(true).open(path)?;
        let synced = file.try_clone()?;
        let (more, over) = channel::<()>();
        let syncing = thread::Builder::new().spawn(move || {
            loop {
                match over.recv_timeout(SYNC_EVERY) {
                    Err(RecvTimeoutError::Timeout) => synced.sync_data()?,
                    Ok(()) | Err(RecvTimeoutError::Disconnected) => return Ok(()),
                }
            }
        })?;
        Ok(Self { file, written: 0, more: Some(more), syncing: Some(syncing) })
    }

    /// The length so far, bytes.
    pub fn written(&self) -> u64 {
        self.written
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// The file system returns an error, now or since the last call.
    pub fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        if self.syncing.as_ref().is_some_and(JoinHandle::is_finished) {
            self.join()?;
        }
        self.file.write_all(bytes)?;
        self.written += bytes.len() as u64;
        Ok(())
    }

    /// Writes the file to the disk.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn finish(mut self) -> io::Result<()> {
        self.more = None;
        self.join()?;
        self.file.sync_all()
    }

    /// The error of the thread that writes to the disk, after its end.
    fn join(&mut self) -> io::Result<()> {
        match self.syncing.take().map(JoinHandle::join) {
            Some(Ok(synced)) => synced,
            // The thread has no code that panics.
            Some(Err(_)) | None => Ok(()),
        }
    }
}
