//! `baliza ble`: positions from the RSSI values of Bluetooth beacons.

mod fingerprint;
mod map;
mod rooms;
pub mod solve;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use analysis::survey::fingerprint::{Average, Plan, Survey};
use anyhow::Result;
use positioning_core::ble::fingerprint::MAX_BEACONS;
use recording::beacons::{Beacon, Capture, Captured, Dwell, Wall, read_beacons, read_walls};
use recording::{DOCUMENT_BYTES, read_limited};
use recording::{Epochs, Height, Solved, UserError};

use crate::cli::floor_plan::FloorPlan;
use crate::cli::report::{Output, Report, Site, TagReport};

super::commands! {
    /// Positions from the RSSI values of Bluetooth beacons
    pub enum Arguments {
        Rooms(rooms),
        Solve(solve),
        Fingerprint(fingerprint),
        Map(map),
    }
}

/// Names of beacons or rooms, separated by commas.
#[derive(Clone, Debug)]
struct Names(Vec<String>);

impl Names {
    fn parse(text: &str) -> Result<Self, String> {
        let names: Vec<String> = text.split(',').map(|name| name.trim().to_owned()).collect();
        match names.iter().enumerate().find(|(at, name)| name.is_empty() || names[..*at].contains(name)) {
            Some((_, name)) if name.is_empty() => Err("a name is empty".to_owned()),
            Some((_, name)) => Err(format!("{name:?} stands twice")),
            None => Ok(Self(names)),
        }
    }

    /// The names, of which there must be `count`.
    fn of(&self, flag: &'static str, what: &str, count: usize) -> Result<Vec<String>, UserError> {
        let names = self.0.len();
        if names == count {
            Ok(self.0.clone())
        } else {
            Err(UserError::flag(flag, format!("{names} names of {count} {what}")))
        }
    }
}

/// Reads the bytes of a map or a model.
fn read_bytes(file: &Path) -> Result<Vec<u8>, UserError> {
    read_limited(file, DOCUMENT_BYTES)
}

/// The names as part of a sentence.
fn listed(names: BTreeSet<&str>) -> String {
    names.into_iter().collect::<Vec<_>>().join(", ")
}

fn heard(tags: &[Captured]) -> BTreeSet<&str> {
    let captures = tags.iter().flat_map(|of| &of.captures);
    captures.flat_map(|capture| &capture.samples).map(|sample| sample.beacon.as_str()).collect()
}

/// Prints a note about received beacons that are not in `known`.
fn tell_strange(known: &[impl AsRef<str>], tags: &[Captured], place: &str) {
    let known: BTreeSet<&str> = known.iter().map(AsRef::as_ref).collect();
    let strange: BTreeSet<&str> = heard(tags).difference(&known).copied().collect();
    if !strange.is_empty() {
        super::note(&format!("heard, but not on {place}: {}\n", listed(strange)));
    }
}

/// Prints a note about received beacons that are not on the map, and about beacons on the map that were never received.
fn tell_unknown(beacons: &[Beacon], tags: &[Captured]) {
    let names: Vec<&str> = beacons.iter().map(|beacon| beacon.name.as_str()).collect();
    tell_strange(&names, tags, "the map");
    let (known, heard) = (BTreeSet::from_iter(names), heard(tags));
    let mute: BTreeSet<&str> = known.difference(&heard).copied().collect();
    if !mute.is_empty() {
        super::note(&format!("on the map, but never heard: {}\n", listed(mute)));
    }
    let usual = beacons.iter().filter(|beacon| beacon.rssi_1m_dbm.is_none() || beacon.path_loss_exponent.is_none());
    let usual: BTreeSet<&str> = usual.map(|beacon| beacon.name.as_str()).collect();
    if !usual.is_empty() {
        super::note(&format!("path loss not known, taken to be usual: {}\n", listed(usual)));
    }
}

/// Known data of a site in addition to its survey.
#[derive(clap::Args)]
struct PlanArguments {
    /// Beacons whose positions are known: CSV with beacon,x_m,y_m; RSSI values are then expected to follow path loss
    /// from them
    #[arg(long, value_name = "FILE")]
    beacons: Option<PathBuf>,
    /// Walls, which no tag crosses, which attenuate the RSSI values of --beacons and are drawn: CSV with the corners of
    /// an outline, x_m,y_m, or with x1_m,y1_m,x2_m,y2_m and, where known, attenuation_db
    #[arg(long, value_name = "FILE")]
    walls: Option<PathBuf>,
}

impl PlanArguments {
    fn read(&self) -> Result<Plan, UserError> {
        let beacons = self.beacons.as_deref().map(read_beacons).transpose()?.unwrap_or_default();
        Ok(Plan { beacons, walls: self.walls.as_deref().map(read_walls).transpose()?.unwrap_or_default() })
    }
}

/// The survey of a file's dwells. A survey that makes no map is refused.
fn survey_of(file: &Path, stays: &[Dwell], average: Average) -> Result<Survey, UserError> {
    let survey = Survey::of(stays, average);
    let names = survey.beacons.len();
    if names > MAX_BEACONS {
        return Err(UserError::line(file, 1, format!("{names} beacons; a map has at most {MAX_BEACONS}")));
    }
    if survey.spots.iter().flat_map(|spot| &spot.rssis).all(Option::is_none) {
        return Err(UserError::line(file, 1, "no point hears any beacon"));
    }
    if survey.spots.len() > usize::from(u16::MAX) {
        return Err(UserError::line(file, 1, format!("{} points; a map has at most {}", survey.spots.len(), u16::MAX)));
    }
    Ok(survey)
}

/// The positions of tags by their captures, and what is drawn with them.
struct Found<'a> {
    /// The file of the captures.
    source: Option<&'a Path>,
    methods: Vec<String>,
    /// The number of neighbours of each method, where the method has neighbours; `None` for `solve` and `track`.
    neighbours: Option<Vec<Option<usize>>>,
    tags: &'a [Captured],
    /// By tag and method: the position of each capture.
    solved: &'a [Vec<Vec<Solved>>],
    beacons: &'a [Beacon],
    walls: &'a [Wall],
}

impl Found<'_> {
    /// Writes the positions and the picture, and prints the summary.
    fn report(self, output: &Output) -> Result<()> {
        let epochs: Vec<Epochs> = self.tags.iter().map(|of| epochs(&of.captures)).collect();
        let tags = self.tags.iter().zip(&epochs).zip(self.solved).map(|((of, epochs), solved)| TagReport {
            tag: of.tag.as_deref(),
            epochs,
            solved,
            time_offset_s: None,
            residuals: None,
            findings: None,
        });
        let report = Report {
            methods: self.methods,
            site: Site {
                source: self.source.map_or_else(String::new, |file| file.display().to_string()),
                beacons: self.beacons.iter().map(|beacon| (beacon.name.clone(), beacon.position_m)).collect(),
                floor_plan: FloorPlan::of_walls(self.walls),
                are_dwells: self.tags.iter().flat_map(|of| &of.captures).any(|capture| capture.is_stay),
                ..Site::default()
            },
            with_errors: epochs.iter().flat_map(Epochs::iter).any(|epoch| epoch.truth.is_some()),
            height: Height::Unknown,
            neighbours: self.neighbours,
            tags: tags.collect(),
        };
        report.write(output)
    }
}

/// Captures as epochs for the files of positions and for the pictures.
fn epochs(captures: &[Capture]) -> Epochs {
    let mut epochs = Epochs::default();
    for capture in captures {
        let truth = capture.truth_m.map(|[x_m, y_m]| recording::Coordinates { x_m, y_m, z_m: None });
        epochs.push(&capture.name, capture.t_s, truth);
    }
    epochs
}
