//! Scenarios as TOML: `examples/every-key.toml` has every key. A text is parsed to a [`Scenario`] or to an error with
//! its line.

mod bluetooth;
mod motion;
mod network;
mod values;

use std::collections::HashSet;
use std::fmt;
use std::ops::Range;

use baliza_report::{Explained, explain, line_of};
use positioning_core::Method;
use ranging::native::Scheme;
use serde::Deserialize;
use toml::Spanned;

use self::bluetooth::{BeaconTable, BluetoothTable, check_list};
use self::motion::{CarrierName, SensorName};
use self::network::NetworkTable;
use self::values::{
    anchors_per_round, board, clock_offset, method, not_negative, optional_antenna_delay, optional_board,
    optional_finite, optional_rate, optional_slowdown, place, places, positive, probability, scheme, slowdown,
};
use super::{AirModel, Anchor, Fault, FaultKind, Fidelity, Motion, NETWORK, Scenario, Tag, TagSettings, Walk};
use crate::air::{Material, Wall};
use crate::board::BoardProfile;

/// The addresses of nodes that have none in the file: anchors from the first, tags from the second, beacons from the
/// third, in the order of the file.
const FIRST_ANCHOR: u16 = 0x0001;
const FIRST_TAG: u16 = 0x1001;
const FIRST_BEACON: u16 = 0x2001;
/// The address of everyone.
const BROADCAST: u16 = 0xFFFF;
/// The default walking speed of a tag, metres per second.
const WALKING_M_S: f64 = 1.0;

/// What is wrong with a scenario, and where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ScenarioError {
    /// The line, from 1.
    pub line: usize,
    /// What is wrong, in one line.
    pub message: String,
}

impl fmt::Display for ScenarioError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.line, self.message)
    }
}

impl std::error::Error for ScenarioError {}

impl Scenario {
    /// Parses the scenario of a TOML text.
    ///
    /// # Errors
    /// Returns the first error in the text, with its line.
    pub fn parse(text: &str) -> Result<Self, ScenarioError> {
        let file: File = toml::from_str(text).map_err(|error| {
            let Explained { line, message } = explain(text, error.span(), error.message());
            ScenarioError { line, message }
        })?;
        let wrong = |SpanError { span, message }: SpanError| ScenarioError { line: line_of(text, span.start), message };
        file.scenario().map_err(wrong)
    }
}

/// A check that failed on a part of the text.
struct SpanError {
    span: Range<usize>,
    message: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, default)]
struct File {
    #[serde(deserialize_with = "positive")]
    seconds: f64,
    seed: u64,
    #[serde(deserialize_with = "probability")]
    loss: f64,
    #[serde(alias = "level")]
    fidelity: FidelityName,
    air: AirName,
    #[serde(deserialize_with = "clock_offset")]
    clock_ppm: f64,
    #[serde(deserialize_with = "optional_finite")]
    height_m: Option<f32>,
    #[serde(deserialize_with = "method")]
    method: Option<Method>,
    weigh_nlos: bool,
    #[serde(deserialize_with = "optional_rate")]
    rate_hz: Option<f64>,
    #[serde(deserialize_with = "optional_rate")]
    still_rate_hz: Option<f64>,
    sleep: bool,
    #[serde(deserialize_with = "scheme")]
    scheme: Scheme,
    #[serde(deserialize_with = "anchors_per_round")]
    anchors_per_round: u8,
    #[serde(deserialize_with = "board")]
    board: BoardProfile,
    #[serde(deserialize_with = "slowdown")]
    cpu_slowdown: f64,
    network: Vec<Spanned<NetworkTable>>,
    wall: Vec<WallTable>,
    bluetooth: BluetoothTable,
    beacon: Vec<Spanned<BeaconTable>>,
    anchor: Vec<Spanned<AnchorTable>>,
    tag: Vec<Spanned<TagTable>>,
    fault: Vec<Spanned<FaultTable>>,
}

impl Default for File {
    fn default() -> Self {
        let tag = TagSettings::default();
        Self {
            seconds: 10.0,
            seed: 1,
            loss: 0.0,
            fidelity: FidelityName::Spi,
            air: AirName::Recorded,
            clock_ppm: 20.0,
            height_m: tag.height_m,
            method: tag.method,
            weigh_nlos: tag.weigh_nlos,
            rate_hz: tag.rate_hz,
            still_rate_hz: tag.still_rate_hz,
            sleep: tag.sleep,
            scheme: tag.scheme,
            anchors_per_round: tag.anchors_per_round,
            board: BoardProfile::DWM1001,
            cpu_slowdown: 1.0,
            network: Vec::new(),
            wall: Vec::new(),
            bluetooth: BluetoothTable::default(),
            beacon: Vec::new(),
            anchor: Vec::new(),
            tag: Vec::new(),
            fault: Vec::new(),
        }
    }
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum FidelityName {
    Spi,
    Air,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum AirName {
    Recorded,
    Ideal,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct WallTable {
    #[serde(deserialize_with = "place")]
    from: [f64; 2],
    #[serde(deserialize_with = "place")]
    to: [f64; 2],
    material: MaterialName,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum MaterialName {
    Drywall,
    Wood,
    Glass,
    Brick,
    Concrete,
    Metal,
    Body,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AnchorTable {
    address: Option<u16>,
    #[serde(default)]
    network: usize,
    #[serde(deserialize_with = "place")]
    at: [f64; 3],
    #[serde(default, deserialize_with = "optional_board")]
    board: Option<BoardProfile>,
    #[serde(default, deserialize_with = "optional_slowdown")]
    cpu_slowdown: Option<f64>,
    #[serde(default, deserialize_with = "optional_antenna_delay")]
    antenna_delay_ticks: Option<f64>,
}

#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct TagTable {
    address: Option<u16>,
    #[serde(default)]
    network: usize,
    #[serde(deserialize_with = "places")]
    path: Vec<[f64; 3]>,
    #[serde(default = "walking", deserialize_with = "positive")]
    speed_m_s: f64,
    #[serde(default)]
    closed: bool,
    #[serde(default, deserialize_with = "not_negative")]
    leaves_s: f64,
    #[serde(default)]
    carried_by: CarrierName,
    #[serde(default, deserialize_with = "not_negative")]
    vibration_mg: f64,
    motion_sensor: Option<SensorName>,
    #[serde(default, deserialize_with = "optional_board")]
    board: Option<BoardProfile>,
    #[serde(default, deserialize_with = "optional_slowdown")]
    cpu_slowdown: Option<f64>,
    #[serde(default, deserialize_with = "optional_antenna_delay")]
    antenna_delay_ticks: Option<f64>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct FaultTable {
    #[serde(deserialize_with = "not_negative")]
    at_s: f64,
    node: u16,
    what: FaultName,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum FaultName {
    Off,
    On,
    Reset,
}

impl File {
    /// The board of a node that names a board or a slowdown of its own; both replace those of the file.
    fn own_board(&self, board: Option<BoardProfile>, cpu_slowdown: Option<f64>) -> Option<BoardProfile> {
        let differs = board.is_some() || cpu_slowdown.is_some();
        differs.then(|| board.unwrap_or(self.board).slowed(cpu_slowdown.unwrap_or(self.cpu_slowdown)))
    }

    fn scenario(self) -> Result<Scenario, SpanError> {
        let nobody = self.anchor.is_empty() && self.beacon.is_empty();
        if nobody || self.tag.is_empty() {
            let missing = if nobody { "[[anchor]] or [[beacon]]" } else { "[[tag]]" };
            return Err(SpanError { span: 0..0, message: format!("a scenario needs at least one {missing}") });
        }
        let networks = if self.network.is_empty() {
            vec![NETWORK]
        } else {
            self.network
                .iter()
                .map(|table| table.get_ref().network().map_err(|m| wrong(table, m)))
                .collect::<Result<_, _>>()?
        };
        let mut nodes = Nodes { networks: networks.len(), addresses: HashSet::new() };
        let mut anchors = Vec::new();
        for (address, table) in (FIRST_ANCHOR..).zip(&self.anchor) {
            let AnchorTable { address: own, network, at, board, cpu_slowdown, antenna_delay_ticks } = *table.get_ref();
            let address = own.unwrap_or(address);
            nodes.admit(address, network).map_err(|m| wrong(table, m))?;
            let board = self.own_board(board, cpu_slowdown);
            anchors.push(Anchor { address, network, at, board, antenna_delay_ticks });
        }
        let mut tags = Vec::new();
        for (address, table) in (FIRST_TAG..).zip(&self.tag) {
            let tag = table.get_ref().clone();
            let (address, network) = (tag.address.unwrap_or(address), tag.network);
            nodes.admit(address, network).map_err(|m| wrong(table, m))?;
            let walk = Walk::new(tag.path, tag.speed_m_s, tag.closed).map(|walk| walk.leaving_at(tag.leaves_s));
            let walk = walk.ok_or_else(|| wrong(table, "a path needs at least one point".to_owned()))?;
            let motion = Motion {
                carrier: tag.carried_by.into(),
                vibration_mg: tag.vibration_mg,
                sensor: tag.motion_sensor.into(),
            };
            let (board, antenna_delay_ticks) = (self.own_board(tag.board, tag.cpu_slowdown), tag.antenna_delay_ticks);
            tags.push(Tag { address, network, walk, board, antenna_delay_ticks, motion });
        }
        let bluetooth = self.bluetooth.settings();
        let mut beacons = Vec::new();
        for ((address, number), table) in (FIRST_BEACON..).zip(1..).zip(&self.beacon) {
            let address = table.get_ref().address.unwrap_or(address);
            nodes.admit(address, 0).map_err(|m| wrong(table, m))?;
            let beacon = table.get_ref().beacon(address, number, &bluetooth.air);
            beacons.push(beacon.map_err(|m| wrong(table, m))?);
        }
        if let Err((place, message)) = check_list(&beacons) {
            return Err(self
                .beacon
                .get(place)
                .map_or(SpanError { span: 0..0, message: message.clone() }, |t| wrong(t, message)));
        }
        let mut faults = Vec::new();
        for table in &self.fault {
            let FaultTable { at_s, node, what } = *table.get_ref();
            if !nodes.addresses.contains(&node) {
                return Err(wrong(table, format!("node is {node}: no node has this address")));
            }
            let what = match what {
                FaultName::Off => FaultKind::Off,
                FaultName::On => FaultKind::On,
                FaultName::Reset => FaultKind::Reset,
            };
            faults.push(Fault { at_s, node, what });
        }
        faults.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        let scenario = Scenario {
            seconds: self.seconds,
            seed: self.seed,
            loss: self.loss,
            fidelity: match self.fidelity {
                FidelityName::Spi => Fidelity::Spi,
                FidelityName::Air => Fidelity::Air,
            },
            air: match self.air {
                AirName::Recorded => AirModel::Recorded,
                AirName::Ideal => AirModel::Ideal,
            },
            clock_ppm: self.clock_ppm,
            board: self.board.slowed(self.cpu_slowdown),
            tag: TagSettings {
                model: None,
                height_m: self.height_m,
                method: self.method,
                weigh_nlos: self.weigh_nlos,
                rate_hz: self.rate_hz,
                still_rate_hz: self.still_rate_hz,
                sleep: self.sleep,
                scheme: self.scheme,
                anchors_per_round: self.anchors_per_round,
            },
            networks,
            walls: self.wall.iter().map(WallTable::wall).collect(),
            bluetooth,
            beacons,
            anchors,
            tags,
            faults,
        };
        for (anchor, table) in scenario.anchors.iter().zip(&self.anchor) {
            scenario.anchor_record(anchor).validate().map_err(|invalid| wrong(table, invalid.to_string()))?;
        }
        for (tag, table) in scenario.tags.iter().zip(&self.tag) {
            scenario.tag_record(tag).validate().map_err(|invalid| wrong(table, invalid.to_string()))?;
        }
        Ok(scenario)
    }
}

fn wrong<T>(table: &Spanned<T>, message: String) -> SpanError {
    SpanError { span: table.span(), message }
}

/// The nodes that were parsed so far.
struct Nodes {
    networks: usize,
    addresses: HashSet<u16>,
}

impl Nodes {
    fn admit(&mut self, address: u16, network: usize) -> Result<(), String> {
        if network >= self.networks {
            return Err(format!("there is no network {network}: the first is 0, and there are {}", self.networks));
        }
        if address == BROADCAST {
            return Err("the address 65535 is everyone's".to_owned());
        }
        if !self.addresses.insert(address) {
            return Err(format!("two nodes have the address {}", wire::telemetry::Address(address)));
        }
        Ok(())
    }
}

impl WallTable {
    fn wall(&self) -> Wall {
        let material = match self.material {
            MaterialName::Drywall => Material::DRYWALL,
            MaterialName::Wood => Material::WOOD,
            MaterialName::Glass => Material::GLASS,
            MaterialName::Brick => Material::BRICK,
            MaterialName::Concrete => Material::CONCRETE,
            MaterialName::Metal => Material::METAL,
            MaterialName::Body => Material::BODY,
        };
        Wall { from: self.from, to: self.to, material }
    }
}

fn walking() -> f64 {
    WALKING_M_S
}

#[cfg(test)]
mod tests {
    use wire::config::{Mode, Network, Phy};

    use super::*;
    use crate::lis2dh12::Condition;
    use crate::scenario::{BluetoothSettings, Carrier, MotionSensor, distance};

    const LEAST: &str = "[[anchor]]\nat = [0, 0, 2]\n[[tag]]\npath = [[1, 2, 1]]\n";

    fn error(text: &str) -> ScenarioError {
        Scenario::parse(text).unwrap_err()
    }

    #[test]
    fn the_example_with_every_key_is_read() {
        let text = include_str!("../../../../examples/every-key.toml");
        let scenario = Scenario::parse(text).unwrap();
        assert_eq!((scenario.seconds, scenario.seed, scenario.loss, scenario.fidelity), (30.0, 1, 0.1, Fidelity::Spi));
        assert_eq!((scenario.anchors.len(), scenario.tags.len(), scenario.walls.len()), (3, 1, 1));
        assert_eq!(scenario.beacons.len(), 1);
        assert_eq!(scenario.bluetooth, BluetoothSettings::default());
        assert_eq!(scenario.walls[0].material, Material::BRICK);
        let phy = Phy { code: Some(9), ..NETWORK.phy };
        assert_eq!(scenario.networks, [Network { phy, ..NETWORK }]);
        assert_eq!(scenario.board, BoardProfile::DWM1001);
        assert_eq!(scenario.anchors[2].board, Some(BoardProfile::ESP32C3.slowed(4.0)));
        assert_eq!(scenario.tag, TagSettings { height_m: Some(1.2), rate_hz: Some(10.0), ..TagSettings::default() });
        assert_eq!(scenario.anchors.iter().map(|a| a.address).collect::<Vec<_>>(), [1, 2, 3]);
        assert_eq!(scenario.faults, [Fault { at_s: 10.0, node: 2, what: FaultKind::Off }]);
        // 6 m along the first side at 1 m/s, then 1 m along the second.
        assert!(distance(scenario.tags[0].walk.at(7.0), [7.0, 2.0, 1.2]) < 1e-9);
    }

    #[test]
    fn little_is_enough() {
        let scenario = Scenario::parse(LEAST).unwrap();
        assert_eq!((scenario.seconds, scenario.clock_ppm, scenario.tag), (10.0, 20.0, TagSettings::default()));
        assert_eq!(scenario.tags[0].address, 0x1001);
    }

    #[test]
    fn errors_name_their_line() {
        let cases = [
            ("", 1, "a scenario needs at least one [[anchor]] or [[beacon]]"),
            ("seed = 1\nsecond = 3\n", 2, "unknown key second; seconds is near it"),
            ("seconds = -1\n", 1, "seconds is -1: it must be a positive number"),
            ("\nloss = 1.5\n", 2, "loss is 1.5: it must be a probability from 0 to 1"),
            ("method = \"guess\"\n", 1, "method is \"guess\": it must be one of \"track\", \"bounding-box\", "),
            (
                "scheme = \"double\"\n",
                1,
                "scheme is \"double\": it must be one of \"single-sided\", \"double-sided\"; double-sided is near it",
            ),
            ("anchors_per_round = 9\n", 1, "anchors_per_round is 9: it must be from 1 to 8"),
            ("board = \"dwm1000\"\n", 1, "board is \"dwm1000\": it must be one of \"dwm1001\", \"evk1000\", "),
            ("cpu_slowdown = 0\n", 1, "cpu_slowdown is 0: it must be a positive number"),
            ("[[anchor]]\nat = [0, 0]\n", 2, "at is [0, 0]: it must be three numbers, [x, y, z]"),
            ("[[anchor]]\nat = [0, 0, nan]\n", 2, "at is [0, 0, nan]: it must be coordinates within 8388 m"),
            ("[[anchor]]\nat = [0, 9000, 0]\n", 2, "at is [0, 9000, 0]: it must be coordinates"),
            (
                "[[wall]]\nfrom = [0, 0]\nto = [1, 1]\nmaterial = \"paper\"\n",
                4,
                "material is \"paper\": it must be one of \"drywall\", ",
            ),
            ("seed = \n", 1, ""),
            ("seed = 1\n[anchor]\nat = [0, 0, 2]\n", 2, "two brackets"),
        ];
        for (text, line, message) in cases {
            let found = error(text);
            assert_eq!(found.line, line, "{text:?}: {found}");
            assert!(found.message.contains(message) && !found.message.contains('\n'), "{text:?}: {found}");
        }
    }

    #[test]
    fn what_does_not_fit_together_names_the_table_it_is_in() {
        let cases = [
            ("[[anchor]]\nat = [1, 0, 2]\nnetwork = 1\n", 5, "no network 1"),
            ("[[anchor]]\nat = [1, 0, 2]\naddress = 1\n", 5, "two nodes have the address 0x0001"),
            ("[[tag]]\npath = [[0, 0, 0]]\naddress = 65535\n", 5, "everyone"),
            ("[[tag]]\npath = []\n", 5, "at least one point"),
            ("[[fault]]\nat_s = 1\nnode = 77\nwhat = \"off\"\n", 5, "node is 77: no node has this address"),
            ("[[network]]\nevk1000_mode = 9\n", 5, "1 to 8, not 9"),
            ("[[network]]\nevk1000_mode = 5\nchannel = 5\n", 5, "evk1000_mode says it all"),
            ("[[network]]\nchannel = 6\n", 5, "network.phy.channel is 6: it must be 1, 2, 3, 4, 5 or 7"),
            ("[[network]]\nrounds_hz = 6\n", 5, "rounds_hz is for mode"),
            (
                "[[network]]\nrate_kbps = 110\npreamble = 128\n",
                5,
                "network.phy.preamble is 128: it must be 1024 or more at 110 kbit/s",
            ),
            ("[[beacon]]\nat = [0, 0, 2]\nchannels = [37, 40]\n", 5, "37, 38 and 39, not 40"),
            ("[[beacon]]\nat = [0, 0, 2]\nchannels = []\n", 5, "one of 37, 38, 39 at least"),
            ("[[beacon]]\nat = [0, 0, 2]\ninterval_ms = 10\n", 5, "beacon.interval_ms is 10: it must be 20 to 10240"),
            ("[[beacon]]\nat = [0, 0, 2]\naddress = 1\n", 5, "two nodes have the address 0x0001"),
            ("[[beacon]]\nat = [0, 0, 2]\nrssi_1m_dbm = 40\n", 7, "rssi_1m_dbm is 40: it must be a level"),
            (
                "[[network]]\nmode = \"listening\"\nrounds_hz = 0.1\n",
                5,
                "network.rounds_hz is 0.1: it must be 0.13 to 1000",
            ),
            ("[[network]]\ncode = 3\n", 5, "network.phy.code is 3"),
        ];
        for (more, line, message) in cases {
            let found = error(&format!("{LEAST}{more}"));
            assert_eq!(found.line, line, "{more:?}: {found}");
            assert!(found.message.contains(message), "{more:?}: {found}");
        }
    }

    #[test]
    fn boards_and_their_slowdowns_are_read() {
        let text = "board = \"evk1000\"\ncpu_slowdown = 2\n[[anchor]]\nat = [0, 0, 2]\n\
            [[anchor]]\nat = [1, 0, 2]\nboard = \"esp32c6\"\n[[tag]]\npath = [[1, 2, 1]]\ncpu_slowdown = 0.5\n";
        let scenario = Scenario::parse(text).unwrap();
        assert_eq!(scenario.board, BoardProfile::EVB1000.slowed(2.0));
        assert_eq!(scenario.anchors[0].board, None);
        assert_eq!(scenario.anchors[1].board, Some(BoardProfile::ESP32C6.slowed(2.0)));
        assert_eq!(scenario.tags[0].board, Some(BoardProfile::EVB1000.slowed(0.5)));
        let mut slower = scenario;
        slower.slow_down(4.0);
        assert_eq!((slower.board.slowdown, slower.anchors[0].board), (8.0, None));
        assert_eq!(slower.anchors[1].board, Some(BoardProfile::ESP32C6.slowed(8.0)));
        assert_eq!(slower.tags[0].board, Some(BoardProfile::EVB1000.slowed(2.0)));
    }

    #[test]
    fn how_tags_are_moved_and_what_their_sensors_are_worth() {
        let text = "[[anchor]]\nat = [0, 0, 2]\n[[tag]]\npath = [[0, 0, 1], [9, 0, 1]]\nleaves_s = 5\ncarried_by = \"trolley\"\n\
            vibration_mg = 60\nmotion_sensor = \"stuck-high\"\n[[tag]]\npath = [[1, 2, 1]]\nboard = \"esp32c3\"\n";
        let scenario = Scenario::parse(text).unwrap();
        let sensor = MotionSensor::Fitted(Condition::Stuck(true));
        assert_eq!(scenario.tags[0].motion, Motion { carrier: Carrier::Trolley, vibration_mg: 60.0, sensor });
        // At 1 m/s from 5 s on.
        assert!(distance(scenario.tags[0].walk.at(7.0), [2.0, 0.0, 1.0]) < 1e-9);
        assert_eq!(scenario.tags[1].motion, Motion::default());
        let of = |tag: usize| scenario.tags[tag].motion.sensor;
        assert_eq!(of(0).on(&BoardProfile::DWM1001), Some(Condition::Stuck(true)));
        assert_eq!(of(1).on(&BoardProfile::DWM1001.slowed(2.0)), Some(Condition::Works));
        assert_eq!(of(1).on(&BoardProfile::ESP32C3), None);
    }

    #[test]
    fn a_network_to_listen_to() {
        let mode = |more: &str| {
            Scenario::parse(&format!("{LEAST}[[network]]\nmode = \"listening\"\n{more}")).unwrap().networks[0].mode
        };
        assert_eq!(mode(""), Mode::Listening { rounds_chz: 1000 });
        assert_eq!(mode("rounds_hz = 6.25\n"), Mode::Listening { rounds_chz: 625 });
        let by_the_usual_name = Scenario::parse(&format!("{LEAST}[[network]]\nmode = \"tdoa\"\n")).unwrap();
        assert_eq!(by_the_usual_name.networks[0].mode, Mode::Listening { rounds_chz: 1000 });
    }

    #[test]
    fn beacons_and_their_air_are_read() {
        let text = "[bluetooth]\nshadowing_db = 4\nscan_window_ms = 100\n\
            [[beacon]]\nat = [1, 2, 3]\n[[beacon]]\nat = [4, 5, 6]\nminor = 9\nrssi_1m_dbm = -40.4\nchannels = [37, 39]\n\
            listed_at = [0, 0, 0]\n[[beacon]]\nat = [7, 8, 9]\nlisted = false\n[[tag]]\npath = [[1, 2, 1]]\n";
        let scenario = Scenario::parse(text).unwrap();
        assert_eq!((scenario.bluetooth.air.medium.shadowing_db, scenario.bluetooth.air.medium.exponent), (4.0, 2.0));
        assert_eq!((scenario.bluetooth.scan.interval_ms, scenario.bluetooth.scan.window_ms), (1000, 100));
        let [first, second, third] = &scenario.beacons[..] else { panic!("{:?}", scenario.beacons) };
        assert_eq!((first.address, first.name(), first.advertiser.channels), (0x2001, "1-1".to_owned(), 0b111));
        assert_eq!((second.name(), second.advertiser.channels), ("1-9".to_owned(), 0b101));
        assert_eq!(second.advertiser.measured_power_dbm, -40);
        assert_eq!(second.listed.map(|listed| listed.position_m), Some([0.0; 3]));
        assert_eq!(third.listed, None);
    }

    #[test]
    fn faults_happen_in_the_order_of_time() {
        let faults = "[[fault]]\nat_s = 5\nnode = 1\nwhat = \"on\"\n[[fault]]\nat_s = 2\nnode = 1\nwhat = \"off\"\n";
        let scenario = Scenario::parse(&format!("{LEAST}{faults}")).unwrap();
        assert_eq!(scenario.faults.iter().map(|f| f.at_s).collect::<Vec<_>>(), [2.0, 5.0]);
    }
}
