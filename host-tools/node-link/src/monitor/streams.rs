//! The sources for byte streams: standard input, and files.

use std::collections::VecDeque;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result};

use super::demux::Demux;
use super::source::{Event, NodeChannel, Source};
use crate::decode::{Chunks, StreamFiles, Waited};
use recording::UserError;

/// The number of bytes read at once.
const CHUNK: usize = 8192;
/// The number of bytes read at once from two files of one node. It is small, so that the two files stay in step.
const STEP: usize = 256;

/// A mixture from a pipe.
pub struct Piped {
    chunks: Chunks,
    demux: Demux,
    ready: VecDeque<Event>,
    ended: bool,
}

impl Piped {
    /// Reads in a thread of its own, as [`Chunks`] do.
    pub fn new(from: impl Read + Send + 'static) -> Self {
        Self { chunks: Chunks::new(from), demux: Demux::default(), ready: VecDeque::new(), ended: false }
    }
}

impl Source for Piped {
    fn next(&mut self, patience: Duration) -> Result<Option<Event>> {
        loop {
            if let Some(event) = self.ready.pop_front() {
                return Ok(Some(event));
            }
            if self.ended {
                return Ok(Some(Event::End));
            }
            match self.chunks.wait(patience).context("cannot read standard input")? {
                Waited::Bytes(chunk) => self.ready.extend(self.demux.feed(&chunk)),
                Waited::Nothing => return Ok(None),
                Waited::End => {
                    self.ready.extend(self.demux.finish());
                    self.ended = true;
                }
            }
        }
    }
}

/// Files: a mixture, and optionally the log in a file of its own.
pub struct Files {
    mixture: Part,
    log: Option<Part>,
    demux: Demux,
    ready: VecDeque<Event>,
}

struct Part {
    path: PathBuf,
    file: StreamFiles,
    read: u64,
    /// The number of bytes read at once.
    step: usize,
    ended: bool,
}

impl Files {
    /// Opens the files.
    ///
    /// # Errors
    /// A file cannot be opened.
    pub fn open(mixture: &Path, log: Option<&Path>) -> Result<Self, UserError> {
        Ok(Self {
            mixture: Part::open(mixture, if log.is_some() { STEP } else { CHUNK })?,
            log: log.map(|log| Part::open(log, STEP)).transpose()?,
            demux: Demux::default(),
            ready: VecDeque::new(),
        })
    }
}

impl Files {
    /// Whether the mixture is a pipe or a device, whose bytes may come from a node now.
    pub fn is_live(&self) -> bool {
        self.mixture.file.is_live()
    }
}

impl Part {
    fn open(path: &Path, step: usize) -> Result<Self, UserError> {
        let file = StreamFiles::open(path)?;
        Ok(Self { path: path.to_owned(), file, read: 0, step, ended: false })
    }

    fn read(&mut self) -> Result<Vec<u8>> {
        let mut chunk = vec![0; self.step];
        let count = self.file.read(&mut chunk).with_context(|| format!("cannot read {}", self.path.display()))?;
        chunk.truncate(count);
        self.ended = count == 0;
        self.read += count as u64;
        Ok(chunk)
    }

    /// The fraction of the file that is read. Both files are read in step, so that their lines come in the order of
    /// their arrival.
    fn progress(&self) -> f64 {
        if self.ended { f64::INFINITY } else { self.read as f64 / self.file.length().max(1) as f64 }
    }
}

impl Source for Files {
    fn next(&mut self, _patience: Duration) -> Result<Option<Event>> {
        loop {
            if let Some(event) = self.ready.pop_front() {
                return Ok(Some(event));
            }
            let behind = self.log.as_mut().filter(|log| !log.ended && log.progress() < self.mixture.progress());
            if let Some(log) = behind {
                let chunk = log.read()?;
                self.ready.push_back(Event::Bytes(NodeChannel::Log, chunk));
            } else if !self.mixture.ended {
                let chunk = self.mixture.read()?;
                let ended = self.mixture.ended;
                self.ready.extend(if ended { self.demux.finish() } else { self.demux.feed(&chunk) });
            } else {
                return Ok(Some(Event::End));
            }
        }
    }
}
