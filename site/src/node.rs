//! `[[node]]`: the settings of one node of a site.

use std::path::PathBuf;
use std::sync::Arc;

use serde::Deserialize;
use serde::de::{Deserializer, Error as _, Unexpected};
use wire::config::{
    Advertiser, Board, Calibration, Identity, Invalid, Mode, Pins, PollContent, Record, Role, Scan, Scheme, Solver,
    Tag, Wifi,
};

use crate::Purpose;
use crate::document::{Hex, KeyLines, SiteError, choice};
use crate::lists::Lists;
use crate::network::centihertz;
use crate::receivers;
use crate::role_keys::refuse_foreign_keys;
use crate::simulation::NodeSimulation;
use crate::values::Exactly;

/// The mode of a tag that blinks.
pub const BLINK: &str = "blink";

/// The UUID of a simulated beacon whose table has none. Eddystone uses its first ten bytes as namespace.
pub const SIMULATED_UUID: [u8; 16] = *b"baliza scenario\0";

/// `role`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum RoleName {
    Anchor,
    Tag,
    Beacon,
    Scanner,
}

impl RoleName {
    pub(crate) const fn as_str(self) -> &'static str {
        match self {
            Self::Anchor => "anchor",
            Self::Tag => "tag",
            Self::Beacon => "beacon",
            Self::Scanner => "scanner",
        }
    }

    /// The first address of simulated nodes that have none in the file.
    const fn first_simulated(self) -> u16 {
        match self {
            Self::Anchor => 0x0001,
            Self::Tag => 0x1001,
            Self::Beacon => 0x2001,
            Self::Scanner => 0x3001,
        }
    }
}

/// `[[node]]`: the keys of all nodes, then those of tags, of beacons, and of scanners.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct NodeTable {
    pub(crate) role: RoleName,
    #[serde(default, deserialize_with = "name")]
    pub(crate) name: Option<String>,
    #[serde(default, deserialize_with = "board")]
    board: Option<Board>,
    eui: Option<Hex<8>>,
    address: Option<u16>,
    antenna_delay_ticks: Option<u16>,
    crystal_trim: Option<u8>,
    uwb_tx_power: Option<u32>,
    pins: Option<PinTable>,
    position_m: Option<Exactly<f64, 3>>,
    #[serde(default)]
    wifi: bool,
    #[serde(default)]
    pub(crate) simulation: NodeSimulation,

    height_m: Option<f32>,
    height_sigma_m: Option<f32>,
    #[serde(rename = "mode", default, deserialize_with = "blinks")]
    blinks: bool,
    #[serde(default, deserialize_with = "solver")]
    solver: Option<Solver>,
    #[serde(default, deserialize_with = "scheme")]
    scheme: Option<Scheme>,
    rate_hz: Option<f64>,
    still_rate_hz: Option<f64>,
    #[serde(default)]
    sleep: bool,
    anchors_per_round: Option<u8>,
    #[serde(default)]
    tell_distances: bool,
    #[serde(default)]
    tell_position: bool,
    #[serde(default)]
    advertise_position: bool,
    report_ranges: Option<bool>,
    scan_interval_ms: Option<u16>,
    scan_window_ms: Option<u16>,
    nlos_model: Option<PathBuf>,
    nlos_classifier: Option<String>,
    fingerprint_map: Option<PathBuf>,
    room_model: Option<PathBuf>,

    uuid: Option<Hex<16>>,
    major: Option<u16>,
    minor: Option<u16>,
    measured_power_dbm: Option<i8>,
    interval_ms: Option<u16>,
    tx_power_dbm: Option<i8>,
    #[serde(default, deserialize_with = "channels")]
    channels: Option<u8>,
    rotate_s: Option<u16>,

    rssi_1m_dbm: Option<f64>,
    path_loss_exponent: Option<f64>,
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
    /// The node's name in the file, or a name by its role and number.
    pub name: String,
    /// The node's board, where the file gives it.
    pub board: Option<Board>,
    /// The node's config record.
    pub record: Record,
    /// How it reaches its station by Wi-Fi, without the key; `None`: it has a cable, or none.
    pub wifi: Option<Wifi>,
    /// The files that a tag's table names.
    pub files: NodeFiles,
    /// The position of an anchor, a beacon or a scanner, metres.
    pub position_m: Option<[f64; 3]>,
    /// RSSI of a usual device one metre from a scanner, dBm.
    pub rssi_1m_dbm: Option<f64>,
    /// The path-loss exponent of what a scanner receives.
    pub path_loss_exponent: Option<f64>,
    /// What only a simulation has.
    pub simulation: NodeSimulation,
    /// The line numbers of the node's table.
    pub lines: KeyLines,
    /// What tags of its network are told of.
    pub lists: Arc<Lists>,
    /// The line numbers of `[network]`.
    pub(crate) network_lines: KeyLines,
}

/// The files of a tag, whose paths are relative to the site's file, and the solver that its table gives.
#[derive(Clone, Debug, Default)]
pub struct NodeFiles {
    /// A classifier for p_nlos.
    pub nlos_model: Option<PathBuf>,
    /// Which classifier of that file.
    pub nlos_classifier: Option<String>,
    /// A map of the beacons' RSSI.
    pub fingerprint_map: Option<PathBuf>,
    /// A model of rooms.
    pub room_model: Option<PathBuf>,
}

/// The content of `[[node]]` itself.
#[derive(Clone, Debug)]
pub(crate) struct Own {
    pub(crate) table: NodeTable,
    pub(crate) identity: Identity,
    pub(crate) role: Role,
    pub(crate) calibration: Calibration,
    pub(crate) pins: Option<Pins>,
    pub(crate) lines: KeyLines,
}

impl Own {
    /// Its position as records have it.
    pub(crate) fn position_m(&self) -> Option<[f32; 3]> {
        self.table.position()
    }

    /// How it reaches its station by Wi-Fi, in a site with these settings.
    pub(crate) fn wifi(&self, site: Option<&Wifi>) -> Result<Option<Wifi>, SiteError> {
        let wrong = |what| Err(SiteError::at(self.lines.of("wifi"), what));
        match site {
            _ if !self.table.wifi => Ok(None),
            None => wrong("wifi is true: [wifi] with ssid and station is missing"),
            Some(_) if self.table.scan_interval_ms.is_some() => {
                wrong("wifi with scan_interval_ms: the image with Wi-Fi has no Bluetooth")
            }
            Some(settings) => Ok(Some(settings.clone())),
        }
    }
}

impl Node {
    /// The record, if a node on this board can follow it. Without a given board, the file's board is used.
    ///
    /// # Errors
    /// The node cannot follow the record. The error has the line number and the reason.
    pub fn record_for(&self, board: Option<Board>) -> Result<&Record, SiteError> {
        let checked = match board.or(self.board) {
            Some(board) if self.wifi.is_some() && !board.spec().has_wifi => {
                let what = format!("wifi is true: a {} has no Wi-Fi", board.name());
                return Err(SiteError::at(self.lines.of("wifi"), what));
            }
            Some(board) => self.record.validate_for(board),
            None => self.record.validate(),
        };
        checked.map(|()| &self.record).map_err(|invalid| self.wrong(&invalid))
    }

    /// The error with the file's line number and key.
    pub fn wrong(&self, invalid: &Invalid) -> SiteError {
        let Invalid { within, field, value, must } = invalid;
        let (line, key) = match within {
            Some((list, index)) => (self.lists.line(list, usize::from(*index)).unwrap_or(self.lines.line), *field),
            None => {
                let lines = if field.starts_with("network.") { &self.network_lines } else { &self.lines };
                let key = key_of(field);
                (lines.of(if field.starts_with("pins.") { "pins" } else { key }), key)
            }
        };
        SiteError::at(line, format!("{key} is {value}: it must be {must}"))
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

/// The addresses and numbers of simulated nodes that have none in the file, in the order of the file.
#[derive(Debug, Default)]
pub(crate) struct Numbers {
    of_role: [u16; 4],
}

impl Numbers {
    /// The next number of a role, from 0.
    fn next(&mut self, role: RoleName) -> u16 {
        let number = &mut self.of_role[role as usize];
        let next = number.saturating_add(1);
        std::mem::replace(number, next)
    }
}

impl NodeTable {
    /// Whether it stands for a node that is not the site's own: one of a neighbouring network, or a beacon that tags
    /// are not told of.
    pub(crate) fn is_foreign(&self) -> bool {
        self.simulation.network > 0 || !self.simulation.listed
    }

    /// The nodes that it stands for: the others have no name and no EUI-64 of their own.
    pub(crate) fn each(self, purpose: Purpose) -> impl Iterator<Item = Self> {
        let count = if purpose == Purpose::Simulation { self.simulation.count } else { 1 };
        (0..count).map(move |i| match i {
            0 => self.clone(),
            _ => {
                Self { name: None, eui: None, address: self.address.map(|first| first.wrapping_add(i)), ..self.clone() }
            }
        })
    }

    fn position(&self) -> Option<[f32; 3]> {
        self.position_m.map(|Exactly(at)| at.map(|metres| metres as f32))
    }

    /// Checks the table, and completes what only real nodes need where the purpose is a simulation.
    ///
    /// # Errors
    /// A key belongs to another role, is missing, or keys cannot be combined.
    pub(crate) fn read(mut self, lines: KeyLines, purpose: Purpose, numbers: &mut Numbers) -> Result<Own, SiteError> {
        refuse_foreign_keys(self.role, &lines)?;
        let mut identity = Identity { eui: self.eui.map(|Hex(eui)| u64::from_be_bytes(eui)), address: self.address };
        if purpose == Purpose::Simulation {
            let number = numbers.next(self.role);
            let default = self.role.first_simulated().saturating_add(number);
            identity.address = identity.address.or(identity.eui.map(|eui| eui as u16)).or(Some(default));
            self.name.get_or_insert_with(|| format!("{}-{}", self.role.as_str(), u32::from(number) + 1));
            self.uuid.get_or_insert(Hex(SIMULATED_UUID));
            self.major.get_or_insert(1);
            self.minor.get_or_insert(number.saturating_add(1));
        }
        let wrong = |what| SiteError::at(lines.line, what);
        if self.antenna_delay_ticks == Some(0) {
            let what = "antenna_delay_ticks is 0, which makes ranges 154 m too long: without the key, the delay of the \
                        module or the usual one is taken";
            return Err(SiteError::at(lines.of("antenna_delay_ticks"), what));
        }
        let role = match self.role {
            RoleName::Anchor => Role::Anchor { position_m: self.position() },
            RoleName::Tag => Role::Tag(self.tag(&lines)?),
            RoleName::Beacon => Role::Advertiser(self.advertiser().map_err(wrong)?),
            RoleName::Scanner => Role::Scanner,
        };
        let calibration = Calibration {
            antenna_delay: self.antenna_delay_ticks,
            crystal_trim: self.crystal_trim,
            tx_power: self.uwb_tx_power,
        };
        let pins = |PinTable { sck, mosi, miso, cs, irq, reset }| Pins { sck, mosi, miso, cs, irq, reset };
        let pins = self.pins.map(pins);
        Ok(Own { table: self, identity, role, calibration, pins, lines })
    }

    fn tag(&self, lines: &KeyLines) -> Result<Tag, SiteError> {
        let scan = match (self.scan_interval_ms, self.scan_window_ms) {
            (Some(interval_ms), window) => Some(Scan { interval_ms, window_ms: window.unwrap_or(interval_ms) }),
            (None, None) => None,
            (None, Some(_)) => {
                let what = "scan_window_ms without scan_interval_ms: both make a scan";
                return Err(SiteError::at(lines.line, what));
            }
        };
        if self.nlos_classifier.is_some() && self.nlos_model.is_none() {
            let what = "nlos_classifier without nlos_model: it names one of the file's";
            return Err(SiteError::at(lines.of("nlos_classifier"), what));
        }
        self.check_site_models(lines)?;
        let telling = if self.advertise_position { "advertise_position" } else { "tell_position" };
        let tells = match (self.tell_distances, self.tell_position, self.advertise_position) {
            (false, false, false) => PollContent::Nothing,
            (true, false, false) => PollContent::Distances,
            (false, true, false) => PollContent::Position,
            (false, _, true) => PollContent::Advertised,
            (true, ..) => {
                let what = format!("{telling} and tell_distances: a poll has room for one of them");
                return Err(SiteError::at(lines.of(telling), what));
            }
        };
        Ok(Tag {
            height_m: self.height_m,
            rate_chz: self.rate_hz.map(centihertz),
            still_rate_chz: self.still_rate_hz.map(centihertz),
            sleep: self.sleep,
            anchors_per_round: self.anchors_per_round.unwrap_or(8),
            tells,
            scan,
            report_ranges: self.report_ranges.unwrap_or(true),
            solver: self.solver.unwrap_or_default(),
            scheme: self.scheme,
            height_sigma_m: self.height_sigma_m.unwrap_or(0.0),
            area: None,
        })
    }

    /// Checks that a tag with a map or a model of rooms can use it.
    fn check_site_models(&self, lines: &KeyLines) -> Result<(), SiteError> {
        let files = [("fingerprint_map", &self.fingerprint_map), ("room_model", &self.room_model)];
        for (key, _) in files.into_iter().filter(|(_, file)| file.is_some()) {
            let without = |other, why| Err(SiteError::at(lines.of(key), format!("{key} without {other}: {why}")));
            if self.scan_interval_ms.is_none() {
                return without("scan_interval_ms", "the tag does not listen to beacons");
            }
            if self.solver.is_some_and(|solver| solver != Solver::Track) {
                let what = format!("solver with {key}: only a track uses beacons");
                return Err(SiteError::at(lines.of("solver"), what));
            }
            if self.height_m.is_none() {
                let why = "beacons give positions in the plane, at the height at which a tag is carried";
                return without("height_m", why);
            }
        }
        Ok(())
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

    /// The mode of its record, in a network with this one.
    pub(crate) fn mode(&self, network: Mode, lines: &KeyLines) -> Result<Mode, SiteError> {
        match (self.blinks, network) {
            (false, mode) => Ok(mode),
            (true, Mode::Native | Mode::Blink) => Ok(Mode::Blink),
            (true, Mode::DecaRanging { .. } | Mode::Listening { .. }) => {
                let what = "mode = \"blink\" in a network whose mode is not native: only its anchors report blinks";
                Err(SiteError::at(lines.of("mode"), what))
            }
        }
    }

    pub(crate) fn files(&self) -> NodeFiles {
        NodeFiles {
            nlos_model: self.nlos_model.clone(),
            nlos_classifier: self.nlos_classifier.clone(),
            fingerprint_map: self.fingerprint_map.clone(),
            room_model: self.room_model.clone(),
        }
    }

    pub(crate) fn node(&self) -> (Option<Board>, Option<[f64; 3]>) {
        (self.board, self.position_m.map(|Exactly(at)| at))
    }

    /// How a scanner's RSSI depends on the distance, checked.
    pub(crate) fn path_loss(&self, lines: &KeyLines) -> Result<[Option<f64>; 2], SiteError> {
        let path_loss = [self.rssi_1m_dbm, self.path_loss_exponent];
        receivers::check_path_loss(path_loss)
            .map(|()| path_loss)
            .map_err(|(key, what)| SiteError::at(lines.of(key), format!("{key} is {what}")))
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
    choice(from, &Board::HARDWARE, Board::name).map(Some)
}

/// `mode` of a tag: `blink`, or that of the network without the key.
fn blinks<'de, D: Deserializer<'de>>(from: D) -> Result<bool, D::Error> {
    choice(from, &[BLINK], |mode| mode).map(|mode| mode == BLINK)
}

fn solver<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Solver>, D::Error> {
    choice(from, &Solver::ALL, Solver::name).map(Some)
}

fn scheme<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Scheme>, D::Error> {
    choice(from, &Scheme::ALL, Scheme::name).map(Some)
}

/// Bits of the channels 37, 38 and 39.
fn channels<'de, D: Deserializer<'de>>(from: D) -> Result<Option<u8>, D::Error> {
    let bits = Vec::<u8>::deserialize(from)?.into_iter().try_fold(0, |bits, channel| match channel {
        37..=39 => Ok(bits | 1 << (channel - 37)),
        _ => Err(format!("channels has {channel}: it must be a list of 37, 38, 39 or some of them")),
    });
    bits.map(Some).map_err(D::Error::custom)
}
