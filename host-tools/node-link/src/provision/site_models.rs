//! The RSSI models of a tag: a map of fingerprints and a model of rooms, from the files of `baliza ble`, bound to the
//! beacons of the tag's record. This module also describes the models of a node in words.

use std::path::Path;

use positioning_core::ble::fingerprint::{MAX_NODE_POINTS, Map};
use positioning_core::ble::rooms::{Classifier, Model, NodeModel};
use site::NodeFiles;
use wire::config::{Beacon, BeaconModel, MODELS_BYTES, StoredSiteModels, decode_models, encode_models};

use super::calibrated::numbers;
use super::site::beside;
use analysis::survey::rooms::ModelFile;
use recording::{DOCUMENT_BYTES, limited_bytes};

/// The keys of a tag's section.
pub(super) const KEYS: [&str; 2] = ["fingerprint_map", "room_model"];

/// One of the two models.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Map,
    Rooms,
}

/// A beacon's name in a model: its minor number, and its major number where the name has one.
type Called = (Option<u16>, u16);

/// The models of the files that a tag's table names, as a node stores them, bound to these beacons; `None` without
/// files. Paths are relative to the site's file. The error is a key and what is wrong with it.
///
/// # Errors
/// A file cannot be read, is not of its kind, or is not suitable for a node; or a beacon of the models is not among
/// `beacons`.
pub(super) fn of_files(
    site: &Path,
    files: &NodeFiles,
    beacons: &[Beacon],
) -> Result<Option<Vec<u8>>, (&'static str, String)> {
    let [map_key, rooms_key] = KEYS;
    let map = files.fingerprint_map.as_ref().map(|name| named(map_key, &beside(site, name), read_map)).transpose()?;
    let rooms = files.room_model.as_ref().map(|name| named(rooms_key, &beside(site, name), read_rooms)).transpose()?;
    if map.is_none() && rooms.is_none() {
        return Ok(None);
    }
    encode(map.as_deref(), rooms.as_ref(), beacons).map(Some).map_err(|(part, what)| {
        let key = match part {
            Part::Map => map_key,
            Part::Rooms => rooms_key,
        };
        (key, format!("{key} {what}"))
    })
}

/// A map and a model of rooms as a node stores them, bound to the beacons of its record. The error is the model and
/// what is wrong with it.
///
/// # Errors
/// A beacon of the models is not among `beacons`, or two beacons match it, or the models are too long.
fn encode(map: Option<&[u8]>, rooms: Option<&ModelFile>, beacons: &[Beacon]) -> Result<Vec<u8>, (Part, String)> {
    let (mut of_map, mut of_rooms) = (Vec::new(), Vec::new());
    if let Some(map) = map {
        let identities: Vec<u16> = Map::decode(map).map(|(map, _)| map.identities().collect()).unwrap_or_default();
        of_map =
            bind(identities.into_iter().map(|minor| Some((None, minor))), beacons).map_err(|what| (Part::Map, what))?;
    }
    if let Some(rooms) = rooms {
        of_rooms =
            bind(rooms.names.beacons.iter().map(|name| called(name)), beacons).map_err(|what| (Part::Rooms, what))?;
    }
    let models = StoredSiteModels {
        map: map.map(|model| BeaconModel { beacons: &of_map, model }),
        rooms: rooms.map(|rooms| BeaconModel { beacons: &of_rooms, model: &rooms.model }),
        room_names: &rooms.map(|rooms| rooms.names.rooms.join("\n")).unwrap_or_default(),
    };
    let bytes = encode_models(&models, &mut [0; MODELS_BYTES]).map(<[u8]>::to_vec);
    bytes.ok_or_else(|| {
        let size = |model: Option<BeaconModel<'_>>| model.map_or(0, |of| of.model.len());
        let all = size(models.map) + size(models.rooms);
        let part = if map.is_some() { Part::Map } else { Part::Rooms };
        (part, format!("makes models of {all} bytes: a node has room for {MODELS_BYTES} in all"))
    })
}

/// Reads a map for a node from a file of `baliza ble map`.
///
/// # Errors
/// The file cannot be read, or it is not a map for a node. The error is a message.
pub fn read_map(file: &Path) -> Result<Vec<u8>, String> {
    let bytes = limited_bytes(file, DOCUMENT_BYTES)?;
    let (map, rest) = Map::decode(&bytes).map_err(|fault| fault.to_string())?;
    if !rest.is_empty() {
        return Err(format!("a map, and {} bytes behind it", rest.len()));
    }
    if !map.has_deviations() {
        return Err("a map of surveyed points: a tag needs a lattice, made without --surveyed".to_owned());
    }
    if map.points() > MAX_NODE_POINTS {
        return Err(format!("a map of {} points: a tag has time for {MAX_NODE_POINTS}", map.points()));
    }
    Ok(bytes)
}

/// Reads a model of rooms from a file of `baliza ble rooms --out`.
///
/// # Errors
/// The file cannot be read, or it is not a model of rooms for a node. The error is a message.
pub fn read_rooms(file: &Path) -> Result<ModelFile, String> {
    let read = ModelFile::parse(&limited_bytes(file, DOCUMENT_BYTES)?)?;
    match NodeModel::decode(&read.model) {
        Ok(_) => Ok(read),
        Err(_) => {
            Err("a model of the nearest fingerprints: a tag needs a support vector machine, made by --method svm"
                .to_owned())
        }
    }
}

/// The content of the file that a key names. The error has the key.
fn named<T>(
    key: &'static str,
    file: &Path,
    read: impl FnOnce(&Path) -> Result<T, String>,
) -> Result<T, (&'static str, String)> {
    read(file).map_err(|what| (key, format!("{key}: {}: {what}", file.display())))
}

fn called(name: &str) -> Option<Called> {
    numbers(name).map(|(major, minor)| (Some(major), minor)).or_else(|| Some((None, name.parse().ok()?)))
}

/// The major and the minor number of each beacon, as the node stores them.
fn bind(called: impl Iterator<Item = Option<Called>>, beacons: &[Beacon]) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    for called in called {
        let Some((major, minor)) = called else {
            return Err("has beacons whose names are no numbers: name them by major-minor in the survey".to_owned());
        };
        let name = major.map_or_else(|| minor.to_string(), |major| format!("{major}-{minor}"));
        let is_it = |beacon: &&Beacon| beacon.minor == minor && major.is_none_or(|major| beacon.major == major);
        let mut found = beacons.iter().filter(is_it);
        match (found.next(), found.next()) {
            (Some(beacon), None) => {
                bytes.extend(beacon.major.to_le_bytes());
                bytes.extend(beacon.minor.to_le_bytes());
            }
            (None, _) => {
                return Err(format!("has beacon {name}, which is not in the tag's record: list it as [[beacon]]"));
            }
            (Some(_), Some(_)) => {
                return Err(format!("has beacon {name}, and the tag's record has two with that minor: change one"));
            }
        }
    }
    Ok(bytes)
}

/// Descriptions of the map and the rooms in a region, where there are any, or why they are not valid.
pub(super) fn describe(region: &[u8]) -> [Option<String>; 2] {
    parts(region).map(|part| part.map(|held| held.unwrap_or_else(|fault| format!("none: {fault}"))))
}

/// Checks that all parts of a region are valid, where there are any. The error names the invalid part.
pub(super) fn check(region: &[u8]) -> Result<(), String> {
    let whole: Result<Vec<_>, _> = parts(region).into_iter().flatten().collect();
    whole.map(drop).map_err(|fault| format!("the record is whole, but beside it is {fault}"))
}

/// Descriptions of the map and the rooms in a region, where there are any. The error is what is wrong with a part.
fn parts(region: &[u8]) -> [Option<Result<String, String>>; 2] {
    let models = match decode_models(region) {
        Ok(models) => models,
        Err(_) => return [Some(Err("damaged models of beacons".to_owned())), None],
    };
    let beacons = |of: &BeaconModel<'_>| {
        let names: Vec<_> = of.numbers().map(|(major, minor)| format!("{major}-{minor}")).collect();
        format!("beacons {}", names.join(", "))
    };
    let map = models.map.map(|of| match Map::decode(of.model) {
        Ok((map, _)) => Ok(format!("{} points, a lattice of {} m; {}", map.points(), map.unit::<f64>(), beacons(&of))),
        Err(fault) => Err(fault.to_string()),
    });
    let rooms = models.rooms.map(|of| match Model::decode(of.model) {
        Ok((model, _)) => {
            let names = models.room_names.lines().collect::<Vec<_>>().join(", ");
            Ok(format!("{} rooms: {names}; {}", model.rooms(), beacons(&of)))
        }
        Err(fault) => Err(fault.to_string()),
    });
    [map, rooms]
}
