//! A recording of what a node tells: the folder of tables that `solve`, `plot` and the commands for beacons read, and the bytes
//! themselves, which `decode`, `monitor` and `replay` read.
//!
//! In flow bytes and the messages that they are, from wherever; out come `anchors.csv`, `ranges.csv`, `positions.csv`, `rssi.csv`
//! where beacons were seen, `rooms.csv` where a tag tells rooms, `differences.csv` where a tag only listened, and `telemetry.bin`. Nothing is seen of them before [`Recorder::finish`].

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

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
    positions: Writer,
    ranges: Writer,
    /// From the first sighting on.
    rssi: Option<Writer>,
    /// From the first room on.
    rooms: Option<Writer>,
    /// From the first difference on.
    differences: Option<Writer>,
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
        if folder.exists() && !folder.is_dir() {
            return Err(UserError::flag("--out", format!("{} is not a folder", folder.display())).into());
        }
        if let Some(file) = FILES.into_iter().find(|file| folder.join(file).exists()) {
            return Err(UserError::flag("--out", format!("{} has {file} already", folder.display())).into());
        }
        std::fs::create_dir_all(folder)?;
        Ok(Self {
            bytes: Growing::create(&folder.join("telemetry.bin"))?,
            positions: writer(folder, "positions.csv", &Table::Positions.columns())?,
            ranges: writer(folder, "ranges.csv", &Table::Ranges.columns())?,
            folder: folder.to_owned(),
            rssi: None,
            rooms: None,
            differences: None,
            given,
            told: BTreeMap::new(),
            waiting: BTreeMap::new(),
            counts: Recorded::default(),
        })
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
        if let Some(row) = Table::Positions.row(stamp, message) {
            self.counts.positions += 1;
            self.positions.write_record(row)?;
        }
        if let Some(row) = Table::Rssi.row(stamp, message) {
            self.counts.sightings += 1;
            let rssi = match &mut self.rssi {
                Some(rssi) => rssi,
                None => self.rssi.insert(writer(&self.folder, "rssi.csv", &Table::Rssi.columns())?),
            };
            rssi.write_record(row)?;
        }
        if let Some(row) = Table::Rooms.row(stamp, message) {
            self.counts.rooms += 1;
            let rooms = match &mut self.rooms {
                Some(rooms) => rooms,
                None => self.rooms.insert(writer(&self.folder, "rooms.csv", &Table::Rooms.columns())?),
            };
            rooms.write_record(row)?;
        }
        if let (Message::Difference(difference), Some(row)) = (message, Table::Differences.row(stamp, message)) {
            if let Some(place_m) = difference.place_m() {
                self.told.insert(difference.peer, place_m);
            }
            self.counts.differences += 1;
            let differences = match &mut self.differences {
                Some(differences) => differences,
                None => {
                    self.differences.insert(writer(&self.folder, "differences.csv", &Table::Differences.columns())?)
                }
            };
            differences.write_record(row)?;
        }
        if let (Message::Range(range), Some(row)) = (message, Table::Ranges.row(stamp, message)) {
            if let Some(place_m) = range.place_m() {
                self.told.insert(range.peer, place_m);
            }
            if !self.given.contains_key(&range.peer) && !self.told.contains_key(&range.peer) {
                self.waiting.entry(range.peer).or_default().push(row);
                return Ok(());
            }
            for row in self.waiting.remove(&range.peer).into_iter().flatten().chain([row]) {
                self.counts.ranges += 1;
                self.ranges.write_record(row)?;
            }
        }
        Ok(())
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
        for table in [Some(anchors), Some(self.ranges), Some(self.positions), self.rssi, self.rooms, self.differences]
            .into_iter()
            .flatten()
        {
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

fn writer(folder: &Path, name: &str, columns: &[&str]) -> csv::Result<Writer> {
    let mut writer = csv::Writer::from_writer(Growing::create(&folder.join(name))?);
    writer.write_record(columns)?;
    Ok(writer)
}
