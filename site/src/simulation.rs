//! `[simulation]` and the table `simulation` of a node: what only a simulation has.

use std::fmt;

use positioning_core::Method;
use serde::Deserialize;
use serde::de::{Deserializer, Visitor};
use toml::Spanned;
use wire::config::{Board, Network};

use crate::document::{Document, KeyLines, SiteError, choice};
use crate::network::{NetworkTable, SIMULATED_NETWORK};
use crate::values::{
    antenna_delay, clock_offset, count, decibels, method, not_negative, path, position, positive, probability, rssi,
    slowdown,
};

/// What is simulated besides the site.
#[derive(Clone, Debug)]
pub struct Simulation {
    /// The simulated time, seconds.
    pub seconds: f64,
    /// Seed of everything random.
    pub seed: u64,
    /// Probability that a reception is lost, at any power.
    pub loss: f64,
    /// How detailed the simulation of the radios is.
    pub fidelity: Fidelity,
    /// How the air treats ranges.
    pub air: AirModel,
    /// The maximum error of the crystals, parts per million.
    pub clock_ppm: f64,
    /// The board of nodes that name none.
    pub board: SimulatedBoard,
    /// How many times slower than estimated processors are.
    pub cpu_slowdown: f64,
    /// The method by which each round is solved by itself; `None`: as tags' records say.
    pub method: Option<Method>,
    /// Whether a range has less weight if its powers say that its path may be blocked.
    pub weigh_nlos: bool,
    /// The neighbouring networks.
    pub networks: Vec<Network>,
    /// The floor plan.
    pub walls: Vec<Wall>,
    /// The faults with the numbers of their lines, in the order of the file.
    pub faults: Vec<(Fault, u64)>,
    /// The attackers.
    pub attackers: Vec<Attacker>,
    /// The Bluetooth air.
    pub bluetooth: Bluetooth,
}

/// `[[simulation.attacker]]`: it knows all of a network but its key, and sends recorded, changed and forged frames.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Attacker {
    /// Where it is, metres.
    #[serde(deserialize_with = "position")]
    pub position_m: [f64; 3],
    /// The network that it attacks: 0 is the site's own, 1 the first neighbour.
    #[serde(default)]
    pub network: usize,
    /// How many frames it sends for each of the network's.
    #[serde(default = "as_many", deserialize_with = "positive")]
    pub rate: f64,
    /// When it comes, seconds.
    #[serde(default = "soon", deserialize_with = "not_negative")]
    pub from_s: f64,
}

const fn as_many() -> f64 {
    1.0
}

const fn soon() -> f64 {
    5.0
}

/// What a node runs on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SimulatedBoard {
    /// A real board.
    Hardware(Board),
    /// A processor that takes no time.
    Instant,
}

impl SimulatedBoard {
    /// Its name in the file.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hardware(board) => board.name(),
            Self::Instant => "instant",
        }
    }
}

/// How detailed the simulation of the radios is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fidelity {
    /// The driver on a register-level chip behind SPI.
    #[default]
    Spi,
    /// A radio directly on the air, for many nodes.
    Air,
}

/// How the air treats ranges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AirModel {
    /// With the errors of recordings in line of sight: links err by as much at each visit of a position, some are too
    /// long by decimetres, antennas and bodies turn, and anchors are surveyed to centimetres.
    #[default]
    Recorded,
    /// Only white noise, and the published bias by power. Anchors are where they are said to be.
    Ideal,
}

/// `[[simulation.wall]]`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wall {
    /// One end, metres.
    #[serde(deserialize_with = "position")]
    pub from_m: [f64; 2],
    /// The other end, metres.
    #[serde(deserialize_with = "position")]
    pub to_m: [f64; 2],
    /// What it is made of.
    pub material: Material,
}

/// What a wall is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "they are materials")]
pub enum Material {
    Drywall,
    Wood,
    Glass,
    Brick,
    Concrete,
    Metal,
    Body,
}

/// `[[simulation.fault]]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// The time of the fault, seconds.
    #[serde(deserialize_with = "not_negative")]
    pub at_s: f64,
    /// The name of the node, or its address in decimal digits.
    #[serde(deserialize_with = "name_or_address")]
    pub node: String,
    /// The kind of the fault.
    pub what: FaultKind,
}

/// The kind of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FaultKind {
    /// The node loses its power.
    Off,
    /// The node has power again.
    On,
    /// The node is reset: off, and on at once.
    Reset,
}

/// `[simulation.bluetooth]`: the air of beacons, where it differs from the simulation's default.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Bluetooth {
    /// The path-loss exponent.
    #[serde(deserialize_with = "positive")]
    pub path_loss_exponent: Option<f64>,
    /// The deviation of what stays with the position, dB.
    #[serde(deserialize_with = "not_negative")]
    pub shadowing_db: Option<f64>,
    /// The correlation length of that, metres.
    #[serde(deserialize_with = "positive")]
    pub shadowing_m: Option<f64>,
    /// The deviation of each channel within centimetres, dB.
    #[serde(deserialize_with = "not_negative")]
    pub fading_db: Option<f64>,
    /// The RSSI at which three in ten advertisements are lost, dBm.
    #[serde(deserialize_with = "rssi")]
    pub sensitivity_dbm: Option<f64>,
    /// How much too high tags read an RSSI, dB.
    #[serde(deserialize_with = "decibels")]
    pub receiver_offset_db: Option<f64>,
    /// The probability that a reception is lost.
    #[serde(deserialize_with = "probability")]
    pub loss: Option<f64>,
    /// The probability that a controller does not know an RSSI.
    #[serde(deserialize_with = "probability")]
    pub unknown_rssi: Option<f64>,
    /// What the controller reports then.
    pub unknown_rssi_dbm: Option<i8>,
}

/// The table `simulation` of a node.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NodeSimulation {
    /// How many tags like this one there are, with consecutive addresses.
    #[serde(deserialize_with = "count")]
    pub count: u16,
    /// The node's network: 0 is the site's own, 1 the first neighbour.
    pub network: usize,
    /// Whether an anchor has a cable to a host. If none has, all have.
    pub gateway: bool,
    /// How often a tag's user sends 24 bytes, seconds; `None`: never.
    #[serde(deserialize_with = "positive")]
    pub data_every_s: Option<f64>,
    /// How often a host sends a tag 24 bytes, seconds; `None`: never.
    #[serde(deserialize_with = "positive")]
    pub messages_every_s: Option<f64>,
    /// How many times slower than estimated its processor is; `None`: as all.
    #[serde(deserialize_with = "slowdown")]
    pub cpu_slowdown: Option<f64>,
    /// The delay between chip and antenna, ticks in each direction, which the record does not have.
    #[serde(deserialize_with = "antenna_delay")]
    pub true_antenna_delay_ticks: Option<f64>,
    /// The points of a tag's path, metres; `None`: a walk among the anchors.
    #[serde(deserialize_with = "path")]
    pub path_m: Option<Vec<[f64; 3]>>,
    /// The speed along the path.
    #[serde(deserialize_with = "positive")]
    pub speed_m_s: f64,
    /// Whether the tag goes round again, or stays at the last point.
    pub closed: bool,
    /// When the tag leaves the first point, seconds.
    #[serde(deserialize_with = "not_negative")]
    pub leaves_s: f64,
    /// Who moves the tag.
    pub carried_by: Carrier,
    /// The vibration of what the tag lies on, standard deviation on each axis, mg.
    #[serde(deserialize_with = "not_negative")]
    pub vibration_mg: f64,
    /// The tag's motion sensor; `None`: as on its board.
    pub motion_sensor: Option<Sensor>,
    /// The true RSSI of a beacon at 1 m in line of sight, dBm; `None`: the advertised one.
    #[serde(deserialize_with = "rssi")]
    pub rssi_1m_dbm: Option<f64>,
    /// The format of a beacon's advertisements.
    pub format: Format,
    /// Whether tags are told of the beacon.
    pub listed: bool,
}

impl Default for NodeSimulation {
    fn default() -> Self {
        Self {
            count: 1,
            network: 0,
            gateway: false,
            data_every_s: None,
            messages_every_s: None,
            cpu_slowdown: None,
            true_antenna_delay_ticks: None,
            path_m: None,
            speed_m_s: 1.0,
            closed: false,
            leaves_s: 0.0,
            carried_by: Carrier::Person,
            vibration_mg: 0.0,
            motion_sensor: None,
            rssi_1m_dbm: None,
            format: Format::Ibeacon,
            listed: true,
        }
    }
}

/// Who moves a tag.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Carrier {
    /// A person who walks.
    #[default]
    Person,
    /// A trolley on a smooth floor that is accelerated gently.
    Trolley,
}

/// The condition of a motion sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sensor {
    /// It works.
    Works,
    /// There is none.
    None,
    /// It does not answer.
    Silent,
    /// It holds the bus.
    Hung,
    /// Another chip answers.
    Foreign,
    /// Its line is always high.
    StuckHigh,
    /// Its line is always low.
    StuckLow,
}

/// The format of a beacon's advertisements.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// As the app sends it.
    Ibeacon,
    /// As a beacon of another maker sends it.
    EddystoneUid,
    /// As a broken beacon sends it.
    Malformed,
}

/// `[simulation]`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct SimulationTable {
    #[serde(deserialize_with = "positive")]
    seconds: f64,
    seed: u64,
    #[serde(deserialize_with = "probability")]
    loss: f64,
    fidelity: Fidelity,
    air: AirModel,
    #[serde(deserialize_with = "clock_offset")]
    clock_ppm: f64,
    #[serde(deserialize_with = "board")]
    board: SimulatedBoard,
    #[serde(deserialize_with = "slowdown")]
    cpu_slowdown: f64,
    #[serde(deserialize_with = "method")]
    method: Option<Method>,
    weigh_nlos: bool,
    network: Vec<Spanned<NetworkTable>>,
    wall: Vec<Wall>,
    fault: Vec<Spanned<Fault>>,
    attacker: Vec<Attacker>,
    bluetooth: Bluetooth,
}

impl Default for SimulationTable {
    fn default() -> Self {
        Self {
            seconds: 10.0,
            seed: 1,
            loss: 0.0,
            fidelity: Fidelity::Spi,
            air: AirModel::Recorded,
            clock_ppm: 20.0,
            board: SimulatedBoard::Hardware(Board::Dwm1001),
            cpu_slowdown: 1.0,
            method: None,
            weigh_nlos: true,
            network: Vec::new(),
            wall: Vec::new(),
            fault: Vec::new(),
            attacker: Vec::new(),
            bluetooth: Bluetooth::default(),
        }
    }
}

impl SimulationTable {
    pub(crate) fn simulation(self, document: Document<'_>) -> Result<Simulation, SiteError> {
        let networks = self.network.into_iter().map(|table| {
            let (table, line) = document.with_line(table);
            table.network(SIMULATED_NETWORK, &KeyLines { line, ..KeyLines::default() })
        });
        Ok(Simulation {
            seconds: self.seconds,
            seed: self.seed,
            loss: self.loss,
            fidelity: self.fidelity,
            air: self.air,
            clock_ppm: self.clock_ppm,
            board: self.board,
            cpu_slowdown: self.cpu_slowdown,
            method: self.method,
            weigh_nlos: self.weigh_nlos,
            networks: networks.collect::<Result<_, _>>()?,
            walls: self.wall,
            faults: self.fault.into_iter().map(|fault| document.with_line(fault)).collect(),
            attackers: self.attacker,
            bluetooth: self.bluetooth,
        })
    }
}

fn board<'de, D: Deserializer<'de>>(from: D) -> Result<SimulatedBoard, D::Error> {
    let hardware = Board::HARDWARE.into_iter().map(SimulatedBoard::Hardware);
    choice(from, &hardware.chain([SimulatedBoard::Instant]).collect::<Vec<_>>(), SimulatedBoard::name)
}

/// A node's name, or its address.
fn name_or_address<'de, D: Deserializer<'de>>(from: D) -> Result<String, D::Error> {
    struct Either;

    impl Visitor<'_> for Either {
        type Value = String;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("the name of a node in quotation marks, or its address")
        }

        fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<String, E> {
            Ok(name.to_owned())
        }

        fn visit_i64<E: serde::de::Error>(self, address: i64) -> Result<String, E> {
            Ok(address.to_string())
        }
    }

    from.deserialize_any(Either)
}
