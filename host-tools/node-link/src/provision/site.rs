//! A site with the files that it names: calibrated beacons, and the classifier, map and room model of each tag.

use std::ops::Deref;
use std::path::{Path, PathBuf};

use ::site::{NodeFiles, Purpose, Receiver, SiteError, SiteFile};
use positioning_core::geodesy::GeographicOrigin;
use positioning_core::nlos::{Classifier, NodeModel};
use wire::config::{Board, Record, WifiKey};

use super::{calibrated, site_models};
use crate::gateway_key::GatewayKey;
use analysis::train::Chosen;
use anyhow::Result;
use recording::UserError;
use recording::read_text;

/// The nodes of a network, and the receivers of a station.
#[derive(Clone, Debug)]
pub struct Site {
    /// The nodes in the file's order. None where there are only receivers.
    pub nodes: Vec<Node>,
    /// The fixed Bluetooth receivers in the file's order.
    pub receivers: Vec<Receiver>,
    /// Where the frame of the positions is on the earth.
    pub geographic_origin: Option<GeographicOrigin>,
    /// The file of the gateways' keys.
    gateways: Option<PathBuf>,
}

/// A node of a site with its record and with what its files hold.
#[derive(Clone, Debug)]
pub struct Node {
    node: ::site::Node,
    /// The classifier for p_nlos, where the node does not use the powers alone.
    pub model: Option<Chosen>,
    /// The RSSI models of the site, as `wire::config::decode_models` reads them.
    pub site_models: Option<Vec<u8>>,
    file: PathBuf,
}

/// What the files of a tag hold.
#[derive(Clone, Debug, Default)]
pub struct NodeModels {
    /// The classifier for p_nlos, where the node does not use the powers alone.
    pub nlos: Option<Chosen>,
    /// The RSSI models of the site, as `wire::config::decode_models` reads them.
    pub site: Option<Vec<u8>>,
}

impl Deref for Node {
    type Target = ::site::Node;

    fn deref(&self) -> &::site::Node {
        &self.node
    }
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
    /// The first line that is wrong: see [`SiteFile::parse`] and [`SiteFile::site`]; or a file that it names is wrong.
    pub fn parse(file: &Path, text: &str) -> Result<Self, UserError> {
        let site = read_site(file, text, Purpose::Nodes)?;
        let nodes = site.nodes.into_iter().map(|node| {
            let NodeModels { nlos: model, site: site_models } = NodeModels::read(file, &node)?;
            Ok(Node { node, model, site_models, file: file.to_owned() })
        });
        let nodes = nodes.collect::<Result<_, UserError>>()?;
        let gateways = site.gateways.map(|name| beside(file, &name));
        Ok(Self { nodes, receivers: site.receivers, geographic_origin: site.geographic_origin, gateways })
    }

    /// Gives each node with Wi-Fi its key, from the file of the gateways' keys; those that are not there are made. Returns the
    /// file with the names of the nodes whose keys were made. A site without such a file has no keys.
    ///
    /// # Errors
    /// The file is wrong, or cannot be made or written.
    pub fn give_keys(&mut self) -> Result<Option<(&Path, Vec<String>)>> {
        let Some(file) = self.gateways.as_deref() else { return Ok(None) };
        let nodes: Vec<_> = self.nodes.iter_mut().filter(|node| node.wifi.is_some()).collect();
        let names: Vec<_> = nodes.iter().map(|node| node.name.clone()).collect();
        let (keys, made) = GatewayKey::read_and_make(file, &names)?;
        for (node, GatewayKey { gateway, secret, .. }) in nodes.into_iter().zip(keys) {
            if let Some(wifi) = &mut node.node.wifi {
                wifi.key = Some(WifiKey { gateway, secret });
            }
        }
        Ok(Some((file, made)))
    }

    /// Whether there is a file of the gateways' keys.
    pub fn has_gateways(&self) -> bool {
        self.gateways.is_some()
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

impl Node {
    /// The record, if a node on this board can follow it. Without a given board, the file's board is used.
    ///
    /// # Errors
    /// The node cannot follow the record. The error has the line number and the reason.
    pub fn record_for(&self, board: Option<Board>) -> Result<&Record, UserError> {
        self.node.record_for(board).map_err(|error| in_file(&self.file, error))
    }
}

impl NodeModels {
    /// Reads the files that a node's table names, whose paths are relative to the site's file.
    ///
    /// # Errors
    /// A file cannot be read, is not of its kind, or is not suitable for the node.
    pub fn read(file: &Path, node: &::site::Node) -> Result<Self, UserError> {
        let wrong = |(key, what): (&str, String)| UserError::line(file, node.lines.of(key), what);
        Ok(Self {
            nlos: classifier(file, &node.files).map_err(|what| wrong(("nlos_model", what)))?,
            site: site_models::of_files(file, &node.files, &node.record.beacons).map_err(wrong)?,
        })
    }
}

/// The site that a text describes, with the calibrated beacons that it names. Errors name `file`.
///
/// # Errors
/// As for [`Site::parse`].
pub fn read_site(file: &Path, text: &str, purpose: Purpose) -> Result<::site::Site, UserError> {
    let tables = SiteFile::parse(text).map_err(|error| in_file(file, error))?;
    let calibrated = tables.beacons_csv().map(|name| calibrated::read(&beside(file, name))).transpose()?;
    tables.site(purpose, &calibrated.unwrap_or_default()).map_err(|error| in_file(file, error))
}

/// The error of a site's text as that of its file.
pub fn in_file(file: &Path, SiteError { line, message }: SiteError) -> UserError {
    match line {
        Some(line) => UserError::line(file, line, message),
        None => UserError::file(file, message),
    }
}

/// The path of a file that a site names.
pub(super) fn beside(file: &Path, name: &Path) -> PathBuf {
    file.parent().map_or_else(|| name.to_owned(), |folder| folder.join(name))
}

/// The classifier of a file.
fn classifier(file: &Path, files: &NodeFiles) -> Result<Option<Chosen>, String> {
    let Some(name) = &files.nlos_model else { return Ok(None) };
    let chosen = Chosen::read(&beside(file, name), files.nlos_classifier.as_deref());
    let chosen = chosen.map_err(|error| format!("nlos_model: {error}"))?;
    let (bytes, room) = (chosen.bytes().len(), wire::config::MODEL_BYTES);
    if bytes > room {
        return Err(format!("nlos_model has {bytes} bytes: a node has room for {room}"));
    }
    if NodeModel::decode(chosen.bytes()).is_err() {
        let name = chosen.model().map_or("", |model| model.name());
        let kinds = "power-difference, skewness, logistic or quantised";
        return Err(format!("nlos_model is {name}, which nodes do not hold: it must be {kinds}"));
    }
    Ok(Some(chosen))
}
