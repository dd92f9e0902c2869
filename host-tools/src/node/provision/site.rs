//! A site: the nodes of a network, in one file.

use std::fs;
use std::path::Path;

use wire::config::{Anchor, Beacon, Mode, Record, Role};

use super::calibrated;
use super::document::{Document, Section, nearest};
use super::lists::{Lists, RecordLists};
use super::network::Shared;
use super::node::{Node, Own};
use crate::UserError;

const KEYS: [&str; 5] = ["network", "node", "anchor", "beacon", "beacons_csv"];

/// The nodes of a network.
#[derive(Clone, Debug)]
pub struct Site {
    /// In the file's order; at least one.
    pub nodes: Vec<Node>,
}

impl Site {
    /// Reads a file.
    ///
    /// # Errors
    /// It cannot be read, or [`parse`](Self::parse) refuses it.
    pub fn read(file: &Path) -> Result<Self, UserError> {
        let text = fs::read_to_string(file).map_err(|error| UserError::file(file, error.to_string()))?;
        Self::parse(file, &text)
    }

    /// The site that a text describes; `file` is what errors call it.
    ///
    /// # Errors
    /// The first line that is wrong: it is no TOML, a key is unknown or missing, a value is not what it must be, two
    /// nodes are the same, or a node could not do as it is told.
    pub fn parse(file: &Path, text: &str) -> Result<Self, UserError> {
        let document = Document { file, text };
        let root = document.parse()?;
        let root = Section::root(document, &root).with_keys(&KEYS, |_| None)?;
        let shared = match root.tables("network")?.as_slice() {
            [network] => Shared::read(network)?,
            [] => return Err(UserError::file(file, "[network] is missing")),
            [_, second, ..] => return Err(second.wrong("[network] is there twice")),
        };
        let listed = Lists::read(&root)?;
        let sections = root.tables("node")?;
        let owns = sections.iter().map(Own::read).collect::<Result<Vec<_>, _>>()?;
        if owns.is_empty() {
            return Err(UserError::file(file, "there is no [[node]]"));
        }

        let mut told = told(listed, &owns, shared.network.mode);
        if let Some(field) = root.optional("beacons_csv") {
            let calibrated = calibrated::read(&field, file)?;
            told.calibrate(&calibrated, field.line).map_err(|what| field.wrong(what))?;
        }
        let mut nodes = Vec::with_capacity(owns.len());
        for own in &owns {
            let node = node(document, own, &shared, &told, owns.len())?;
            node.record_for(None)?;
            nodes.push(node);
        }
        distinct(document, &nodes)?;
        Ok(Self { nodes })
    }

    /// The node of a name, or the only one.
    ///
    /// # Errors
    /// There are several and none is named, or there is none of that name.
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
                let near = nearest(name, &names).map_or_else(|| names.join(", "), ToOwned::to_owned);
                UserError::flag("--node", format!("there is no node {name}; there is {near}"))
            }),
        }
    }
}

/// What tags are told of: what is listed; then beacons that are nodes; and, in DecaRanging, where they do not tell it
/// themselves, anchors that are nodes.
fn told(mut lists: Lists, owns: &[Own], mode: Mode) -> Lists {
    for own in owns {
        match (&own.role, own.position_m) {
            (Role::Anchor { .. }, Some(position_m)) => match (mode, own.identity.address) {
                (Mode::DecaRanging { fast: _ }, Some(address)) => {
                    lists.add_anchor(Anchor { address, position_m }, own.line);
                }
                (Mode::DecaRanging { fast: _ }, None) | (Mode::Native | Mode::Listening { .. }, _) => (),
            },
            (Role::Advertiser(advertiser), Some(position_m)) => {
                let (major, minor) = (advertiser.major, advertiser.minor);
                let beacon = Beacon { major, minor, position_m, rssi_1m_dbm: None, path_loss_exponent: None };
                lists.add_beacon(beacon, own.line);
            }
            (Role::Anchor { .. } | Role::Advertiser(_), None) | (Role::Tag(_), _) => (),
        }
    }
    lists
}

fn node(document: Document<'_>, own: &Own, shared: &Shared, told: &Lists, count: usize) -> Result<Node, UserError> {
    let name = match (&own.name, count) {
        (Some(name), _) => name.clone(),
        (None, 1) => "node".to_owned(),
        (None, _) => return Err(document.wrong(own.line, "name is missing: there are several nodes")),
    };
    let mut lines = shared.lines.clone();
    lines.extend(own.lines.clone());
    let (lists, beacon_key) = match &own.role {
        Role::Tag(_) => {
            let lists = told.of_record(&mut lines).map_err(|(line, what)| document.wrong(line, what))?;
            (lists, shared.beacon_key)
        }
        Role::Advertiser(_) => (RecordLists::default(), shared.beacon_key),
        // It has no use for the key, so it cannot lose it.
        Role::Anchor { .. } => (RecordLists::default(), None),
    };
    let record = Record {
        identity: own.identity,
        role: own.role,
        network: shared.network,
        calibration: own.calibration,
        pins: own.pins,
        anchors: lists.anchors,
        beacons: lists.beacons,
        beacon_key,
    };
    let site_models = own.site_models.bound(&record.beacons).map_err(|(line, what)| document.wrong(line, what))?;
    let (file, model) = (document.file.to_owned(), own.model.clone());
    Ok(Node { name, board: own.board, record, model, site_models, file, line: own.line, lines })
}

/// No two nodes are called, or are, the same.
fn distinct(document: Document<'_>, nodes: &[Node]) -> Result<(), UserError> {
    for (index, node) in nodes.iter().enumerate() {
        for before in nodes.iter().take(index) {
            let same = |what: String| {
                document.wrong(node.line, format!("{what} as {}'s in line {}", before.name, before.line))
            };
            if node.name == before.name {
                return Err(same(format!("the name {} is the same", node.name)));
            }
            let (ours, theirs) = (node.record.identity, before.record.identity);
            if let (Some(address), true) = (ours.address, ours.address == theirs.address) {
                return Err(same(format!("the address 0x{address:04X} is the same")));
            }
            if let (Some(eui), true) = (ours.eui, ours.eui == theirs.eui) {
                return Err(same(format!("the EUI {eui:016X} is the same")));
            }
        }
    }
    Ok(())
}
