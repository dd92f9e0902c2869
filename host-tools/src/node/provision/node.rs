//! `[[node]]`: one node's own part of a site.

use std::path::PathBuf;

use positioning_core::nlos::{Classifier, NodeModel};
use wire::config::{Advertiser, Board, Calibration, Identity, Invalid, Pins, Record, Role, Scan, Scheme, Solver, Tag};

use super::document::{Field, Section, nearest};
use super::network::{Lines, centihertz};
use super::site_models::{self, Files};
use crate::UserError;
use crate::train::Chosen;

const COMMON_KEYS: [&str; 9] =
    ["name", "board", "role", "eui", "address", "antenna_delay_ticks", "crystal_trim", "uwb_tx_power", "pins"];
const ANCHOR_KEYS: [&str; 1] = ["position_m"];
const TAG_KEYS: [&str; 15] = [
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
];
const BEACON_KEYS: [&str; 9] = [
    "position_m",
    "uuid",
    "major",
    "minor",
    "measured_power_dbm",
    "interval_ms",
    "tx_power_dbm",
    "channels",
    "rotate_s",
];
const PIN_KEYS: [&str; 6] = ["sck", "mosi", "miso", "cs", "irq", "reset"];

/// The roles with their keys.
const ROLES: [(&str, &[&str]); 3] = [("anchor", &ANCHOR_KEYS), ("tag", &TAG_KEYS), ("beacon", &BEACON_KEYS)];

const WHOLE: &str = "a whole number, 0 to 65535";

/// A node with its record.
#[derive(Clone, Debug)]
pub struct Node {
    /// What the file calls it.
    pub name: String,
    /// What it is built on, where the file says it.
    pub board: Option<Board>,
    /// What it is told.
    pub record: Record,
    /// What it tells blocked links by, where that is not their powers.
    pub model: Option<Chosen>,
    /// What it knows of beacons' levels on the spot, as `wire::config::decode_models` reads it.
    pub site_models: Option<Vec<u8>>,
    pub(super) file: PathBuf,
    pub(super) line: u64,
    pub(super) lines: Lines,
}

/// What `[[node]]` itself says.
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
    /// Where it stands, for those that list it.
    pub(super) position_m: Option<[f32; 3]>,
    pub(super) line: u64,
    pub(super) lines: Lines,
}

impl Node {
    /// The record, if a node on this board, or on the file's where there is none given, can do as it says.
    ///
    /// # Errors
    /// It cannot; the line says what is wrong.
    pub fn record_for(&self, board: Option<Board>) -> Result<&Record, UserError> {
        let judged = match board.or(self.board) {
            Some(board) => self.record.validate_for(board),
            None => self.record.validate(),
        };
        judged.map(|()| &self.record).map_err(|invalid| self.wrong(&invalid))
    }

    /// In the file's words.
    fn wrong(&self, invalid: &Invalid) -> UserError {
        let Invalid { within, field, value, must } = invalid;
        let (place, key) = match within {
            Some((list, index)) => (format!("{list}[{index}]"), *field),
            None => ((*field).to_owned(), key_of(field)),
        };
        let line = self.lines.get(&place).copied().unwrap_or(self.line);
        UserError::line(&self.file, line, format!("{key} is {value}: it must be {must}"))
    }
}

/// The file's key for a field of the record.
fn key_of(field: &'static str) -> &'static str {
    match field {
        "network.phy.preamble" => "preamble_symbols",
        "network.phy.code" => "preamble_code",
        "tag.scan.interval_ms" => "scan_interval_ms",
        "tag.scan.window_ms" => "scan_window_ms",
        other => other.rsplit('.').next().unwrap_or(other),
    }
}

impl Own {
    pub(super) fn read(section: &Section<'_>) -> Result<Self, UserError> {
        let role_field = section.required("role")?;
        let must = "\"anchor\", \"tag\" or \"beacon\"";
        let said = role_field.text(must)?;
        let (role, own_keys) =
            ROLES.into_iter().find(|(role, _)| *role == said).ok_or_else(|| role_field.refuse(must))?;
        let known = [COMMON_KEYS.as_slice(), own_keys].concat();
        section.with_keys(&known, |key| {
            let of = ROLES.iter().find(|(_, keys)| keys.contains(&key))?.0;
            Some(format!("{key} is a key of a node whose role is {of}, this one's is {role}"))
        })?;

        let mut lines = Lines::new();
        let mut reader = Reader { section, lines: &mut lines };
        let identity = reader.identity()?;
        let calibration = reader.calibration()?;
        let pins = reader.pins()?;
        let position_m = reader.field("position_m", "anchor.position_m").map(|field| field.place()).transpose()?;
        let model = reader.model()?;
        let site_models = Files::read(section)?;
        let role = match role {
            "anchor" => Role::Anchor { position_m },
            "tag" => Role::Tag(reader.tag()?),
            _ => Role::Advertiser(reader.advertiser()?),
        };
        let name = section.optional("name").map(name).transpose()?;
        let board = section.optional("board").map(board).transpose()?;
        Ok(Self {
            name,
            board,
            identity,
            role,
            calibration,
            pins,
            model,
            site_models,
            position_m,
            line: section.line,
            lines,
        })
    }
}

/// Names are those of files, too.
fn name(field: Field<'_>) -> Result<String, UserError> {
    let must = "letters, digits, - and _";
    let text = field.text(must)?;
    let plain = text.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_'));
    if plain && !text.is_empty() { Ok(text.to_owned()) } else { Err(field.refuse(must)) }
}

fn board(field: Field<'_>) -> Result<Board, UserError> {
    let names = Board::ALL.map(Board::name);
    let must = names.join(", ");
    let text = field.text(&must)?;
    Board::from_name(text).ok_or_else(|| match nearest(text, &names) {
        Some(near) => field.refuse(&format!("one of {must}; {near} is near it")),
        None => field.refuse(&format!("one of {must}")),
    })
}

/// Reads fields and notes their lines by the record's names.
struct Reader<'s, 'd> {
    section: &'s Section<'d>,
    lines: &'s mut Lines,
}

impl<'d> Reader<'_, 'd> {
    fn field(&mut self, key: &'static str, name: &str) -> Option<Field<'d>> {
        let field = self.section.optional(key)?;
        self.lines.insert(name.to_owned(), field.line);
        Some(field)
    }

    fn integer<T: TryFrom<i128>>(&mut self, key: &'static str, name: &str, must: &str) -> Result<Option<T>, UserError> {
        self.field(key, name).map(|field| field.integer(must)).transpose()
    }

    fn choice<T: Copy>(
        &mut self,
        key: &'static str,
        name: &str,
        all: &[T],
        name_of: impl Fn(T) -> &'static str,
    ) -> Result<Option<T>, UserError> {
        self.field(key, name).map(|field| field.choice(all, name_of)).transpose()
    }

    fn boolean(&mut self, key: &'static str, default: bool) -> Result<bool, UserError> {
        self.section.optional(key).map_or(Ok(default), |field| field.boolean())
    }

    fn identity(&mut self) -> Result<Identity, UserError> {
        let eui = self.field("eui", "identity.eui").map(|field| field.bytes().map(u64::from_be_bytes)).transpose()?;
        Ok(Identity { eui, address: self.integer("address", "identity.address", "a short address, 0 to 0xFFFD")? })
    }

    fn calibration(&mut self) -> Result<Calibration, UserError> {
        Ok(Calibration {
            antenna_delay: self.integer("antenna_delay_ticks", "calibration.antenna_delay", WHOLE)?,
            crystal_trim: self.integer("crystal_trim", "calibration.crystal_trim", "0 to 31")?,
            tx_power: self.integer("uwb_tx_power", "calibration.tx_power", "a register of 32 bits")?,
        })
    }

    fn pins(&mut self) -> Result<Option<Pins>, UserError> {
        let Some(field) = self.field("pins", "pins") else { return Ok(None) };
        let table = field.table()?.with_keys(&PIN_KEYS, |_| None)?;
        let mut pin = |key: &'static str| {
            let given = table.required(key)?;
            self.lines.insert(format!("pins.{key}"), given.line);
            given.integer("the number of a pin")
        };
        Ok(Some(Pins {
            sck: pin("sck")?,
            mosi: pin("mosi")?,
            miso: pin("miso")?,
            cs: pin("cs")?,
            irq: pin("irq")?,
            reset: pin("reset")?,
        }))
    }

    /// A rate in Hz as hundredths.
    fn rate(&mut self, key: &'static str, name: &str) -> Result<Option<u32>, UserError> {
        let Some(field) = self.field(key, name) else { return Ok(None) };
        field.real().map(|hertz| Some(centihertz(hertz)))
    }

    fn tag(&mut self) -> Result<Tag, UserError> {
        let interval: Option<u16> = self.integer("scan_interval_ms", "tag.scan.interval_ms", WHOLE)?;
        let window: Option<u16> = self.integer("scan_window_ms", "tag.scan.window_ms", WHOLE)?;
        let scan = match (interval, window) {
            (Some(interval_ms), window) => Some(Scan { interval_ms, window_ms: window.unwrap_or(interval_ms) }),
            (None, None) => None,
            (None, Some(_)) => {
                return Err(self.section.wrong("scan_window_ms without scan_interval_ms: both make a scan"));
            }
        };
        Ok(Tag {
            height_m: self.field("height_m", "tag.height_m").map(|field| field.real()).transpose()?,
            rate_chz: self.rate("rate_hz", "tag.rate_hz")?,
            still_rate_chz: self.rate("still_rate_hz", "tag.still_rate_hz")?,
            sleep: self.boolean("sleep", false)?,
            anchors_per_round: self.integer("anchors_per_round", "tag.anchors_per_round", "1 to 8")?.unwrap_or(8),
            tell_distances: self.boolean("tell_distances", false)?,
            scan,
            report_ranges: self.boolean("report_ranges", true)?,
            solver: self.choice("solver", "tag.solver", &Solver::ALL, Solver::name)?.unwrap_or_default(),
            scheme: self.choice("scheme", "tag.scheme", &Scheme::ALL, Scheme::name)?,
        })
    }

    fn advertiser(&mut self) -> Result<Advertiser, UserError> {
        Ok(Advertiser {
            uuid: self.section.required("uuid")?.bytes()?,
            major: self.section.required("major")?.integer(WHOLE)?,
            minor: self.section.required("minor")?.integer(WHOLE)?,
            measured_power_dbm: self.integer("measured_power_dbm", "", "-128 to 127")?.unwrap_or(-59),
            interval_ms: self.integer("interval_ms", "beacon.interval_ms", WHOLE)?.unwrap_or(100),
            tx_power_dbm: self.integer("tx_power_dbm", "beacon.tx_power_dbm", "-40 to 20")?.unwrap_or(0),
            channels: self.channels()?,
            rotate_s: self.integer("rotate_s", "beacon.rotate_s", WHOLE)?.unwrap_or(0),
        })
    }

    /// The classifier of a file, whose path counts from the site's.
    fn model(&mut self) -> Result<Option<Chosen>, UserError> {
        let classifier = self.section.optional("nlos_classifier");
        let Some(field) = self.section.optional("nlos_model") else {
            let alone =
                classifier.map(|field| field.wrong("nlos_classifier without nlos_model: it names one of the file's"));
            return alone.map_or(Ok(None), Err);
        };
        let name = classifier.map(|field| field.text("the name of a classifier")).transpose()?;
        let chosen = Chosen::read(&field.path("the name of a file of `baliza nlos train`")?, name)
            .map_err(|wrong| field.wrong(format!("nlos_model: {wrong}")))?;
        let (bytes, room) = (chosen.bytes().len(), wire::config::MODEL_BYTES);
        if bytes > room {
            return Err(field.wrong(format!("nlos_model has {bytes} bytes: a node has room for {room}")));
        }
        if NodeModel::decode(chosen.bytes()).is_err() {
            let name = chosen.model().map_or("", |model| model.name());
            let kinds = "power-difference, skewness, logistic or quantised";
            return Err(field.wrong(format!("nlos_model is {name}, which nodes do not hold: it must be {kinds}")));
        }
        Ok(Some(chosen))
    }

    fn channels(&mut self) -> Result<u8, UserError> {
        let Some(field) = self.field("channels", "beacon.channels") else { return Ok(0b111) };
        let must = "a list of 37, 38, 39 or some of them";
        let channels: Vec<u8> = field.integers(must)?;
        channels.iter().try_fold(0, |bits, channel| match channel {
            37..=39 => Ok(bits | 1 << (channel - 37)),
            _ => Err(field.wrong(format!("channels has {channel}: it must be {must}"))),
        })
    }
}
