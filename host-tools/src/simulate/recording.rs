//! The recording that a simulation's tags make, by the same [`Recorder`] as a recording of real nodes, and the true
//! positions. Each table has one more column, the tag. Epochs count through all tags, so that each number belongs to
//! one position.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use positioning_core::nlos::{Feature, Features};
use sim::scenario::{Record, Scenario, SimulatedEpoch, What};
use wire::telemetry::{Body, Fix, MAX_FRAME, Message, Sighting, Table, encode, metres};

use crate::files::output::{Growing, write_file};
use crate::node::decode::{Stamp, row};
use crate::node::recorder::{Recorder, writer};

/// A recording in progress.
pub struct SimulatedRecording {
    folder: PathBuf,
    recorder: Recorder,
    truth: csv::Writer<Growing>,
    beacons: Option<csv::Writer<Growing>>,
    /// The tag in `telemetry.bin`: the first one.
    first_tag: Option<u16>,
    /// The telemetry of every other node, by its address: a stream belongs to one node.
    others: BTreeMap<u16, Vec<u8>>,
    /// The current epoch.
    epoch: u64,
    method: &'static str,
    /// Features of impulse responses, which telemetry does not contain; empty where tags read no responses.
    features: Vec<Feature>,
}

impl SimulatedRecording {
    /// Begins the recording of a scenario in a folder, which is made where it does not exist.
    ///
    /// # Errors
    /// The path is no folder, or the file system fails.
    pub fn create(folder: &Path, scenario: &Scenario) -> anyhow::Result<Self> {
        let anchors = scenario.anchors.iter().map(|anchor| (anchor.address, scenario.surveyed_m(anchor))).collect();
        let reads = scenario.tag.model.is_some();
        let features: Vec<_> = Feature::ALL.into_iter().filter(|feature| reads && feature.is_of_response()).collect();
        let of_ranges = ["los", "tag"].into_iter().chain(features.iter().map(|feature| feature.as_str()));
        let more = BTreeMap::from([
            ("positions", vec!["error_m", "tag"]),
            ("ranges", of_ranges.collect()),
            ("differences", vec!["los", "truth_m", "tag"]),
            ("rssi", vec!["tag"]),
            ("rooms", vec!["tag"]),
        ]);
        Ok(Self {
            recorder: Recorder::begin(folder, anchors, more)?,
            truth: writer(folder, "truth.csv", &["epoch", "t_s", "x_m", "y_m", "z_m", "tag"])?,
            beacons: (!scenario.beacons.is_empty()).then(|| beacons(folder, scenario)).transpose()?,
            folder: folder.to_owned(),
            first_tag: scenario.tags.first().map(|tag| tag.address),
            others: BTreeMap::new(),
            epoch: 0,
            method: scenario.tag.method_name(),
            features,
        })
    }

    /// Adds a record.
    ///
    /// # Errors
    /// The file system fails.
    pub fn take(&mut self, record: &Record) -> anyhow::Result<()> {
        for message in record.messages() {
            let mut frame = [0; MAX_FRAME];
            let frame = encode(&message, &mut frame);
            if self.first_tag == Some(record.node) {
                self.recorder.bytes(frame)?;
            } else {
                self.others.entry(record.node).or_default().extend(frame);
            }
        }
        let tag = record.node.to_string();
        let stamp = Stamp { t_s: record.t_s, epoch: self.epoch };
        match &record.what {
            What::Epoch(epoch) => {
                self.epoch = epoch.number + 1;
                self.take_epoch(record, epoch)?;
            }
            What::Message(message @ Message::Sighting(sighting)) => {
                self.recorder.message_with(stamp, message, |row| {
                    row.splice(2..3, [short_name(sighting)]);
                    row.push(tag);
                })?;
            }
            What::Message(message @ Message::Room(_)) => {
                self.recorder.message_with(stamp, message, |row| row.push(tag))?;
            }
            // Ranges without a round are those that tags report to anchors.
            What::Message(
                Message::Hello(_)
                | Message::Fix(_)
                | Message::Range(_)
                | Message::Difference(_)
                | Message::State(_)
                | Message::Counters(_)
                | Message::Reset(_),
            )
            | What::Fault(_) => {}
        }
        Ok(())
    }

    fn take_epoch(&mut self, record: &Record, epoch: &SimulatedEpoch) -> csv::Result<()> {
        let stamp = Stamp { t_s: record.t_s, epoch: epoch.number };
        let tag = || record.node.to_string();
        let los = |los: bool| if los { "1" } else { "0" }.to_owned();
        for measured in &epoch.ranges {
            let mut shape = Features::default();
            measured.shape.iter().for_each(|of| shape.set_shape(of));
            let features = self.features.iter().map(|&of| shape.get(of).map_or_else(String::new, |x| x.to_string()));
            self.recorder.message_with(stamp, &Message::Range(measured.range), |row| {
                row.extend([los(measured.los), tag()].into_iter().chain(features));
            })?;
        }
        for measured in &epoch.differences {
            self.recorder.message_with(stamp, &Message::Difference(measured.difference), |row| {
                row.extend([los(measured.los), metres(measured.truth_m), tag()]);
            })?;
        }
        self.recorder.message_with(stamp, &Message::Fix(epoch.fix), |row| {
            complete_position(row, record.node, self.method, epoch);
        })?;
        let [x, y, z] = epoch.truth_m.map(metres);
        self.truth.write_record([epoch.number.to_string(), format!("{:.6}", record.t_s), x, y, z, tag()])
    }

    /// Moves all files to their places.
    ///
    /// # Errors
    /// The file system fails.
    pub fn finish(self) -> anyhow::Result<()> {
        self.recorder.finish()?;
        for table in [Some(self.truth), self.beacons].into_iter().flatten() {
            table.into_inner().map_err(csv::IntoInnerError::into_error)?.finish()?;
        }
        for (node, bytes) in self.others {
            write_file(&self.folder.join(format!("telemetry-{node}.bin")), &bytes)?;
        }
        Ok(())
    }
}

/// The beacons that are configured on the tags.
fn beacons(folder: &Path, scenario: &Scenario) -> csv::Result<csv::Writer<Growing>> {
    let columns = ["beacon", "x_m", "y_m", "z_m", "rssi_1m_dbm", "path_loss_exponent"];
    let mut beacons = writer(folder, "beacons.csv", &columns)?;
    for beacon in &scenario.beacons {
        let Some(listed) = beacon.listed else { continue };
        let [x, y, z] = listed.position_m.map(|coordinate| metres(coordinate.into()));
        let figure = |known: Option<f32>| known.map_or_else(String::new, |value| value.to_string());
        let (rssi, exponent) = (figure(listed.rssi_1m_dbm), figure(listed.path_loss_exponent));
        beacons.write_record([beacon.name(), x, y, z, rssi, exponent])?;
    }
    Ok(beacons)
}

/// The short name of a scenario's beacon in all its files, because they are of one network.
fn short_name(sighting: &Sighting) -> String {
    format!("{}-{}", sighting.beacon.major, sighting.beacon.minor)
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
    row.extend([epoch.error_m().map_or_else(String::new, metres), tag.to_string()]);
}
