//! The tables of a recording, which `solve`, `plot` and the commands for beacons read.
//!
//! The input is messages with their times. The output is `anchors.csv`, `ranges.csv`, `positions.csv`, and a file for
//! each further table with at least one row. The memory they take does not depend on the length of the recording.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fs::File;
use std::io::{Seek, SeekFrom};
use std::path::{Path, PathBuf};

use anyhow::Result;
use serde::Serializer;
use wire::telemetry::{Address, Message, Table, metres};

use super::file_names::ANCHORS;
use crate::decode::{Stamp, row};
use recording::output::write_file;
use recording::{Anchor, UserError};

/// Tables that every recording has. Each other table gets a file with its first row.
const ALWAYS: [&str; 2] = ["positions", "ranges"];

type Writer = csv::Writer<File>;

/// The tables of a recording in progress.
pub struct Tables {
    folder: PathBuf,
    /// The tables by their names.
    tables: BTreeMap<&'static str, Writer>,
    /// Columns in addition to those of telemetry, by the tables' names.
    more: BTreeMap<&'static str, Vec<&'static str>>,
    /// The configured positions of anchors, by short address. They have precedence over the positions that anchors
    /// report.
    given: BTreeMap<u16, [f64; 3]>,
    reported: BTreeMap<u16, [f64; 3]>,
    /// Whether `anchors.csv` lacks a position.
    anchors_changed: bool,
    /// Rows of a table to anchors whose positions are not known yet, in a file without a name.
    waiting: Option<(Table, Writer)>,
    rows: BTreeMap<&'static str, u64>,
}

/// The contents of a recording.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Recorded {
    /// The number of rows of each table, by the name of its rows.
    #[serde(flatten)]
    pub rows: BTreeMap<&'static str, u64>,
    /// Rows of `anchors.csv`.
    pub anchors: u64,
    /// The number of ranges that were left out because the position of their anchor was not known, by the anchor's
    /// short address.
    #[serde(serialize_with = "by_address")]
    pub left_out: BTreeMap<u16, u64>,
}

fn by_address<S: Serializer>(counts: &BTreeMap<u16, u64>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(counts.iter().map(|(address, count)| (Address(*address).to_string(), count)))
}

impl Default for Recorded {
    fn default() -> Self {
        let rows = Message::tables().map(|table| (table.rows, 0)).collect();
        Self { rows, anchors: 0, left_out: BTreeMap::new() }
    }
}

impl Recorded {
    /// Adds the next part of the recording, which knows the anchors of this one.
    pub(super) fn add(&mut self, next: Self) {
        for (rows, count) in next.rows {
            *self.rows.entry(rows).or_default() += count;
        }
        for (anchor, count) in next.left_out {
            *self.left_out.entry(anchor).or_default() += count;
        }
        self.anchors = next.anchors;
    }
}

impl Tables {
    /// Begins the tables in a folder that has none. `given` are the known positions of anchors, metres, by their short
    /// addresses. `more` are additional columns of the tables, by the tables' names.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn create(
        folder: &Path,
        given: BTreeMap<u16, [f64; 3]>,
        more: BTreeMap<&'static str, Vec<&'static str>>,
    ) -> csv::Result<Self> {
        let mut tables = Self {
            tables: BTreeMap::new(),
            more,
            folder: folder.to_owned(),
            given,
            reported: BTreeMap::new(),
            anchors_changed: true,
            waiting: None,
            rows: Recorded::default().rows,
        };
        for table in Message::tables().filter(|table| ALWAYS.contains(&table.name)) {
            tables.table(&table)?;
        }
        Ok(tables)
    }

    /// Adds positions that anchors have reported before.
    pub(super) fn know(&mut self, reported: BTreeMap<u16, [f64; 3]>) {
        self.reported.extend(reported);
    }

    /// Adds a message.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn message(&mut self, stamp: Stamp, message: &Message) -> csv::Result<()> {
        self.message_with(stamp, message, |_| ())
    }

    /// Adds a message. `complete` adds fields to its row.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn message_with(
        &mut self,
        stamp: Stamp,
        message: &Message,
        complete: impl FnOnce(&mut Vec<String>),
    ) -> csv::Result<()> {
        let Some((table, mut row)) = row(stamp, message) else { return Ok(()) };
        complete(&mut row);
        if let Message::Difference(difference) = message {
            self.place(difference.peer, difference.position_m());
        }
        if let Message::Range(range) = message {
            self.place(range.peer, range.position_m());
            if !self.knows(range.peer) {
                return self.wait(table, range.peer, row);
            }
        }
        self.row(&table, row.iter().map(String::as_str))
    }

    /// Stores the position that an anchor reports.
    fn place(&mut self, anchor: u16, position_m: Option<[f64; 3]>) {
        let Some(position_m) = position_m else { return };
        self.anchors_changed |= self.reported.insert(anchor, position_m) != Some(position_m);
    }

    fn knows(&self, anchor: u16) -> bool {
        self.given.contains_key(&anchor) || self.reported.contains_key(&anchor)
    }

    fn wait(&mut self, table: Table, anchor: u16, row: Vec<String>) -> csv::Result<()> {
        let waiting = match self.waiting.take() {
            Some(waiting) => waiting,
            None => (table, csv::Writer::from_writer(tempfile::tempfile_in(&self.folder)?)),
        };
        let (_, rows) = self.waiting.insert(waiting);
        // The address is the first field, the row follows.
        rows.write_record([anchor.to_string()].into_iter().chain(row))
    }

    fn row<'r>(&mut self, table: &Table, row: impl IntoIterator<Item = &'r str>) -> csv::Result<()> {
        *self.rows.entry(table.rows).or_default() += 1;
        self.table(table)?.write_record(row)
    }

    fn table(&mut self, table: &Table) -> csv::Result<&mut Writer> {
        match self.tables.entry(table.name) {
            Entry::Occupied(writer) => Ok(writer.into_mut()),
            Entry::Vacant(none) => {
                let mut columns = table.header();
                columns.extend(self.more.get(table.name).into_iter().flatten());
                Ok(none.insert(writer(&self.folder, &format!("{}.csv", table.name), &columns)?))
            }
        }
    }

    /// Writes all rows so far to the files, but those that wait for the position of their anchor.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn flush(&mut self) -> csv::Result<()> {
        for table in self.tables.values_mut() {
            table.flush()?;
        }
        if std::mem::take(&mut self.anchors_changed) {
            let mut anchors = csv::Writer::from_writer(Vec::new());
            anchors.write_record(["anchor", "x_m", "y_m", "z_m"])?;
            for (address, place_m) in self.anchors() {
                let [x, y, z] = place_m.map(metres);
                anchors.write_record([Address(address).to_string(), x, y, z])?;
            }
            let text = anchors.into_inner().map_err(csv::IntoInnerError::into_error)?;
            write_file(&self.folder.join(ANCHORS), &text)?;
        }
        Ok(())
    }

    /// The known positions of anchors, metres, by short address.
    fn anchors(&self) -> BTreeMap<u16, [f64; 3]> {
        let mut anchors = self.reported.clone();
        anchors.extend(&self.given);
        anchors
    }

    /// Completes the tables. Returns their contents, and the positions that anchors have reported.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn finish(mut self) -> Result<(Recorded, BTreeMap<u16, [f64; 3]>)> {
        let left_out = self.waited()?;
        self.flush()?;
        let anchors = self.anchors().len() as u64;
        Ok((Recorded { rows: self.rows, anchors, left_out }, self.reported))
    }

    /// Adds the rows that have waited, and counts those to anchors whose positions are still not known.
    fn waited(&mut self) -> Result<BTreeMap<u16, u64>> {
        let mut left_out = BTreeMap::new();
        let Some((table, rows)) = self.waiting.take() else { return Ok(left_out) };
        let mut file = rows.into_inner().map_err(csv::IntoInnerError::into_error)?;
        file.seek(SeekFrom::Start(0))?;
        let mut rows = csv::ReaderBuilder::new().has_headers(false).from_reader(file);
        let mut waited = csv::StringRecord::new();
        while rows.read_record(&mut waited)? {
            let anchor = waited.get(0).unwrap_or_default().parse()?;
            if self.knows(anchor) {
                self.row(&table, waited.iter().skip(1))?;
            } else {
                *left_out.entry(anchor).or_default() += 1;
            }
        }
        Ok(left_out)
    }
}

/// The short address and the position, metres, of an anchor whose name is its short address.
///
/// # Errors
/// The name is not a short address, or the anchor has no height.
pub fn address_and_place(anchor: &Anchor) -> Result<(u16, [f64; 3]), UserError> {
    let wrong = |what: &str| UserError::flag("--anchors", format!("anchor {:?} {what}", anchor.name));
    let Address(address) =
        anchor.name.parse().map_err(|_| wrong("is not named by its short address, such as 0x0102 or 258"))?;
    let z_m = anchor.place.z_m.ok_or_else(|| wrong("has no z_m"))?;
    Ok((address, [anchor.place.x_m, anchor.place.y_m, z_m]))
}

/// A table with its header.
pub fn writer(folder: &Path, name: &str, columns: &[&str]) -> csv::Result<Writer> {
    let mut writer = csv::Writer::from_writer(File::create_new(folder.join(name))?);
    writer.write_record(columns)?;
    Ok(writer)
}
