//! Opens the stream of a file, of a recording's folder, or of all parts of a rotated recording, one after the other.

use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use super::Stream;
use crate::recorder::{STREAM, folders, other_nodes};
use recording::UserError;
use recording::inputs::note_read;
use wire::telemetry::{Address, Message};

/// The stream of a node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeStream {
    /// Its file, or the folder of a recording of one node.
    pub path: PathBuf,
    /// The node's address, where the input has the streams of several nodes.
    pub node: Option<String>,
}

/// The streams of an input: those of all nodes in the folder of a simulation, the first tag's at the beginning; else
/// one. There is at least one.
///
/// # Errors
/// A file cannot be read.
pub fn node_streams(input: &Path) -> Result<Vec<NodeStream>, UserError> {
    let others = if input.is_dir() { other_nodes(input) } else { BTreeMap::new() };
    if others.is_empty() {
        return Ok(vec![NodeStream { path: input.to_owned(), node: None }]);
    }
    let first = input.join(STREAM);
    // A simulation without tags has an empty stream.
    let first = address_of(&first)?.map(|node| NodeStream { path: first, node: Some(node) });
    let others = others.into_iter();
    let others = others.map(|(address, path)| NodeStream { path, node: Some(Address(address).to_string()) });
    Ok(first.into_iter().chain(others).collect())
}

/// The address of the node that a stream is of, as its first `Hello` says.
fn address_of(file: &Path) -> Result<Option<String>, UserError> {
    let (mut from, mut stream, mut chunk) = (StreamFiles::open(file)?, Stream::default(), vec![0; 1 << 12]);
    loop {
        let count = from.read(&mut chunk).map_err(|error| UserError::file(file, format!("cannot read it: {error}")))?;
        for byte in chunk.iter().take(count) {
            if let Some((_, Message::Hello(hello))) = stream.feed(*byte) {
                return Ok(Some(Address(hello.address).to_string()));
            }
        }
        if count == 0 {
            return Ok(None);
        }
    }
}

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
