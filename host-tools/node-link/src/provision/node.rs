//! `[[node]]`: the settings of one node of a site.

use std::path::PathBuf;
use std::sync::Arc;

use positioning_core::nlos::{Classifier, NodeModel};
use serde::Deserialize;
use serde::de::{Deserializer, Error as _, Unexpected};
use wire::config::{Advertiser, Board, Calibration, Identity, Invalid, Pins, Record, Role, Scan, Scheme, Solver, Tag};

use super::document::{Document, Hex, Lines, choice};
use super::lists::Lists;
use super::network::centihertz;
use super::site_models::{self, Files};
use analysis::train::Chosen;
use recording::UserError;

/// The keys that are only for anchors, only for tags or only for beacons.
const ROLE_KEYS: [(RoleName, &[&str]); 3] = [
    (RoleName::Anchor, &["position_m"]),
    (
        RoleName::Tag,
        &[
            "height_m",
            "solver",
            "scheme",
            "rate_hz",
            "still_rate_hz",
            "sleep",
            "anchors_per_round",
            "tell_distances",
            "report_ranges",
            "scan_interval_ms",
            "scan_window_ms",
            "nlos_model",
            "nlos_classifier",
            site_models::KEYS[0],
            site_models::KEYS[1],
        ],
    ),
    (
        RoleName::Beacon,
        &[
            "position_m",
            "uuid",
            "major",
            "minor",
            "measured_power_dbm",
            "interval_ms",
            "tx_power_dbm",
            "channels",
            "rotate_s",
        ],
    ),
];

/// `role`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum RoleName {
    Anchor,
    Tag,
    Beacon,
}

impl RoleName {
    const fn as_str(self) -> &'static str {
        match self {
            Self::Anchor => "anchor",
            Self::Tag => "tag",
            Self::Beacon => "beacon",
        }
    }
}

/// `[[node]]`: the keys of all nodes, then those of tags, then those of beacons.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NodeTable {
    role: RoleName,
    #[serde(default, deserialize_with = "name")]
    name: Option<String>,
    #[serde(default, deserialize_with = "board")]
    board: Option<Board>,
    eui: Option<Hex<8>>,
    address: Option<u16>,
    antenna_delay_ticks: Option<u16>,
    crystal_trim: Option<u8>,
    uwb_tx_power: Option<u32>,
    pins: Option<PinTable>,
    position_m: Option<[f32; 3]>,

    pub(super) height_m: Option<f32>,
    #[serde(default, deserialize_with = "solver")]
    pub(super) solver: Option<Solver>,
    #[serde(default, deserialize_with = "scheme")]
    scheme: Option<Scheme>,
    rate_hz: Option<f32>,
    still_rate_hz: Option<f32>,
    #[serde(default)]
    sleep: bool,
    anchors_per_round: Option<u8>,
    #[serde(default)]
    tell_distances: bool,
    report_ranges: Option<bool>,
    pub(super) scan_interval_ms: Option<u16>,
    scan_window_ms: Option<u16>,
    nlos_model: Option<PathBuf>,
    nlos_classifier: Option<String>,
    pub(super) fingerprint_map: Option<PathBuf>,
    pub(super) room_model: Option<PathBuf>,

    uuid: Option<Hex<16>>,
    major: Option<u16>,
    minor: Option<u16>,
    measured_power_dbm: Option<i8>,
    interval_ms: Option<u16>,
    tx_power_dbm: Option<i8>,
    #[serde(default, deserialize_with = "channels")]
    channels: Option<u8>,
    rotate_s: Option<u16>,
}

/// `pins`.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PinTable {
    sck: u8,
    mosi: u8,
    miso: u8,
    cs: u8,
    irq: u8,
    reset: u8,
}

/// A node with its record.
#[derive(Clone, Debug)]
pub struct Node {
    /// The node's name in the file.
    pub name: String,
    /// The node's board, where the file gives it.
    pub board: Option<Board>,
    /// The node's config record.
    pub record: Record,
    /// The classifier for p_nlos, where the node does not use the powers alone.
    pub model: Option<Chosen>,
    /// The RSSI models of the site, as `wire::config::decode_models` reads them.
    pub site_models: Option<Vec<u8>>,
    pub(super) file: PathBuf,
    /// The line numbers of `[network]`, of this node's table, and of its lists.
    pub(super) network_lines: Lines,
    pub(super) lines: Lines,
    pub(super) lists: Arc<Lists>,
}

/// The content of `[[node]]` itself.
#[derive(Clone, Debug)]
pub(super) struct Own {
    pub(super) name: Option<String>,
    pub(super) board: Option<Board>,
    pub(super) identity: Identity,
    pub(super) role: Role,
    pub(super) calibration: Calibration,
    pub(super) pins: Option<Pins>,
    pub(super) model: Option<Chosen>,
    pub(super) site_models: Files,
    /// Its position, for the nodes that list it.
    pub(super) position_m: Option<[f32; 3]>,
    pub(super) lines: Lines,
}

impl Node {
    /// The record, if a node on this board can follow it. Without a given board, the file's board is used.
    ///
    /// # Errors
    /// The node cannot follow the record. The error has the line number and the reason.
    pub fn record_for(&self, board: Option<Board>) -> Result<&Record, UserError> {
        let judged = match board.or(self.board) {
            Some(board) => self.record.validate_for(board),
            None => self.record.validate(),
        };
        judged.map(|()| &self.record).map_err(|invalid| self.wrong(&invalid))
    }

    /// The error with the file's line number and key.
    fn wrong(&self, invalid: &Invalid) -> UserError {
        let Invalid { within, field, value, must } = invalid;
        let (line, key) = match within {
            Some((list, index)) => (self.lists.line(list, usize::from(*index)).unwrap_or(self.lines.line), *field),
            None => {
                let lines = if field.starts_with("network.") { &self.network_lines } else { &self.lines };
                let key = key_of(field);
                (lines.of(if field.starts_with("pins.") { "pins" } else { key }), key)
            }
        };
        UserError::line(&self.file, line, format!("{key} is {value}: it must be {must}"))
    }
}

/// The file's key for a field of the record.
fn key_of(field: &'static str) -> &'static str {
    match field {
        "network.phy.preamble" => "preamble_symbols",
        "network.phy.code" => "preamble_code",
        "calibration.antenna_delay" => "antenna_delay_ticks",
        "calibration.tx_power" => "uwb_tx_power",
        "tag.scan.interval_ms" => "scan_interval_ms",
        "tag.scan.window_ms" => "scan_window_ms",
        other => other.rsplit('.').next().unwrap_or(other),
    }
}

impl NodeTable {
    /// Reads the table and the files that it names.
    ///
    /// # Errors
    /// A key belongs to another role, keys cannot be combined, or a file is wrong.
    pub(super) fn read(&self, document: Document<'_>, lines: &Lines) -> Result<Own, UserError> {
        let is_of = |role: RoleName, key: &str| ROLE_KEYS.iter().any(|(of, keys)| *of == role && keys.contains(&key));
        let foreign = lines.keys.iter().filter(|(key, _)| !is_of(self.role, key));
        let foreign = foreign.filter_map(|(key, line)| {
            let (of, _) = ROLE_KEYS.iter().find(|(_, keys)| keys.contains(&key.as_str()))?;
            Some((
                line,
                format!("{key} is a key of a node whose role is {}, this one's is {}", of.as_str(), self.role.as_str()),
            ))
        });
        if let Some((line, what)) = foreign.min_by_key(|(line, _)| **line) {
            return Err(document.wrong(*line, what));
        }
        let model = self.model(document, lines)?;
        let site_models = Files::read(self, document, lines)?;
        let role = match self.role {
            RoleName::Anchor => Role::Anchor { position_m: self.position_m },
            RoleName::Tag => Role::Tag(self.tag().map_err(|what| document.wrong(lines.line, what))?),
            RoleName::Beacon => Role::Advertiser(self.advertiser().map_err(|what| document.wrong(lines.line, what))?),
        };
        let pins = |PinTable { sck, mosi, miso, cs, irq, reset }| Pins { sck, mosi, miso, cs, irq, reset };
        Ok(Own {
            name: self.name.clone(),
            board: self.board,
            identity: Identity { eui: self.eui.map(|Hex(eui)| u64::from_be_bytes(eui)), address: self.address },
            role,
            calibration: Calibration {
                antenna_delay: self.antenna_delay_ticks,
                crystal_trim: self.crystal_trim,
                tx_power: self.uwb_tx_power,
            },
            pins: self.pins.map(pins),
            model,
            site_models,
            position_m: self.position_m,
            lines: lines.clone(),
        })
    }

    fn tag(&self) -> Result<Tag, String> {
        let scan = match (self.scan_interval_ms, self.scan_window_ms) {
            (Some(interval_ms), window) => Some(Scan { interval_ms, window_ms: window.unwrap_or(interval_ms) }),
            (None, None) => None,
            (None, Some(_)) => return Err("scan_window_ms without scan_interval_ms: both make a scan".to_owned()),
        };
        Ok(Tag {
            height_m: self.height_m,
            rate_chz: self.rate_hz.map(centihertz),
            still_rate_chz: self.still_rate_hz.map(centihertz),
            sleep: self.sleep,
            anchors_per_round: self.anchors_per_round.unwrap_or(8),
            tell_distances: self.tell_distances,
            scan,
            report_ranges: self.report_ranges.unwrap_or(true),
            solver: self.solver.unwrap_or_default(),
            scheme: self.scheme,
        })
    }

    fn advertiser(&self) -> Result<Advertiser, String> {
        let missing = |key: &str| format!("{key} is missing");
        let Hex(uuid) = self.uuid.ok_or_else(|| missing("uuid"))?;
        Ok(Advertiser {
            uuid,
            major: self.major.ok_or_else(|| missing("major"))?,
            minor: self.minor.ok_or_else(|| missing("minor"))?,
            measured_power_dbm: self.measured_power_dbm.unwrap_or(-59),
            interval_ms: self.interval_ms.unwrap_or(100),
            tx_power_dbm: self.tx_power_dbm.unwrap_or(0),
            channels: self.channels.unwrap_or(0b111),
            rotate_s: self.rotate_s.unwrap_or(0),
        })
    }

    /// The classifier of a file, whose path is relative to the site's file.
    fn model(&self, document: Document<'_>, lines: &Lines) -> Result<Option<Chosen>, UserError> {
        let Some(file) = &self.nlos_model else {
            let what = "nlos_classifier without nlos_model: it names one of the file's";
            let alone = self.nlos_classifier.as_ref().map(|_| document.wrong(lines.of("nlos_classifier"), what));
            return alone.map_or(Ok(None), Err);
        };
        let wrong = |what: String| document.wrong(lines.of("nlos_model"), what);
        let chosen = Chosen::read(&document.beside(file), self.nlos_classifier.as_deref())
            .map_err(|error| wrong(format!("nlos_model: {error}")))?;
        let (bytes, room) = (chosen.bytes().len(), wire::config::MODEL_BYTES);
        if bytes > room {
            return Err(wrong(format!("nlos_model has {bytes} bytes: a node has room for {room}")));
        }
        if NodeModel::decode(chosen.bytes()).is_err() {
            let name = chosen.model().map_or("", |model| model.name());
            let kinds = "power-difference, skewness, logistic or quantised";
            return Err(wrong(format!("nlos_model is {name}, which nodes do not hold: it must be {kinds}")));
        }
        Ok(Some(chosen))
    }
}

/// A node's name must also be valid as a file name.
fn name<'de, D: Deserializer<'de>>(from: D) -> Result<Option<String>, D::Error> {
    let text = String::deserialize(from)?;
    let plain = text.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_'));
    let wrong = || D::Error::invalid_value(Unexpected::Str(&text), &"letters, digits, - and _");
    if plain && !text.is_empty() { Ok(Some(text)) } else { Err(wrong()) }
}

fn board<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Board>, D::Error> {
    choice(from, &Board::HARDWARE, Board::name)
}

fn solver<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Solver>, D::Error> {
    choice(from, &Solver::ALL, Solver::name)
}

fn scheme<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Scheme>, D::Error> {
    choice(from, &Scheme::ALL, Scheme::name)
}

/// Bits of the channels 37, 38 and 39.
fn channels<'de, D: Deserializer<'de>>(from: D) -> Result<Option<u8>, D::Error> {
    let bits = Vec::<u8>::deserialize(from)?.into_iter().try_fold(0, |bits, channel| match channel {
        37..=39 => Ok(bits | 1 << (channel - 37)),
        _ => Err(format!("channels has {channel}: it must be a list of 37, 38, 39 or some of them")),
    });
    bits.map(Some).map_err(D::Error::custom)
}
