//! Tag or anchor on an EVB1000, as S1-4 says at the start, without a record if need be; the distance on the display.
#![no_std]
#![no_main]

use boards::evk1000::{self, Board, Bus, Delay, Flash, Interrupt, Reset, SharedPanel, Shown};
use boards::node::{self, Guard, Reporter, Tasks};
use boards::panel::{Awaiting, Panel};
use embassy_executor::{SendSpawner, Spawner};
use firmware_common::{AnchorProtocol, Settings, TagProtocol};
use firmware_tag::{AnchorPlace, Epoch, Locator, NlosModelStore, RateControl, Sink, Task, TelemetrySink};
use positioning_core::nlos::NodeModel;
use ranging::dw1000::Dw1000;
use ranging::exchange::{Event, Link};
use static_cell::StaticCell;
use wire::config::{Record, Role, Tag};
use wire::telemetry::Condition;

type Radio = Dw1000<Bus, Interrupt, Reset, Delay>;
type TaskChannels = firmware_tag::TaskChannels<Guard>;

static REPORTER: StaticCell<Reporter> = StaticCell::new();
static CHANNELS: StaticCell<TaskChannels> = StaticCell::new();
static RADIO: StaticCell<Radio> = StaticCell::new();
static NLOS_MODEL: NlosModelStore = NlosModelStore::new();
static ANCHORS: StaticCell<heapless::Vec<AnchorPlace, { wire::config::MAX_ANCHORS }>> = StaticCell::new();
static TAG: StaticCell<TagProtocol> = StaticCell::new();
static ANCHOR: StaticCell<AnchorProtocol> = StaticCell::new();
static PANEL: StaticCell<SharedPanel> = StaticCell::new();

/// A tag's results, told and shown.
#[derive(Clone, Copy)]
struct TagShown {
    told: TelemetrySink<'static, Guard, { node::TELEMETRY_BYTES }>,
    panel: &'static SharedPanel,
}

impl Sink for TagShown {
    fn now_us(&self) -> u64 {
        self.told.now_us()
    }

    async fn publish(&self, epoch: Epoch<'_>) {
        self.panel.measured(epoch.measured.ranges().iter().map(|range| range.distance_m));
        self.told.publish(epoch).await;
    }

    fn step(&self, event: &Event<'_>) {
        self.told.step(event);
    }

    fn rests(&self, until_us: u64) {
        self.told.rests(until_us);
    }

    fn link(&self, link: Link) {
        self.panel.link(link);
        self.told.link(link);
    }

    fn radio_failed(&self, error: &impl core::fmt::Debug, failures: u32) {
        self.told.radio_failed(error, failures);
    }

    fn round_dropped(&self) {
        self.told.round_dropped();
    }

    fn alive(&self, task: Task) {
        self.told.alive(task);
    }
}

#[embassy_executor::task]
async fn tag_ranging(
    radio: &'static mut Radio,
    machine: &'static mut TagProtocol,
    channels: &'static TaskChannels,
    sink: TagShown,
) {
    firmware_tag::ranging(radio, Delay, machine, channels, &sink).await;
}

#[embassy_executor::task]
async fn engine(
    channels: &'static TaskChannels,
    tag: Tag,
    known: (&'static [AnchorPlace], Option<&'static NodeModel>),
    sink: TagShown,
) {
    let (anchors, model) = known;
    let locator = Locator::new(tag.height_m, anchors).by(tag.solver).with_model(model);
    let rates = RateControl::of(&tag);
    firmware_tag::engine(channels, Delay, locator, rates, &sink).await;
}

#[embassy_executor::task]
async fn anchor_ranging(
    radio: &'static mut Radio,
    machine: &'static mut AnchorProtocol,
    reporter: &'static Reporter,
    panel: &'static SharedPanel,
) {
    let listener = firmware_anchor::TelemetrySink(reporter);
    firmware_anchor::run(radio, Delay, machine, Shown { listener, panel }).await;
}

/// What the tasks of either role have.
struct Parts {
    radio: &'static mut Radio,
    reporter: &'static Reporter,
    panel: &'static SharedPanel,
    flash: Flash,
}

/// Spawns the role's tasks; which have to show that they are alive.
fn spawn(spawner: Spawner, above: SendSpawner, parts: Parts, record: &Record, settings: &Settings) -> Tasks {
    let Parts { radio, reporter, panel, mut flash } = parts;
    match settings.role {
        Role::Tag(tag) => {
            let channels: &_ = CHANNELS.init_with(TaskChannels::new);
            let sink = TagShown { told: TelemetrySink::new(reporter, tag.report_ranges), panel };
            let anchors = ANCHORS.init_with(|| firmware_tag::places(record));
            let model = NLOS_MODEL.fill(&mut flash, evk1000::KIND.pages().offsets);
            let machine = TAG.init_with(|| TagProtocol::new(settings, &tag));
            above.spawn(tag_ranging(radio, machine, channels, sink).unwrap());
            spawner.spawn(engine(channels, tag, (anchors, model), sink).unwrap());
            Tasks::RangingAndEngine
        }
        Role::Anchor { position_m } => {
            let machine = ANCHOR.init_with(|| AnchorProtocol::new(settings, position_m));
            above.spawn(anchor_ranging(radio, machine, reporter, panel).unwrap());
            Tasks::Ranging
        }
        Role::Advertiser(_) => {
            reporter.event_log.state(reporter.now_us(), Condition::WrongRecord);
            Tasks::None
        }
    }
}

/// Spawns all tasks.
fn start(spawner: Spawner) {
    let Board { uwb, switches, mut care, lcd, start, flash, ranging: above, .. } = Board::take();
    let reporter: &_ = REPORTER.init_with(|| Reporter::new(evk1000::uptime_us));
    let (role, awaiting) = if switches.anchor {
        (wire::telemetry::Role::Anchor, Awaiting::Poll)
    } else {
        (wire::telemetry::Role::Tag, Awaiting::Response)
    };
    care.leds.show_role(switches.anchor);
    let panel: &_ = PANEL.init_with(|| SharedPanel::new(Panel::new(awaiting)));
    spawner.spawn(evk1000::display(lcd, panel).unwrap());
    let (hello, followed) = node::introduce(reporter, evk1000::KIND, role, start);
    let mut tasks = Tasks::None;
    if let Some((record, settings)) = followed {
        let radio = RADIO.init_with(|| Dw1000::new(uwb.bus, uwb.interrupt, uwb.reset, uwb.delay, settings.radio));
        tasks = spawn(spawner, above, Parts { radio, reporter, panel, flash }, &record, &settings);
    }
    spawner.spawn(evk1000::supervise(reporter, tasks, care).unwrap());
    spawner.spawn(node::keep_telling(reporter, hello).unwrap());
}

#[embassy_executor::main(entry = "boards::cortex::entry")]
async fn main(spawner: Spawner) {
    start(spawner);
}
