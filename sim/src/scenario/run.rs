//! A scenario put into a world and run.

use std::cell::RefCell;
use std::collections::HashMap;
use std::convert::Infallible;
use std::future::pending;
use std::rc::Rc;
use std::time::Duration;

use embassy_futures::join::{join, join3};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use firmware_common::lines::LinePace;
use firmware_tag::motion;
use firmware_tag::motion::lis2dh12::{Lis2dh12, Sa0Pad};
use firmware_tag::scan::{self, Plan};
use firmware_tag::{AnchorPosition, KnownBeacons, LocatorConfig, RateControl, TaskChannels, site_models};
use positioning_core::Blocked;
use positioning_core::engine::Solvers;
use positioning_core::nlos::Model;
use rand::Rng;
use ranging::Restart;
use ranging::exchange::Protocol;
use ranging::native::{self, ReplyDelay};
use ranging::{RadioDuration, decaranging, dw1000};

use super::beacon::{BeaconNode, listed};
use super::carrying::Feeling;
use super::draw::{Draw, Drawn};
use super::hardware::{Firmware, Hardware, NodePlan};
use super::record::{BluetoothSummary, Record, Summary};
use super::sink::{AnchorSink, Log, Notebook, TagSink};
use super::{Anchor, FaultKind, Fidelity, Mode, Network, Scenario, Tag, TagSettings};
use crate::air::{Path, PortId, Sniffed};
use crate::bluetooth::Bluetooth;
use crate::board::BoardProfile;
use crate::costs::Charged;
use crate::lis2dh12::Sensor;
use crate::random::{Purpose, stream};
use crate::{AirConfig, ClockConfig, Interrupts, Node, Processor, SimDelay, TrueTime, World};

/// Rounds a second of a DecaRanging tag that nobody told.
const DECARANGING_HZ: f64 = 20.0;
/// How often it is looked for tags' first positions, seconds.
const LOOK_S: f64 = 0.1;

/// A scenario that runs.
pub struct Simulation {
    world: World,
    scenario: Rc<Scenario>,
    log: Rc<RefCell<Log>>,
    addresses: HashMap<PortId, u16>,
    nodes: Rc<HashMap<u16, Hardware>>,
    /// Of the tags that have one.
    sensors: Rc<HashMap<u16, Sensor>>,
    bluetooth: Option<Bluetooth>,
    /// What tags had drawn, and how many positions they had, soon after their first.
    settled: HashMap<u16, (Draw, usize)>,
}

impl Simulation {
    /// A scenario at its beginning: all nodes are switched on now.
    pub fn new(scenario: Scenario) -> Self {
        let air = AirConfig { loss: scenario.loss, walls: scenario.walls.clone(), ..AirConfig::default() };
        let world = World::new(scenario.seed, air);
        let scenario = Rc::new(scenario);
        let log: Rc<RefCell<Log>> = Rc::default();
        let notebook = |node| Notebook { world: world.clone(), scenario: scenario.clone(), node, log: log.clone() };
        let settings = &scenario.bluetooth;
        let bluetooth =
            (!scenario.beacons.is_empty()).then(|| Bluetooth::new(&world, settings.air.clone(), &scenario.walls));
        let mut beacons = HashMap::new();
        for beacon in &scenario.beacons {
            if let Some(air) = &bluetooth {
                beacons.insert(beacon.address, BeaconNode::start(&world, air, beacon));
            }
        }
        let known = listed(&scenario.beacons);
        let mut nodes = HashMap::new();
        for anchor in &scenario.anchors {
            let plan = plan(&world, &scenario, anchor.address, Path::Fixed(anchor.at), anchor.network, Role::Anchor);
            let firmware = AnchorFirmware { anchor: anchor.clone(), notebook: notebook(anchor.address) };
            let board = anchor.board.unwrap_or(scenario.board);
            let hardware = Hardware::start(&world, scenario.level, board, plan, firmware);
            nodes.insert(anchor.address, hardware);
        }
        let mut sensors = HashMap::new();
        for tag in &scenario.tags {
            let walk = tag.walk.clone();
            let path = match walk.place() {
                Some(place) => Path::Fixed(place),
                None => Path::Function(Rc::new(move |seconds| walk.at(seconds))),
            };
            let ears = bluetooth.clone().map(|air| Ears {
                air,
                address: tag.address,
                path: path.clone(),
                plan: settings.scan,
                known: known.clone(),
                site_models: settings.site_models.clone(),
            });
            let plan = plan(&world, &scenario, tag.address, path, tag.network, Role::Tag);
            let board = tag.board.unwrap_or(scenario.board);
            let sensor = sensor(&world, tag, &board);
            sensors.extend(sensor.clone().map(|sensor| (tag.address, sensor)));
            let firmware = TagFirmware { tag: tag.clone(), notebook: notebook(tag.address), ears, sensor };
            nodes.insert(tag.address, Hardware::start(&world, scenario.level, board, plan, firmware));
        }
        let addresses = nodes.iter().map(|(&address, node)| (node.port(), address)).collect();
        let (nodes, sensors, beacons) = (Rc::new(nodes), Rc::new(sensors), Rc::new(beacons));
        for &fault in &scenario.faults {
            let (nodes, beacons, notebook) = (nodes.clone(), beacons.clone(), notebook(fault.node));
            let sensors = sensors.clone();
            world.at(TrueTime::from_secs_f64(fault.at_s), move |_| {
                if let Some(node) = nodes.get(&fault.node) {
                    notebook.fault(fault.what);
                    node.suffer(fault.what);
                }
                if let Some(sensor) = sensors.get(&fault.node) {
                    match fault.what {
                        FaultKind::Off => sensor.set_supply(false),
                        FaultKind::On => sensor.set_supply(true),
                        // The processor's: the sensor stays as it is.
                        FaultKind::Reset => {}
                    }
                }
                if let Some(beacon) = beacons.get(&fault.node) {
                    notebook.fault(fault.what);
                    beacon.suffer(fault.what);
                }
            });
        }
        Self { world, scenario, log, addresses, nodes, sensors, bluetooth, settled: HashMap::new() }
    }

    /// The scenario.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Simulated time, seconds.
    pub fn now_s(&self) -> f64 {
        self.world.now().as_secs_f64()
    }

    /// Lets everything happen up to this time, seconds; what happened since the last call.
    pub fn run_until(&mut self, seconds: f64) -> Vec<Record> {
        while self.settled.len() < self.scenario.tags.len() && self.now_s() + LOOK_S < seconds {
            self.world.run_until(TrueTime::from_secs_f64(self.now_s() + LOOK_S));
            self.note_settled();
        }
        self.world.run_until(TrueTime::from_secs_f64(seconds));
        std::mem::take(&mut self.log.borrow_mut().records)
    }

    /// Notes what tags have drawn that have a position.
    fn note_settled(&mut self) {
        let log = self.log.borrow();
        for (&address, &fixes) in &log.fixes {
            if let Some(draw) = self.draw(address) {
                self.settled.entry(address).or_insert((draw, fixes));
            }
        }
    }

    /// What a tag has drawn.
    fn draw(&self, address: u16) -> Option<Draw> {
        let draw = self.nodes.get(&address)?.draw(self.world.now())?;
        Some(draw.with_motion_sensor(self.sensors.get(&address).map_or(0.0, Sensor::drawn_uc)))
    }

    /// What all tags have drawn since they settled.
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

    /// The node of an address: its chip and its processor. `None`: there is no such node, or it has no board.
    pub fn node(&self, address: u16) -> Option<&Node> {
        self.nodes.get(&address).and_then(Hardware::board)
    }

    /// The figures so far.
    pub fn summary(&self) -> Summary {
        let nodes = [self.scenario.tags.len(), self.scenario.anchors.len()];
        let log = self.log.borrow();
        let errors_m = log.errors_m.iter().map(|(_, error_m)| *error_m).collect();
        let of_beacons =
            |air: &Bluetooth| BluetoothSummary::new(self.scenario.beacons.len(), &log.errors_m, air.statistics());
        let summary = Summary::new(nodes, self.now_s(), errors_m, self.world.statistics());
        let summary = summary.with_charge(self.drawn());
        Summary { bluetooth: self.bluetooth.as_ref().map(of_beacons), ..summary }
    }
}

/// The motion sensor of a tag on a board, where there is one.
fn sensor(world: &World, tag: &Tag, board: &BoardProfile) -> Option<Sensor> {
    let condition = tag.motion.sensor.on(board)?;
    let random = stream(world.seed(), Purpose::MotionSensor, tag.address.into());
    let feeling = Feeling::new(tag.walk.clone(), tag.motion.carrier, tag.motion.vibration_mg, random);
    Some(Sensor::new(world, condition, move |seconds| feeling.at(seconds)))
}

/// What a node does.
#[derive(Clone, Copy)]
enum Role {
    Anchor,
    Tag,
}

fn plan(world: &World, scenario: &Scenario, address: u16, path: Path, network: usize, role: Role) -> NodePlan {
    let offset_ppm = world.random(u64::from(address)).random_range(-1.0..=1.0) * scenario.clock_ppm;
    let network = network_of(scenario, network);
    let mut config = dw1000::Config::new(network.phy);
    // Calibrated: simulated chips have this delay at every pulse frequency.
    config.tx_antenna_delay = Some(dw1000::DEFAULT_ANTENNA_DELAY);
    config.rx_antenna_delay = Some(dw1000::DEFAULT_ANTENNA_DELAY);
    config.sleeps = scenario.tag.sleep && matches!(role, Role::Tag);
    match (network.mode, role) {
        (Mode::Native, _) | (Mode::Listening { .. }, Role::Anchor) => {
            config.filter = dw1000::FrameFilter::DATA;
            (config.pan, config.short_address) = (network.pan, address);
        }
        // Answers to others are what there is to hear.
        (Mode::Listening { .. }, Role::Tag) => {}
        // Blinks, and addresses that a tag learns when it is taken: everything is heard.
        (Mode::DecaRanging(_), _) => {}
    }
    NodePlan { path, clock: ClockConfig::crystal(offset_ppm), config }
}

fn network_of(scenario: &Scenario, network: usize) -> Network {
    scenario.networks.get(network).copied().unwrap_or_default()
}

fn native_network(network: &Network) -> native::Network {
    native::Network { pan: network.pan, phy: network.phy, pinned: network.pinned }
}

fn period(hz: f64) -> RadioDuration {
    RadioDuration::from_micros((1e6 / hz) as u32)
}

/// What the driver adds in sending; a radio straight on the air has no antenna delay.
fn antenna_delay(level: Fidelity) -> RadioDuration {
    RadioDuration::from_ticks(match level {
        Fidelity::Spi => i64::from(dw1000::DEFAULT_ANTENNA_DELAY),
        Fidelity::Air => 0,
    })
}

/// The long address of a node.
fn eui(address: u16) -> u64 {
    0xDECA_0000_0000_0000 | u64::from(address)
}

/// How a scenario's tags make positions.
fn locator<'a>(tag: &TagSettings, anchors: &'a [AnchorPosition], model: Option<&'a Model<'a>>) -> LocatorConfig<'a> {
    let mut locator = LocatorConfig::new(tag.height_m, anchors).with_model(model);
    if let Some(method) = tag.method {
        locator = locator.solving(Solvers::of(method));
    }
    if !tag.weigh_nlos {
        locator.settings.engine.filter.blocked = Blocked::Alike;
    }
    locator
}

/// `firmware-anchor` for one node of a scenario.
struct AnchorFirmware {
    anchor: Anchor,
    notebook: Notebook,
}

impl Firmware for AnchorFirmware {
    fn run<R: Restart + 'static>(
        self: Rc<Self>,
        radio: R,
        delay: SimDelay,
        processor: Processor,
    ) -> impl Future<Output = Infallible> + 'static {
        let scenario = &self.notebook.scenario;
        let network = network_of(scenario, self.anchor.network);
        let antenna_delay = antenna_delay(scenario.level);
        let (address, at, sink) = (self.anchor.address, self.anchor.at, AnchorSink(self.notebook.clone()));
        async move {
            let rounds = match network.mode {
                Mode::Native | Mode::DecaRanging(_) => None,
                Mode::Listening { period } => Some(native::Rate::Every(period)),
            };
            match network.mode {
                Mode::Native | Mode::Listening { .. } => {
                    let machine = native::Anchor::new(native::AnchorConfig {
                        address,
                        network: native_network(&network),
                        antenna_delay,
                        position_m: Some(at.map(|metres| metres as f32)),
                        rounds,
                    });
                    let machine = Charged::new(machine, &processor).with_address(address);
                    firmware_anchor::run(radio, delay, machine, sink).await
                }
                // The anchor answers in the tag's variant.
                Mode::DecaRanging(_) => {
                    let machine = decaranging::Anchor::new(decaranging::AnchorConfig {
                        address,
                        eui: eui(address),
                        phy: network.phy,
                        turnaround: ReplyDelay::START,
                        antenna_delay,
                        init_delay: decaranging::INIT_DELAY,
                    });
                    firmware_anchor::run(radio, delay, Charged::new(machine, &processor), sink).await
                }
            }
        }
    }
}

/// `firmware-tag` for one node of a scenario.
struct TagFirmware {
    tag: Tag,
    notebook: Notebook,
    ears: Option<Ears>,
    sensor: Option<Sensor>,
}

/// A tag's Bluetooth.
#[derive(Clone)]
struct Ears {
    air: Bluetooth,
    address: u16,
    path: Path,
    plan: Plan,
    known: Rc<[wire::config::Beacon]>,
    site_models: Option<Rc<[u8]>>,
}

/// Interrupts of a Bluetooth controller while it scans: an assumption. Of each advertisement that comes, the access address, the end
/// and what follows are served, and a timer now and then; with fifty a second, two hundred interrupts of 40 µs.
const SCANNING: Interrupts = Interrupts { per_second: 200.0, each: Duration::from_micros(40) };

/// A scanner whose interrupts go before all else while it is on.
struct Interfering<S> {
    scanner: S,
    world: World,
    processor: Processor,
    address: u16,
}

impl<S> Interfering<S> {
    fn interfere(&self, interrupts: Option<Interrupts>) {
        let random = stream(self.world.seed(), Purpose::Interrupts, self.address.into());
        self.processor.interfere(self.world.now(), interrupts, random);
    }
}

impl<S: scan::Scanner> scan::Scanner for Interfering<S> {
    async fn start(&mut self) {
        self.interfere(Some(SCANNING));
        self.scanner.start().await;
    }

    async fn stop(&mut self) {
        self.interfere(None);
        self.scanner.stop().await;
    }
}

/// A tag's life: ranging, the engine in the background, and where there are beacons the scan beside them, as on a board. The motion sensor
/// runs beside it where there is one that serves a still rate.
async fn live<R: Restart + 'static>(
    radio: R,
    delay: SimDelay,
    machine: impl Protocol,
    (locator, rates): (LocatorConfig<'_>, RateControl),
    sink: TagSink,
    (ears, sensor): (Option<Ears>, Option<Sensor>),
) -> Infallible {
    let processor = sink.processor.clone();
    let background = delay.for_background();
    let (channels, sink) = (Rc::new(TaskChannels::<NoopRawMutex>::new()), Rc::new(sink));
    let motion = async {
        if let Some(sensor) = sensor {
            let (twi, int1) = (sensor.twi(&processor), sensor.int1(&processor));
            let sensor = Lis2dh12::new(twi, Sa0Pad::High, int1, background.clone());
            motion::run(&channels, sensor, background.clone(), &*sink).await;
        }
        pending::<Infallible>().await
    };
    let life = tag_tasks(radio, delay, machine, (locator, rates), (&channels, &sink), ears);
    join(life, motion).await.0
}

async fn tag_tasks<R: Restart + 'static>(
    radio: R,
    delay: SimDelay,
    machine: impl Protocol,
    (locator, rates): (LocatorConfig<'_>, RateControl),
    (channels, sink): (&Rc<TaskChannels<NoopRawMutex>>, &Rc<TagSink>),
    ears: Option<Ears>,
) -> Infallible {
    let processor = sink.processor.clone();
    let background = delay.for_background();
    let Some(Ears { air, address, path, plan, known, site_models: region }) = ears else {
        let ranging = firmware_tag::ranging(radio, delay, machine, channels, &**sink);
        return join(ranging, firmware_tag::engine(channels, background, locator, rates, &**sink)).await.0;
    };
    let world = sink.notebook.world.clone();
    let scanner = {
        let (channels, sink) = (channels.clone(), sink.clone());
        air.scanner(address, path, move |data, rssi_dbm| scan::receive(&channels, &*sink, data, rssi_dbm))
    };
    let scanner = Interfering { scanner, world, processor, address };
    let models = region.as_deref().map_or(Err(wire::config::LoadError::Missing), wire::config::decode_models);
    let models = site_models(models, &known, |condition| sink.unused(condition));
    let locator = locator.with_beacons(KnownBeacons::new(&known, None)).with_site_models(&models);
    let ranging = firmware_tag::ranging(radio, delay, machine, channels, &**sink);
    let engine = firmware_tag::engine(channels, background.clone(), locator, rates, &**sink);
    join3(ranging, engine, scan::run(channels, plan, scanner, background, &**sink)).await.0
}

impl Firmware for TagFirmware {
    fn run<R: Restart + 'static>(
        self: Rc<Self>,
        radio: R,
        delay: SimDelay,
        processor: Processor,
    ) -> impl Future<Output = Infallible> + 'static {
        let scenario = self.notebook.scenario.clone();
        let network = network_of(&scenario, self.tag.network);
        let settings = scenario.tag;
        let (address, ears, sensor) = (self.tag.address, self.ears.clone(), self.sensor.clone());
        let (notebook, walk) = (self.notebook.clone(), self.tag.walk.clone());
        let sink = TagSink { notebook, walk, processor, lines: RefCell::new(LinePace::new()) };
        async move {
            let model = settings.model.and_then(|bytes| Model::decode(bytes).ok()).map(|(model, _)| model);
            let model = model.as_ref();
            match network.mode {
                Mode::Native => {
                    let rate = match settings.rate_hz {
                        Some(hz) => native::Rate::Every(period(hz)),
                        None => native::Rate::Greedy,
                    };
                    let still = settings.still_rate_hz.map(|hz| native::Rate::Every(period(hz)));
                    let mut machine = native::Tag::new(native::TagConfig {
                        address,
                        network: native_network(&network),
                        anchors: settings.anchors_per_round,
                        rate,
                        scheme: settings.scheme,
                        tell_distances: false,
                    });
                    if settings.sleep {
                        machine.doze();
                    }
                    let machine = Charged::new(machine, &sink.processor).with_address(address);
                    // Native anchors tell where they are.
                    let locator = locator(&settings, &[], model);
                    let sensor = sensor.filter(|_| still.is_some());
                    live(radio, delay, machine, (locator, RateControl::new(rate, still)), sink, (ears, sensor)).await
                }
                Mode::Listening { .. } => {
                    let period = settings.rate_hz.map(period);
                    let network = native_network(&network);
                    let machine = native::TdoaTag::new(native::TdoaTagConfig { network, period });
                    let machine = Charged::new(machine, &sink.processor);
                    let rate = period.map_or(native::Rate::Greedy, native::Rate::Every);
                    let locator = locator(&settings, &[], model);
                    live(radio, delay, machine, (locator, RateControl::new(rate, None)), sink, (ears, None)).await
                }
                Mode::DecaRanging(variant) => {
                    let period = period(settings.rate_hz.unwrap_or(DECARANGING_HZ));
                    let machine = decaranging::Tag::new(decaranging::TagConfig {
                        eui: eui(address),
                        variant,
                        phy: network.phy,
                        turnaround: ReplyDelay::START,
                        antenna_delay: antenna_delay(scenario.level),
                        period,
                    });
                    let machine = Charged::new(machine, &sink.processor);
                    let places = scenario.anchors.iter().map(|anchor| AnchorPosition {
                        address: anchor.address,
                        position_m: anchor.at.map(|metres| metres as f32),
                    });
                    let places: Vec<_> = places.collect();
                    let locator = locator(&settings, &places, model);
                    let rates = RateControl::new(native::Rate::Every(period), None);
                    live(radio, delay, machine, (locator, rates), sink, (ears, None)).await
                }
            }
        }
    }
}
