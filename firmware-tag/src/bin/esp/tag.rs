//! The tag on a chip of Espressif: ranging in a thread above all others; engine, Bluetooth host, telemetry and supervision in the
//! main one.

use boards::esp::{self, Board, Uwb, crash};
use boards::node::{self, Guard, Reporter, Tasks};
use embassy_executor::Spawner;
use embassy_futures::join::join;
use embassy_time::Delay;
use firmware_common::{Settings, TagMachine};
use firmware_tag::{Handover, Locator, Pace, Told};
use node_record::{Record, Role, Tag};
use ranging::dw1000::Dw1000;
use static_cell::StaticCell;
use telemetry::{Condition, RecordFault};

static REPORTER: Reporter = Reporter::new(esp::uptime_us);
static HANDOVER: Handover<Guard> = Handover::new();

#[embassy_executor::task]
async fn ranging(uwb: Uwb, settings: Settings, tag: Tag) {
    let radio = Dw1000::new(uwb.bus, uwb.interrupt, uwb.reset, uwb.delay, settings.radio);
    let machine = TagMachine::new(&settings, &tag);
    firmware_tag::ranging(radio, Delay, machine, &HANDOVER, &Told::new(&REPORTER, tag.report_ranges)).await;
}

#[embassy_executor::task]
async fn engine(record: &'static Record, tag: Tag) {
    let anchors = firmware_tag::places(record);
    let (locator, pace) = (Locator::of(&tag, &anchors), Pace::of(&tag));
    let told = Told::new(&REPORTER, tag.report_ranges);
    let positions = firmware_tag::engine(&HANDOVER, Delay, locator, pace, &told);
    #[cfg(feature = "ble")]
    let positions =
        join(positions, firmware_tag::tell_sightings(&HANDOVER, firmware_tag::KnownBeacons::of(record), &told));
    positions.await;
}

#[cfg(feature = "ble")]
mod bluetooth {
    use boards::esp::bluetooth::{Parts, Scanner};
    use embassy_futures::join::join;
    use embassy_time::Delay;
    use firmware_tag::{Told, scan};
    use node_record::Scan;

    use super::{HANDOVER, REPORTER};

    struct Commanded<'s>(&'s Scanner);

    impl scan::Scanner for Commanded<'_> {
        async fn start(&mut self) {
            if let Err(error) = self.0.start_scan().await {
                defmt::warn!("the scan does not start: {}", error);
            }
        }

        async fn stop(&mut self) {
            if let Err(error) = self.0.stop_scan().await {
                defmt::warn!("the scan does not stop: {}", error);
            }
        }
    }

    #[embassy_executor::task]
    pub async fn scan(parts: Parts, wanted: Scan) {
        let scanner = match Scanner::start(parts) {
            Ok(scanner) => scanner,
            Err(error) => {
                defmt::error!("no Bluetooth, ranging goes on: {}", error);
                return;
            }
        };
        let told = Told::new(&REPORTER, false);
        let listening = scanner.listen(|heard| scan::hear(&HANDOVER, &told, heard.data, heard.rssi));
        let scanning = scan::run(&HANDOVER, wanted.into(), Commanded(&scanner), Delay, &told);
        join(listening, scanning).await;
    }
}

/// What a tag does, where its record is one of a tag.
fn work(
    spawner: Spawner,
    uwb: Uwb,
    #[cfg(feature = "ble")] bluetooth: boards::esp::bluetooth::Parts,
    record: &'static Record,
    settings: Settings,
    tag: Tag,
) {
    esp::thread::start(move |thread| thread.spawn(ranging(uwb, settings, tag).unwrap()));
    spawner.spawn(engine(record, tag).unwrap());
    #[cfg(feature = "ble")]
    if let Some(wanted) = tag.scan {
        spawner.spawn(bluetooth::scan(bluetooth, wanted).unwrap());
    }
}

/// The main thread's first task.
#[embassy_executor::task]
pub async fn main(spawner: Spawner) {
    let board = Board::take(spawner);
    let (mut watchdog, mut telemetry) = (board.watchdog, board.telemetry);
    let (hello, followed) = node::introduce(&REPORTER, esp::KIND, telemetry::Role::Tag, board.start);
    let mut tasks = Tasks::None;
    if let Some((record, settings)) = followed {
        static RECORD: StaticCell<Record> = StaticCell::new();
        let record = RECORD.init(record);
        let complain = |condition| REPORTER.journal.state(REPORTER.now_us(), condition);
        match (settings.role, board.uwb.wire(record)) {
            (Role::Tag(tag), Ok(uwb)) => {
                tasks = Tasks::RangingAndEngine;
                work(
                    spawner,
                    uwb,
                    #[cfg(feature = "ble")]
                    board.bluetooth,
                    record,
                    settings,
                    tag,
                );
            }
            (Role::Anchor { .. } | Role::Advertiser(_), Ok(_)) => complain(Condition::WrongRecord),
            (_, Err(what)) => {
                defmt::error!("{}", what);
                complain(Condition::NoRecord(RecordFault::Invalid));
            }
        }
    }
    let supervision =
        node::supervise(&REPORTER, tasks, |frame| telemetry.write(frame), |_| (), || watchdog.feed(), crash::leave);
    join(supervision, REPORTER.keep_telling(hello, Delay)).await;
}
