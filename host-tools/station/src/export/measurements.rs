//! Ranges and sightings as the tables of a recording: `ranges.csv` with `anchors.csv`, `rssi.csv` with `beacons.csv`.
//! In the latter two, what a fixed receiver received stands as if it were a beacon: `ble` takes both alike.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::Result;
use station_core::model::{MeasuredValue, NodeMeasurement, PlacedNode};

use super::recording_tables::metres;
use super::seconds;
use node_link::recorder::writer;

/// A table of measurements, and the table of the nodes that they are to.
struct Pair {
    file: &'static str,
    columns: &'static [&'static str],
    nodes_file: &'static str,
    nodes_columns: &'static [&'static str],
}

const RANGES: Pair = Pair {
    file: "ranges.csv",
    columns: &["epoch", "t_s", "tag", "anchor", "range_m", "rx_power_dbm", "fp_power_dbm", "clock_offset_ppm"],
    nodes_file: "anchors.csv",
    nodes_columns: &["anchor", "x_m", "y_m", "z_m"],
};
const SIGHTINGS: Pair = Pair {
    file: "rssi.csv",
    columns: &["epoch", "t_s", "tag", "beacon", "rssi_dbm"],
    nodes_file: "beacons.csv",
    nodes_columns: &["beacon", "x_m", "y_m", "z_m", "rssi_1m_dbm", "path_loss_exponent"],
};

/// The rows of one table so far.
struct Written {
    table: csv::Writer<File>,
    /// The nodes of its rows.
    nodes: BTreeMap<String, PlacedNode>,
}

/// The tables of measurements. A table without rows is not written.
pub(super) struct Measurements {
    folder: PathBuf,
    places: BTreeMap<String, PlacedNode>,
    ranges: Option<Written>,
    sightings: Option<Written>,
    rows: usize,
    left_out: BTreeMap<String, usize>,
}

impl Measurements {
    /// No measurements yet, to nodes at these places.
    pub(super) fn new(folder: &Path, places: Vec<PlacedNode>) -> Self {
        let places = places.into_iter().map(|node| (node.node.clone(), node)).collect();
        let left_out = BTreeMap::new();
        Self { folder: folder.to_owned(), places, ranges: None, sightings: None, rows: 0, left_out }
    }

    /// Takes the measurements of a round.
    pub(super) fn take(&mut self, epoch: usize, measurements: &[NodeMeasurement]) -> csv::Result<()> {
        measurements.iter().try_for_each(|measurement| self.row(epoch, measurement))
    }

    fn row(&mut self, epoch: usize, measurement: &NodeMeasurement) -> csv::Result<()> {
        let NodeMeasurement { node, tag, t, what, .. } = measurement;
        let Some(place) = self.places.get(node) else {
            *self.left_out.entry(node.clone()).or_default() += 1;
            return Ok(());
        };
        let mut row = vec![epoch.to_string(), seconds(*t), tag.clone(), node.clone()];
        let (pair, written) = match *what {
            MeasuredValue::Range(range) => {
                row.push(metres(Some(range.range_m)));
                row.extend([range.rx_power_dbm, range.first_path_power_dbm].map(hundredths));
                row.push(metres(range.clock_offset_ppm));
                (RANGES, &mut self.ranges)
            }
            MeasuredValue::Rssi(rssi_dbm) => {
                row.push(hundredths(Some(rssi_dbm)));
                (SIGHTINGS, &mut self.sightings)
            }
        };
        let written = match written {
            Some(written) => written,
            none => {
                let table = writer(&self.folder, pair.file, pair.columns)?;
                none.insert(Written { table, nodes: BTreeMap::new() })
            }
        };
        if !written.nodes.contains_key(node) {
            written.nodes.insert(node.clone(), place.clone());
        }
        self.rows += 1;
        written.table.write_record(row)
    }

    /// Completes the tables. Returns the number of rows, and of those that were left out because the place of their
    /// node is not known.
    pub(super) fn finish(self) -> Result<(usize, BTreeMap<String, usize>)> {
        for (pair, written) in [(RANGES, self.ranges), (SIGHTINGS, self.sightings)] {
            let Some(mut written) = written else { continue };
            written.table.flush()?;
            let mut table = writer(&self.folder, pair.nodes_file, pair.nodes_columns)?;
            for (node, place) in written.nodes {
                let row = [node].into_iter().chain(place.position_m.map(|m| metres(Some(m))));
                let path_loss = [hundredths(place.rssi_1m_dbm), metres(place.path_loss_exponent)];
                table.write_record(row.chain(path_loss).take(pair.nodes_columns.len()))?;
            }
            table.flush()?;
        }
        Ok((self.rows, self.left_out))
    }
}

fn hundredths(value: Option<f64>) -> String {
    value.map(|value| format!("{value:.2}")).unwrap_or_default()
}
