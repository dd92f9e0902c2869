//! The tag on a chip of Espressif: ranging in a thread above all others; engine, Bluetooth scan, telemetry and supervision in the
//! main one.

use boards::esp::{self, Board, Bus, Interrupt, Reset, Uwb};
use boards::node::{self, Guard, Reporter, Tasks};
use embassy_executor::Spawner;
use embassy_time::Delay;
use firmware_common::{Settings, TagProtocol};
#[cfg(feature = "ble")]
use firmware_tag::LoadedModels;
use firmware_tag::{AnchorPlace, Locator, NlosModelStore, RateControl, TelemetrySink};
use positioning_core::nlos::NodeModel;
use ranging::dw1000::Dw1000;
#[cfg(feature = "ble")]
use static_cell::ConstStaticCell;
use static_cell::StaticCell;
use wire::config::{Record, Role, Tag};
use wire::telemetry::{Condition, RecordError};

type Radio = Dw1000<Bus, Interrupt, Reset, Delay>;
type TaskChannels = firmware_tag::TaskChannels<Guard>;

static REPORTER: StaticCell<Reporter> = StaticCell::new();
static CHANNELS: StaticCell<TaskChannels> = StaticCell::new();
static RADIO: StaticCell<Radio> = StaticCell::new();
static MACHINE: StaticCell<TagProtocol> = StaticCell::new();
static RECORD: StaticCell<Record> = StaticCell::new();
static NLOS_MODEL: NlosModelStore = NlosModelStore::new();
static ANCHORS: StaticCell<heapless::Vec<AnchorPlace, { wire::config::MAX_ANCHORS }>> = StaticCell::new();

/// The flash is not in the processor's memory: what it has of beacons' levels is copied, once.
#[cfg(feature = "ble")]
static MODELS: ConstStaticCell<[u8; wire::config::MODELS_BYTES]> =
    ConstStaticCell::new([0; wire::config::MODELS_BYTES]);

#[cfg(feature = "ble")]
static SURVEYED: StaticCell<LoadedModels<'static>> = StaticCell::new();

/// What the tag's tasks share.
#[derive(Clone, Copy)]
struct Shared {
    channels: &'static TaskChannels,
    reporter: &'static Reporter,
    record: &'static Record,
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
async fn ranging(radio: &'static mut Radio, machine: &'static mut TagProtocol, shared: Shared) {
    firmware_tag::ranging(radio, Delay, machine, shared.channels, &shared.sink()).await;
}

#[embassy_executor::task]
async fn engine(shared: Shared, anchors: &'static [AnchorPlace]) {
    let locator = Locator::of(&shared.tag, shared.record, anchors).with_model(shared.model);
    #[cfg(feature = "ble")]
    let locator = locator.with_surveyed(shared.surveyed);
    let rates = RateControl::of(&shared.tag);
    firmware_tag::engine(shared.channels, Delay, locator, rates, &shared.sink()).await;
}

#[cfg(feature = "ble")]
#[path = "../commanded.rs"]
mod commanded;

#[cfg(feature = "ble")]
mod bluetooth {
    use boards::esp::bluetooth::{Parts, Scanner};
    use embassy_futures::join::join;
    use embassy_time::Delay;
    use firmware_tag::scan;
    use wire::config::Scan;

    use super::Shared;
    use super::commanded::Commanded;

    #[embassy_executor::task]
    pub async fn scan(parts: Parts, wanted: Scan, shared: Shared) {
        let scanner = match Scanner::start(parts) {
            Ok(scanner) => scanner,
            Err(error) => {
                defmt::error!("no Bluetooth, ranging goes on: {}", error);
                return;
            }
        };
        let (channels, sink) = (shared.channels, shared.sink());
        let listening = scanner.listen(|heard| scan::receive(channels, &sink, heard.data, heard.rssi));
        let scanning = scan::run(channels, wanted.into(), Commanded(&scanner), Delay, &sink);
        join(listening, scanning).await;
    }
}

/// Spawns what a tag does.
fn work(spawner: Spawner, uwb: Uwb, settings: &Settings, shared: Shared) {
    let radio = RADIO.init_with(|| Dw1000::new(uwb.bus, uwb.interrupt, uwb.reset, uwb.delay, settings.radio));
    let machine = MACHINE.init_with(|| TagProtocol::new(settings, &shared.tag));
    esp::thread::start(move |above| above.spawn(ranging(radio, machine, shared).unwrap()));
    let anchors = ANCHORS.init_with(|| firmware_tag::places(shared.record));
    spawner.spawn(engine(shared, anchors).unwrap());
}

/// Spawns all tasks; without a record to follow, only those that tell so.
pub fn start(spawner: Spawner) {
    let mut board = Board::take(spawner);
    let reporter: &_ = REPORTER.init_with(|| Reporter::new(esp::uptime_us));
    let (hello, followed) = node::introduce(reporter, esp::KIND, wire::telemetry::Role::Tag, board.start);
    let mut tasks = Tasks::None;
    if let Some((record, settings)) = followed {
        let record: &_ = RECORD.init(record);
        let complain = |condition| reporter.event_log.state(reporter.now_us(), condition);
        match (settings.role, board.uwb.wire(record)) {
            (Role::Tag(tag), Ok(uwb)) => {
                tasks = Tasks::RangingAndEngine;
                let model = NLOS_MODEL.fill(&mut board.flash, esp::KIND.pages().offsets);
                #[cfg(feature = "ble")]
                let surveyed = {
                    let models = match esp::KIND.pages().models {
                        Some(at) => wire::config::load_models(&mut board.flash, at, MODELS.take()),
                        None => Err(wire::config::LoadError::Missing),
                    };
                    SURVEYED.init_with(|| LoadedModels::of(models, &record.beacons, complain))
                };
                let shared = Shared {
                    channels: CHANNELS.init_with(TaskChannels::new),
                    reporter,
                    record,
                    #[cfg(feature = "ble")]
                    surveyed,
                    tag,
                    model,
                };
                work(spawner, uwb, &settings, shared);
                #[cfg(feature = "ble")]
                if let Some(wanted) = tag.scan {
                    spawner.spawn(bluetooth::scan(board.bluetooth, wanted, shared).unwrap());
                }
            }
            (Role::Anchor { .. } | Role::Advertiser(_), Ok(_)) => complain(Condition::WrongRecord),
            (_, Err(what)) => {
                defmt::error!("{}", what);
                complain(Condition::NoRecord(RecordError::Invalid));
            }
        }
    }
    spawner.spawn(esp::supervise(reporter, tasks, board.care).unwrap());
    spawner.spawn(node::keep_telling(reporter, hello).unwrap());
}
