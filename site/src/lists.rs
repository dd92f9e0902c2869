//! The lists of a tag's record: `[[anchor]]` and `[[beacon]]`, and the nodes of the same file.

use std::collections::HashSet;

use serde::Deserialize;
use wire::config::{Anchor, Anchors, Beacon, Beacons, MAX_ANCHORS, MAX_BEACONS};

use crate::document::SiteError;
use crate::values::Exactly;

/// `[[anchor]]`.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct AnchorTable {
    address: u16,
    position_m: Exactly<f32, 3>,
}

/// `[[beacon]]`.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct BeaconTable {
    major: u16,
    minor: u16,
    position_m: Exactly<f32, 3>,
    rssi_1m_dbm: Option<f32>,
    path_loss_exponent: Option<f32>,
}

impl From<&AnchorTable> for Anchor {
    fn from(table: &AnchorTable) -> Self {
        Self { address: table.address, position_m: table.position_m.0 }
    }
}

impl From<&BeaconTable> for Beacon {
    fn from(table: &BeaconTable) -> Self {
        let BeaconTable { major, minor, position_m: Exactly(position_m), rssi_1m_dbm, path_loss_exponent } = *table;
        Self { major, minor, position_m, rssi_1m_dbm, path_loss_exponent }
    }
}

/// A beacon of `beacons_csv`. If its height is not known there, the site's file must list the beacon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibrated {
    /// The beacon.
    pub beacon: Beacon,
    /// Whether the third coordinate of its position is known.
    pub height_is_known: bool,
}

/// The anchors and beacons that tags are told of, with the numbers of their lines.
#[derive(Clone, Debug, Default)]
pub struct Lists {
    /// The anchors: those of `[[anchor]]`, then nodes.
    pub anchors: Vec<(Anchor, u64)>,
    /// The beacons: those of `[[beacon]]`, then nodes, then those of `beacons_csv`.
    pub beacons: Vec<(Beacon, u64)>,
}

impl Lists {
    /// Adds the anchors that are nodes, unless they are listed: the list has precedence.
    pub(crate) fn add_anchors(&mut self, nodes: impl Iterator<Item = (Anchor, u64)>) {
        let mut known: HashSet<_> = self.anchors.iter().map(|(anchor, _)| anchor.address).collect();
        self.anchors.extend(nodes.filter(|(anchor, _)| known.insert(anchor.address)));
    }

    /// Adds the beacons that are nodes, unless they are listed.
    pub(crate) fn add_beacons(&mut self, nodes: impl Iterator<Item = (Beacon, u64)>) {
        let mut known: HashSet<_> = self.beacons.iter().map(|(beacon, _)| (beacon.major, beacon.minor)).collect();
        self.beacons.extend(nodes.filter(|(beacon, _)| known.insert((beacon.major, beacon.minor))));
    }

    /// The listed beacon with these numbers.
    pub fn beacon(&self, major: u16, minor: u16) -> Option<&Beacon> {
        self.beacons.iter().map(|(beacon, _)| beacon).find(|beacon| (beacon.major, beacon.minor) == (major, minor))
    }

    /// Adds calibrated beacons. Beacons that are listed already get the values that they lack, and the other beacons
    /// are added. The error is about a beacon that cannot be added.
    pub(crate) fn calibrate(&mut self, calibrated: &[Calibrated], line: u64) -> Result<(), String> {
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
    pub(crate) fn of_record(&self) -> Result<(Anchors, Beacons), SiteError> {
        let (mut anchors, mut beacons) = (Anchors::default(), Beacons::default());
        for (anchor, line) in &self.anchors {
            let full =
                |_| SiteError::at(*line, format!("a tag's record holds {MAX_ANCHORS} anchors, and this is one more"));
            anchors.push(*anchor).map_err(full)?;
        }
        for (beacon, line) in &self.beacons {
            let full =
                |_| SiteError::at(*line, format!("a tag's record holds {MAX_BEACONS} beacons, and this is one more"));
            beacons.push(*beacon).map_err(full)?;
        }
        Ok((anchors, beacons))
    }

    /// The line number of an element of a record's list.
    pub(crate) fn line(&self, list: &str, index: usize) -> Option<u64> {
        match list {
            "anchors" => self.anchors.get(index).map(|(_, line)| *line),
            "beacons" => self.beacons.get(index).map(|(_, line)| *line),
            _ => None,
        }
    }
}
