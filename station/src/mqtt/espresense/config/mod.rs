//! The file `config.yaml` of ESPresense's companion, as a house: rooms, receivers, and which devices are wanted.
//!
//! Coordinates are metres. The floors of a house lie above each other; here they lie side by side, because a site is a
//! plan: the first one is where the file has it, each other one is moved along x to the right of the one before.

use std::collections::HashSet;

use serde::Deserialize;

use crate::bounds::{LONGEST_NAME, is_name};
use crate::model::{NodeRole, Zone, ZoneKind};
use crate::{ReportKind, SourceReport, Utc};

/// Between two floors on the plan, metres.
const GAP_M: f64 = 3.0;
/// The greatest coordinate, metres.
const FARTHEST_M: f64 = 10_000.0;
/// The most floors, rooms, nodes or devices.
const MOST: usize = 1000;

/// What is wrong with the file.
#[derive(Debug, thiserror::Error)]
pub enum NoHouse {
    /// It is no YAML, or has other values than expected.
    #[error("{text}")]
    Yaml {
        /// The line, where it is known.
        line: Option<u64>,
        /// What is wrong.
        text: String,
    },
    /// A value is wrong.
    #[error("{0}")]
    Value(String),
}

#[derive(Debug, Deserialize)]
struct Config {
    #[serde(default)]
    floors: Vec<ConfigFloor>,
    #[serde(default)]
    nodes: Vec<ConfigNode>,
    devices: Option<Vec<ConfigDevice>>,
    #[serde(default)]
    exclude_devices: Vec<ConfigDevice>,
}

#[derive(Debug, Deserialize)]
struct ConfigFloor {
    id: Option<String>,
    name: Option<String>,
    bounds: Option<Vec<Vec<f64>>>,
    #[serde(default)]
    rooms: Vec<ConfigRoom>,
}

#[derive(Debug, Deserialize)]
struct ConfigRoom {
    name: String,
    #[serde(default)]
    points: Vec<Vec<f64>>,
}

#[derive(Debug, Deserialize)]
struct ConfigNode {
    id: Option<String>,
    name: String,
    point: Option<Vec<f64>>,
    floors: Option<Vec<String>>,
    #[serde(default = "yes")]
    stationary: bool,
    #[serde(default = "yes")]
    enabled: bool,
}

#[derive(Debug, Deserialize)]
struct ConfigDevice {
    id: Option<String>,
    name: Option<String>,
    #[serde(rename = "rssi@1m")]
    rssi_1m_dbm: Option<f64>,
}

fn yes() -> bool {
    true
}

/// A house with ESPresense.
#[derive(Clone, Debug, PartialEq)]
pub struct House {
    /// The names of its floors, and how far each one is moved along x, metres.
    pub floors: Vec<(String, f64)>,
    /// Rooms: name and corners, metres.
    rooms: Vec<(String, Vec<[f64; 2]>)>,
    /// The receivers.
    pub(super) receivers: Vec<Receiver>,
    /// None: every device.
    wanted: Option<Vec<Device>>,
    unwanted: Vec<Device>,
}

/// A receiver on one floor.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Receiver {
    /// Its node's key: [`key`] of the name or the id.
    pub(super) key: String,
    /// Its name in the site.
    pub(super) node: String,
    /// The name in the file.
    name: String,
    /// The index of the floor.
    pub(super) floor: usize,
    position_m: [f64; 3],
}

/// Which devices: texts, in which `*` stands for anything.
#[derive(Clone, Debug, PartialEq)]
struct Device {
    id: Option<String>,
    name: Option<String>,
    rssi_1m_dbm: Option<f64>,
}

/// What the file says of a device that is wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Wanted<'a> {
    /// Its name, where the file gives it.
    pub(super) name: Option<&'a str>,
    pub(super) rssi_1m_dbm: Option<f64>,
}

impl House {
    /// Reads the text of a `config.yaml`.
    ///
    /// # Errors
    /// It is no such file, or something in it cannot be.
    pub fn read(text: &str) -> Result<Self, NoHouse> {
        let config: Config = serde_saphyr::from_str(text).map_err(|error| NoHouse::Yaml {
            line: error.location().map(|location| location.line()),
            text: one_line(&error.without_snippet().to_string()),
        })?;
        let counts = [config.floors.len(), config.nodes.len(), config.devices.as_ref().map_or(0, Vec::len)];
        if counts.iter().any(|count| *count > MOST) || config.exclude_devices.len() > MOST {
            return Err(wrong(format!("there are more than {MOST} floors, nodes or devices")));
        }
        let nodes: Vec<&ConfigNode> =
            config.nodes.iter().filter(|node| node.enabled && node.stationary && node.point.is_some()).collect();
        if nodes.is_empty() {
            return Err(wrong("`nodes` has no receiver with a `point`: [x, y, z] in metres".to_owned()));
        }
        let mut house = Self {
            floors: Vec::new(),
            rooms: Vec::new(),
            receivers: Vec::new(),
            wanted: config.devices.map(|devices| devices.into_iter().map(Device::from).collect()),
            unwanted: config.exclude_devices.into_iter().map(Device::from).collect(),
        };
        let (mut names, mut edge_m) = (HashSet::new(), None);
        for (index, floor) in config.floors.iter().enumerate() {
            house.add_floor(index, floor, &nodes, &mut names, &mut edge_m)?;
        }
        if config.floors.is_empty() {
            let floor = ConfigFloor { id: None, name: None, bounds: None, rooms: Vec::new() };
            house.add_floor(0, &floor, &nodes, &mut names, &mut edge_m)?;
        }
        let on_no_floor = |node: &&&ConfigNode| !house.receivers.iter().any(|receiver| receiver.name == node.name);
        if let Some(node) = nodes.iter().find(on_no_floor) {
            return Err(wrong(format!("node {}: `floors` names no floor of the file", node.name)));
        }
        Ok(house)
    }

    /// Its rooms in a site.
    pub fn zones(&self, site: &str) -> Vec<Zone> {
        let zone = |(name, corners_m): &(String, Vec<[f64; 2]>)| Zone {
            site: site.to_owned(),
            name: name.clone(),
            kind: ZoneKind::Room,
            corners_m: corners_m.clone(),
            alarm: false,
        };
        self.rooms.iter().map(zone).collect()
    }

    /// Its receivers, as reports of a site.
    pub fn nodes(&self, site: &str, t: Utc) -> Vec<SourceReport> {
        let what = |receiver: &Receiver| ReportKind::Node {
            node: receiver.node.clone(),
            name: Some(receiver.name.clone()),
            role: NodeRole::Receiver,
            position_m: Some(receiver.position_m),
        };
        self.receivers.iter().map(|receiver| SourceReport { t, site: site.to_owned(), what: what(receiver) }).collect()
    }

    /// Whether a device is wanted, and what the file says of it. `name` is what its receiver calls it.
    pub(super) fn device(&self, id: &str, name: Option<&str>) -> Option<Wanted<'_>> {
        // Receivers receive each other as `node:…`.
        if id.starts_with("node:") || self.unwanted.iter().any(|device| device.is(id, name)) {
            return None;
        }
        let Some(wanted) = &self.wanted else { return Some(Wanted { name: None, rssi_1m_dbm: None }) };
        // A pattern wants a device; the entry with its own id names it.
        let own = wanted.iter().find(|device| device.id.as_deref().is_some_and(|own| own.eq_ignore_ascii_case(id)));
        let device = own.or_else(|| wanted.iter().find(|device| device.is(id, name)))?;
        let named = own.and_then(|own| own.name.as_deref());
        Some(Wanted { name: named, rssi_1m_dbm: device.rssi_1m_dbm })
    }

    fn add_floor(
        &mut self,
        index: usize,
        floor: &ConfigFloor,
        nodes: &[&ConfigNode],
        names: &mut HashSet<String>,
        edge_m: &mut Option<f64>,
    ) -> Result<(), NoHouse> {
        let floor_name = floor.name.as_ref().or(floor.id.as_ref()).cloned().unwrap_or_else(|| format!("{}", index + 1));
        let here = |node: &&&ConfigNode| match &node.floors {
            Some(floors) => floors.iter().any(|name| Some(name) == floor.id.as_ref() || *name == floor_name),
            None => true,
        };
        let nodes: Vec<_> = nodes.iter().filter(here).collect();
        let mut rooms = Vec::with_capacity(floor.rooms.len());
        for room in &floor.rooms {
            let corners: Result<Vec<_>, _> = room.points.iter().map(|point| corner(&room.name, point)).collect();
            let mut corners = corners?;
            // The companion closes outlines; ours are closed by themselves.
            if corners.len() > 1 && corners.first() == corners.last() {
                corners.pop();
            }
            if corners.len() < 3 {
                return Err(wrong(format!("room {}: `points` has less than three corners", room.name)));
            }
            rooms.push((room.name.as_str(), corners));
        }
        if rooms.len() > MOST {
            return Err(wrong(format!("floor {floor_name} has more than {MOST} rooms")));
        }
        let mut places = Vec::with_capacity(nodes.len());
        for node in &nodes {
            places.push(place(&node.name, node.point.as_deref().unwrap_or_default())?);
        }
        let bounds = floor.bounds.iter().flatten().filter_map(|corner| corner.first().copied());
        let xs = rooms.iter().flat_map(|(_, corners)| corners.iter().map(|[x, _]| *x));
        let xs = xs.chain(places.iter().map(|[x, ..]| *x)).chain(bounds.filter(|x| x.abs() <= FARTHEST_M));
        let (low, high) = xs.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
        let shift_m = if low > high { 0.0 } else { edge_m.map_or(0.0, |edge_m| edge_m + GAP_M - low) };
        if low <= high {
            *edge_m = Some(high + shift_m);
        }
        for (name, corners) in rooms {
            let mut name = checked("room", name)?.to_owned();
            if names.contains(&name) {
                name = checked("room", &format!("{name} ({floor_name})"))?.to_owned();
            }
            if !names.insert(name.clone()) {
                return Err(wrong(format!("room {name} is there twice")));
            }
            self.rooms.push((name, corners.into_iter().map(|[x, y]| [x + shift_m, y]).collect()));
        }
        for (node, [x, y, z]) in nodes.iter().zip(places) {
            let name = checked("node", &node.name)?.to_owned();
            let key = key(node.id.as_deref().unwrap_or(&node.name));
            let slug = slug(node.id.as_deref().unwrap_or(&node.name));
            let is_elsewhere = self.receivers.iter().any(|receiver| receiver.node == slug);
            let node = if is_elsewhere { format!("{slug}@{}", index + 1) } else { slug };
            if key.is_empty() || self.receivers.iter().any(|known| known.floor == index && known.key == key) {
                return Err(wrong(format!("node {name}: another node has this name, but for signs between letters")));
            }
            let position_m = [x + shift_m, y, z];
            self.receivers.push(Receiver {
                key,
                node: checked("node", &node)?.to_owned(),
                name,
                floor: index,
                position_m,
            });
        }
        self.floors.push((floor_name, shift_m));
        Ok(())
    }
}

impl From<ConfigDevice> for Device {
    fn from(ConfigDevice { id, name, rssi_1m_dbm }: ConfigDevice) -> Self {
        let rssi_1m_dbm = rssi_1m_dbm.filter(|dbm| positioning_core::ble::signal::rssi(*dbm).is_ok());
        Self { id, name, rssi_1m_dbm }
    }
}

impl Device {
    /// Whether the entry means a device: by its id or by its name.
    fn is(&self, id: &str, name: Option<&str>) -> bool {
        let is =
            |pattern: &Option<String>, text: &str| pattern.as_deref().is_some_and(|pattern| matches(pattern, text));
        is(&self.id, id) || name.is_some_and(|name| is(&self.name, name))
    }
}

/// Whether a text is as a pattern, in which `*` stands for anything.
fn matches(pattern: &str, text: &str) -> bool {
    let mut parts = pattern.split('*');
    let Some(mut rest) = parts.next().and_then(|first| text.strip_prefix(first)) else { return false };
    let Some(last) = parts.next_back() else { return rest.is_empty() };
    for part in parts {
        let Some(at) = rest.find(part) else { return false };
        rest = rest.get(at + part.len()..).unwrap_or_default();
    }
    rest.ends_with(last)
}

/// What is equal of a node's name in the file and in topics: the companion and the receivers write signs between
/// letters in different ways.
pub(super) fn key(name: &str) -> String {
    name.chars().filter(|character| character.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// A node's name as its topics have it: `Upstairs Hallway` is `upstairs_hallway`.
fn slug(name: &str) -> String {
    let words = name.split(|character: char| !character.is_alphanumeric()).filter(|word| !word.is_empty());
    words.collect::<Vec<_>>().join("_").to_lowercase()
}

fn corner(room: &str, point: &[f64]) -> Result<[f64; 2], NoHouse> {
    match *point {
        [x, y] | [x, y, _] if [x, y].iter().all(|at| at.abs() <= FARTHEST_M) => Ok([x, y]),
        _ => Err(wrong(format!("room {room}: a corner is [x, y] in metres, not {point:?}"))),
    }
}

fn place(node: &str, point: &[f64]) -> Result<[f64; 3], NoHouse> {
    match *point {
        [x, y, z] if [x, y, z].iter().all(|at| at.abs() <= FARTHEST_M) => Ok([x, y, z]),
        _ => Err(wrong(format!("node {node}: `point` is [x, y, z] in metres, not {point:?}"))),
    }
}

fn checked<'a>(what: &str, name: &'a str) -> Result<&'a str, NoHouse> {
    if is_name(name) {
        Ok(name)
    } else {
        Err(wrong(format!("{what} {name:?}: a name has 1 to {LONGEST_NAME} bytes and no control characters")))
    }
}

fn wrong(text: String) -> NoHouse {
    NoHouse::Value(text)
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests;
