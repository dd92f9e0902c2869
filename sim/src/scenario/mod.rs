//! Scenarios: a floor plan, anchors, beacons, tags on their ways, what goes wrong; and whole nodes in them.
//!
//! A scenario comes from a TOML file ([`Scenario::parse`]) or from [`Scenario::rooms`]; a [`Simulation`] of it runs the
//! apps of `firmware-tag`, `firmware-anchor` and `firmware-beacon` as they are: each node starts by its record, as a board does, and what it
//! reports is telemetry, which becomes [`Record`]s beside the truth. Equal scenarios with equal seeds yield
//! equal records.

mod beacon;
mod carrying;
mod config;
mod draw;
mod file;
mod generate;
mod hardware;
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

pub use beacon::{Beacon, BluetoothSettings, Format, SiteModelFiles};
pub use config::{LISTENING, NETWORK};
pub use draw::Charges;
pub use file::ScenarioError;
pub use motion::{Walk, distance};
pub use record::{
    BluetoothSummary, Cover, DifferenceRecord, RangeRecord, Record, SimulatedEpoch, Source, Summary, What,
};
pub use run::Simulation;
pub use survey::{SurveySample, survey};

/// What is simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// For how long, seconds.
    pub seconds: f64,
    /// Seed of everything random.
    pub seed: u64,
    /// Probability that a reception is lost, whatever its power.
    pub loss: f64,
    /// How deep the radios are simulated.
    pub fidelity: Fidelity,
    /// Every crystal is off by something between −this and +this, millionths.
    pub clock_ppm: f64,
    /// The board of nodes that have none of their own.
    pub board: BoardProfile,
    /// What tags do with their ranges.
    pub tag: TagSettings,
    /// The networks, as records have them.
    pub networks: Vec<Network>,
    /// The floor plan.
    pub walls: Vec<Wall>,
    /// The Bluetooth air, and when tags scan; without beacons there is none.
    pub bluetooth: BluetoothSettings,
    /// The beacons.
    pub beacons: Vec<Beacon>,
    /// The anchors.
    pub anchors: Vec<Anchor>,
    /// The tags.
    pub tags: Vec<Tag>,
    /// What goes wrong, in the order of time.
    pub faults: Vec<Fault>,
}

impl Scenario {
    /// Makes every node's processor so many times slower.
    pub fn slow_down(&mut self, times: f64) {
        let own = self.anchors.iter_mut().map(|anchor| &mut anchor.board);
        let own = own.chain(self.tags.iter_mut().map(|tag| &mut tag.board)).flatten();
        for board in own.chain([&mut self.board]) {
            *board = board.slowed(times);
        }
    }
}

/// How deep the radios are simulated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fidelity {
    /// The driver on a register-level chip behind SPI.
    #[default]
    Spi,
    /// A radio straight on the air: for many nodes.
    Air,
}

/// What tags do with their ranges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TagSettings {
    /// The height tags are known to be carried at, metres: positions in the plane. Without it, in space.
    pub height_m: Option<f32>,
    /// How each round is solved by itself; without it, a track is followed.
    pub method: Option<Method>,
    /// Whether a range counts less where its powers, or the classifier, tell of a path that may be blocked.
    pub weigh_nlos: bool,
    /// A trained classifier of line of sight, as a tag has it beside its record; it should be sound.
    pub model: Option<&'static [u8]>,
    /// Rounds a second that a tag wants, or hears; without it, as many as it can get.
    pub rate_hz: Option<f64>,
    /// The same while it lies still; without it, there is no difference.
    pub still_rate_hz: Option<f64>,
    /// Whether its DW1000 sleeps between rounds.
    pub sleep: bool,
    /// How native rounds are made.
    pub scheme: Scheme,
    /// Anchors a round.
    pub anchors_per_round: u8,
}

impl TagSettings {
    /// What makes the positions: `track`, or the method's name.
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
    /// Its network, by place in [`Scenario::networks`].
    pub network: usize,
    /// Where it stands, metres.
    pub at: [f64; 3],
    /// Its board, if it is not that of all.
    pub board: Option<BoardProfile>,
}

/// A tag.
#[derive(Clone, Debug, PartialEq)]
pub struct Tag {
    /// Short address, unique among all nodes.
    pub address: u16,
    /// Its network, by place in [`Scenario::networks`].
    pub network: usize,
    /// Its way.
    pub walk: Walk,
    /// Its board, if it is not that of all.
    pub board: Option<BoardProfile>,
    /// What its motion sensor feels, beside its way.
    pub motion: Motion,
}

/// What a tag's motion sensor feels, and whether there is one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Who moves the tag.
    pub carrier: Carrier,
    /// What it lies on, or is carried in, shakes: standard deviation of each axis, mg.
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
    /// A trolley on a smooth floor, which is pushed off gently.
    Trolley,
}

/// A tag's motion sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MotionSensor {
    /// As its board has it: a DWM1001 has one that works, the others have none.
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

/// Something that goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fault {
    /// When, seconds.
    pub at_s: f64,
    /// Which node, by address.
    pub node: u16,
    /// What.
    pub what: FaultKind,
}

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// The node loses its power.
    Off,
    /// The node has power again.
    On,
    /// The node is reset: off, and on at once.
    Reset,
}
