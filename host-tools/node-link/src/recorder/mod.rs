//! A recording of a node's telemetry, made while the node sends.
//!
//! The input is the bytes, as they arrive from any source. The output is a folder with `telemetry.bin`, the received
//! bytes, which `decode`, `monitor` and `replay` read; `telemetry.times.csv`, when each frame was received; and the
//! [`Tables`] that `solve`, `plot` and the commands for beacons read. `telemetry.bin` has its name from the first byte,
//! and each write goes to the system at once: whatever ends the program, the bytes stay. The tables follow within a
//! second, and [`make_tables`] makes them again from the bytes.

mod file_names;
mod remade;
mod tables;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Context, Result};
use wire::telemetry::Message;

use crate::decode::{DecodeSummary, Stamp, Stream, no_telemetry};
use crate::provision::SiteNames;
use recording::output::{Live, clear, refuse_existing};
use recording::{Anchor, UserError};

pub use file_names::{STREAM, TIMES, folders, is_of_recording, other_nodes};
pub use remade::make_tables;
pub use tables::writer;
pub use tables::{Recorded, Tables, address_and_place};

/// The interval between two writes of the tables.
const FLUSH_EVERY: Duration = Duration::from_secs(1);
/// A file is no telemetry where no frame is in this many bytes at its beginning. A node sends `Hello` every two
/// seconds.
const HELD_BYTES: usize = 1 << 24;

/// When the next part of a recording begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rotation {
    /// After this time.
    Time(Duration),
    /// After this many bytes of telemetry.
    Bytes(u64),
}

/// How to record.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// The known positions of anchors, metres, by short address. They have precedence over what anchors report.
    pub anchors: BTreeMap<u16, [f64; 3]>,
    /// The names of the site, which go into the folder with the recording.
    pub site: SiteNames,
    /// Each part goes to a numbered folder of its own.
    pub rotation: Option<Rotation>,
    /// Replace the recording that is in the folder.
    pub force: bool,
    /// The file that the bytes come from; none: a live node. The recording of a live node begins with the first byte,
    /// and has the times of arrival. That of a file begins with the first frame.
    pub file: Option<PathBuf>,
}

impl Settings {
    /// The settings with the names and the positions of a site, and the positions of these anchors, whose names are
    /// their short addresses. A position of `anchors` has precedence over that of the site.
    ///
    /// # Errors
    /// A name is not a short address, or an anchor has no height.
    pub fn of(site: SiteNames, anchors: &[Anchor]) -> Result<Self, UserError> {
        let mut anchors_m = site.anchors_m();
        for anchor in anchors {
            let (address, position_m) = address_and_place(anchor)?;
            anchors_m.insert(address, position_m);
        }
        Ok(Self { anchors: anchors_m, site, ..Self::default() })
    }
}

/// A recording in progress.
pub struct Recorder {
    folder: PathBuf,
    settings: Settings,
    stream: Stream,
    /// The place in the part where the current frame begins.
    frame_at: u64,
    /// The current part. Before the first bytes there is none, and an earlier recording is still there.
    part: Option<Part>,
    /// The number of the latest part.
    number: u32,
    /// The bytes of a file before its first frame.
    held: Vec<u8>,
    /// The contents of the parts that are complete, and the positions that anchors have reported.
    recorded: Recorded,
    reported: BTreeMap<u16, [f64; 3]>,
}

/// A decoded frame.
struct Frame {
    /// The place of its first byte in the stream's file.
    at: u64,
    stamp: Stamp,
    message: Message,
}

impl Recorder {
    /// Begins a recording in a folder, which is created where it does not exist. `flag` is the flag that names it.
    ///
    /// # Errors
    /// The folder already has a recording, or the file system returns an error.
    pub fn create(flag: &'static str, folder: &Path, settings: Settings) -> Result<Self> {
        let rotates = settings.rotation.is_some();
        refuse_existing(flag, folder, &is_of_recording, settings.force && !rotates)?;
        let parts = file_names::parts(folder);
        if let (Some((number, _)), false) = (parts.first(), rotates) {
            let what =
                format!("{} has the parts of a recording ({})", folder.display(), file_names::part_name(*number));
            return Err(UserError::flag(flag, what).into());
        }
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        Ok(Self {
            folder: folder.to_owned(),
            settings,
            stream: Stream::default(),
            frame_at: 0,
            part: None,
            number: parts.last().map_or(0, |(number, _)| *number),
            held: Vec::new(),
            recorded: Recorded::default(),
            reported: BTreeMap::new(),
        })
    }

    /// Records bytes that have just arrived.
    ///
    /// # Errors
    /// The file system returns an error, or a file has no telemetry at its beginning.
    pub fn take(&mut self, bytes: &[u8]) -> Result<()> {
        let arrived = SystemTime::now();
        let mut rest = bytes;
        while !rest.is_empty() {
            let (count, frames, is_full) = self.decode(rest);
            let (taken, behind) = rest.split_at_checked(count).unwrap_or((rest, &[]));
            rest = behind;
            if self.part.is_some() || self.settings.file.is_none() || !frames.is_empty() {
                let held = std::mem::take(&mut self.held);
                self.part()?.take([&held, taken], &frames, arrived)?;
            } else {
                self.hold(taken)?;
            }
            if is_full {
                self.finish_part()?;
            }
        }
        Ok(())
    }

    /// Decodes up to the frame with which the part is full, or all bytes. Returns the number of bytes, their frames,
    /// and whether the part is full.
    fn decode(&mut self, bytes: &[u8]) -> (usize, Vec<Frame>, bool) {
        let before = self.part.as_ref().map_or(self.held.len() as u64, |part| part.bytes.written());
        let age = self.part.as_ref().map_or(Duration::ZERO, |part| part.begun.elapsed());
        let is_full = |end| match self.settings.rotation {
            None => false,
            Some(Rotation::Time(most)) => age >= most,
            Some(Rotation::Bytes(most)) => end >= most,
        };
        let mut frames = Vec::new();
        for (byte, end) in bytes.iter().zip(before + 1..) {
            let decoded = self.stream.feed(*byte);
            let is_frame = decoded.is_some();
            frames.extend(decoded.map(|(stamp, message)| Frame { at: self.frame_at, stamp, message }));
            if *byte == 0 {
                self.frame_at = end;
            }
            if is_frame && is_full(end) {
                return ((end - before) as usize, frames, true);
            }
        }
        (bytes.len(), frames, false)
    }

    /// Holds the bytes of a file before its first frame.
    fn hold(&mut self, bytes: &[u8]) -> Result<(), UserError> {
        self.held.extend(bytes);
        match &self.settings.file {
            Some(file) if self.held.len() > HELD_BYTES => Err(no_telemetry(file, self.held.len() as u64)),
            Some(_) | None => Ok(()),
        }
    }

    /// The current part, which begins where there is none.
    fn part(&mut self) -> Result<&mut Part> {
        let part = match self.part.take() {
            Some(part) => part,
            None => self.begin_part()?,
        };
        Ok(self.part.insert(part))
    }

    fn begin_part(&mut self) -> Result<Part> {
        let mut folder = self.folder.clone();
        if self.settings.rotation.is_some() {
            self.number += 1;
            folder.push(file_names::part_name(self.number));
            fs::create_dir(&folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        } else {
            clear(&folder, &is_of_recording).with_context(|| format!("cannot replace {}", folder.display()))?;
        }
        let reported = std::mem::take(&mut self.reported);
        let part = Part::create(&folder, &self.settings, reported);
        part.with_context(|| format!("cannot write the recording into {}", folder.display()))
    }

    fn finish_part(&mut self) -> Result<()> {
        let Some(part) = self.part.take() else { return Ok(()) };
        let cannot = part.cannot_write();
        let (recorded, reported) = part.finish().context(cannot)?;
        self.recorded.add(recorded);
        self.reported = reported;
        self.frame_at = 0;
        Ok(())
    }

    /// Writes the rows of the last second, where no bytes come.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn tick(&mut self) -> Result<()> {
        self.part.as_mut().map_or(Ok(()), Part::tick)
    }

    /// The connection was lost: bytes are missing from here on.
    pub fn interrupted(&mut self) {
        self.stream.interrupted();
    }

    /// The source has seen a restart of the node.
    pub fn restarted(&mut self) {
        self.stream.restarted();
    }

    /// The summary of what was received so far.
    pub fn summary(&self) -> DecodeSummary {
        self.stream.summary()
    }

    /// Completes the tables. Where no byte came, there are no files, and an earlier recording is still there.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn finish(mut self) -> Result<Recorded> {
        self.finish_part()?;
        Ok(self.recorded)
    }
}

/// The files of one folder.
struct Part {
    folder: PathBuf,
    bytes: Live,
    /// Only of a live node.
    times: Option<Live>,
    tables: Tables,
    begun: Instant,
    flushed: Instant,
}

impl Part {
    fn create(folder: &Path, settings: &Settings, reported: BTreeMap<u16, [f64; 3]>) -> Result<Self> {
        let bytes = Live::create(&folder.join(STREAM))?;
        settings.site.write_into(folder)?;
        let times = match &settings.file {
            None => {
                let mut times = Live::create(&folder.join(TIMES))?;
                times.append(b"offset,t_s,utc_us\n")?;
                Some(times)
            }
            Some(_) => None,
        };
        let mut tables = Tables::create(folder, settings.anchors.clone(), BTreeMap::new())?;
        tables.know(reported);
        let now = Instant::now();
        Ok(Self { folder: folder.to_owned(), bytes, times, tables, begun: now, flushed: now })
    }

    fn cannot_write(&self) -> String {
        let folder = self.folder.display();
        format!(
            "cannot write the recording; what came before stays in {folder}, and `record --finish` makes its tables"
        )
    }

    /// Writes the bytes first: everything else can be made of them.
    fn take(&mut self, bytes: [&[u8]; 2], frames: &[Frame], arrived: SystemTime) -> Result<()> {
        self.write(bytes, frames, arrived).with_context(|| self.cannot_write())
    }

    fn write(&mut self, bytes: [&[u8]; 2], frames: &[Frame], arrived: SystemTime) -> Result<()> {
        for bytes in bytes.into_iter().filter(|bytes| !bytes.is_empty()) {
            self.bytes.append(bytes)?;
        }
        if let (Some(times), false) = (&mut self.times, frames.is_empty()) {
            // A clock before 1970 is not set.
            let utc_us = arrived.duration_since(SystemTime::UNIX_EPOCH).map_or(0, |since| since.as_micros());
            let rows = frames.iter().map(|frame| format!("{},{:.6},{utc_us}\n", frame.at, frame.stamp.t_s));
            times.append(rows.collect::<String>().as_bytes())?;
        }
        for frame in frames {
            self.tables.message(frame.stamp, &frame.message)?;
        }
        Ok(self.flush()?)
    }

    fn tick(&mut self) -> Result<()> {
        self.flush().with_context(|| self.cannot_write())
    }

    /// Writes the rows so far to their files, once a second.
    fn flush(&mut self) -> csv::Result<()> {
        if self.flushed.elapsed() >= FLUSH_EVERY {
            self.flushed = Instant::now();
            self.tables.flush()?;
        }
        Ok(())
    }

    fn finish(self) -> Result<(Recorded, BTreeMap<u16, [f64; 3]>)> {
        for file in [Some(self.bytes), self.times].into_iter().flatten() {
            file.finish()?;
        }
        self.tables.finish()
    }
}
