//! The names of a site's nodes, beacons and rooms, for lines, tables and pictures that a person reads.
//!
//! They come from the file that `provision` reads, or from the copy of its names and places that `record` puts into the
//! folder of a recording. The copy has no keys.

use std::collections::BTreeMap;
use std::path::Path;
use std::{fs, io};

use positioning_core::geodesy::GeographicOrigin;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use site::{Receiver, is_copy, read_toml};
use wire::config::{Mode, Record, Role, decode_models};
use wire::telemetry::{Address, BeaconEvidence, Condition, Message, RoomEstimate};

use super::calibrated::numbers;
use super::{Site, in_file};
use recording::UserError;
use recording::output::write_file;
use recording::read_text;

/// The name of the file in the folder of a recording.
pub const SITE: &str = "site.toml";

/// The names of a site, and the places of its anchors, beacons and receivers. Without a site there are none.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SiteNames {
    known: Vec<Known>,
    #[serde(skip_serializing_if = "Option::is_none")]
    geographic_origin: Option<GeographicOrigin>,
}

/// A node, a beacon or a receiver of a site.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedNode<'a> {
    /// Its short address, a beacon's major and minor number, or a receiver's name, as files call it.
    pub key: String,
    /// Its name, where it has one besides its key.
    pub name: Option<&'a str>,
    /// What it does.
    pub role: NamedRole,
    /// The position of an anchor, a beacon or a receiver, metres.
    pub position_m: Option<[f64; 3]>,
    /// The height at which a tag that blinks is carried, metres.
    pub height_m: Option<f64>,
    /// RSSI at one metre, dBm: of a beacon, or of devices at a receiver.
    pub rssi_1m_dbm: Option<f64>,
    /// The path-loss exponent of a beacon's signals, or of what a receiver receives.
    pub path_loss_exponent: Option<f64>,
}

/// What a named node does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NamedRole {
    /// It ranges: an anchor or a tag.
    Ranging,
    /// It sends advertisements.
    Beacon,
    /// It receives advertisements at a fixed place.
    Receiver,
}

/// A node, a beacon or a receiver.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Known {
    /// None: an anchor that is only listed.
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none", with = "address_text")]
    address: Option<u16>,
    /// A beacon's major and minor number: `1-7`.
    #[serde(skip_serializing_if = "Option::is_none")]
    beacon: Option<String>,
    /// The name of a receiver, or the address of a scanner: its key, too.
    #[serde(skip_serializing_if = "Option::is_none")]
    receiver: Option<String>,
    /// The position of an anchor, a beacon or a receiver, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    position_m: Option<[f64; 3]>,
    /// The height at which a tag that blinks is carried, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    height_m: Option<f64>,
    /// RSSI at one metre, dBm: of a beacon, or of devices at a receiver.
    #[serde(skip_serializing_if = "Option::is_none")]
    rssi_1m_dbm: Option<f64>,
    /// The path-loss exponent of a beacon's signals, or of what a receiver receives.
    #[serde(skip_serializing_if = "Option::is_none")]
    path_loss_exponent: Option<f64>,
    /// The names of a tag's rooms, by their numbers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    rooms: Vec<String>,
}

mod address_text {
    use super::{Address, Deserialize, Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(address: &Option<u16>, to: S) -> Result<S::Ok, S::Error> {
        match address {
            Some(address) => to.collect_str(&Address(*address)),
            None => to.serialize_none(),
        }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<u16>, D::Error> {
        let text = String::deserialize(from)?;
        let address = text.parse().map_err(|_| serde::de::Error::custom(format!("{text:?} is not an address")));
        address.map(|Address(address)| Some(address))
    }
}

impl SiteNames {
    /// Reads the file that `provision` reads, or a copy of its names and places.
    ///
    /// # Errors
    /// The file cannot be read, or its first line that is wrong.
    pub fn read(file: &Path) -> Result<Self, UserError> {
        let text = read_text(file)?;
        if is_copy(&text) {
            read_toml(&text).map_err(|error| in_file(file, error))
        } else {
            Site::parse(file, &text).map(|site| Self::of(&site))
        }
    }

    /// The names of a site.
    pub fn of(site: &Site) -> Self {
        let mut known: Vec<Known> = site.nodes.iter().map(Known::of).collect();
        let listed = site.nodes.first().into_iter().flat_map(|node| &node.lists.anchors);
        for (anchor, _) in listed {
            let position_m = Some(anchor.position_m.map(rounded));
            match known.iter_mut().find(|node| node.address == Some(anchor.address)) {
                Some(node) => node.position_m = node.position_m.or(position_m),
                None => known.push(Known { address: Some(anchor.address), position_m, ..Known::default() }),
            }
        }
        let listed = site.nodes.first().into_iter().flat_map(|node| &node.lists.beacons);
        for (beacon, _) in listed {
            let key = format!("{}-{}", beacon.major, beacon.minor);
            let place = |of: Known| Known {
                position_m: Some(beacon.position_m.map(rounded)),
                rssi_1m_dbm: beacon.rssi_1m_dbm.map(rounded).or(of.rssi_1m_dbm),
                path_loss_exponent: beacon.path_loss_exponent.map(rounded),
                ..of
            };
            match known.iter_mut().find(|node| node.beacon.as_ref() == Some(&key)) {
                Some(node) => *node = place(std::mem::take(node)),
                None => known.push(place(Known { beacon: Some(key), ..Known::default() })),
            }
        }
        known.extend(site.receivers.iter().cloned().map(Known::of_receiver));
        Self { known, geographic_origin: site.geographic_origin }
    }

    /// Writes the copy into the folder of a recording. A file of the same name that is not a copy stays: it is the
    /// user's, and has the names too.
    ///
    /// # Errors
    /// The file system returns an error.
    pub fn write_into(&self, folder: &Path) -> io::Result<()> {
        let file = folder.join(SITE);
        let text = toml::to_string(self).map_err(io::Error::other)?;
        let text = format!("# The names and places of a site, without its keys.\n\n{text}");
        let stays = match fs::read_to_string(&file) {
            Ok(there) => !is_copy(&there) || there == text,
            Err(error) => error.kind() != io::ErrorKind::NotFound,
        };
        if stays || self.known.is_empty() { Ok(()) } else { write_file(&file, text.as_bytes()) }
    }

    /// The positions of the anchors, metres, by short address.
    pub fn anchors_m(&self) -> BTreeMap<u16, [f64; 3]> {
        let anchors = self.known.iter().filter(|node| node.beacon.is_none() && node.receiver.is_none());
        anchors.filter_map(|node| node.address.zip(node.position_m)).collect()
    }

    /// Where the frame of the positions is on the earth.
    pub fn geographic_origin(&self) -> Option<GeographicOrigin> {
        self.geographic_origin
    }

    /// The receivers, and the nodes and beacons that have an address or a number.
    pub fn nodes(&self) -> impl Iterator<Item = NamedNode<'_>> {
        self.known.iter().filter_map(|node| {
            let (key, role) = match (&node.receiver, &node.beacon) {
                (Some(name), _) => (name.clone(), NamedRole::Receiver),
                (None, Some(numbers)) => (numbers.clone(), NamedRole::Beacon),
                (None, None) => (Address(node.address?).to_string(), NamedRole::Ranging),
            };
            let &Known { position_m, height_m, rssi_1m_dbm, path_loss_exponent, .. } = node;
            let name = node.name.as_deref();
            Some(NamedNode { key, name, role, position_m, height_m, rssi_1m_dbm, path_loss_exponent })
        })
    }

    /// What a person reads for the node that files call `key`: its name, or `key` itself.
    pub fn node<'a>(&'a self, key: &'a str) -> &'a str {
        key.parse().ok().and_then(|Address(address)| self.name(address)).unwrap_or(key)
    }

    /// What a person reads for the beacon that files call `key`: its name, or `key` itself.
    pub fn beacon<'a>(&'a self, key: &'a str) -> &'a str {
        let named = numbers(key).and_then(|(major, minor)| self.beacon_name(major, minor));
        named.unwrap_or(key)
    }

    /// An address with the node's name before it, where it has one: `anchor-2 (0x0102)`.
    pub fn with_address(&self, address: u16) -> String {
        let address_text = Address(address);
        self.name(address).map_or_else(|| address_text.to_string(), |name| format!("{name} ({address_text})"))
    }

    /// The text of a message from the node `sender`, with names beside addresses, and rooms by their names.
    pub fn text(&self, message: &Message, sender: Option<u16>) -> String {
        let text = message.to_string();
        match message {
            Message::Hello(hello) => self.with_names(text, [hello.address]),
            Message::Range(range) => self.with_names(text, [range.peer]),
            Message::Difference(of) if of.peer == of.reference => self.with_names(text, [of.peer]),
            Message::Difference(of) => self.with_names(text, [of.peer, of.reference]),
            Message::State(state) => match state.is {
                Condition::Paired(peer) | Condition::Synchronised(peer) | Condition::Following(peer) => {
                    self.with_names(text, [peer])
                }
                Condition::BeaconMoved(BeaconEvidence { major, minor, .. })
                | Condition::BeaconDuplicated(BeaconEvidence { major, minor, .. })
                | Condition::BeaconRestored(BeaconEvidence { major, minor, .. }) => {
                    self.with_beacon(text, &format!("{major}-{minor}"))
                }
                Condition::NoRecord(_)
                | Condition::WrongRecord
                | Condition::Searching
                | Condition::Joined(_)
                | Condition::Coordinating
                | Condition::RadioFailed(_)
                | Condition::ScannerRestarted(_)
                | Condition::Advertising
                | Condition::Unused(..)
                | Condition::NetworkFull
                | Condition::Unlisted
                | Condition::MotionSensor(_) => text,
            },
            Message::Sighting(sighting) => self.with_beacon(text, &sighting.beacon.to_string()),
            Message::Room(room) => self.room(room.is, sender).unwrap_or(text),
            // No other message names a node.
            _ => text,
        }
    }

    /// The name of the node with this record.
    pub fn name_of(&self, record: &Record) -> Option<&str> {
        match (own_address(record), &record.role) {
            (Some(address), _) => self.name(address),
            (None, Role::Advertiser(beacon)) => self.beacon_name(beacon.major, beacon.minor),
            (None, Role::Tag(_) | Role::Anchor { .. } | Role::Scanner) => None,
        }
    }

    fn name(&self, address: u16) -> Option<&str> {
        self.known.iter().find(|node| node.address == Some(address))?.name.as_deref()
    }

    fn beacon_name(&self, major: u16, minor: u16) -> Option<&str> {
        let is_it = |node: &&Known| node.beacon.as_deref().and_then(numbers) == Some((major, minor));
        self.known.iter().find(is_it)?.name.as_deref()
    }

    /// Each address occurs once in the text.
    fn with_names<const N: usize>(&self, text: String, addresses: [u16; N]) -> String {
        addresses
            .into_iter()
            .filter(|address| self.name(*address).is_some())
            .fold(text, |text, address| text.replacen(&Address(address).to_string(), &self.with_address(address), 1))
    }

    fn with_beacon(&self, text: String, key: &str) -> String {
        let name = self.beacon(key);
        if name == key { text } else { text.replacen(key, &format!("{name} ({key})"), 1) }
    }

    /// The rooms of an estimate by their names, where all of them have one.
    fn room(&self, is: RoomEstimate, sender: Option<u16>) -> Option<String> {
        let rooms = self.rooms(sender);
        let named =
            is.rooms().iter().map(|of| Some(format!("{} ({} %)", rooms.get(usize::from(of.room))?, of.percent())));
        let named = named.collect::<Option<Vec<_>>>()?;
        (!named.is_empty()).then(|| named.join(" or "))
    }

    /// The rooms of a tag. Where the tag is not known, those of the site, if all tags have the same.
    fn rooms(&self, tag: Option<u16>) -> &[String] {
        let mut with_rooms = self.known.iter().filter(|node| !node.rooms.is_empty());
        if let Some(own) = with_rooms.clone().find(|node| tag.is_some() && node.address == tag) {
            return &own.rooms;
        }
        let Some(first) = with_rooms.next() else { return &[] };
        if with_rooms.all(|other| other.rooms == first.rooms) { &first.rooms } else { &[] }
    }
}

/// A number of a record to four decimals: finer than any survey.
fn rounded(number: f32) -> f64 {
    (f64::from(number) * 1e4).round() / 1e4
}

/// A node's address: one without takes the low 16 bits of its EUI.
fn own_address(record: &Record) -> Option<u16> {
    record.identity.address.or(record.identity.eui.map(|eui| eui as u16))
}

impl Known {
    fn of_receiver(receiver: Receiver) -> Self {
        let Receiver { name, position_m, rssi_1m_dbm, path_loss_exponent } = receiver;
        let (receiver, position_m) = (Some(name), Some(position_m));
        Self { receiver, position_m, rssi_1m_dbm, path_loss_exponent, ..Self::default() }
    }

    fn of(node: &super::Node) -> Self {
        let known = Self { name: Some(node.name.clone()), address: own_address(&node.record), ..Self::default() };
        match &node.record.role {
            Role::Anchor { position_m } => Self { position_m: position_m.map(|at| at.map(rounded)), ..known },
            Role::Tag(tag) => {
                // Whoever ranges knows its height itself.
                let height_m = tag.height_m.filter(|_| node.record.network.mode == Mode::Blink).map(rounded);
                let models = node.site_models.as_deref().and_then(|region| decode_models(region).ok());
                let rooms =
                    models.map_or_else(Vec::new, |models| models.room_names.lines().map(str::to_owned).collect());
                Self { rooms, height_m, ..known }
            }
            Role::Scanner => Self {
                receiver: known.address.map(|address| Address(address).to_string()),
                position_m: node.position_m,
                rssi_1m_dbm: node.rssi_1m_dbm,
                path_loss_exponent: node.path_loss_exponent,
                ..known
            },
            Role::Advertiser(beacon) => Self {
                beacon: Some(format!("{}-{}", beacon.major, beacon.minor)),
                rssi_1m_dbm: Some(beacon.measured_power_dbm.into()),
                ..known
            },
        }
    }
}
