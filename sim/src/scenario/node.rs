//! A scenario's nodes: the apps of tag and anchor, started with their config records as on a board. Each step takes
//! processor time.

use std::cell::RefCell;
use std::convert::Infallible;
use std::future::pending;
use std::rc::Rc;

use embassy_futures::join::{join, join3};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embedded_hal_async::delay::DelayNs;
use firmware_common::lines::LinePace;
use firmware_common::settings::{Cipher, ProtocolConfig};
use firmware_common::{AnchorProtocol, Settings, Start, TagProtocol, introduce};
use firmware_tag::advertise;
use firmware_tag::motion;
use firmware_tag::motion::lis2dh12::{Lis2dh12, Sa0Pad};
use firmware_tag::scan;
use firmware_tag::{LISTED, LocatorConfig, Observer, RateControl, TaskChannels, TelemetrySink, site_models};
use positioning_core::Blocked;
use positioning_core::engine::Solvers;
use positioning_core::nlos::Model;
use rand::Rng;
use ranging::PhyConfig;
use ranging::Restart;
use ranging::native::AnchorTables;
use ranging::radio::Config;
use wire::config::{LoadError, MAX_BYTES, PollContent, Record, Role};
use wire::telemetry::{Board, Condition, Hello, ResetCause};
use wire::uwb::native::software_code;

use super::config::eui;
use super::downlink::content;
use super::hardware::{Firmware, NodePlan};
use super::inspection::{Inspected, Inspection};
use super::tag_advertiser::TagAdvertiser;
use super::telemetry::{Outlet, Reporter};
use super::{Anchor, Scenario, Tag};
use crate::air::Path;
use crate::bluetooth::Bluetooth;
use crate::costs::{Charged, Costs, counted_code};
use crate::lis2dh12::Sensor;
use crate::random::{Purpose, stream};
use crate::{ClockConfig, Interrupts, Processor, SimDelay, World};

/// In how many polls a user asks that data go.
const DATA_POLLS: u8 = 2;

/// What every node has: its flash, and the sink of its telemetry.
struct App {
    world: World,
    scenario: Rc<Scenario>,
    address: u16,
    /// The page of flash with its config record.
    page: Vec<u8>,
    outlet: Rc<Outlet>,
}

impl App {
    fn new(world: &World, scenario: &Rc<Scenario>, address: u16, record: &Record, outlet: Rc<Outlet>) -> Self {
        let page = wire::config::encode(record, 0, &mut [0; MAX_BYTES]).to_vec();
        Self { world: world.clone(), scenario: scenario.clone(), address, page, outlet }
    }

    fn is_attacked(&self) -> bool {
        !self.scenario.attackers.is_empty()
    }

    fn record(&self) -> Result<Record, LoadError> {
        wire::config::decode(&self.page).map(|(record, _)| record)
    }

    /// Starts the interrupts of Wi-Fi, if the node has it. They have the highest priority.
    fn join_wifi(&self, processor: &Processor) {
        if self.scenario.has_wifi(self.address) {
            let random = stream(self.world.seed(), Purpose::Interrupts, self.address.into());
            processor.interfere(self.world.now(), Some(processor.board().wifi), random);
        }
    }

    /// As a board draws it at each start.
    fn cipher(&self) -> Cipher {
        let drawn: u64 = stream(self.world.seed(), Purpose::Keys, self.address.into()).random();
        Cipher { seed: drawn ^ self.world.now().as_ps(), make_code: counted_code }
    }

    fn plan(&self) -> NodePlan {
        let offset_ppm = self.world.random(u64::from(self.address)).random_range(-1.0..=1.0) * self.scenario.clock_ppm;
        let settings = self
            .record()
            .and_then(|of| Settings::of(&of, eui(self.address), self.cipher()).map_err(LoadError::Invalid));
        // A node whose record cannot be followed starts no radio.
        let config = settings.map_or(Config::new(PhyConfig::FAST), |settings| settings.radio);
        NodePlan { clock: ClockConfig::crystal(offset_ppm), config }
    }

    fn start(&self, reporter: &Reporter, role: wire::telemetry::Role) -> (Hello, Option<(Record, Settings)>) {
        let eui = eui(self.address);
        let start =
            Start { record: self.record(), eui, reset: ResetCause::PowerOn, crash: None, cipher: self.cipher() };
        introduce(reporter, Board::Simulated, role, start)
    }
}

/// The record is for another role.
async fn quiet(reporter: &Reporter) -> Infallible {
    reporter.event_log.state(reporter.now_us(), Condition::WrongRecord);
    pending().await
}

/// `firmware-anchor` for one node of a scenario.
pub(super) struct AnchorApp(App);

impl AnchorApp {
    pub(super) fn new(world: &World, scenario: &Rc<Scenario>, anchor: &Anchor, outlet: Rc<Outlet>) -> Self {
        Self(App::new(world, scenario, anchor.address, &scenario.anchor_record(anchor), outlet))
    }
}

impl Firmware for AnchorApp {
    fn plan(&self) -> NodePlan {
        self.0.plan()
    }

    fn run<R: Restart + 'static>(
        self: Rc<Self>,
        radio: R,
        delay: SimDelay,
        processor: Processor,
    ) -> impl Future<Output = Infallible> + 'static {
        let reporter = self.0.outlet.boot(Some(processor.clone()));
        self.0.join_wifi(&processor);
        async move {
            let (hello, followed) = self.0.start(&reporter, wire::telemetry::Role::Anchor);
            let ranging = async {
                let Some((_, settings)) = followed else { return pending().await };
                let Role::Anchor { position_m } = settings.role else { return quiet(&reporter).await };
                let machine =
                    Charged::new(AnchorProtocol::new(&settings, position_m, AnchorTables::default()), &processor);
                let machine = if self.0.is_attacked() { machine.seen(self.0.outlet.judge()) } else { machine };
                let machine = match settings.protocol {
                    ProtocolConfig::Native | ProtocolConfig::Listening { .. } => machine.with_address(settings.address),
                    ProtocolConfig::DecaRanging(_) => machine,
                };
                firmware_anchor::run(radio, delay, machine, firmware_anchor::TelemetrySink(&reporter)).await
            };
            join(ranging, reporter.keep_telling(hello, self.0.world.delay())).await.0
        }
    }
}

/// `firmware-tag` for one node of a scenario.
pub(super) struct TagApp {
    app: App,
    tag: Tag,
    ears: Option<Ears>,
    sensor: Option<Sensor>,
    inspection: Inspection,
}

/// A tag's Bluetooth.
pub(super) struct Ears {
    pub(super) air: Bluetooth,
    pub(super) path: Path,
}

impl TagApp {
    pub(super) fn new(
        world: &World,
        scenario: &Rc<Scenario>,
        tag: &Tag,
        outlet: Rc<Outlet>,
        (ears, sensor): (Option<Ears>, Option<Sensor>),
        inspection: &Inspection,
    ) -> Self {
        let app = App::new(world, scenario, tag.address, &scenario.tag_record(tag), outlet);
        Self { app, tag: tag.clone(), ears, sensor, inspection: inspection.clone() }
    }
}

/// A scanner whose interrupts have the highest priority while it is on.
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
        self.interfere(Some(self.processor.board().scanning));
        self.scanner.start().await;
    }

    async fn stop(&mut self) {
        self.interfere(None);
        self.scanner.stop().await;
    }
}

/// Observes a tag's reports: it notes the tag's true position, and charges the time that computing and reporting a
/// position takes.
struct Charging<'a> {
    tag: &'a TagApp,
    reporter: &'a Reporter,
    processor: &'a Processor,
    /// Selects the positions that a board would log.
    lines: RefCell<LinePace>,
}

impl Observer for &Charging<'_> {
    async fn epoch(&self, epoch: &firmware_tag::RoundOutcome<'_>) {
        let App { world, scenario, outlet, .. } = &self.tag.app;
        // The tag moves a few millimetres during the ranges of a round. This is the true position at the end of the
        // round.
        let truth_m = self.tag.tag.walk.at(world.now().as_secs_f64());
        outlet.note_truth(epoch, truth_m);
        // In the simulation the position was computed in zero time. Its cost is awaited here, before the position is
        // reported.
        let costs = &Costs::of(self.processor.board().core).tag;
        let (tag, track) = (&self.tag.tag, wire::config::Solver::Track.name());
        let (tracks, space) = (scenario.method_name(tag) == track, tag.settings.record.height_m.is_none());
        let measured = epoch.measured.count();
        let round = costs.round(tracks, space, measured);
        self.processor.background(world, round + costs.publish_range * measured as u32).await;
        if self.lines.borrow_mut().is_due(self.reporter.now_us()) {
            // `defmt` writes a line in one critical section.
            self.processor.locked(world, costs.line).await;
        }
    }

    fn sighting(&self) {
        self.processor.charge_background(Costs::of(self.processor.board().core).tag.advert);
    }
}

/// A tag's locator with the settings that only a scenario has: methods that no node has, and powers that are ignored.
fn adapted<'a>(locator: LocatorConfig<'a>, scenario: &Scenario) -> LocatorConfig<'a> {
    let other = scenario.method.filter(|method| method.as_str() != locator.solver.name());
    let mut locator = match other {
        Some(method) => locator.solving(Solvers::of(method)),
        None => locator,
    };
    if !scenario.weigh_nlos {
        locator.settings.engine.filter.blocked = Blocked::Alike;
    }
    locator
}

impl TagApp {
    /// The tasks of a tag: ranging, the engine in the background and, if there are beacons, the scan beside them, as on
    /// a board. The motion sensor runs beside them if there is one that is used for a still rate.
    async fn live<R: Restart>(
        &self,
        (radio, delay, processor): (R, SimDelay, &Processor),
        (record, settings): (&Record, &Settings),
        tag: &wire::config::Tag,
        reporter: &Rc<Reporter>,
    ) -> Infallible {
        let App { scenario, world, address, .. } = &self.app;
        let background = delay.for_background();
        let machine = Charged::new(TagProtocol::new(settings, tag), processor);
        let machine = if self.app.is_attacked() { machine.seen(self.app.outlet.judge()) } else { machine };
        let machine = match settings.protocol {
            ProtocolConfig::Native => machine.with_address(settings.address),
            ProtocolConfig::DecaRanging(_) | ProtocolConfig::Listening { .. } => machine,
        };
        let machine = Inspected::new(machine, *address, &self.inspection);
        let model =
            self.tag.settings.model.as_deref().and_then(|bytes| Model::decode(bytes).ok()).map(|(model, _)| model);
        let anchors = firmware_tag::anchor_positions(record);
        let mut locator = adapted(LocatorConfig::of(tag, record, &anchors), scenario).with_model(model.as_ref());
        (self.inspection.tune)(&mut locator.settings.engine);
        let models = self.tag.settings.site_models.as_deref();
        let models = models.map_or(Err(LoadError::Missing), wire::config::decode_models);
        let complain = |condition| reporter.event_log.state(reporter.now_us(), condition);
        let surveyed = tag.scan.map(|_| site_models(models, &record.beacons, complain));
        let locator = match &surveyed {
            Some(surveyed) => locator.with_site_models(surveyed),
            None => locator,
        };
        let charging = Charging { tag: self, reporter, processor, lines: RefCell::new(LinePace::new()) };
        let sink = TelemetrySink::new(reporter, tag.report_ranges).with_observer(&charging);
        let channels = Rc::new(TaskChannels::<NoopRawMutex>::new());
        let ranging = firmware_tag::ranging(radio, delay, machine, &channels, &sink);
        let engine =
            firmware_tag::engine::<LISTED, _>(&channels, background.clone(), locator, RateControl::of(tag), &sink);
        let scan = async {
            let (Some(plan), Some(Ears { air, path })) = (tag.scan, &self.ears) else { return pending().await };
            let scanner = {
                let (channels, reporter) = (channels.clone(), reporter.clone());
                let hear = move |data: &[u8], rssi_dbm| {
                    scan::receive(&channels, &TelemetrySink::new(&reporter, false), data, rssi_dbm);
                };
                air.scanner(*address, path.clone(), hear)
            };
            let (world, processor, address) = (world.clone(), processor.clone(), *address);
            let scanner = Interfering { scanner, world, processor, address };
            scan::run(&channels, plan.into(), scanner, background.clone(), &sink).await
        };
        let advertising = async {
            let (PollContent::Advertised, Some(Ears { air, path })) = (tag.tells, &self.ears) else {
                return pending().await;
            };
            let radio = TagAdvertiser::new((world, air), *address, path.clone(), (processor, &self.app.outlet));
            let sender = advertise::Sender::new(record, settings.address, software_code);
            advertise::run(&channels, sender, radio, background.clone()).await
        };
        let motion = async {
            if let Some(sensor) = self.sensor.as_ref().filter(|_| tag.still_rate_chz.is_some()) {
                let (twi, int1) = (sensor.twi(processor), sensor.int1(processor));
                let sensor = Lis2dh12::new(twi, Sa0Pad::High, int1, background.clone());
                motion::run(&channels, sensor, background.clone(), &sink).await;
            }
            pending::<Infallible>().await
        };
        let user = join(self.send_data(&channels), self.take_messages(&channels));
        join3(join3(ranging, engine, scan), join(motion, advertising), user).await.0.0
    }
}

impl TagApp {
    /// The user's task: data whose bytes are their number and its complement, in turn.
    async fn send_data(&self, channels: &TaskChannels<NoopRawMutex>) -> Infallible {
        let Some(every_s) = self.tag.data_every_s else { return pending().await };
        let mut number = 0_u8;
        loop {
            self.app.world.delay().delay_ms((every_s * 1e3).max(1.0) as u32).await;
            let taken = channels.send(&content(number), DATA_POLLS).ok();
            self.app.outlet.sends_data(taken);
            number = number.wrapping_add(taken.is_some().into());
        }
    }
}

impl TagApp {
    /// The user's task: takes messages, which are those that hosts send.
    async fn take_messages(&self, channels: &TaskChannels<NoopRawMutex>) -> Infallible {
        if self.tag.messages_every_s.is_none() {
            return pending().await;
        }
        loop {
            let data = channels.next_message().await;
            let is_whole = data.bytes().first().is_some_and(|&number| data.bytes() == content(number));
            assert!(is_whole, "a message was changed on its way: {data:?}");
        }
    }
}

impl Firmware for TagApp {
    fn plan(&self) -> NodePlan {
        self.app.plan()
    }

    fn run<R: Restart + 'static>(
        self: Rc<Self>,
        radio: R,
        delay: SimDelay,
        processor: Processor,
    ) -> impl Future<Output = Infallible> + 'static {
        let reporter = self.app.outlet.boot(Some(processor.clone()));
        self.app.join_wifi(&processor);
        async move {
            let (hello, followed) = self.app.start(&reporter, wire::telemetry::Role::Tag);
            let life = async {
                let Some((record, settings)) = followed else { return pending().await };
                let Role::Tag(tag) = settings.role else { return quiet(&reporter).await };
                self.live((radio, delay, &processor), (&record, &settings), &tag, &reporter).await
            };
            join(life, reporter.keep_telling(hello, self.app.world.delay())).await.0
        }
    }
}
