//! The recording that a simulation's tags make, with the same [`Tables`] as a recording of real nodes, and the true
//! positions. Each table has one more column, the tag. Epochs count through all tags, so that each number belongs to
//! one position. The memory that it takes does not depend on the length of the simulation.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use positioning_core::nlos::{Feature, Features};
use sim::scenario::{Record, Scenario, SimulatedEpoch, Unrounded, What};
use wire::config::{self, Network};
use wire::telemetry::{
    Address, Body, Difference, Doubt, Fix, MAX_FRAME, Message, Range, Sighting, Table, encode, metres,
};

use node_link::decode::{Stamp, row};
use node_link::recorder::{STREAM, Tables, is_of_recording, writer};
use recording::AGE;
use recording::folder::{MeasurementMode, RecordingSettings, SETTINGS, Weighting};
use recording::output::{Growing, OutputFolder};

/// The walls of the floor plan, which pictures and beacons use.
const WALLS: &str = "walls.csv";

/// Whether a file belongs to a simulated recording, and is replaced with it.
pub fn is_of_simulation(name: &str) -> bool {
    is_of_recording(name) || name == WALLS
}

/// A recording in progress.
pub struct SimulatedRecording {
    output: OutputFolder,
    tables: Tables,
    truth: csv::Writer<File>,
    streams: Streams,
    /// The current epoch.
    epoch: u64,
    /// How the positions of each tag are computed.
    methods: HashMap<u16, &'static str>,
    /// Features of impulse responses, which telemetry does not contain; empty where tags read no responses.
    features: Vec<Feature>,
    /// Whether a position is doubtful.
    has_flags: bool,
}

impl SimulatedRecording {
    /// Begins the recording of a scenario.
    ///
    /// # Errors
    /// The file system fails.
    pub fn create(output: OutputFolder, scenario: &Scenario) -> anyhow::Result<Self> {
        let folder = output.path();
        let surveyed = scenario.anchors.iter().map(|anchor| (anchor.address, scenario.surveyed_m(anchor)));
        // Tags use the position in their records, where these have one.
        let listed = scenario.listed_anchors.iter().map(|anchor| (anchor.address, anchor.position_m.map(f64::from)));
        let anchors = surveyed.chain(listed).collect();
        let reads = scenario.tags.iter().any(|tag| tag.settings.model.is_some());
        let features: Vec<_> = Feature::ALL.into_iter().filter(|feature| reads && feature.is_of_response()).collect();
        let power_difference = Feature::PowerDifference.as_str();
        let of_ranges = ["los", "tag", AGE, power_difference].into_iter();
        let more = BTreeMap::from([
            ("positions", vec!["error_m", "tag"]),
            ("ranges", of_ranges.chain(features.iter().map(|feature| feature.as_str())).collect()),
            ("differences", vec!["los", "truth_m", "tag", AGE, power_difference]),
            ("rssi", vec!["tag"]),
            ("rooms", vec!["tag"]),
        ]);
        if !scenario.beacons.is_empty() {
            write_beacons(folder, scenario)?;
        }
        if !scenario.walls.is_empty() {
            write_walls(folder, scenario)?;
        }
        std::fs::write(folder.join(SETTINGS), settings(scenario).to_toml()?)?;
        Ok(Self {
            tables: Tables::create(folder, anchors, more)?,
            truth: writer(folder, "truth.csv", &["epoch", "t_s", "x_m", "y_m", "z_m", "tag"])?,
            streams: Streams::create(folder, scenario.tags.first().map(|tag| tag.address))?,
            output,
            epoch: 0,
            methods: scenario.tags.iter().map(|tag| (tag.address, scenario.method_name(tag))).collect(),
            features,
            has_flags: false,
        })
    }

    /// Adds a record.
    ///
    /// # Errors
    /// The file system fails.
    pub fn take(&mut self, record: &Record) -> anyhow::Result<()> {
        for message in record.messages() {
            self.streams.take(record.node, encode(&message, &mut [0; MAX_FRAME]))?;
        }
        let tag = Address(record.node).to_string();
        let stamp = Stamp { t_s: record.t_s, epoch: self.epoch };
        match &record.what {
            What::Epoch(epoch) => {
                self.epoch = epoch.number + 1;
                self.take_epoch(record, epoch)?;
            }
            What::Message(message @ Message::Sighting(sighting)) => {
                self.tables.message_with(stamp, message, |row| {
                    row.splice(2..3, [short_name(sighting)]);
                    row.push(tag);
                })?;
            }
            What::Message(message @ Message::Room(_)) => {
                self.tables.message_with(stamp, message, |row| row.push(tag))?;
            }
            // Ranges without a round are those that tags report to anchors. No other message has a table of its own.
            What::Message(_) | What::Fault(_) => {}
        }
        Ok(())
    }

    fn take_epoch(&mut self, record: &Record, epoch: &SimulatedEpoch) -> csv::Result<()> {
        let stamp = Stamp { t_s: record.t_s, epoch: epoch.number };
        let tag = || Address(record.node).to_string();
        let los = |los: bool| if los { "1" } else { "0" }.to_owned();
        let given = |of: &Unrounded| [epoch.fix.age_s().to_string(), number(of.powers_dbm[0] - of.powers_dbm[1])];
        for measured in &epoch.ranges {
            let mut shape = Features::default();
            measured.shape.iter().for_each(|of| shape.set_shape(of));
            let features = self.features.iter().map(|&of| shape.get(of).map_or_else(String::new, |x| x.to_string()));
            self.tables.message_with(stamp, &Message::Range(measured.range), |row| {
                unround(row, Range::TABLE, "range_m", &measured.unrounded);
                row.extend([los(measured.los), tag()].into_iter().chain(given(&measured.unrounded)).chain(features));
            })?;
        }
        for measured in &epoch.differences {
            self.tables.message_with(stamp, &Message::Difference(measured.difference), |row| {
                unround(row, Difference::TABLE, "difference_m", &measured.unrounded);
                let own = [los(measured.los), metres(measured.truth_m), tag()];
                row.extend(own.into_iter().chain(given(&measured.unrounded)));
            })?;
        }
        self.has_flags |= epoch.fix.doubt != Doubt::None;
        let method = self.methods.get(&record.node).copied().unwrap_or_default();
        self.tables.message_with(stamp, &Message::Fix(epoch.fix), |row| {
            complete_position(row, record.node, method, epoch);
        })?;
        let [x, y, z] = epoch.truth_m.map(metres);
        self.truth.write_record([epoch.number.to_string(), format!("{:.6}", record.t_s), x, y, z, tag()])
    }

    /// Completes the files, and lets them appear in their folder.
    ///
    /// # Errors
    /// The file system fails.
    pub fn finish(mut self) -> anyhow::Result<()> {
        self.tables.finish()?;
        if !self.has_flags {
            leave_out_flags(&self.output.path().join(format!("{}.csv", Fix::POSITIONS.name)))?;
        }
        self.truth.flush()?;
        self.streams.flush()?;
        Ok(self.output.finish()?)
    }
}

/// Leaves out the columns of flags, as `solve` and `track` do where no position has one.
fn leave_out_flags(positions: &Path) -> anyhow::Result<()> {
    let mut rows = csv::ReaderBuilder::new().has_headers(false).from_path(positions)?;
    let mut kept = csv::Writer::from_writer(Growing::create(positions)?);
    let header = Fix::POSITIONS.header();
    let is_flag = |column: usize| header.get(column).is_some_and(|name| Fix::FLAGS.contains(name));
    let mut row = csv::StringRecord::new();
    while rows.read_record(&mut row)? {
        kept.write_record(row.iter().enumerate().filter(|(column, _)| !is_flag(*column)).map(|(_, field)| field))?;
    }
    Ok(kept.into_inner().map_err(csv::IntoInnerError::into_error)?.finish()?)
}

/// Replaces the rounded numbers of telemetry in a row with those of the tag's engine.
fn unround(row: &mut [String], table: Option<Table>, measured: &str, of: &Unrounded) {
    let [rx_power_dbm, first_path_dbm] = of.powers_dbm;
    let exact = [
        (measured, of.measured_m),
        ("sigma_m", of.deviation_m),
        ("rx_power_dbm", rx_power_dbm),
        ("fp_power_dbm", first_path_dbm),
    ];
    let header = table.map_or_else(Vec::new, |table| table.header());
    for (field, column) in row.iter_mut().zip(header) {
        if let Some((_, value)) = exact.iter().find(|(name, _)| *name == column) {
            *field = number(*value);
        }
    }
}

/// A number with all its digits; empty where there is none.
fn number(value: f32) -> String {
    if value.is_finite() { value.to_string() } else { String::new() }
}

/// The telemetry of each node in a file of its own, because a stream belongs to one node. A simulation may have more
/// nodes than a process may have open files, so a file is open only while it is written.
struct Streams {
    folder: PathBuf,
    /// The tag in `telemetry.bin`: the first one.
    first_tag: Option<u16>,
    /// What is not written yet, by the address of the node.
    held: BTreeMap<u16, Vec<u8>>,
}

impl Streams {
    /// The greatest number of bytes that are held for a node.
    const MOST_HELD: usize = 1 << 14;

    /// Begins with an empty stream of the first tag.
    fn create(folder: &Path, first_tag: Option<u16>) -> io::Result<Self> {
        File::create_new(folder.join(STREAM))?;
        Ok(Self { folder: folder.to_owned(), first_tag, held: BTreeMap::new() })
    }

    fn take(&mut self, node: u16, frame: &[u8]) -> io::Result<()> {
        let held = self.held.entry(node).or_default();
        held.extend(frame);
        if held.len() < Self::MOST_HELD {
            return Ok(());
        }
        let bytes = std::mem::take(held);
        self.append(node, &bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        std::mem::take(&mut self.held).into_iter().try_for_each(|(node, bytes)| self.append(node, &bytes))
    }

    fn append(&self, node: u16, bytes: &[u8]) -> io::Result<()> {
        let name =
            if self.first_tag == Some(node) { STREAM.to_owned() } else { format!("telemetry-{}.bin", Address(node)) };
        File::options().append(true).create(true).open(self.folder.join(name))?.write_all(bytes)
    }
}

/// Writes the beacons that are configured on the tags.
fn write_beacons(folder: &Path, scenario: &Scenario) -> csv::Result<()> {
    let columns = ["beacon", "x_m", "y_m", "z_m", "rssi_1m_dbm", "path_loss_exponent"];
    let mut beacons = writer(folder, "beacons.csv", &columns)?;
    for beacon in &scenario.beacons {
        let Some(listed) = beacon.listed else { continue };
        let [x, y, z] = listed.position_m.map(|coordinate| metres(coordinate.into()));
        let figure = |known: Option<f32>| known.map_or_else(String::new, |value| value.to_string());
        let (rssi, exponent) = (figure(listed.rssi_1m_dbm), figure(listed.path_loss_exponent));
        beacons.write_record([beacon.name(), x, y, z, rssi, exponent])?;
    }
    Ok(beacons.flush()?)
}

/// Writes the floor plan. Attenuations are left out: a surveyor does not know them.
fn write_walls(folder: &Path, scenario: &Scenario) -> csv::Result<()> {
    let mut walls = writer(folder, WALLS, &["x1_m", "y1_m", "x2_m", "y2_m"])?;
    for wall in &scenario.walls {
        let [[x1, y1], [x2, y2]] = [wall.from, wall.to].map(|end| end.map(metres));
        walls.write_record([x1, y1, x2, y2])?;
    }
    Ok(walls.flush()?)
}

/// The short name of a scenario's beacon in all its files, because they are of one network.
fn short_name(sighting: &Sighting) -> String {
    format!("{}-{}", sighting.beacon.major, sighting.beacon.minor)
}

/// How the tags of a scenario measure, and in which space.
fn settings(scenario: &Scenario) -> RecordingSettings {
    let listens = |network: &Network| matches!(network.mode, config::Mode::Listening { .. });
    let mode =
        if scenario.networks.iter().all(listens) { MeasurementMode::Differences } else { MeasurementMode::Ranges };
    // Half a millimetre is finer than any height.
    let metres = |metres: f32| (f64::from(metres) * 2000.0).round() / 2000.0;
    let height_m = scenario.height_m().map(metres);
    let is_in_space = scenario.tags.iter().all(|tag| tag.settings.record.height_m.is_none());
    // Where tags differ, the reader has to say it.
    let dims = if is_in_space { Some(3) } else { height_m.map(|_| 2) };
    let mut sigmas = scenario.tags.iter().map(|tag| tag.settings.record.height_sigma_m);
    let sigma = sigmas.next().filter(|first| *first != 0.0 && sigmas.all(|other| other == *first));
    let height_sigma_m = sigma.filter(|_| height_m.is_some()).map(metres);
    // All tags of a site have its area.
    let area = scenario.tags.first().and_then(|tag| tag.settings.record.area);
    let area_m = area.map(|area| [area.least_m, area.greatest_m].map(|[x_m, y_m, _]| [metres(x_m), metres(y_m)]));
    let nlos = (!scenario.weigh_nlos).then_some(Weighting::Alike);
    RecordingSettings { dims, height_m, height_sigma_m, area_m, mode: Some(mode), nlos }
}

/// The columns of a position.
pub fn position_header() -> Vec<&'static str> {
    Fix::TABLE.iter().flat_map(Table::header).chain(["error_m", "tag"]).collect()
}

/// The fields of a position, or of the reason for its absence.
pub fn position_row(record: &Record, method: &str, epoch: &SimulatedEpoch) -> Vec<String> {
    let stamp = Stamp { t_s: record.t_s, epoch: epoch.number };
    let mut row = row(stamp, &Message::Fix(epoch.fix)).map_or_else(Vec::new, |(_, row)| row);
    complete_position(&mut row, record.node, method, epoch);
    row
}

fn complete_position(row: &mut Vec<String>, tag: u16, method: &str, epoch: &SimulatedEpoch) {
    row.splice(2..3, [method.to_owned()]);
    row.extend([epoch.error_m().map_or_else(String::new, metres), Address(tag).to_string()]);
}
