//! The tag on a DWM1001: ranging in an executor above the thread's; engine, motion sensor, Bluetooth, telemetry and supervision in the
//! thread's.
#![no_std]
#![no_main]

use boards::dwm1001::{self, Board, Bus, Delay, Interrupt, Reset};
use boards::node::{self, Guard, Reporter, Tasks};
use embassy_executor::Spawner;
use firmware_common::TagProtocol;
#[cfg(feature = "ble")]
use firmware_tag::LoadedModels;
use firmware_tag::motion::lis2dh12::{Lis2dh12, Sa0Pad};
use firmware_tag::{AnchorPlace, Locator, NlosModelStore, RateControl, TelemetrySink};
use positioning_core::nlos::NodeModel;
use ranging::dw1000::Dw1000;
use static_cell::StaticCell;
use wire::config::{Role, Tag};
use wire::telemetry::Condition;

type Radio = Dw1000<Bus, Interrupt, Reset, Delay>;
type TaskChannels = firmware_tag::TaskChannels<Guard>;

static REPORTER: StaticCell<Reporter> = StaticCell::new();
static CHANNELS: StaticCell<TaskChannels> = StaticCell::new();
static RADIO: StaticCell<Radio> = StaticCell::new();
static MACHINE: StaticCell<TagProtocol> = StaticCell::new();
#[cfg(feature = "ble")]
static RECORD: StaticCell<wire::config::Record> = StaticCell::new();
#[cfg(feature = "ble")]
static SURVEYED: StaticCell<LoadedModels<'static>> = StaticCell::new();
static NLOS_MODEL: NlosModelStore = NlosModelStore::new();
static ANCHORS: StaticCell<heapless::Vec<AnchorPlace, { wire::config::MAX_ANCHORS }>> = StaticCell::new();

/// What the tag's tasks share.
#[derive(Clone, Copy)]
struct Shared {
    channels: &'static TaskChannels,
    reporter: &'static Reporter,
    #[cfg(feature = "ble")]
    record: &'static wire::config::Record,
    #[cfg(feature = "ble")]
    surveyed: &'static LoadedModels<'static>,
    tag: Tag,
    model: Option<&'static NodeModel>,
}

impl Shared {
    fn sink(&self) -> TelemetrySink<'static, Guard, { node::TELEMETRY_BYTES }> {
        TelemetrySink::new(self.reporter, self.tag.report_ranges)
    }
}

#[embassy_executor::task]
async fn ranging(radio: &'static mut Radio, delay: Delay, machine: &'static mut TagProtocol, shared: Shared) {
    firmware_tag::ranging(radio, delay, machine, shared.channels, &shared.sink()).await;
}

#[embassy_executor::task]
async fn engine(shared: Shared, anchors: &'static [AnchorPlace]) {
    #[cfg(feature = "ble")]
    let locator =
        Locator::of(&shared.tag, shared.record, anchors).with_model(shared.model).with_surveyed(shared.surveyed);
    #[cfg(not(feature = "ble"))]
    let locator = Locator::new(shared.tag.height_m, anchors).by(shared.tag.solver).with_model(shared.model);
    let rates = RateControl::of(&shared.tag);
    firmware_tag::engine(shared.channels, embassy_time::Delay, locator, rates, &shared.sink()).await;
}

/// Only where there is a rate for a tag that lies still.
#[embassy_executor::task]
async fn motion(parts: dwm1001::motion::Parts, shared: Shared) {
    let (bus, int1) = parts.into_bus_and_line();
    let sensor = Lis2dh12::new(bus, Sa0Pad::High, int1, embassy_time::Delay);
    firmware_tag::motion::run(shared.channels, sensor, embassy_time::Delay, &shared.sink()).await;
}

#[cfg(feature = "ble")]
mod commanded;

#[cfg(feature = "ble")]
mod bluetooth {
    use boards::dwm1001::bluetooth::{Parts, Scanner};
    use embassy_executor::Spawner;
    use embassy_futures::join::join;
    use firmware_tag::scan;
    use wire::config::Scan;

    use super::Shared;
    use super::commanded::Commanded;

    /// Scans; what is heard goes to the engine.
    #[embassy_executor::task]
    pub async fn scan(spawner: Spawner, parts: Parts, wanted: Scan, shared: Shared) {
        let scanner = match Scanner::start(parts, spawner).await {
            Ok(scanner) => scanner,
            Err(error) => {
                defmt::error!("no Bluetooth, ranging goes on: {}", error);
                return;
            }
        };
        let (channels, sink) = (shared.channels, shared.sink());
        let listening = scanner.listen(|heard| scan::receive(channels, &sink, heard.data, heard.rssi));
        let scanning = scan::run(channels, wanted.into(), Commanded(&scanner), embassy_time::Delay, &sink);
        join(listening, scanning).await;
    }
}

/// Spawns all tasks; without a record to follow, only those that tell so.
fn start(spawner: Spawner) {
    let mut board = Board::take();
    let reporter: &_ = REPORTER.init_with(|| Reporter::new(dwm1001::uptime_us));
    let (hello, followed) = node::introduce(reporter, dwm1001::KIND, wire::telemetry::Role::Tag, board.start);
    let mut tasks = Tasks::None;
    if let Some((record, settings)) = followed {
        match settings.role {
            Role::Tag(tag) => {
                if board.may_rest && tag.sleep {
                    board.delay.rest();
                }
                let uwb = board.uwb;
                let radio =
                    RADIO.init_with(|| Dw1000::new(uwb.bus, uwb.interrupt, uwb.reset, uwb.delay, settings.radio));
                let machine = MACHINE.init_with(|| TagProtocol::new(&settings, &tag));
                let anchors = ANCHORS.init_with(|| firmware_tag::places(&record));
                #[cfg(feature = "ble")]
                let record: &_ = RECORD.init(record);
                let channels: &_ = CHANNELS.init_with(TaskChannels::new);
                let shared = Shared {
                    channels,
                    reporter,
                    #[cfg(feature = "ble")]
                    record,
                    #[cfg(feature = "ble")]
                    surveyed: SURVEYED.init_with(|| {
                        let complain = |condition| reporter.event_log.state(reporter.now_us(), condition);
                        LoadedModels::of(wire::config::decode_models(dwm1001::models()), &record.beacons, complain)
                    }),
                    tag,
                    model: NLOS_MODEL.fill(&mut board.flash, dwm1001::KIND.pages().offsets),
                };
                tasks = Tasks::RangingAndEngine;
                board.ranging.spawn(ranging(radio, board.delay, machine, shared).unwrap());
                spawner.spawn(engine(shared, anchors).unwrap());
                if tag.still_rate_chz.is_some() {
                    spawner.spawn(motion(board.motion, shared).unwrap());
                }
                #[cfg(feature = "ble")]
                if let Some(wanted) = tag.scan {
                    spawner.spawn(bluetooth::scan(spawner, board.bluetooth, wanted, shared).unwrap());
                }
            }
            Role::Anchor { .. } | Role::Advertiser(_) => {
                reporter.event_log.state(reporter.now_us(), Condition::WrongRecord);
            }
        }
    }
    spawner.spawn(dwm1001::supervise(reporter, tasks, board.care).unwrap());
    spawner.spawn(node::keep_telling(reporter, hello).unwrap());
}

#[embassy_executor::main(entry = "boards::cortex::entry")]
async fn main(spawner: Spawner) {
    start(spawner);
}
