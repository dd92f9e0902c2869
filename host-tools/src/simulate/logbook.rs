//! A simulation's records as the files of a recording, and its positions as `solve` writes them; each with one more
//! column, the tag. Epochs count through all tags, so that one number is one fix.

use positioning_core::nlos::{Feature, Features};
use ranging::Diagnostics;
use sim::scenario::{Epoch, Scenario, What};
use wire::telemetry::Sighting;

use crate::files::positions::{CHIP_COLUMNS, COLUMNS, POWER_COLUMNS};

type Writer = csv::Writer<Vec<u8>>;

/// The files, as they fill.
pub struct Logbook {
    anchors: Writer,
    ranges: Writer,
    /// From the first difference on.
    differences: Option<Writer>,
    truth: Writer,
    positions: Writer,
    bluetooth: Option<Bluetooth>,
    /// The epoch under way.
    epoch: u64,
    method: &'static str,
    /// Features of impulse responses that ranges have columns for: none where tags read no responses.
    features: Vec<Feature>,
}

/// What beacons add.
struct Bluetooth {
    beacons: Writer,
    rssi: Writer,
}

impl Bluetooth {
    fn new(scenario: &Scenario) -> csv::Result<Self> {
        let mut beacons = with_header(&["beacon", "x_m", "y_m", "z_m", "rssi_1m_dbm", "path_loss_exponent"])?;
        // What tags are told.
        for beacon in &scenario.beacons {
            let Some(listed) = beacon.listed else { continue };
            let [x, y, z] = listed.position_m.map(|coordinate| metres(coordinate.into()));
            let figure = |known: Option<f32>| known.map_or_else(String::new, |value| value.to_string());
            let (rssi, exponent) = (figure(listed.rssi_1m_dbm), figure(listed.path_loss_exponent));
            beacons.write_record([beacon.name(), x, y, z, rssi, exponent])?;
        }
        Ok(Self { beacons, rssi: with_header(&["epoch", "t_s", "beacon", "rssi_dbm", "tag"])? })
    }

    fn take(&mut self, epoch: u64, t_s: f64, tag: u16, sighting: &Sighting) -> csv::Result<()> {
        let beacon = format!("{}-{}", sighting.beacon.major, sighting.beacon.minor);
        let (epoch, time) = (epoch.to_string(), seconds(t_s));
        self.rssi.write_record([epoch, time, beacon, sighting.rssi.to_string(), tag.to_string()])
    }
}

impl Logbook {
    /// Of a scenario.
    ///
    /// # Errors
    /// The CSV writer's.
    pub fn new(scenario: &Scenario) -> csv::Result<Self> {
        let mut anchors = with_header(&["anchor", "x_m", "y_m", "z_m"])?;
        for anchor in &scenario.anchors {
            let [x, y, z] = anchor.at.map(metres);
            anchors.write_record([anchor.address.to_string(), x, y, z])?;
        }
        let reads = scenario.tag.model.is_some();
        let features: Vec<_> = Feature::ALL.into_iter().filter(|feature| reads && feature.is_of_response()).collect();
        let range = ["epoch", "t_s", "anchor", "range_m"].into_iter().chain(received_columns()).chain(["tag"]);
        let columns: Vec<_> = range.chain(features.iter().map(|feature| feature.as_str())).collect();
        Ok(Self {
            anchors,
            ranges: with_header(&columns)?,
            differences: None,
            truth: with_header(&["epoch", "t_s", "x_m", "y_m", "z_m", "tag"])?,
            positions: with_header(&position_header())?,
            bluetooth: (!scenario.beacons.is_empty()).then(|| Bluetooth::new(scenario)).transpose()?,
            epoch: 0,
            method: scenario.tag.method_name(),
            features,
        })
    }

    /// Takes a record; epochs are written, and sightings of beacons, by the epoch under way.
    ///
    /// # Errors
    /// The CSV writer's.
    pub fn take(&mut self, record: &sim::scenario::Record) -> csv::Result<()> {
        let epoch = match &record.what {
            What::Epoch(epoch) => epoch,
            What::Sighting(sighting) => {
                let Some(bluetooth) = &mut self.bluetooth else { return Ok(()) };
                return bluetooth.take(self.epoch, record.t_s, record.node, sighting);
            }
            What::Link(_)
            | What::RadioFailed(_)
            | What::Fault(_)
            | What::Room(_)
            | What::Beacon(_)
            | What::MotionSensor(_) => return Ok(()),
        };
        self.epoch = epoch.number + 1;
        let (number, time, tag) = (epoch.number.to_string(), seconds(record.t_s), record.node.to_string());
        for measured in &epoch.ranges {
            let range = measured.range;
            let mut told = Features::default();
            if let Some(shape) = &measured.shape {
                told.set_shape(shape);
            }
            let told =
                self.features.iter().map(|&feature| told.get(feature).map_or_else(String::new, |x| x.to_string()));
            let start = [number.clone(), time.clone(), range.peer.to_string(), metres(range.distance_m.into())];
            let row = start.into_iter().chain(received(&range.diagnostics, measured.los)).chain([tag.clone()]);
            self.ranges.write_record(row.chain(told))?;
        }
        for measured in &epoch.differences {
            let difference = measured.difference;
            let writer = match &mut self.differences {
                Some(writer) => writer,
                None => self.differences.insert(with_header(&difference_columns())?),
            };
            let (reference, anchor) = (measured.reference.to_string(), difference.peer.to_string());
            let start = [number.clone(), time.clone(), reference, anchor, metres(difference.difference_m.into())];
            let row = start.into_iter().chain(received(&difference.diagnostics, measured.los));
            writer.write_record(row.chain([metres(measured.truth_m), tag.clone()]))?;
        }
        let [x, y, z] = epoch.truth_m.map(metres);
        self.truth.write_record([number, time, x, y, z, tag])?;
        self.positions.write_record(position_row(record.t_s, record.node, self.method, epoch))
    }

    /// The files by name.
    ///
    /// # Errors
    /// The CSV writer's.
    pub fn finish(self) -> csv::Result<Vec<(&'static str, Vec<u8>)>> {
        let bytes = |writer: Writer| writer.into_inner().map_err(|error| csv::Error::from(error.into_error()));
        let mut files = vec![
            ("anchors.csv", bytes(self.anchors)?),
            ("ranges.csv", bytes(self.ranges)?),
            ("truth.csv", bytes(self.truth)?),
            ("positions.csv", bytes(self.positions)?),
        ];
        if let Some(Bluetooth { beacons, rssi }) = self.bluetooth {
            files.extend([("beacons.csv", bytes(beacons)?), ("rssi.csv", bytes(rssi)?)]);
        }
        if let Some(differences) = self.differences {
            files.push(("differences.csv", bytes(differences)?));
        }
        Ok(files)
    }
}

/// The columns of a difference of arrivals: as `decode` has them, and the truth. The reference comes first, with a difference of 0.
fn difference_columns() -> Vec<&'static str> {
    let start = ["epoch", "t_s", "reference", "anchor", "difference_m"].into_iter();
    start.chain(received_columns()).chain(["truth_m", "tag"]).collect()
}

/// The columns of what a receiver measured, as the contract of the files names them.
fn received_columns() -> impl Iterator<Item = &'static str> {
    POWER_COLUMNS.into_iter().chain(["los"]).chain(CHIP_COLUMNS)
}

/// Their fields.
fn received(measured: &Diagnostics, los: bool) -> [String; 10] {
    let [amp1, amp2, amp3] = measured.first_path_amplitudes.map(|amplitude| amplitude.to_string());
    [
        format!("{:.2}", measured.rx_power_dbm),
        format!("{:.2}", measured.first_path_power_dbm),
        if los { "1" } else { "0" }.to_owned(),
        measured.first_path_index.to_string(),
        amp1,
        amp2,
        amp3,
        measured.cir_power.to_string(),
        measured.preamble_count.to_string(),
        measured.noise_deviation.to_string(),
    ]
}

/// The columns of a position.
pub fn position_header() -> Vec<&'static str> {
    COLUMNS.into_iter().chain(["error_m", "tag"]).collect()
}

/// The fields of a position, or of the reason why there is none.
pub fn position_row(t_s: f64, tag: u16, method: &str, epoch: &Epoch) -> Vec<String> {
    let mut row = vec![epoch.number.to_string(), seconds(t_s), method.to_owned()];
    match &epoch.outcome {
        Ok(position) => {
            let sigma = position.deviation_m().map(|sigma| metres(sigma.into()));
            let [sigma_x, sigma_y, sigma_z] = sigma;
            row.extend(position.position_m.map(|coordinate| metres(coordinate.into())));
            row.extend([sigma_x, sigma_y, if position.height_is_given() { String::new() } else { sigma_z }]);
            row.extend([position.used.count_ones().to_string(), String::new()]);
        }
        Err(reason) => {
            row.extend([const { String::new() }; 7]);
            row.push(reason.to_string());
        }
    }
    row.extend([epoch.error_m().map_or_else(String::new, metres), tag.to_string()]);
    row
}

fn with_header(columns: &[&str]) -> csv::Result<Writer> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(columns)?;
    Ok(writer)
}

/// A tenth of a millimetre is finer than any range.
fn metres(value: f64) -> String {
    format!("{value:.4}")
}

fn seconds(value: f64) -> String {
    format!("{value:.6}")
}
