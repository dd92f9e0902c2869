//! A site: the nodes of a network and the receivers of a station, in one file.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use positioning_core::geodesy::GeographicOrigin;
use serde::Deserialize;
use wire::config::{Anchor, Beacon, Identity, Mode, Network, Record, Role};
use wire::telemetry::Address;

use super::calibrated;
use super::document::{Document, Lines};
use super::lists::{AnchorTable, BeaconTable, Lists};
use super::network::NetworkTable;
use super::node::{Node, NodeTable, Own};
use super::receivers::{self, Receiver};
use recording::UserError;
use recording::read_text;

/// The file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SiteFile {
    network: Option<NetworkTable>,
    #[serde(default)]
    node: Vec<NodeTable>,
    #[serde(default)]
    anchor: Vec<AnchorTable>,
    #[serde(default)]
    beacon: Vec<BeaconTable>,
    #[serde(default)]
    receiver: Vec<Receiver>,
    beacons_csv: Option<PathBuf>,
    geographic_origin: Option<GeographicOrigin>,
}

impl SiteFile {
    /// Whether it describes a station's receivers and nothing that is for nodes.
    fn is_of_receivers(&self) -> bool {
        let Self { network: _, node, anchor, beacon, receiver, beacons_csv, geographic_origin: _ } = self;
        let is_for_nodes = !(node.is_empty() && anchor.is_empty() && beacon.is_empty()) || beacons_csv.is_some();
        !is_for_nodes && !receiver.is_empty()
    }
}

/// The nodes of a network, and the receivers of a station.
#[derive(Clone, Debug)]
pub struct Site {
    /// The nodes in the file's order. None where there are only receivers.
    pub nodes: Vec<Node>,
    /// The fixed Bluetooth receivers in the file's order.
    pub receivers: Vec<Receiver>,
    /// Where the frame of the positions is on the earth.
    pub geographic_origin: Option<GeographicOrigin>,
}

impl Site {
    /// Reads a file that has nodes.
    ///
    /// # Errors
    /// The file cannot be read, [`parse`](Self::parse) refuses it, or it has receivers only.
    pub fn read(file: &Path) -> Result<Self, UserError> {
        let text = read_text(file)?;
        let site = Self::parse(file, &text)?;
        if site.nodes.is_empty() { Err(UserError::file(file, "there is no [[node]]")) } else { Ok(site) }
    }

    /// The site that a text describes. Errors name `file`.
    ///
    /// # Errors
    /// The first line that is wrong: the text is not TOML, a key is unknown or missing, a value is not valid, two nodes
    /// or receivers are the same, or a node could not follow its record. A file without nodes is wrong unless it has
    /// receivers and nothing for nodes.
    pub fn parse(file: &Path, text: &str) -> Result<Self, UserError> {
        let document = Document { file, text };
        let site: SiteFile = document.read()?;
        let (root, tables) = document.lines();
        let lines = |key: &str| tables.get(key).map_or(&[][..], Vec::as_slice);
        let network_lines = lines("network").first().cloned().unwrap_or_default();
        let network = site.network.as_ref().map(|network| network.network(document, &network_lines)).transpose()?;
        receivers::check(document, &site.receiver, lines("receiver"))?;
        if site.is_of_receivers() {
            let (receivers, geographic_origin) = (site.receiver, site.geographic_origin);
            return Ok(Self { nodes: Vec::new(), receivers, geographic_origin });
        }
        if site.node.is_empty() {
            let what = "there is no [[node]]; only [[receiver]] and [geographic_origin] can be alone";
            return Err(UserError::file(file, what));
        }
        let (network, beacon_key) = network.ok_or_else(|| document.wrong(1, "network is missing"))?;
        let owns = site.node.iter().zip(lines("node")).map(|(table, lines)| table.read(document, lines));
        let owns = owns.collect::<Result<Vec<_>, _>>()?;

        let line = |lines: &Lines| lines.line;
        let listed = Lists {
            anchors: site.anchor.iter().map(Into::into).zip(lines("anchor").iter().map(line)).collect(),
            beacons: site.beacon.iter().map(Into::into).zip(lines("beacon").iter().map(line)).collect(),
        };
        let mut lists = tag_lists(listed, &owns, network.mode);
        if let Some(name) = &site.beacons_csv {
            let (calibrated, line) = (calibrated::read(&document.beside(name))?, root.of("beacons_csv"));
            lists.calibrate(&calibrated, line).map_err(|what| document.wrong(line, what))?;
        }
        let lists = Arc::new(lists);
        let shared = Shared { network, beacon_key, lines: network_lines };
        let mut nodes = Vec::with_capacity(owns.len());
        for own in &owns {
            let node = node(document, own, &shared, &lists, owns.len())?;
            node.record_for(None)?;
            nodes.push(node);
        }
        distinct(document, &nodes)?;
        Ok(Self { nodes, receivers: site.receiver, geographic_origin: site.geographic_origin })
    }

    /// The node with this name, or the only node.
    ///
    /// # Errors
    /// There are several nodes and no name is given, or no node has this name.
    pub fn node(&self, name: Option<&str>) -> Result<&Node, UserError> {
        let names: Vec<_> = self.nodes.iter().map(|node| node.name.as_str()).collect();
        match (name, self.nodes.as_slice()) {
            (None, [only]) => Ok(only),
            (None, _) => {
                let what =
                    format!("the file has {} nodes, name one of {}, or give --all", names.len(), names.join(", "));
                Err(UserError::flag("--node", what))
            }
            (Some(name), nodes) => nodes.iter().find(|node| node.name == name).ok_or_else(|| {
                UserError::flag("--node", format!("there is no node {name}; there are {}", names.join(", ")))
            }),
        }
    }
}

/// The settings that all nodes share.
struct Shared {
    network: Network,
    beacon_key: Option<[u8; 16]>,
    lines: Lines,
}

/// The lists of a tag's record: the listed anchors and beacons, then beacons that are nodes. In DecaRanging mode,
/// anchors that are nodes are added where they do not report their positions.
fn tag_lists(mut lists: Lists, owns: &[Own], mode: Mode) -> Lists {
    for own in owns {
        match (&own.role, own.position_m) {
            (Role::Anchor { .. }, Some(position_m)) => match (mode, own.identity.address) {
                (Mode::DecaRanging { fast: _ }, Some(address)) => {
                    lists.add_anchor(Anchor { address, position_m }, own.lines.line);
                }
                (Mode::DecaRanging { fast: _ }, None) | (Mode::Native | Mode::Listening { .. }, _) => (),
            },
            (Role::Advertiser(advertiser), Some(position_m)) => {
                let (major, minor) = (advertiser.major, advertiser.minor);
                let beacon = Beacon { major, minor, position_m, rssi_1m_dbm: None, path_loss_exponent: None };
                lists.add_beacon(beacon, own.lines.line);
            }
            (Role::Anchor { .. } | Role::Advertiser(_), None) | (Role::Tag(_), _) => (),
        }
    }
    lists
}

fn node(
    document: Document<'_>,
    own: &Own,
    shared: &Shared,
    lists: &Arc<Lists>,
    count: usize,
) -> Result<Node, UserError> {
    let name = match (&own.name, count) {
        (Some(name), _) => name.clone(),
        (None, 1) => "node".to_owned(),
        (None, _) => return Err(document.wrong(own.lines.line, "name is missing: there are several nodes")),
    };
    let ((anchors, beacons), beacon_key) = match &own.role {
        Role::Tag(_) => {
            let record = lists.of_record().map_err(|(line, what)| document.wrong(line, what))?;
            (record, shared.beacon_key)
        }
        Role::Advertiser(_) => (Default::default(), shared.beacon_key),
        // An anchor does not use the key, so its record does not contain the key.
        Role::Anchor { .. } => (Default::default(), None),
    };
    let record = Record {
        identity: own.identity,
        role: own.role,
        network: shared.network,
        calibration: own.calibration,
        pins: own.pins,
        anchors,
        beacons,
        beacon_key,
    };
    let site_models = own.site_models.bound(&record.beacons).map_err(|(line, what)| document.wrong(line, what))?;
    let (file, model) = (document.file.to_owned(), own.model.clone());
    let (network_lines, lines, lists) = (shared.lines.clone(), own.lines.clone(), Arc::clone(lists));
    Ok(Node { name, board: own.board, record, model, site_models, file, network_lines, lines, lists })
}

/// Checks that no two nodes have the same name or the same identity.
fn distinct(document: Document<'_>, nodes: &[Node]) -> Result<(), UserError> {
    let (mut names, mut addresses, mut euis) = (HashMap::new(), HashMap::new(), HashMap::new());
    for node in nodes {
        let Identity { eui, address } = node.record.identity;
        let same = |what: String, before: &Node| {
            document.wrong(node.lines.line, format!("{what} as {}'s in line {}", before.name, before.lines.line))
        };
        if let Some(before) = names.insert(&node.name, node) {
            return Err(same(format!("the name {} is the same", node.name), before));
        }
        if let Some((eui, before)) = eui.and_then(|eui| Some((eui, euis.insert(eui, node)?))) {
            return Err(same(format!("the EUI {eui:016X} is the same"), before));
        }
        // A node without an address takes the low 16 bits of its EUI.
        let (own, is_given) = (address.or(eui.map(|eui| eui as u16)), address.is_some());
        if let Some((own, before)) = own.and_then(|own| Some((own, addresses.insert(own, node)?))) {
            let both_given = is_given && before.record.identity.address.is_some();
            let whence = if both_given { "" } else { ", which a node without address takes from its EUI," };
            return Err(same(format!("the address {}{whence} is the same", Address(own)), before));
        }
    }
    Ok(())
}
