//! Scenarios: a floor plan, anchors, beacons, tags on their paths, and faults; and whole nodes that run in them.
//!
//! A scenario comes from a site's file ([`Scenario::parse`], crate `site`) or from [`Scenario::rooms`]. A [`Simulation`] runs it with
//! the unchanged apps of `firmware-tag`, `firmware-anchor`, `firmware-beacon` and `firmware-scanner`. Each node starts with its config
//! record, as a board does, and reports telemetry, which becomes [`Record`]s beside the true values. Equal scenarios
//! with equal seeds yield equal records.

mod air;
mod airtime;
mod attacker;
mod beacon;
mod beacon_survey;
mod bluetooth_node;
mod carrying;
mod config;
mod default_walk;
mod downlink;
mod draw;
mod generate;
mod hardware;
mod inspection;
mod motion;
mod node;
mod of_site;
mod record;
mod run;
mod scanning;
mod tag_advertiser;
mod telemetry;
mod uplink;

use std::sync::Arc;

use positioning_core::Method;
use wire::config::{Network, PollContent, Scheme, Solver};

use crate::air::Wall;
use crate::bluetooth::BluetoothConfig;
use crate::board::BoardProfile;
use crate::lis2dh12;

pub use attacker::Attacker;
pub use beacon::Beacon;
pub use beacon_survey::{SurveySample, survey};
pub use draw::Charges;
pub use inspection::{Inspection, StepObserver};
pub use motion::{Walk, distance};
pub use record::{
    BluetoothSummary, Cover, DifferenceRecord, RangeRecord, Record, SimulatedEpoch, Source, Summary, Unrounded, What,
};
pub use run::Simulation;
pub use scanning::Scanner;
pub use site::{AirModel, Carrier, FaultKind, Fidelity, Format, LISTENING, SIMULATED_NETWORK as NETWORK};

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
    /// The method by which each round is solved by itself. Without it, positions are made as tags' records say.
    pub method: Option<Method>,
    /// Whether a range has less weight if its powers, or the classifier, say that its path may be blocked.
    pub weigh_nlos: bool,
    /// The networks, as config records have them.
    pub networks: Vec<Network>,
    /// The key of the beacons' rotating identifiers.
    pub beacon_key: Option<[u8; 16]>,
    /// The floor plan.
    pub walls: Vec<Wall>,
    /// The Bluetooth air. Without beacons there is none.
    pub bluetooth: BluetoothConfig,
    /// The beacons.
    pub beacons: Vec<Beacon>,
    /// The scanners, which receive the beacons.
    pub scanners: Vec<Scanner>,
    /// The anchors.
    pub anchors: Vec<Anchor>,
    /// What tags are told of anchors that do not send their positions, or send wrong ones.
    pub listed_anchors: Vec<wire::config::Anchor>,
    /// The tags.
    pub tags: Vec<Tag>,
    /// The faults, in the order of time.
    pub faults: Vec<Fault>,
    /// The attackers.
    pub attackers: Vec<Attacker>,
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

    /// Whether a host reads what a node reports: where anchors are gateways, or scanners are there, only those and nodes with
    /// Wi-Fi have one.
    pub fn has_host(&self, address: u16) -> bool {
        let gateways = self.anchors.iter().filter(|anchor| anchor.gateway).map(|anchor| anchor.address);
        let mut with_host = gateways.chain(self.scanners.iter().map(|scanner| scanner.address)).peekable();
        with_host.peek().is_none() || with_host.any(|known| known == address) || self.has_wifi(address)
    }

    /// Whether a node has Wi-Fi.
    pub fn has_wifi(&self, address: u16) -> bool {
        self.anchors.iter().any(|anchor| anchor.wifi && anchor.address == address)
            || self.tags.iter().any(|tag| tag.wifi && tag.address == address)
    }

    /// Changes what the records of all tags say.
    pub fn change_tags(&mut self, change: impl Fn(&mut wire::config::Tag)) {
        self.tags.iter_mut().for_each(|tag| change(&mut tag.settings.record));
    }

    /// How the positions of a tag are computed: `track`, or the method's name.
    pub fn method_name(&self, tag: &Tag) -> &'static str {
        self.method.map_or(tag.settings.record.solver.name(), Method::as_str)
    }

    /// The known height at which all tags are carried, metres; `None`: tags do not know theirs, or have different ones.
    pub fn height_m(&self) -> Option<f32> {
        let mut heights = self.tags.iter().map(|tag| tag.settings.record.height_m);
        let first = heights.next()?;
        first.filter(|_| heights.all(|other| other == first))
    }
}

/// What a tag has in its flash.
#[derive(Clone, Debug, PartialEq)]
pub struct TagSettings {
    /// What its config record says of a tag.
    pub record: wire::config::Tag,
    /// A trained line-of-sight classifier, as a tag has it beside its config record. It should be valid.
    pub model: Option<Arc<[u8]>>,
    /// The models of the beacons' RSSI (`wire::config::decode_models`), for the beacons in its list. They should be
    /// valid.
    pub site_models: Option<Arc<[u8]>>,
}

impl Default for TagSettings {
    /// A tag that keeps a track in space, of as many single-sided rounds as it can get, of eight anchors.
    fn default() -> Self {
        let record = wire::config::Tag {
            height_m: None,
            rate_chz: None,
            still_rate_chz: None,
            sleep: false,
            anchors_per_round: 8,
            tells: PollContent::Nothing,
            scan: None,
            report_ranges: true,
            solver: Solver::Track,
            scheme: Some(Scheme::SingleSided),
            height_sigma_m: 0.0,
            area: None,
        };
        Self { record, model: None, site_models: None }
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
    /// Whether it reaches a host, by a cable or by Wi-Fi: see [`Scenario::has_host`].
    pub gateway: bool,
    /// Whether it has Wi-Fi, whose interrupts are charged.
    pub wifi: bool,
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
    /// What it has in its flash.
    pub settings: TagSettings,
    /// Whether it blinks instead of ranging.
    pub blinks: bool,
    /// Whether it has Wi-Fi, whose interrupts are charged.
    pub wifi: bool,
    /// Its path.
    pub walk: Walk,
    /// Its board, if it is not the default board.
    pub board: Option<BoardProfile>,
    /// The true antenna delay, as [`Anchor::antenna_delay_ticks`].
    pub antenna_delay_ticks: Option<f64>,
    /// What its motion sensor measures, besides the motion along its path.
    pub motion: Motion,
    /// How often its user sends data, seconds; `None`: never.
    pub data_every_s: Option<f64>,
    /// How often a host sends it a message, seconds; `None`: never.
    pub messages_every_s: Option<f64>,
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
