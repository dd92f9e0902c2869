//! A site's file as a whole.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use positioning_core::geodesy::GeographicOrigin;
use serde::Deserialize;
use wire::config::{Anchor, Beacon, Identity, Mode, Network, Record, Role, TagArea, Wifi};
use wire::telemetry::Address;

use crate::document::{Document, KeyLines, SiteError};
use crate::lists::{AnchorTable, BeaconTable, Calibrated, Lists};
use crate::moved;
use crate::network::{NetworkTable, SIMULATED_NETWORK};
use crate::node::{Node, NodeTable, Numbers, Own};
use crate::receivers::{self, Receiver};
use crate::simulation::{Simulation, SimulationTable};
use crate::values::Exactly;
use crate::wifi::WifiTable;

/// Frames carry coordinates up to this, metres.
const FARTHEST_M: f32 = 8388.0;
/// UWB ranges are hardly longer, metres.
const REACH_M: f64 = 300.0;

/// What a site is read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// For the config records of real nodes. Nodes that are not the site's own are left out: those of neighbouring
    /// networks, and beacons that tags are not told of.
    Nodes,
    /// For a simulation: what only real nodes need has a default, as names, addresses, `pan` and `uuid`.
    Simulation,
}

/// The file, whose keys are known and whose values are of their types.
pub struct SiteFile<'t> {
    document: Document<'t>,
    tables: Tables,
    root: KeyLines,
    lines: std::collections::BTreeMap<String, Vec<KeyLines>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Tables {
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
    area: Option<AreaTable>,
    wifi: Option<WifiTable>,
    #[serde(default)]
    simulation: SimulationTable,
}

/// `[area]`: least and greatest coordinates.
#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct AreaTable {
    x_m: Exactly<f32, 2>,
    y_m: Exactly<f32, 2>,
    z_m: Option<Exactly<f32, 2>>,
}

impl Tables {
    /// Whether it describes a station's receivers or the origin, and nothing that is for nodes.
    fn is_without_nodes(&self) -> bool {
        let Self { network: _, node, anchor, beacon, receiver, beacons_csv, geographic_origin, .. } = self;
        let is_for_nodes = !(node.is_empty() && anchor.is_empty() && beacon.is_empty()) || beacons_csv.is_some();
        !is_for_nodes && (!receiver.is_empty() || geographic_origin.is_some())
    }
}

/// The nodes of a network, the receivers of a station, and what a simulation adds.
#[derive(Clone, Debug)]
pub struct Site {
    /// The network.
    pub network: Network,
    /// The key of the beacons' rotating identifiers.
    pub beacon_key: Option<[u8; 16]>,
    /// The nodes in the file's order. None where there are only receivers.
    pub nodes: Vec<Node>,
    /// What tags of the site's own network are told of.
    pub lists: Arc<Lists>,
    /// The anchors of `[[anchor]]`.
    pub listed_anchors: Vec<Anchor>,
    /// The fixed Bluetooth receivers in the file's order.
    pub receivers: Vec<Receiver>,
    /// Where tags can be.
    pub area: Option<TagArea>,
    /// The file of the gateways' keys, relative to the site's file.
    pub gateways: Option<PathBuf>,
    /// Where the frame of the positions is on the earth.
    pub geographic_origin: Option<GeographicOrigin>,
    /// What only a simulation has.
    pub simulation: Simulation,
}

impl<'t> SiteFile<'t> {
    /// Parses a text.
    ///
    /// # Errors
    /// The text is not TOML, a key is unknown, missing, or has another name now, or a value is not of its type.
    pub fn parse(text: &'t str) -> Result<Self, SiteError> {
        let document = Document { text };
        moved::refuse_old_keys(document)?;
        let tables = document.read()?;
        let (root, lines) = document.lines();
        Ok(Self { document, tables, root, lines })
    }

    /// The file of calibrated beacons, whose path is relative to the site's file.
    pub fn beacons_csv(&self) -> Option<&Path> {
        self.tables.beacons_csv.as_deref()
    }

    /// The site, with the beacons of [`beacons_csv`](Self::beacons_csv).
    ///
    /// # Errors
    /// The first line that is wrong: two nodes or receivers are the same, a node could not follow its record, or a
    /// key is missing. A file without nodes is wrong unless it has receivers and nothing for nodes.
    pub fn site(self, purpose: Purpose, calibrated: &[Calibrated]) -> Result<Site, SiteError> {
        let Self { document, tables, root, lines } = self;
        let lines = |key: &str| lines.get(key).map_or(&[][..], Vec::as_slice);
        let network_lines = lines("network").first().cloned().unwrap_or_default();
        let is_without_nodes = tables.is_without_nodes();
        if tables.node.is_empty() && !is_without_nodes {
            let what = "there is no [[node]]; only [[receiver]] and [geographic_origin] can be alone";
            return Err(SiteError::whole(what));
        }
        receivers::check(&tables.receiver, lines("receiver"))?;
        let site = Site {
            network: network(tables.network.as_ref(), &network_lines, purpose, is_without_nodes)?,
            beacon_key: tables.network.as_ref().map_or(Ok(None), |table| table.beacon_key(&network_lines))?,
            nodes: Vec::new(),
            lists: Arc::default(),
            listed_anchors: tables.anchor.iter().map(Into::into).collect(),
            receivers: tables.receiver,
            area: tables.area.map(|table| table.area(lines("area").first())).transpose()?,
            gateways: tables.wifi.as_ref().and_then(|table| table.gateways.clone()),
            geographic_origin: tables.geographic_origin,
            simulation: tables.simulation.simulation(document)?,
        };
        if is_without_nodes {
            return Ok(site);
        }
        let mut numbers = Numbers::default();
        let own = tables.node.into_iter().zip(lines("node"));
        let own = own.filter(|(table, _)| purpose == Purpose::Simulation || !table.is_foreign());
        let each = own.flat_map(|(table, lines)| table.each(purpose).map(move |table| (table, lines)));
        let owns = each.map(|(table, lines)| table.read(lines.clone(), purpose, &mut numbers));
        let owns = owns.collect::<Result<Vec<_>, _>>()?;
        let line = |lines: &KeyLines| lines.line;
        let listed = Lists {
            anchors: tables.anchor.iter().map(Into::into).zip(lines("anchor").iter().map(line)).collect(),
            beacons: tables.beacon.iter().map(Into::into).zip(lines("beacon").iter().map(line)).collect(),
        };
        let csv_line = root.of("beacons_csv");
        let calibrated = |mut lists: Lists| {
            lists.calibrate(calibrated, csv_line).map_err(|what| SiteError::at(csv_line, what))?;
            Ok(Arc::new(lists))
        };
        let wifi = tables.wifi.map(|table| table.settings(&lines("wifi").first().cloned().unwrap_or_default()));
        let wifi = wifi.transpose()?;
        let site = site.with_nodes(&owns, (listed, wifi), network_lines, calibrated)?;
        if purpose == Purpose::Nodes {
            in_reach(&site.nodes)?;
        }
        Ok(site)
    }
}

/// The site's own network.
fn network(
    table: Option<&NetworkTable>,
    lines: &KeyLines,
    purpose: Purpose,
    is_without_nodes: bool,
) -> Result<Network, SiteError> {
    let real = Network { region: None, ..SIMULATED_NETWORK };
    match (table, purpose) {
        (Some(table), Purpose::Nodes) => match table.pan {
            Some(_) => table.network(real, lines),
            None => Err(SiteError::at(lines.line, "pan is missing")),
        },
        (Some(table), Purpose::Simulation) => table.network(SIMULATED_NETWORK, lines),
        (None, Purpose::Nodes) if !is_without_nodes => Err(SiteError::at(1, "network is missing")),
        (None, Purpose::Nodes | Purpose::Simulation) => Ok(SIMULATED_NETWORK),
    }
}

impl Site {
    /// Reads a text without the files that it names.
    ///
    /// # Errors
    /// As [`SiteFile::parse`] and [`SiteFile::site`].
    pub fn parse(text: &str, purpose: Purpose) -> Result<Self, SiteError> {
        SiteFile::parse(text)?.site(purpose, &[])
    }

    /// Adds the nodes with their records.
    fn with_nodes(
        mut self,
        owns: &[Own],
        (listed, wifi): (Lists, Option<Wifi>),
        network_lines: KeyLines,
        calibrated: impl Fn(Lists) -> Result<Arc<Lists>, SiteError>,
    ) -> Result<Self, SiteError> {
        // The lists of anchors are of one network each.
        let mut of_network: HashMap<usize, (Network, Arc<Lists>)> = HashMap::new();
        self.lists = calibrated(tag_lists(listed.clone(), owns, 0, self.network.mode))?;
        of_network.insert(0, (self.network, Arc::clone(&self.lists)));
        for own in owns {
            let number = own.table.simulation.network;
            if let Entry::Vacant(unknown) = of_network.entry(number) {
                let neighbour = self.simulation.networks.get(number - 1).copied().ok_or_else(|| {
                    let count = self.simulation.networks.len();
                    let what =
                        format!("there is no network {number}: [[simulation.network]] begins with 1, of {count}");
                    SiteError::at(own.lines.of("simulation.network"), what)
                })?;
                let strangers = Lists { anchors: Vec::new(), ..listed.clone() };
                let lists = calibrated(tag_lists(strangers, owns, number, neighbour.mode))?;
                unknown.insert((neighbour, lists));
            }
            if let Some((network, lists)) = of_network.get(&number) {
                let mut node = self.node(own, (*network, lists), &network_lines, owns.len())?;
                node.wifi = own.wifi(wifi.as_ref())?;
                node.record_for(None)?;
                self.nodes.push(node);
            }
        }
        distinct(&self.nodes)?;
        Ok(self)
    }

    fn node(
        &self,
        own: &Own,
        (network, lists): (Network, &Arc<Lists>),
        network_lines: &KeyLines,
        count: usize,
    ) -> Result<Node, SiteError> {
        let name = match (&own.table.name, count) {
            (Some(name), _) => name.clone(),
            (None, 1) => "node".to_owned(),
            (None, _) => return Err(SiteError::at(own.lines.line, "name is missing: there are several nodes")),
        };
        let ((anchors, beacons), beacon_key) = match &own.role {
            Role::Tag(_) => (lists.of_record()?, self.beacon_key),
            // A scanner tells of every beacon.
            Role::Advertiser(_) | Role::Scanner => (Default::default(), self.beacon_key),
            // An anchor does not use the key, so its record does not contain the key.
            Role::Anchor { .. } => (Default::default(), None),
        };
        // Beacons and scanners send no frames of the network.
        let key = network.key.filter(|_| !matches!(own.role, Role::Advertiser(_) | Role::Scanner));
        let mode = own.table.mode(network.mode, &own.lines)?;
        let network = Network { key, mode, ..network };
        let mut role = own.role;
        if let Role::Tag(tag) = &mut role {
            tag.area = self.area;
        }
        let record = Record {
            identity: own.identity,
            role,
            network,
            calibration: own.calibration,
            pins: own.pins,
            anchors,
            beacons,
            beacon_key,
        };
        let (board, position_m) = own.table.node();
        let [rssi_1m_dbm, path_loss_exponent] = own.table.path_loss(&own.lines)?;
        Ok(Node {
            name,
            board,
            record,
            wifi: None,
            files: own.table.files(),
            position_m,
            rssi_1m_dbm,
            path_loss_exponent,
            simulation: own.table.simulation.clone(),
            lines: own.lines.clone(),
            lists: Arc::clone(lists),
            network_lines: network_lines.clone(),
        })
    }
}

impl AreaTable {
    fn area(self, lines: Option<&KeyLines>) -> Result<TagArea, SiteError> {
        let z_m = self.z_m.unwrap_or(Exactly([f32::NEG_INFINITY, f32::INFINITY]));
        let bounds = [("x_m", self.x_m), ("y_m", self.y_m), ("z_m", z_m)].map(|(key, Exactly(bounds))| (key, bounds));
        for (key, [least, greatest]) in bounds {
            let is_sane = |metres: f32| metres.abs() <= FARTHEST_M || key == "z_m" && self.z_m.is_none();
            if !(least < greatest && is_sane(least) && is_sane(greatest)) {
                let what = format!(
                    "{key} is [{least}, {greatest}]: it must be the least and the greatest {key}, within 8388 m"
                );
                return Err(SiteError::at(lines.map_or(1, |lines| lines.of(key)), what));
            }
        }
        let [least_m, greatest_m] = [0, 1].map(|end| bounds.map(|(_, bounds)| bounds[end]));
        Ok(TagArea { least_m, greatest_m })
    }
}

/// Refuses anchors of which none reaches another: their positions are no metres.
fn in_reach(nodes: &[Node]) -> Result<(), SiteError> {
    let anchors = nodes.iter().filter(|node| matches!(node.record.role, Role::Anchor { .. }));
    let placed: Vec<(&Node, [f64; 3])> = anchors.filter_map(|node| Some((node, node.position_m?))).collect();
    let square = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let pairs =
        placed.iter().enumerate().flat_map(|(at, (_, a))| placed.iter().skip(at + 1).map(|(_, b)| square(*a, *b)));
    let nearest_m = pairs.fold(f64::INFINITY, f64::min).sqrt();
    match placed.first() {
        Some((node, _)) if nearest_m.is_finite() && nearest_m > REACH_M => {
            let what = format!(
                "the nearest two anchors are {nearest_m:.0} m from each other, and ranges reach {REACH_M} m at most: write \
                 position_m in metres"
            );
            Err(SiteError::at(node.lines.of("position_m"), what))
        }
        _ => Ok(()),
    }
}

/// The lists of a tag's record: the listed anchors and beacons, then beacons that are nodes. In DecaRanging mode,
/// anchors of the network that are nodes are added where they do not report their positions.
fn tag_lists(mut lists: Lists, owns: &[Own], network: usize, mode: Mode) -> Lists {
    match mode {
        Mode::DecaRanging { fast: _ } => lists.add_anchors(owns.iter().filter_map(|own| {
            let is_of_network = own.table.simulation.network == network;
            let (Role::Anchor { position_m }, true) = (own.role, is_of_network) else { return None };
            Some((Anchor { address: own.identity.address?, position_m: position_m? }, own.lines.line))
        })),
        Mode::Native | Mode::Blink | Mode::Listening { .. } => (),
    }
    lists.add_beacons(owns.iter().filter_map(|own| {
        let (Role::Advertiser(advertiser), true) = (own.role, own.table.simulation.listed) else { return None };
        let (major, minor, position_m) = (advertiser.major, advertiser.minor, own.position_m()?);
        Some((Beacon { major, minor, position_m, rssi_1m_dbm: None, path_loss_exponent: None }, own.lines.line))
    }));
    lists
}

/// Checks that no two nodes have the same name or the same identity.
fn distinct(nodes: &[Node]) -> Result<(), SiteError> {
    let (mut names, mut addresses, mut euis) = (HashMap::new(), HashMap::new(), HashMap::new());
    for node in nodes {
        let Identity { eui, address } = node.record.identity;
        let same = |what: String, before: &Node| {
            let what = format!("{what} as {}'s in line {}", before.name, before.lines.line);
            SiteError::at(node.lines.line, what)
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
