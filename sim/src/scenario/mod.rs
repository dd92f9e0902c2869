//! Scenarios: a floor plan, anchors, beacons, tags on their paths, and faults; and whole nodes that run in them.
//!
//! A scenario comes from a TOML file ([`Scenario::parse`]) or from [`Scenario::rooms`]. A [`Simulation`] runs it with
//! the unchanged apps of `firmware-tag`, `firmware-anchor` and `firmware-beacon`. Each node starts with its config
//! record, as a board does, and reports telemetry, which becomes [`Record`]s beside the true values. Equal scenarios
//! with equal seeds yield equal records.

mod air;
mod airtime;
mod beacon;
mod carrying;
mod config;
mod draw;
mod file;
mod generate;
mod hardware;
mod inspection;
mod motion;
mod node;
mod record;
mod run;
mod survey;
mod telemetry;

use positioning_core::Method;
use ranging::native::Scheme;
use wire::config::Network;

use crate::air::Wall;
use crate::board::BoardProfile;
use crate::lis2dh12;

pub use air::AirModel;
pub use beacon::{Beacon, BluetoothSettings, Format, SiteModelFiles};
pub use config::{LISTENING, NETWORK};
pub use draw::Charges;
pub use file::ScenarioError;
pub use inspection::{Inspection, StepObserver};
pub use motion::{Walk, distance};
pub use record::{
    BluetoothSummary, Cover, DifferenceRecord, RangeRecord, Record, SimulatedEpoch, Source, Summary, What,
};
pub use run::Simulation;
pub use survey::{SurveySample, survey};

/// What is simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
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
    /// The maximum error of the crystals, parts per million. Each crystal has an error between −this and +this.
    pub clock_ppm: f64,
    /// The board of nodes that name no board.
    pub board: BoardProfile,
    /// What tags do with their ranges.
    pub tag: TagSettings,
    /// The networks, as config records have them.
    pub networks: Vec<Network>,
    /// The floor plan.
    pub walls: Vec<Wall>,
    /// The Bluetooth air, and when tags scan. Without beacons there is none.
    pub bluetooth: BluetoothSettings,
    /// The beacons.
    pub beacons: Vec<Beacon>,
    /// The anchors.
    pub anchors: Vec<Anchor>,
    /// The tags.
    pub tags: Vec<Tag>,
    /// The faults, in the order of time.
    pub faults: Vec<Fault>,
}

impl Scenario {
    /// Makes every node's processor `times` times slower.
    pub fn slow_down(&mut self, times: f64) {
        let own = self.anchors.iter_mut().map(|anchor| &mut anchor.board);
        let own = own.chain(self.tags.iter_mut().map(|tag| &mut tag.board)).flatten();
        for board in own.chain([&mut self.board]) {
            *board = board.slowed(times);
        }
    }
}

/// How detailed the simulation of the radios is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fidelity {
    /// The driver on a register-level chip behind SPI.
    #[default]
    Spi,
    /// A radio directly on the air, for many nodes.
    Air,
}

/// What tags do with their ranges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TagSettings {
    /// The known height at which tags are carried, metres: positions are in the plane. Without it, positions are in
    /// space.
    pub height_m: Option<f32>,
    /// The method by which each round is solved by itself. Without it, a track is kept.
    pub method: Option<Method>,
    /// Whether a range has less weight if its powers, or the classifier, say that its path may be blocked.
    pub weigh_nlos: bool,
    /// A trained line-of-sight classifier, as a tag has it beside its config record. It should be valid.
    pub model: Option<&'static [u8]>,
    /// Rounds per second that a tag requests or listens to. Without it, as many as it can get.
    pub rate_hz: Option<f64>,
    /// The same while the tag lies still. Without it, there is no difference.
    pub still_rate_hz: Option<f64>,
    /// Whether its DW1000 sleeps between rounds.
    pub sleep: bool,
    /// How native rounds are made.
    pub scheme: Scheme,
    /// Anchors per round.
    pub anchors_per_round: u8,
}

impl TagSettings {
    /// How the positions are computed: `track`, or the method's name.
    pub fn method_name(&self) -> &'static str {
        self.method.map_or("track", Method::as_str)
    }
}

impl Default for TagSettings {
    fn default() -> Self {
        Self {
            height_m: None,
            method: None,
            weigh_nlos: true,
            model: None,
            rate_hz: None,
            still_rate_hz: None,
            sleep: false,
            scheme: Scheme::SingleSided,
            anchors_per_round: 8,
        }
    }
}

/// An anchor.
#[derive(Clone, Debug, PartialEq)]
pub struct Anchor {
    /// Short address, unique among all nodes.
    pub address: u16,
    /// The index of its network in [`Scenario::networks`].
    pub network: usize,
    /// Its true position, metres. Its config record has [`Scenario::surveyed_m`].
    pub at: [f64; 3],
    /// Its board, if it is not the default board.
    pub board: Option<BoardProfile>,
    /// The true delay between its chip and its antenna, ticks in each direction, which its record does not have; if it
    /// is not the default. [`Fidelity::Air`] has none.
    pub antenna_delay_ticks: Option<f64>,
}

/// A tag.
#[derive(Clone, Debug, PartialEq)]
pub struct Tag {
    /// Short address, unique among all nodes.
    pub address: u16,
    /// The index of its network in [`Scenario::networks`].
    pub network: usize,
    /// Its path.
    pub walk: Walk,
    /// Its board, if it is not the default board.
    pub board: Option<BoardProfile>,
    /// The true antenna delay, as [`Anchor::antenna_delay_ticks`].
    pub antenna_delay_ticks: Option<f64>,
    /// What its motion sensor measures, besides the motion along its path.
    pub motion: Motion,
}

/// What a tag's motion sensor measures, and whether there is one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Who moves the tag.
    pub carrier: Carrier,
    /// The vibration of the surface that the tag lies on or is carried in: standard deviation on each axis, mg.
    pub vibration_mg: f64,
    /// The sensor.
    pub sensor: MotionSensor,
}

/// Who moves a tag.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Carrier {
    /// A person who walks.
    #[default]
    Person,
    /// A trolley on a smooth floor that is accelerated gently.
    Trolley,
}

/// A tag's motion sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MotionSensor {
    /// As on its board: a DWM1001 has a sensor that works, the other boards have none.
    #[default]
    OfBoard,
    /// There is none.
    Absent,
    /// There is one in this condition.
    Fitted(lis2dh12::Condition),
}

impl MotionSensor {
    /// The condition of the sensor on a board; `None`: there is none.
    pub fn on(self, board: &BoardProfile) -> Option<lis2dh12::Condition> {
        match self {
            Self::OfBoard => (board.name == BoardProfile::DWM1001.name).then_some(lis2dh12::Condition::Works),
            Self::Absent => None,
            Self::Fitted(condition) => Some(condition),
        }
    }
}

/// A fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fault {
    /// The time of the fault, seconds.
    pub at_s: f64,
    /// The address of the node.
    pub node: u16,
    /// The kind of the fault.
    pub what: FaultKind,
}

/// The kind of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// The node loses its power.
    Off,
    /// The node has power again.
    On,
    /// The node is reset: off, and on at once.
    Reset,
}
