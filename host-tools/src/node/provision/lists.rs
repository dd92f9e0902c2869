//! What tags are told of: `[[anchor]]` and `[[beacon]]`, and the nodes of the same file.

use wire::config::{Anchor, Anchors, Beacon, Beacons, MAX_ANCHORS, MAX_BEACONS};

use super::calibrated::Calibrated;
use super::document::Section;
use super::network::Lines;
use crate::UserError;

const ANCHOR_KEYS: [&str; 2] = ["address", "position_m"];
const BEACON_KEYS: [&str; 5] = ["major", "minor", "position_m", "rssi_1m_dbm", "path_loss_exponent"];

/// Anchors and beacons with the lines that they come from.
#[derive(Clone, Debug, Default)]
pub(super) struct Lists {
    pub(super) anchors: Vec<(Anchor, u64)>,
    pub(super) beacons: Vec<(Beacon, u64)>,
}

impl Lists {
    /// Those that the file lists.
    pub(super) fn read(root: &Section<'_>) -> Result<Self, UserError> {
        let anchors = root.tables("anchor")?;
        let beacons = root.tables("beacon")?;
        Ok(Self {
            anchors: anchors.into_iter().map(anchor).collect::<Result<_, _>>()?,
            beacons: beacons.into_iter().map(beacon).collect::<Result<_, _>>()?,
        })
    }

    /// Adds an anchor that is a node, where it is not listed: what the list says counts.
    pub(super) fn add_anchor(&mut self, anchor: Anchor, line: u64) {
        if self.anchors.iter().all(|(listed, _)| listed.address != anchor.address) {
            self.anchors.push((anchor, line));
        }
    }

    /// Adds a beacon that is a node, where it is not listed.
    pub(super) fn add_beacon(&mut self, beacon: Beacon, line: u64) {
        let same = |listed: &Beacon| (listed.major, listed.minor) == (beacon.major, beacon.minor);
        if self.beacons.iter().all(|(listed, _)| !same(listed)) {
            self.beacons.push((beacon, line));
        }
    }

    /// Takes what was calibrated: beacons that are known already get what they lack, the others join them. The error is of a beacon
    /// that cannot.
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
                        "beacon {major}-{minor} of the file has no z_m: say there how high it is, or list it as [[beacon]]"
                    ));
                }
            }
        }
        Ok(())
    }

    /// The lists of a record, and the lines of their elements. The error is of the first line that has no room.
    pub(super) fn of_record(&self, lines: &mut Lines) -> Result<RecordLists, (u64, String)> {
        let mut lists = RecordLists::default();
        for (index, (anchor, line)) in self.anchors.iter().enumerate() {
            lines.insert(format!("anchors[{index}]"), *line);
            let full = |_| (*line, format!("a tag can be told of {MAX_ANCHORS} anchors, this is one more"));
            lists.anchors.push(*anchor).map_err(full)?;
        }
        for (index, (beacon, line)) in self.beacons.iter().enumerate() {
            lines.insert(format!("beacons[{index}]"), *line);
            let full = |_| (*line, format!("a tag can be told of {MAX_BEACONS} beacons, this is one more"));
            lists.beacons.push(*beacon).map_err(full)?;
        }
        Ok(lists)
    }
}

/// The lists as the record has them.
#[derive(Clone, Debug, Default)]
pub(super) struct RecordLists {
    pub(super) anchors: Anchors,
    pub(super) beacons: Beacons,
}

fn anchor(section: Section<'_>) -> Result<(Anchor, u64), UserError> {
    section.with_keys(&ANCHOR_KEYS, |_| None)?;
    let address = section.required("address")?.integer("a short address, 0 to 0xFFFD")?;
    Ok((Anchor { address, position_m: section.required("position_m")?.place()? }, section.line))
}

fn beacon(section: Section<'_>) -> Result<(Beacon, u64), UserError> {
    section.with_keys(&BEACON_KEYS, |_| None)?;
    let beacon = Beacon {
        major: section.required("major")?.integer("a whole number, 0 to 65535")?,
        minor: section.required("minor")?.integer("a whole number, 0 to 65535")?,
        position_m: section.required("position_m")?.place()?,
        rssi_1m_dbm: section.optional("rssi_1m_dbm").map(|field| field.real()).transpose()?,
        path_loss_exponent: section.optional("path_loss_exponent").map(|field| field.real()).transpose()?,
    };
    Ok((beacon, section.line))
}
