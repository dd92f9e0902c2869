//! A recording of what a node tells: the folder of tables that `solve`, `plot` and the commands for beacons read, and the bytes
//! themselves, which `decode`, `monitor` and `replay` read.
//!
//! In flow bytes and the messages that they are, from wherever; out come `telemetry.bin`, `anchors.csv`, `ranges.csv`, `positions.csv`, and
//! a file of each further table of which a row came. Nothing is seen of them before [`Recorder::finish`].

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;
use wire::telemetry::{Message, Table, metres};

use crate::files::output::Growing;
use crate::node::decode::{Stamp, row};
use crate::{Anchor, UserError};

/// Tables that a recording has in any case; others have a file from their first row on.
const ALWAYS: [&str; 2] = ["positions", "ranges"];

type Writer = csv::Writer<Growing>;

/// A recording as it fills.
pub struct Recorder {
    folder: PathBuf,
    bytes: Growing,
    /// By their names.
    tables: BTreeMap<&'static str, Writer>,
    /// Columns beside those of telemetry, by the tables' names.
    more: BTreeMap<&'static str, Vec<&'static str>>,
    /// By short address; what the user gives counts more than what the anchors say of themselves.
    given: BTreeMap<u16, [f64; 3]>,
    reported: BTreeMap<u16, [f64; 3]>,
    /// Ranges to anchors of which nobody has said where they stand.
    waiting: BTreeMap<u16, Vec<Vec<String>>>,
    counts: Recorded,
}

/// What a recording has.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Recorded {
    /// Rows of each table, by what its rows are called.
    #[serde(flatten)]
    pub rows: BTreeMap<&'static str, u64>,
    /// Rows of `anchors.csv`.
    pub anchors: u64,
    /// Ranges that were left out, because nobody said where their anchor stands: how many by its short address.
    pub left_out: BTreeMap<u16, u64>,
}

impl Recorder {
    /// Begins a recording in a folder, which is made where it does not exist. `anchors` are those whose places are known, by their
    /// short addresses.
    ///
    /// # Errors
    /// The folder has a recording already, an anchor's name is no short address, or the file system's.
    pub fn create(folder: &Path, anchors: &[Anchor]) -> anyhow::Result<Self> {
        let given = anchors.iter().map(address_and_place).collect::<Result<_, _>>()?;
        let tables = Message::tables().map(|table| format!("{}.csv", table.name));
        let mut files = ["anchors.csv".to_owned()].into_iter().chain(tables).chain(["telemetry.bin".to_owned()]);
        if let Some(file) = files.find(|file| folder.join(file).exists()) {
            return Err(UserError::flag("--out", format!("{} has {file} already", folder.display())).into());
        }
        Self::begin(folder, given, BTreeMap::new())
    }

    /// Begins a recording that replaces the one in its folder. `given` are anchors whose positions are known, metres, by their short
    /// addresses; `more` are columns that tables have beside those of telemetry, by the tables' names.
    ///
    /// # Errors
    /// The folder is none, or the file system's.
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

    /// Takes bytes as they came.
    ///
    /// # Errors
    /// The file system's.
    pub fn bytes(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.bytes.write_all(bytes)
    }

    /// Takes a message.
    ///
    /// # Errors
    /// The CSV writer's.
    pub fn message(&mut self, stamp: Stamp, message: &Message) -> csv::Result<()> {
        self.message_with(stamp, message, |_| ())
    }

    /// Takes a message whose row `complete` fills up.
    ///
    /// # Errors
    /// The CSV writer's.
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

    /// Takes note of where an anchor says that it stands.
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

    /// Puts all files in their places.
    ///
    /// # Errors
    /// The file system's.
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

/// Reads the places of anchors that are called by their short addresses.
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
