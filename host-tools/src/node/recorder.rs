//! A recording of what a node tells: the folder of tables that `solve`, `plot` and the commands for beacons read, and the bytes
//! themselves, which `decode`, `monitor` and `replay` read.
//!
//! In flow bytes and the messages that they are, from wherever; out come `anchors.csv`, `ranges.csv`, `positions.csv`, `rssi.csv`
//! where beacons were seen, `rooms.csv` where a tag tells rooms, `differences.csv` where a tag only listened, and `telemetry.bin`. Nothing is seen of them before [`Recorder::finish`].

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;
use wire::telemetry::Message;

use crate::files::output::Growing;
use crate::node::decode::{Stamp, Table, metres};
use crate::{Anchor, UserError};

/// The files of a recording.
const FILES: [&str; 7] =
    ["anchors.csv", "ranges.csv", "positions.csv", "rssi.csv", "rooms.csv", "differences.csv", "telemetry.bin"];

type Writer = csv::Writer<Growing>;

/// A recording as it fills.
pub struct Recorder {
    folder: PathBuf,
    bytes: Growing,
    tables: BTreeMap<Table, Writer>,
    /// Columns beside those of telemetry.
    more: BTreeMap<Table, Vec<&'static str>>,
    /// By short address; what the user gives counts more than what the anchors say of themselves.
    given: BTreeMap<u16, [f64; 3]>,
    told: BTreeMap<u16, [f64; 3]>,
    /// Ranges to anchors of which nobody has said where they stand.
    waiting: BTreeMap<u16, Vec<Vec<String>>>,
    counts: Recorded,
}

/// What a recording has.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Recorded {
    /// Rows of `positions.csv`.
    pub positions: u64,
    /// Rows of `ranges.csv`.
    pub ranges: u64,
    /// Rows of `rssi.csv`.
    pub sightings: u64,
    /// Rows of `rooms.csv`.
    pub rooms: u64,
    /// Rows of `differences.csv`.
    pub differences: u64,
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
        if let Some(file) = FILES.into_iter().find(|file| folder.join(file).exists()) {
            return Err(UserError::flag("--out", format!("{} has {file} already", folder.display())).into());
        }
        Self::begin(folder, given, BTreeMap::new())
    }

    /// Begins a recording that replaces the one in its folder; it knows where these anchors stand, and its tables have these columns more.
    ///
    /// # Errors
    /// The folder is none, or the file system's.
    pub fn begin(
        folder: &Path,
        given: BTreeMap<u16, [f64; 3]>,
        more: BTreeMap<Table, Vec<&'static str>>,
    ) -> anyhow::Result<Self> {
        if folder.exists() && !folder.is_dir() {
            return Err(UserError::flag("--out", format!("{} is not a folder", folder.display())).into());
        }
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let mut recorder = Self {
            bytes: Growing::create(&folder.join("telemetry.bin"))?,
            folder: folder.to_owned(),
            tables: BTreeMap::new(),
            more,
            given,
            told: BTreeMap::new(),
            waiting: BTreeMap::new(),
            counts: Recorded::default(),
        };
        // The others are there from their first row on.
        recorder.table(Table::Positions)?;
        recorder.table(Table::Ranges)?;
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
        self.message_with(stamp, message, |_, _| ())
    }

    /// Takes a message whose row `complete` fills up.
    ///
    /// # Errors
    /// The CSV writer's.
    pub fn message_with(
        &mut self,
        stamp: Stamp,
        message: &Message,
        complete: impl FnOnce(Table, &mut Vec<String>),
    ) -> csv::Result<()> {
        let row = Table::ALL.into_iter().find_map(|table| Some((table, table.row(stamp, message)?)));
        let Some((table, mut row)) = row else { return Ok(()) };
        complete(table, &mut row);
        match message {
            Message::Difference(difference) => self.told.extend(difference.place_m().map(|at| (difference.peer, at))),
            Message::Range(range) => {
                self.told.extend(range.place_m().map(|at| (range.peer, at)));
                if !self.given.contains_key(&range.peer) && !self.told.contains_key(&range.peer) {
                    self.waiting.entry(range.peer).or_default().push(row);
                    return Ok(());
                }
                for earlier in self.waiting.remove(&range.peer).into_iter().flatten() {
                    self.row(table, earlier)?;
                }
            }
            Message::Hello(_)
            | Message::Fix(_)
            | Message::Sighting(_)
            | Message::State(_)
            | Message::Counters(_)
            | Message::Reset(_)
            | Message::Room(_) => {}
        }
        self.row(table, row)
    }

    fn row(&mut self, table: Table, row: Vec<String>) -> csv::Result<()> {
        *match table {
            Table::Positions => &mut self.counts.positions,
            Table::Ranges => &mut self.counts.ranges,
            Table::Differences => &mut self.counts.differences,
            Table::Rssi => &mut self.counts.sightings,
            Table::Rooms => &mut self.counts.rooms,
        } += 1;
        self.table(table)?.write_record(row)
    }

    fn table(&mut self, table: Table) -> csv::Result<&mut Writer> {
        match self.tables.entry(table) {
            Entry::Occupied(writer) => Ok(writer.into_mut()),
            Entry::Vacant(place) => {
                let mut columns = table.columns();
                columns.extend(self.more.get(&table).into_iter().flatten());
                Ok(place.insert(writer(&self.folder, table.file(), &columns)?))
            }
        }
    }

    /// Puts all files in their places.
    ///
    /// # Errors
    /// The file system's.
    pub fn finish(mut self) -> anyhow::Result<Recorded> {
        let mut anchors = writer(&self.folder, "anchors.csv", &["anchor", "x_m", "y_m", "z_m"])?;
        self.told.extend(self.given);
        for (address, place_m) in &self.told {
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
