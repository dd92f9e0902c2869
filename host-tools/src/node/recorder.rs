//! A recording of a node's telemetry: the folder of tables that `solve`, `plot` and the commands for beacons read, and
//! the received bytes, which `decode`, `monitor` and `replay` read.
//!
//! The input is the bytes, and the messages decoded from them, from any source. The output is `telemetry.bin`,
//! `anchors.csv`, `ranges.csv`, `positions.csv`, and a file for each further table with at least one row. The files
//! appear in the folder only at [`Recorder::finish`].

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;
use wire::telemetry::{Message, Table, metres};

use crate::files::output::Growing;
use crate::node::decode::{Stamp, row};
use crate::{Anchor, UserError};

/// Tables that every recording has. Each other table gets a file with its first row.
const ALWAYS: [&str; 2] = ["positions", "ranges"];

type Writer = csv::Writer<Growing>;

/// A recording in progress.
pub struct Recorder {
    folder: PathBuf,
    bytes: Growing,
    /// The tables by their names.
    tables: BTreeMap<&'static str, Writer>,
    /// Columns in addition to those of telemetry, by the tables' names.
    more: BTreeMap<&'static str, Vec<&'static str>>,
    /// The configured positions of anchors, by short address. They have precedence over the positions that anchors
    /// report.
    given: BTreeMap<u16, [f64; 3]>,
    reported: BTreeMap<u16, [f64; 3]>,
    /// Ranges to anchors whose positions are not known yet.
    waiting: BTreeMap<u16, Vec<Vec<String>>>,
    counts: Recorded,
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
    pub left_out: BTreeMap<u16, u64>,
}

impl Recorder {
    /// Begins a recording in a folder, which is created where it does not exist. `anchors` are the anchors with known
    /// positions, named by their short addresses.
    ///
    /// # Errors
    /// The folder already has a recording, an anchor's name is not a short address, or the file system returns an
    /// error.
    pub fn create(folder: &Path, anchors: &[Anchor]) -> anyhow::Result<Self> {
        let given = anchors.iter().map(address_and_place).collect::<Result<_, _>>()?;
        let tables = Message::tables().map(|table| format!("{}.csv", table.name));
        let mut files = ["anchors.csv".to_owned()].into_iter().chain(tables).chain(["telemetry.bin".to_owned()]);
        if let Some(file) = files.find(|file| folder.join(file).exists()) {
            return Err(UserError::flag("--out", format!("{} has {file} already", folder.display())).into());
        }
        Self::begin(folder, given, BTreeMap::new())
    }

    /// Begins a recording that replaces the recording in its folder. `given` are the known positions of anchors,
    /// metres, by their short addresses. `more` are additional columns of the tables, by the tables' names.
    ///
    /// # Errors
    /// The path is not a folder, or the file system returns an error.
    pub fn begin(
        folder: &Path,
        given: BTreeMap<u16, [f64; 3]>,
        more: BTreeMap<&'static str, Vec<&'static str>>,
    ) -> anyhow::Result<Self> {
        if folder.exists() && !folder.is_dir() {
            return Err(UserError::flag("--out", format!("{} is not a folder", folder.display())).into());
        }
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let mut recorder = Self {
            bytes: Growing::create(&folder.join("telemetry.bin"))?,
            tables: BTreeMap::new(),
            more,
            folder: folder.to_owned(),
            given,
            reported: BTreeMap::new(),
            waiting: BTreeMap::new(),
            counts: Recorded {
                rows: Message::tables().map(|table| (table.rows, 0)).collect(),
                anchors: 0,
                left_out: BTreeMap::new(),
            },
        };
        for table in Message::tables().filter(|table| ALWAYS.contains(&table.name)) {
            recorder.table(&table)?;
        }
        Ok(recorder)
    }

    /// Records received bytes, unchanged.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn bytes(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.bytes.write_all(bytes)
    }

    /// Records a message.
    ///
    /// # Errors
    /// The CSV writer returns an error.
    pub fn message(&mut self, stamp: Stamp, message: &Message) -> csv::Result<()> {
        self.message_with(stamp, message, |_| ())
    }

    /// Records a message. `complete` adds fields to its row.
    ///
    /// # Errors
    /// The CSV writer returns an error.
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
            if !self.given.contains_key(&range.peer) && !self.reported.contains_key(&range.peer) {
                self.waiting.entry(range.peer).or_default().push(row);
                return Ok(());
            }
            for row in self.waiting.remove(&range.peer).into_iter().flatten() {
                self.row(&table, &row)?;
            }
        }
        self.row(&table, &row)
    }

    /// Stores the position that an anchor reports.
    fn place(&mut self, anchor: u16, position_m: Option<[f64; 3]>) {
        self.reported.extend(position_m.map(|position_m| (anchor, position_m)));
    }

    fn row(&mut self, table: &Table, row: &[String]) -> csv::Result<()> {
        *self.counts.rows.entry(table.rows).or_default() += 1;
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

    /// Moves all files to their places.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn finish(mut self) -> anyhow::Result<Recorded> {
        let mut anchors = writer(&self.folder, "anchors.csv", &["anchor", "x_m", "y_m", "z_m"])?;
        self.reported.extend(self.given);
        for (address, place_m) in &self.reported {
            let [x, y, z] = place_m.map(metres);
            anchors.write_record([address.to_string(), x, y, z])?;
            self.counts.anchors += 1;
        }
        self.counts.left_out = self.waiting.into_iter().map(|(address, rows)| (address, rows.len() as u64)).collect();
        for table in self.tables.into_values().chain([anchors]) {
            table.into_inner().map_err(csv::IntoInnerError::into_error)?.finish()?;
        }
        self.bytes.finish()?;
        Ok(self.counts)
    }
}

/// The short address and the position of an anchor whose name is its short address.
fn address_and_place(anchor: &Anchor) -> Result<(u16, [f64; 3]), UserError> {
    let wrong = |what: &str| UserError::flag("--anchors", format!("anchor {:?} {what}", anchor.name));
    let address = anchor.name.parse().map_err(|_| wrong("is not called by its short address, 0 to 65535"))?;
    let z_m = anchor.place.z_m.ok_or_else(|| wrong("has no z_m"))?;
    Ok((address, [anchor.place.x_m, anchor.place.y_m, z_m]))
}

pub(crate) fn writer(folder: &Path, name: &str, columns: &[&str]) -> csv::Result<Writer> {
    let mut writer = csv::Writer::from_writer(Growing::create(&folder.join(name))?);
    writer.write_record(columns)?;
    Ok(writer)
}
