//! A scenario that is put into a world and run.

use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::rc::Rc;

use super::airtime::Airtime;
use super::attacker;
use super::bluetooth_node::BluetoothNode;
use super::tag_advertiser;
use wire::config::PollContent;
use wire::uwb::native::Downlink;

use super::carrying::Feeling;
use super::downlink::Sender;
use super::draw::{Draw, Drawn};
use super::hardware::Hardware;
use super::node::{AnchorApp, Ears, TagApp};
use super::record::{BluetoothSummary, Record, Summary};
use super::telemetry::{Log, Outlet};
use super::{FaultKind, Inspection, Scenario, Tag, beacon, scanning};
use crate::air::{Path, PortId, Sniffed};
use crate::bluetooth::Bluetooth;
use crate::board::BoardProfile;
use crate::lis2dh12::Sensor;
use crate::random::{Purpose, stream};
use crate::{Node, TrueTime, World};

/// The interval of the check for tags' first positions, seconds.
const LOOK_S: f64 = 0.1;
/// The interval at which telemetry is taken from the nodes, seconds, as boards take it from their queues.
const DRAIN_S: f64 = 0.01;

/// A scenario that runs.
pub struct Simulation {
    world: World,
    scenario: Rc<Scenario>,
    log: Rc<RefCell<Log>>,
    outlets: Rc<BTreeMap<u16, Rc<Outlet>>>,
    addresses: HashMap<PortId, u16>,
    nodes: Rc<HashMap<u16, Hardware>>,
    /// The sensors of the tags that have one.
    sensors: Rc<HashMap<u16, Sensor>>,
    bluetooth: Option<Bluetooth>,
    airtime: Airtime,
    /// For each tag, soon after its first position: the charge drawn and the number of positions.
    settled: HashMap<u16, (Draw, usize)>,
}

/// Starts the nodes that only have Bluetooth.
fn on_bluetooth(
    world: &World,
    scenario: &Scenario,
    air: Option<&Bluetooth>,
    outlet: &mut dyn FnMut((u16, bool)) -> Rc<Outlet>,
) -> HashMap<u16, BluetoothNode> {
    let Some(air) = air else { return HashMap::new() };
    let (around, key) = ((world, air), scenario.beacon_key);
    let mut nodes = HashMap::new();
    for beacon in &scenario.beacons {
        nodes.insert(beacon.address, beacon::start(around, beacon, key, outlet((beacon.address, false))));
    }
    for scanner in &scenario.scanners {
        let record = scenario.scanner_record(scanner);
        nodes.insert(scanner.address, scanning::start(around, scanner, record, outlet((scanner.address, false))));
    }
    nodes
}

impl Simulation {
    /// A scenario at its beginning: all nodes are switched on now.
    pub fn new(scenario: Scenario) -> Self {
        Self::inspected(scenario, &Inspection::none())
    }

    /// The same, with a look into its tags.
    pub fn inspected(scenario: Scenario, inspection: &Inspection) -> Self {
        let world = World::new(scenario.seed, scenario.air_config());
        let scenario = Rc::new(scenario);
        let log: Rc<RefCell<Log>> = Rc::default();
        for anchor in &scenario.anchors {
            log.borrow_mut().blinks.set_anchor(anchor.address, scenario.surveyed_m(anchor));
        }
        for tag in &scenario.tags {
            log.borrow_mut().blinks.set_height(tag.address, tag.settings.record.height_m);
        }
        log.borrow_mut().sender = Sender::of(&scenario);
        let advertises = |tag: &Tag| tag.settings.record.tells == PollContent::Advertised;
        let is_used =
            !(scenario.beacons.is_empty() && scenario.scanners.is_empty()) || scenario.tags.iter().any(advertises);
        let bluetooth = is_used.then(|| Bluetooth::new(&world, scenario.bluetooth.clone(), &scenario.walls));
        let mut outlets = BTreeMap::new();
        let mut outlet =
            |of: (u16, bool)| outlets.entry(of.0).or_insert(Outlet::new(of, &world, &scenario, &log)).clone();
        let on_bluetooth = on_bluetooth(&world, &scenario, bluetooth.as_ref(), &mut outlet);
        let mut nodes = HashMap::new();
        for anchor in &scenario.anchors {
            let app = AnchorApp::new(&world, &scenario, anchor, outlet((anchor.address, false)));
            let board = anchor.board.unwrap_or(scenario.board);
            let hardware = Hardware::start(
                &world,
                scenario.fidelity,
                board,
                (Path::Fixed(anchor.at), anchor.antenna_delay_ticks),
                app,
            );
            nodes.insert(anchor.address, hardware);
        }
        let mut sensors = HashMap::new();
        for tag in &scenario.tags {
            let walk = tag.walk.clone();
            let path = match walk.place() {
                Some(place) => Path::Fixed(place),
                None => Path::Function(Rc::new(move |seconds| walk.at(seconds))),
            };
            let ears = bluetooth.clone().map(|air| Ears { air, path: path.clone() });
            let board = tag.board.unwrap_or(scenario.board);
            let sensor = sensor(&world, tag, &board);
            sensors.extend(sensor.clone().map(|sensor| (tag.address, sensor)));
            let outlet = outlet((tag.address, tag.tells_position()));
            let app = TagApp::new(&world, &scenario, tag, outlet, (ears, sensor), inspection);
            let hardware = Hardware::start(&world, scenario.fidelity, board, (path, tag.antenna_delay_ticks), app);
            if tag.is_worn() {
                world.air().wear(hardware.port());
            }
            nodes.insert(tag.address, hardware);
        }
        let addresses = nodes.iter().map(|(&address, node)| (node.port(), address)).collect();
        let of_anchors = scenario.anchors.iter().map(|anchor| (anchor.address, anchor.network));
        let members = of_anchors.chain(scenario.tags.iter().map(|tag| (tag.address, tag.network)));
        let port = |address: u16| nodes.get(&address).map(Hardware::port);
        let airtime =
            Airtime::of(&world, members.filter_map(|(address, network)| Some((port(address)?, network))).collect());
        for attacker in scenario.attackers.iter().enumerate() {
            attacker::start(&world, &scenario, attacker, &log.borrow().attack);
        }
        let (nodes, sensors, outlets) = (Rc::new(nodes), Rc::new(sensors), Rc::new(outlets));
        let simulation = Self {
            world,
            scenario,
            log,
            outlets,
            addresses,
            nodes,
            sensors,
            bluetooth,
            airtime,
            settled: HashMap::new(),
        };
        simulation.schedule_faults(&Rc::new(on_bluetooth));
        simulation
    }

    /// Lets the faults happen at their times.
    fn schedule_faults(&self, on_bluetooth: &Rc<HashMap<u16, BluetoothNode>>) {
        for &fault in &self.scenario.faults {
            let (nodes, on_bluetooth, outlets) = (self.nodes.clone(), on_bluetooth.clone(), self.outlets.clone());
            let sensors = self.sensors.clone();
            self.world.at(TrueTime::from_secs_f64(fault.at_s), move |_| {
                if let Some(outlet) = outlets.get(&fault.node) {
                    outlet.fault(fault.what);
                }
                if let Some(node) = nodes.get(&fault.node) {
                    node.suffer(fault.what);
                }
                if let Some(sensor) = sensors.get(&fault.node) {
                    match fault.what {
                        FaultKind::Off => sensor.set_supply(false),
                        FaultKind::On => sensor.set_supply(true),
                        // A reset of the processor leaves the sensor as it is.
                        FaultKind::Reset => {}
                    }
                }
                if let Some(node) = on_bluetooth.get(&fault.node) {
                    node.suffer(fault.what);
                }
            });
        }
    }

    /// The scenario.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Simulated time, seconds.
    pub fn now_s(&self) -> f64 {
        self.world.now().as_secs_f64()
    }

    /// Runs the world up to this time, seconds, and returns what happened since the last call.
    pub fn run_until(&mut self, seconds: f64) -> Vec<Record> {
        while self.settled.len() < self.scenario.tags.len() && self.now_s() + LOOK_S < seconds {
            self.run_and_drain(self.now_s() + LOOK_S);
            self.note_settled();
        }
        self.run_and_drain(seconds);
        self.log.borrow_mut().take()
    }

    /// Runs the world up to this time, seconds, and takes the nodes' telemetry.
    fn run_and_drain(&self, seconds: f64) {
        loop {
            let next_s = seconds.min(self.now_s() + DRAIN_S);
            self.world.run_until(TrueTime::from_secs_f64(next_s));
            self.outlets.values().for_each(|outlet| outlet.drain());
            let due = self.log.borrow_mut().sender.due(next_s);
            if let Some(message) = due {
                // A tag's own cable is no way through the air.
                let of_anchors = self.scenario.anchors.iter().filter_map(|anchor| self.outlets.get(&anchor.address));
                of_anchors.for_each(|outlet| outlet.tell(message));
            }
            let solved = self.log.borrow_mut().blinks.advance(next_s);
            for solved in solved {
                if let Some(outlet) = self.outlets.get(&solved.tag) {
                    outlet.blinked(&solved);
                }
            }
            if next_s >= seconds {
                return;
            }
        }
    }

    /// All nodes with a host get a host's message to a tag.
    pub fn tell(&self, message: Downlink) {
        self.outlets.values().for_each(|outlet| outlet.tell(message));
    }

    /// Notes the charge drawn by each tag that has a position.
    fn note_settled(&mut self) {
        let log = self.log.borrow();
        for (&address, &fixes) in &log.fixes {
            if let Some(draw) = self.draw(address) {
                self.settled.entry(address).or_insert((draw, fixes));
            }
        }
    }

    /// The charge that a tag has drawn.
    fn draw(&self, address: u16) -> Option<Draw> {
        let draw = self.nodes.get(&address)?.draw(self.world.now())?;
        let motion_sensor = self.sensors.get(&address).map_or(0.0, Sensor::drawn_uc);
        let advertised = self.outlets.get(&address).map_or(0, |outlet| outlet.advertised.get());
        Some(draw.with(motion_sensor, f64::from(advertised) * tag_advertiser::ADVERTISEMENT_UC))
    }

    /// The charge that all tags have drawn since their first positions.
    fn drawn(&self) -> Option<Drawn> {
        let log = self.log.borrow();
        self.scenario.tags.iter().try_fold(Drawn::default(), |drawn, tag| {
            let draw = self.draw(tag.address)?;
            let (earlier, before) = self.settled.get(&tag.address).copied().unzip();
            let fixes = log.fixes.get(&tag.address).copied().unwrap_or(0) - before.unwrap_or(0);
            Some(drawn.plus(draw.since(earlier), fixes))
        })
    }

    /// Calls `sniffer` for each frame on the air, in the order of time.
    pub fn sniff(&self, sniffer: impl FnMut(&Sniffed) + 'static) {
        self.world.sniff(sniffer);
    }

    /// The node that sends on a port.
    pub fn address(&self, port: PortId) -> Option<u16> {
        self.addresses.get(&port).copied()
    }

    /// The node with an address: its chip and its processor. `None` if there is no such node, or if it has no board.
    pub fn node(&self, address: u16) -> Option<&Node> {
        self.nodes.get(&address).and_then(Hardware::board)
    }

    /// The figures up to now.
    pub fn summary(&self) -> Summary {
        let nodes = [self.scenario.tags.len(), self.scenario.anchors.len()];
        let log = self.log.borrow();
        let of_beacons =
            |air: &Bluetooth| BluetoothSummary::new(self.scenario.beacons.len(), &log.errors, air.statistics());
        let summary = Summary::new(
            nodes,
            self.now_s(),
            &log.errors,
            self.world.statistics(),
            &self.airtime.shares(self.world.now()),
        );
        let joined = self.scenario.tags.iter().filter_map(|tag| {
            let at_s = *log.joined_s.get(&tag.address)?;
            let rate_hz = tag.settings.record.rate_chz.map(|rate_chz| f64::from(rate_chz) / 100.0);
            Some((at_s, rate_hz, log.fixes.get(&tag.address).copied().unwrap_or(0)))
        });
        let summary = summary.with_joined(&joined.collect::<Vec<_>>()).with_charge(self.drawn());
        let (uplink_share, uplink_p99_s) = log.uplink.figures().unzip();
        let uplink_p99_s = uplink_p99_s.flatten();
        let (message_share, message_p99_s) = log.sender.figures().unzip();
        let message_p99_s = message_p99_s.flatten();
        let (data_share, bluetooth) = (log.uplink.data_share(), self.bluetooth.as_ref().map(of_beacons));
        let forged = (!self.scenario.attackers.is_empty()).then(|| log.attack.figures());
        let (forged_frames, forged_accepted) = forged.unzip();
        Summary {
            uplink_share,
            uplink_p99_s,
            data_share,
            message_share,
            message_p99_s,
            forged_frames,
            forged_accepted,
            bluetooth,
            ..summary
        }
    }
}

/// The motion sensor of a tag on a board, if there is one.
fn sensor(world: &World, tag: &Tag, board: &BoardProfile) -> Option<Sensor> {
    let condition = tag.motion.sensor.on(board)?;
    let random = stream(world.seed(), Purpose::MotionSensor, tag.address.into());
    let feeling = Feeling::new(tag.walk.clone(), tag.motion.carrier, tag.motion.vibration_mg, random);
    Some(Sensor::new(world, condition, move |seconds| feeling.at(seconds)))
}
