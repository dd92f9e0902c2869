//! The lists of a tag's record: `[[anchor]]` and `[[beacon]]`, and the nodes of the same file.

use wire::config::{Anchor, Anchors, Beacon, Beacons, MAX_ANCHORS, MAX_BEACONS};

use serde::Deserialize;

use super::calibrated::Calibrated;

/// `[[anchor]]`.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AnchorTable {
    address: u16,
    position_m: [f32; 3],
}

/// `[[beacon]]`.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BeaconTable {
    major: u16,
    minor: u16,
    position_m: [f32; 3],
    rssi_1m_dbm: Option<f32>,
    path_loss_exponent: Option<f32>,
}

impl From<&AnchorTable> for Anchor {
    fn from(table: &AnchorTable) -> Self {
        Self { address: table.address, position_m: table.position_m }
    }
}

impl From<&BeaconTable> for Beacon {
    fn from(table: &BeaconTable) -> Self {
        let BeaconTable { major, minor, position_m, rssi_1m_dbm, path_loss_exponent } = *table;
        Self { major, minor, position_m, rssi_1m_dbm, path_loss_exponent }
    }
}

/// Anchors and beacons with the numbers of their lines.
#[derive(Clone, Debug, Default)]
pub(super) struct Lists {
    pub(super) anchors: Vec<(Anchor, u64)>,
    pub(super) beacons: Vec<(Beacon, u64)>,
}

impl Lists {
    /// Adds an anchor that is a node, unless it is listed: the list has precedence.
    pub(super) fn add_anchor(&mut self, anchor: Anchor, line: u64) {
        if self.anchors.iter().all(|(listed, _)| listed.address != anchor.address) {
            self.anchors.push((anchor, line));
        }
    }

    /// Adds a beacon that is a node, unless it is listed.
    pub(super) fn add_beacon(&mut self, beacon: Beacon, line: u64) {
        let same = |listed: &Beacon| (listed.major, listed.minor) == (beacon.major, beacon.minor);
        if self.beacons.iter().all(|(listed, _)| !same(listed)) {
            self.beacons.push((beacon, line));
        }
    }

    /// Adds calibrated beacons. Beacons that are listed already get the values that they lack, and the other beacons
    /// are added. The error is about a beacon that cannot be added.
    pub(super) fn calibrate(&mut self, calibrated: &[Calibrated], line: u64) -> Result<(), String> {
        for Calibrated { beacon, height_is_known } in calibrated {
            let same = |listed: &Beacon| (listed.major, listed.minor) == (beacon.major, beacon.minor);
            match self.beacons.iter_mut().find(|(listed, _)| same(listed)) {
                Some((listed, _)) => {
                    listed.rssi_1m_dbm = listed.rssi_1m_dbm.or(beacon.rssi_1m_dbm);
                    listed.path_loss_exponent = listed.path_loss_exponent.or(beacon.path_loss_exponent);
                }
                None if *height_is_known => self.beacons.push((*beacon, line)),
                None => {
                    let Beacon { major, minor, .. } = beacon;
                    return Err(format!(
                        "beacon {major}-{minor} of the file has no z_m: add its height there, or list it as [[beacon]]"
                    ));
                }
            }
        }
        Ok(())
    }

    /// The lists of a record. The error is about the first line for which the record has no room.
    pub(super) fn of_record(&self) -> Result<(Anchors, Beacons), (u64, String)> {
        let (mut anchors, mut beacons) = (Anchors::default(), Beacons::default());
        for (anchor, line) in &self.anchors {
            let full = |_| (*line, format!("a tag's record holds {MAX_ANCHORS} anchors, and this is one more"));
            anchors.push(*anchor).map_err(full)?;
        }
        for (beacon, line) in &self.beacons {
            let full = |_| (*line, format!("a tag's record holds {MAX_BEACONS} beacons, and this is one more"));
            beacons.push(*beacon).map_err(full)?;
        }
        Ok((anchors, beacons))
    }

    /// The line number of an element of a record's list.
    pub(super) fn line(&self, list: &str, index: usize) -> Option<u64> {
        match list {
            "anchors" => self.anchors.get(index).map(|(_, line)| *line),
            "beacons" => self.beacons.get(index).map(|(_, line)| *line),
            _ => None,
        }
    }
}
