//! Reads a file or a pipe in a way that lets the caller stop waiting.

use std::io::{self, ErrorKind, Read};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread;
use std::time::Duration;

/// The number of bytes read at once.
const CHUNK: usize = 1 << 16;
/// The number of chunks read ahead.
const AHEAD: usize = 4;

/// The result of waiting for bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Waited {
    /// Received bytes.
    Bytes(Vec<u8>),
    /// No bytes yet.
    Nothing,
    /// The stream has ended.
    End,
}

/// The bytes of a reader, chunk by chunk.
pub struct Chunks {
    chunks: Receiver<io::Result<Vec<u8>>>,
}

impl Chunks {
    /// Reads in a thread of its own, which runs until the reader ends, because waiting for a pipe has no timeout.
    pub fn new(mut from: impl Read + Send + 'static) -> Self {
        let (to, chunks) = sync_channel(AHEAD);
        thread::spawn(move || {
            loop {
                let mut chunk = vec![0; CHUNK];
                let read = match from.read(&mut chunk) {
                    Ok(0) => break,
                    Ok(count) => {
                        chunk.truncate(count);
                        Ok(chunk)
                    }
                    Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                    Err(error) => Err(error),
                };
                let failed = read.is_err();
                // If the receiver is gone, the thread ends.
                if to.send(read).is_err() || failed {
                    break;
                }
            }
        });
        Self { chunks }
    }

    /// Waits for the next bytes, for `patience` at most.
    ///
    /// # Errors
    /// The reader returns an error.
    pub fn wait(&self, patience: Duration) -> io::Result<Waited> {
        match self.chunks.recv_timeout(patience) {
            Ok(chunk) => chunk.map(Waited::Bytes),
            Err(RecvTimeoutError::Timeout) => Ok(Waited::Nothing),
            Err(RecvTimeoutError::Disconnected) => Ok(Waited::End),
        }
    }
}
