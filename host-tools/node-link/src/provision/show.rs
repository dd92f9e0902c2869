//! Writes a record as the file from which it could be made: show, edit, provision.

use std::fmt::{Display, Write};

use site::{HIDDEN, mode_name};
use wire::config::{Advertiser, Anchor, Beacon, Board, Mode, PollContent, Record, Role, Tag, TagArea, Wifi, WifiKey};
use wire::telemetry::Address;

use super::SiteNames;
use super::image::Held;
use super::site_models::KEYS;

/// Whether keys are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keys {
    /// Keys are replaced by a text that is not a valid key.
    Hidden,
    /// Keys as they are.
    Shown,
}

/// The record as TOML that [`Site::parse`](super::Site::parse) reads, with its board where that is known. A record has no
/// room for the node's name: `names` have it. Comments name a classifier, a map and a model of rooms.
pub fn toml(held: &Held, board: Option<Board>, keys: Keys, names: &SiteNames) -> String {
    let record = &held.record;
    let mut text =
        Text(format!("# The record of a node: version {}, sequence {}\n\n[network]\n", held.version, held.sequence));
    text.network(record, keys);
    if let Ok(wifi) = &held.wifi {
        text.wifi(wifi, keys);
    }
    text.node(record, board, names);
    if held.wifi.is_ok() {
        text.line("wifi", true);
    }
    if let Some(classifier) = held.classifier() {
        let _ = writeln!(text.0, "# nlos_model: {classifier}");
    }
    for (key, words) in KEYS.into_iter().zip(held.map_and_rooms()) {
        if let Some(words) = words {
            let _ = writeln!(text.0, "# {key}: {words}");
        }
    }
    for anchor in &record.anchors {
        text.anchor(anchor);
    }
    for beacon in &record.beacons {
        text.beacon(beacon);
    }
    text.0
}

/// The record as one JSON document. `nlos_model` has the classifier's name and features, `fingerprint_map` describes
/// the map, and `room_model` describes the rooms.
///
/// # Errors
/// No record can cause an error.
pub fn json(
    held: &Held,
    board: Option<Board>,
    keys: Keys,
    names: &SiteNames,
) -> Result<serde_json::Value, toml::de::Error> {
    let mut document: serde_json::Value = toml::from_str(&toml(held, board, keys, names))?;
    for list in ["node", "anchor"] {
        let nodes = document.get_mut(list).and_then(serde_json::Value::as_array_mut);
        for address in nodes.into_iter().flatten().filter_map(|node| node.get_mut("address")) {
            let number = address.as_u64().and_then(|number| u16::try_from(number).ok());
            *address = number.map(|number| Address(number).to_string()).into();
        }
    }
    if let (Some(classifier), Some(fields)) = (held.classifier(), document.as_object_mut()) {
        fields.insert("nlos_model".to_owned(), classifier.into());
    }
    if let Some(fields) = document.as_object_mut() {
        let words = KEYS.into_iter().zip(held.map_and_rooms());
        fields.extend(words.filter_map(|(key, words)| Some((key.to_owned(), words?.into()))));
    }
    Ok(document)
}

/// A short description of the node.
pub fn summary(held: &Held) -> String {
    let record = &held.record;
    let address = match (record.identity.address, record.identity.eui) {
        (Some(address), _) => format!(" {}", Address(address)),
        (None, Some(eui)) => format!(" {eui:016X}"),
        (None, None) => String::new(),
    };
    let what = match &record.role {
        Role::Tag(_) => format!("tag{address} of network 0x{:04X}", record.network.pan),
        Role::Anchor { position_m: Some([x, y, z]) } => {
            format!("anchor{address} of network 0x{:04X} at ({x}, {y}, {z}) m", record.network.pan)
        }
        Role::Anchor { position_m: None } => {
            format!("anchor{address} of network 0x{:04X}, its place not surveyed", record.network.pan)
        }
        Role::Advertiser(beacon) => format!("beacon, major {}, minor {}", beacon.major, beacon.minor),
        Role::Scanner => format!("scanner{address}"),
    };
    let classifier = held.classifier().map_or_else(String::new, |classifier| format!(", with {classifier}"));
    let [map, rooms] = held.map_and_rooms().map(|words| words.is_some());
    let site_models = match (map, rooms) {
        (true, true) => ", with a map and rooms",
        (true, false) => ", with a map",
        (false, true) => ", with rooms",
        (false, false) => "",
    };
    let wifi =
        held.wifi.as_ref().map_or_else(|_| String::new(), |wifi| format!(", by Wi-Fi to {}:{}", wifi.host, wifi.port));
    format!("{what}{classifier}{site_models}{wifi}; version {}, sequence {}", held.version, held.sequence)
}

/// The TOML text.
struct Text(String);

impl Text {
    fn line(&mut self, key: &str, value: impl Display) {
        // Writing to a string does not fail.
        let _ = writeln!(self.0, "{key} = {value}");
    }

    fn line_if(&mut self, key: &str, value: Option<impl Display>) {
        if let Some(value) = value {
            self.line(key, value);
        }
    }

    fn text(&mut self, key: &str, value: impl Display) {
        self.line(key, format_args!("\"{value}\""));
    }

    fn place(&mut self, position_m: [f32; 3]) {
        self.line("position_m", format_args!("{position_m:?}"));
    }

    fn network(&mut self, record: &Record, keys: Keys) {
        let network = &record.network;
        self.line("pan", format_args!("0x{:04X}", network.pan));
        if let Some(region) = network.region {
            self.text("region", region.name());
        }
        self.text("mode", mode_name(network.mode));
        match network.mode {
            Mode::Listening { rounds_chz } => self.line("rounds_hz", hertz(rounds_chz)),
            Mode::Native | Mode::Blink | Mode::DecaRanging { fast: _ } => (),
        }
        self.line("channel", network.phy.channel);
        self.line("prf_mhz", network.phy.prf_mhz);
        self.line("rate_kbps", network.phy.rate_kbps);
        self.line("preamble_symbols", network.phy.preamble);
        self.line_if("preamble_code", network.phy.code);
        if let Some(pinned) = network.turnaround {
            self.line("answer_us", pinned.answer_us);
            self.line("listen_again_us", pinned.listen_again_us);
            self.line("transmit_us", pinned.transmit_us);
        }
        for (name, key) in [("key", network.key), ("beacon_key", record.beacon_key)] {
            match (key, keys) {
                (Some(key), Keys::Shown) => self.text(name, hex(&key)),
                (Some(_), Keys::Hidden) => self.text(name, HIDDEN),
                (None, _) => (),
            }
        }
    }

    fn wifi(&mut self, wifi: &Wifi, keys: Keys) {
        let Wifi { ssid, password, host, port, key } = wifi;
        self.0.push_str("\n[wifi]\n");
        self.line("ssid", toml::Value::from(ssid.as_str()));
        match (password.is_empty(), keys) {
            (true, _) => (),
            (false, Keys::Shown) => self.line("password", toml::Value::from(password.as_str())),
            (false, Keys::Hidden) => self.text("password", HIDDEN),
        }
        self.line("station", toml::Value::from(format!("{host}:{port}")));
        if let Some(WifiKey { gateway, secret }) = key {
            let secret = if keys == Keys::Shown { hex(secret) } else { HIDDEN.to_owned() };
            let _ = writeln!(self.0, "# of the file of `gateways`: id = \"0x{gateway:016x}\", key = \"{secret}\"");
        }
    }

    fn node(&mut self, record: &Record, board: Option<Board>, names: &SiteNames) {
        if let Role::Tag(Tag { area: Some(area), .. }) = &record.role {
            self.area(area);
        }
        self.0.push_str("\n[[node]]\n");
        let (role, identity) = (role(&record.role), &record.identity);
        match (names.name_of(record), identity.address) {
            (Some(name), _) => self.text("name", name),
            (None, Some(address)) => self.text("name", format_args!("{role}-{address:04X}")),
            (None, None) => self.text("name", role),
        }
        if let Some(board) = board {
            self.text("board", board.name());
        }
        self.text("role", role);
        if let Some(eui) = identity.eui {
            self.text("eui", format_args!("{eui:016X}"));
        }
        self.line_if("address", identity.address.map(Address));
        self.line_if("antenna_delay_ticks", record.calibration.antenna_delay);
        self.line_if("crystal_trim", record.calibration.crystal_trim);
        self.line_if("uwb_tx_power", record.calibration.tx_power.map(|register| format!("0x{register:08X}")));
        if let Some(pins) = record.pins {
            let pins = pins.named().map(|(name, pin, _)| format!("{} = {pin}", name.trim_start_matches("pins.")));
            self.line("pins", format_args!("{{ {} }}", pins.join(", ")));
        }
        match &record.role {
            Role::Tag(tag) => {
                if record.network.mode == Mode::Blink {
                    self.text("mode", site::BLINK);
                }
                self.tag(tag);
            }
            Role::Anchor { position_m: Some(position_m) } => self.place(*position_m),
            Role::Anchor { position_m: None } | Role::Scanner => (),
            Role::Advertiser(beacon) => self.advertiser(beacon),
        }
    }

    fn area(&mut self, area: &TagArea) {
        self.0.push_str("\n[area]\n");
        for (key, bounds_m) in ["x_m", "y_m", "z_m"].into_iter().zip(area.bounds_m()) {
            self.line_if(key, bounds_m[0].is_finite().then(|| format!("{bounds_m:?}")));
        }
    }

    fn tag(&mut self, tag: &Tag) {
        // A float keeps its decimal point, so that it is read as a float.
        self.line_if("height_m", tag.height_m.map(|height| format!("{height:?}")));
        self.line_if("height_sigma_m", (tag.height_sigma_m != 0.0).then(|| format!("{:?}", tag.height_sigma_m)));
        self.text("solver", tag.solver.name());
        if let Some(scheme) = tag.scheme {
            self.text("scheme", scheme.name());
        }
        self.line_if("rate_hz", tag.rate_chz.map(hertz));
        self.line_if("still_rate_hz", tag.still_rate_chz.map(hertz));
        self.line("sleep", tag.sleep);
        self.line("anchors_per_round", tag.anchors_per_round);
        self.line("tell_distances", tag.tells == PollContent::Distances);
        self.line("tell_position", tag.tells.has_position());
        self.line_if("advertise_position", (tag.tells == PollContent::Advertised).then_some(true));
        self.line("report_ranges", tag.report_ranges);
        if let Some(scan) = tag.scan {
            self.line("scan_interval_ms", scan.interval_ms);
            self.line("scan_window_ms", scan.window_ms);
        }
    }

    fn advertiser(&mut self, beacon: &Advertiser) {
        let uuid = hex(&beacon.uuid);
        let parts = [0..8, 8..12, 12..16, 16..20, 20..32].map(|part| uuid.get(part).unwrap_or_default());
        self.text("uuid", parts.join("-"));
        self.line("major", beacon.major);
        self.line("minor", beacon.minor);
        self.line("measured_power_dbm", beacon.measured_power_dbm);
        self.line("interval_ms", beacon.interval_ms);
        self.line("tx_power_dbm", beacon.tx_power_dbm);
        let channels: Vec<u8> = (0..3).filter(|bit| beacon.channels >> bit & 1 == 1).map(|bit| 37 + bit).collect();
        self.line("channels", format_args!("{channels:?}"));
        self.line("rotate_s", beacon.rotate_s);
    }

    fn anchor(&mut self, anchor: &Anchor) {
        self.0.push_str("\n[[anchor]]\n");
        self.line("address", Address(anchor.address));
        self.place(anchor.position_m);
    }

    fn beacon(&mut self, beacon: &Beacon) {
        self.0.push_str("\n[[beacon]]\n");
        self.line("major", beacon.major);
        self.line("minor", beacon.minor);
        self.place(beacon.position_m);
        self.line_if("rssi_1m_dbm", beacon.rssi_1m_dbm.map(|rssi| format!("{rssi:?}")));
        self.line_if("path_loss_exponent", beacon.path_loss_exponent.map(|exponent| format!("{exponent:?}")));
    }
}

fn role(role: &Role) -> &'static str {
    match role {
        Role::Tag(_) => "tag",
        Role::Anchor { position_m: _ } => "anchor",
        Role::Advertiser(_) => "beacon",
        Role::Scanner => "scanner",
    }
}

/// A rate of the record, Hz.
fn hertz(hundredths: u32) -> String {
    format!("{:?}", f64::from(hundredths) / 100.0)
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
