//! The queue on disk: datagrams that wait for a receipt, in the order of their making.
//!
//! ```text
//!              sent                    receipt                   RETAINED
//!   Waiting ─────────▶ Sent ────────────────────▶ Taken(at) ──────────────▶ its file is deleted
//!      ▲                 │ no receipt for a while      │ another run of the station
//!      └─────────────────┴─────────────────────────────┘
//! ```
//!
//! A file has many datagrams, each behind its length. A station writes to its store twice a second, so what it has taken
//! is kept for some seconds, for a station that is killed. A program that ends in between sends a file's datagrams again;
//! the station knows them.

use std::collections::VecDeque;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use wire::datagram::{Datagram, Envelope, MAX_DATAGRAM, parse};

/// Bytes after which the next file begins.
const FILE_BYTES: u64 = 1 << 20;
/// How long datagrams are kept that were taken.
const RETAINED: Duration = Duration::from_secs(5);
/// What the files are called: `00000001.datagrams`.
const EXTENSION: &str = "datagrams";

/// Where a datagram is: the number of its file, and its place there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Place {
    file: u64,
    index: usize,
}

/// What has become of a datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    Waiting,
    Sent,
    Taken(Instant),
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    /// Where it begins in its file.
    at: u64,
    length: u16,
    fate: Fate,
}

/// A file of the queue.
struct Part {
    number: u64,
    path: PathBuf,
    file: File,
    bytes: u64,
    entries: Vec<Entry>,
}

/// The queue.
pub(super) struct Queue {
    folder: PathBuf,
    parts: VecDeque<Part>,
    /// Before it nothing waits.
    cursor: Place,
    most_bytes: u64,
    /// Datagrams that were deleted because the queue was full.
    lost: u64,
    /// Only one program uses the folder.
    _lock: File,
}

impl Queue {
    /// The queue in a folder, which is made if it does not exist, of at most `most_bytes`.
    ///
    /// # Errors
    /// The folder cannot be used, or another program uses it.
    pub(super) fn open(folder: &Path, most_bytes: u64) -> Result<Self> {
        let cannot = || format!("cannot use the folder {}", folder.display());
        fs::create_dir_all(folder).with_context(cannot)?;
        let lock = File::create(folder.join("lock")).with_context(cannot)?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                bail!("another baliza forward uses the folder {}: --queue takes another one", folder.display())
            }
            Err(TryLockError::Error(error)) => return Err(error).with_context(cannot),
        }
        let mut numbers = Vec::new();
        for entry in fs::read_dir(folder).with_context(cannot)? {
            let path = entry.with_context(cannot)?.path();
            let is_part = path.extension().is_some_and(|extension| extension == EXTENSION);
            let number = path.file_stem().and_then(|stem| stem.to_str()?.parse::<u64>().ok());
            numbers.extend(number.filter(|_| is_part).map(|number| (number, path)));
        }
        numbers.sort_unstable();
        let mut parts = VecDeque::new();
        for (number, path) in numbers {
            parts.push_back(Part::read(number, path).with_context(cannot)?);
        }
        let cursor = Place { file: 0, index: 0 };
        Ok(Self { folder: folder.to_owned(), parts, cursor, most_bytes, lost: 0, _lock: lock })
    }

    /// Adds a datagram, which counts as sent.
    ///
    /// # Errors
    /// The disk does not take it.
    pub(super) fn push(&mut self, envelope: &Envelope<'_>) -> Result<Place> {
        let mut bytes = [0; MAX_DATAGRAM];
        let length = envelope.emit(false, &mut bytes).context("a datagram is too long")?;
        if self.parts.back().is_none_or(|last| last.bytes >= FILE_BYTES) {
            let number = self.parts.back().map_or(1, |last| last.number + 1);
            let path = self.folder.join(format!("{number:08}.{EXTENSION}"));
            self.parts.push_back(Part::make(number, path)?);
        }
        let last = self.parts.back_mut().context("there is a file")?;
        last.push(bytes.get(..length).unwrap_or_default())?;
        let place = Place { file: last.number, index: last.entries.len() - 1 };
        while self.bytes() > self.most_bytes && self.parts.len() > 1 {
            if let Some(oldest) = self.parts.pop_front() {
                self.lost += oldest.entries.iter().filter(|entry| !matches!(entry.fate, Fate::Taken(_))).count() as u64;
                oldest.delete();
            }
        }
        Ok(place)
    }

    fn bytes(&self) -> u64 {
        self.parts.iter().map(|part| part.bytes).sum()
    }

    /// Bytes of all that was not taken.
    pub(super) fn untaken_bytes(&self) -> u64 {
        let entries = self.parts.iter().flat_map(|part| &part.entries);
        entries.filter(|entry| !matches!(entry.fate, Fate::Taken(_))).map(|entry| u64::from(entry.length)).sum()
    }

    /// Datagrams that were deleted because the queue was full, since the last call.
    pub(super) fn take_lost(&mut self) -> u64 {
        std::mem::take(&mut self.lost)
    }

    fn part(&mut self, number: u64) -> Option<&mut Part> {
        let index = self.parts.binary_search_by_key(&number, |part| part.number).ok()?;
        self.parts.get_mut(index)
    }

    fn set(&mut self, place: Place, fate: Fate) {
        if let Some(entry) = self.part(place.file).and_then(|part| part.entries.get_mut(place.index)) {
            entry.fate = fate;
        }
        if fate == Fate::Waiting {
            self.cursor = self.cursor.min(place);
        }
    }

    /// A receipt has come.
    pub(super) fn taken(&mut self, place: Place, now: Instant) {
        self.set(place, Fate::Taken(now));
    }

    /// No receipt has come.
    pub(super) fn unanswered(&mut self, place: Place) {
        self.set(place, Fate::Waiting);
    }

    /// The station runs anew: what it has taken lately may be lost.
    pub(super) fn recall(&mut self) {
        for entry in self.parts.iter_mut().flat_map(|part| &mut part.entries) {
            if matches!(entry.fate, Fate::Taken(_)) {
                entry.fate = Fate::Waiting;
            }
        }
        self.cursor = Place { file: 0, index: 0 };
    }

    /// The oldest datagram that waits, which counts as sent from now on.
    pub(super) fn next_waiting(&mut self) -> Option<Place> {
        let Place { file, index } = self.cursor;
        for part in self.parts.iter_mut().skip_while(|part| part.number < file) {
            let begin = if part.number == file { index } else { 0 };
            let waiting =
                part.entries.iter_mut().enumerate().skip(begin).find(|(_, entry)| entry.fate == Fate::Waiting);
            if let Some((index, entry)) = waiting {
                entry.fate = Fate::Sent;
                self.cursor = Place { file: part.number, index };
                return Some(self.cursor);
            }
            self.cursor = Place { file: part.number + 1, index: 0 };
        }
        None
    }

    /// The bytes of a datagram, without its code. None: it was deleted.
    ///
    /// # Errors
    /// The disk fails.
    pub(super) fn read(&mut self, place: Place) -> Result<Option<Vec<u8>>> {
        let Some(part) = self.part(place.file) else { return Ok(None) };
        let Some(entry) = part.entries.get(place.index).copied() else { return Ok(None) };
        let mut bytes = vec![0; entry.length.into()];
        let read = part.file.seek(SeekFrom::Start(entry.at)).and_then(|_| part.file.read_exact(&mut bytes));
        read.with_context(|| format!("cannot read {}", part.path.display()))?;
        Ok(Some(bytes))
    }

    /// Deletes the files whose datagrams were all taken a while ago.
    pub(super) fn tidy(&mut self, now: Instant) {
        let is_over =
            |entry: &Entry| matches!(entry.fate, Fate::Taken(at) if now.saturating_duration_since(at) >= RETAINED);
        while let Some(oldest) = self.parts.pop_front_if(|part| part.entries.iter().all(is_over)) {
            oldest.delete();
        }
    }

    /// Deletes all that was taken: at the end of the program.
    pub(super) fn close(mut self) {
        let is_taken = |entry: &Entry| matches!(entry.fate, Fate::Taken(_));
        for part in self.parts.drain(..).filter(|part| part.entries.iter().all(is_taken)) {
            part.delete();
        }
    }
}

impl Part {
    fn make(number: u64, path: PathBuf) -> Result<Self> {
        let file = OpenOptions::new().read(true).append(true).create_new(true).open(&path);
        let file = file.with_context(|| format!("cannot write {}", path.display()))?;
        Ok(Self { number, path, file, bytes: 0, entries: Vec::new() })
    }

    /// A file of an earlier run. What is cut at its end, or no datagram, is left out.
    fn read(number: u64, path: PathBuf) -> Result<Self> {
        let mut file = OpenOptions::new().read(true).append(true).open(&path)?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        let (mut entries, mut at) = (Vec::new(), 0);
        while let Some(length) = bytes.get(at..).and_then(|rest| rest.first_chunk()).map(|two| u16::from_le_bytes(*two))
        {
            let begin = at + 2;
            let Some(datagram) = bytes.get(begin..begin + usize::from(length)) else { break };
            if parse(datagram).is_ok_and(|known| matches!(known.datagram, Datagram::Telemetry(_))) {
                entries.push(Entry { at: begin as u64, length, fate: Fate::Waiting });
            }
            at = begin + usize::from(length);
        }
        // Nothing is written behind a datagram that is cut.
        Ok(Self { number, path, file, bytes: (bytes.len() as u64).max(FILE_BYTES), entries })
    }

    fn push(&mut self, datagram: &[u8]) -> Result<()> {
        let length = u16::try_from(datagram.len())?;
        let record = [&length.to_le_bytes()[..], datagram].concat();
        if let Err(error) = self.file.write_all(&record) {
            // A part of it may be there: the next datagram begins another file.
            self.bytes = self.bytes.max(FILE_BYTES);
            return Err(error).with_context(|| format!("cannot write {}", self.path.display()));
        }
        self.entries.push(Entry { at: self.bytes + 2, length, fate: Fate::Sent });
        self.bytes += record.len() as u64;
        Ok(())
    }

    fn delete(self) {
        drop(self.file);
        if let Err(error) = fs::remove_file(&self.path) {
            log::warn!("cannot delete {}: {error}", self.path.display());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn envelope(number: u32, frames: &[u8]) -> Envelope<'_> {
        let (gateway, session, station, node) = (1, 2, 0, 0x0101);
        Envelope { gateway, session, number, station, is_repeated: false, sent_us: 0, received_us: 5, node, frames }
    }

    fn numbers(queue: &mut Queue) -> Vec<u32> {
        let mut numbers = Vec::new();
        while let Some(place) = queue.next_waiting() {
            let bytes = queue.read(place).expect("read").expect("there");
            let Ok(Datagram::Telemetry(envelope)) = parse(&bytes).map(|received| received.datagram) else {
                panic!("{bytes:?}")
            };
            numbers.push(envelope.number);
        }
        numbers
    }

    #[test]
    fn what_no_receipt_came_for_is_there_after_a_restart() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut queue = Queue::open(folder.path(), 1 << 30).expect("a queue");
        assert!(Queue::open(folder.path(), 1 << 30).is_err(), "one program at a time");
        let places: Vec<_> = (0..3).map(|number| queue.push(&envelope(number, &[7; 9])).expect("taken")).collect();
        assert!(numbers(&mut queue).is_empty(), "all are sent");
        let now = Instant::now();
        queue.taken(places[1], now);
        queue.unanswered(places[2]);
        queue.unanswered(places[0]);
        assert_eq!(numbers(&mut queue), [0, 2]);
        queue.tidy(now + 2 * RETAINED);
        drop(queue);
        // A power cut in the middle of a datagram, and a file of somebody else.
        let part = folder.path().join("00000001.datagrams");
        let mut bytes = fs::read(&part).expect("a file");
        bytes.extend([200, 0, 1, 2, 3]);
        fs::write(&part, bytes).expect("written");
        fs::write(folder.path().join("notes.txt"), "mine").expect("written");
        let mut queue = Queue::open(folder.path(), 1 << 30).expect("a queue");
        let new = queue.push(&envelope(9, &[])).expect("taken");
        assert_eq!(numbers(&mut queue), [0, 1, 2]);
        queue.unanswered(new);
        assert_eq!(numbers(&mut queue), [9]);
    }

    #[test]
    fn what_was_taken_comes_back_for_another_run_of_the_station_and_goes_later() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut queue = Queue::open(folder.path(), 1 << 30).expect("a queue");
        let now = Instant::now();
        let places: Vec<_> = (0..2).map(|number| queue.push(&envelope(number, &[])).expect("taken")).collect();
        places.iter().for_each(|place| queue.taken(*place, now));
        queue.recall();
        assert_eq!(numbers(&mut queue), [0, 1]);
        places.iter().for_each(|place| queue.taken(*place, now));
        assert_eq!(queue.untaken_bytes(), 0);
        queue.tidy(now + RETAINED - Duration::from_millis(1));
        assert!(folder.path().join("00000001.datagrams").exists());
        queue.tidy(now + RETAINED);
        assert!(!folder.path().join("00000001.datagrams").exists());
        // What is told late is of a file that is gone.
        queue.taken(places[0], now);
        assert!(queue.read(places[0]).expect("no error").is_none());
    }

    #[test]
    fn a_full_queue_loses_its_oldest_file_and_counts_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut queue = Queue::open(folder.path(), 2 * FILE_BYTES).expect("a queue");
        let frames = [1; 1000];
        for number in 0..4000 {
            queue.push(&envelope(number, &frames)).expect("taken");
        }
        let lost = queue.take_lost();
        let kept = queue.parts.iter().map(|part| part.entries.len()).sum::<usize>();
        assert_eq!(lost + kept as u64, 4000);
        // A datagram has 41 + 1000 bytes, and two for its length.
        assert!((FILE_BYTES..=2 * FILE_BYTES).contains(&(kept as u64 * 1043)), "{kept}");
        queue.recall();
        assert_eq!(queue.take_lost(), 0);
    }
}
