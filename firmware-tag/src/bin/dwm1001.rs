//! The tag on a DWM1001: ranging in an executor above the thread's; engine, Bluetooth, telemetry and supervision in the thread's.
#![no_std]
#![no_main]

use boards::cortex::crash;
use boards::dwm1001::{self, Board, Delay, Uwb};
use boards::node::{self, Guard, Reporter};
use embassy_executor::Spawner;
use embassy_futures::join::join;
use firmware_common::{Settings, TagMachine};
use firmware_tag::{Handover, Locator, Pace, Told};
use node_record::{Record, Role, Tag};
use ranging::dw1000::Dw1000;
use static_cell::StaticCell;
use telemetry::Condition;

static REPORTER: Reporter = Reporter::new(dwm1001::uptime_us);
static HANDOVER: Handover<Guard> = Handover::new();

#[embassy_executor::task]
async fn ranging(uwb: Uwb, delay: Delay, settings: Settings, tag: Tag) {
    let radio = Dw1000::new(uwb.bus, uwb.interrupt, uwb.reset, uwb.delay, settings.radio);
    let machine = TagMachine::new(&settings, &tag);
    firmware_tag::ranging(radio, delay, machine, &HANDOVER, &Told::new(&REPORTER, tag.report_ranges)).await;
}

#[embassy_executor::task]
async fn engine(record: &'static Record, tag: Tag) {
    let anchors = firmware_tag::places(record);
    let (locator, pace) = (Locator::of(&tag, &anchors), Pace::of(&tag));
    let told = Told::new(&REPORTER, tag.report_ranges);
    let positions = firmware_tag::engine(&HANDOVER, embassy_time::Delay, locator, pace, &told);
    #[cfg(feature = "ble")]
    let positions =
        join(positions, firmware_tag::tell_sightings(&HANDOVER, firmware_tag::KnownBeacons::of(record), &told));
    positions.await;
}

#[cfg(feature = "ble")]
mod bluetooth {
    use boards::dwm1001::bluetooth::{Parts, Scanner};
    use embassy_executor::Spawner;
    use embassy_futures::join::join;
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
    pub async fn scan(spawner: Spawner, parts: Parts, wanted: Scan) {
        let scanner = match Scanner::start(parts, spawner).await {
            Ok(scanner) => scanner,
            Err(error) => {
                defmt::error!("no Bluetooth, ranging goes on: {}", error);
                return;
            }
        };
        let told = Told::new(&REPORTER, false);
        let listening = scanner.listen(|heard| scan::hear(&HANDOVER, &told, heard.data, heard.rssi));
        let scanning = scan::run(&HANDOVER, wanted.into(), Commanded(&scanner), embassy_time::Delay, &told);
        join(listening, scanning).await;
    }
}

#[embassy_executor::main(entry = "boards::cortex::entry")]
async fn main(spawner: Spawner) {
    let board = Board::take();
    let (mut leds, mut watchdog, mut telemetry) = (board.leds, board.watchdog, board.telemetry);
    let (hello, followed) = node::introduce(&REPORTER, dwm1001::KIND, telemetry::Role::Tag, board.start);
    let mut works = false;
    if let Some((record, settings)) = followed {
        match settings.role {
            Role::Tag(tag) => {
                works = true;
                static RECORD: StaticCell<Record> = StaticCell::new();
                board.ranging.spawn(ranging(board.uwb, board.delay, settings, tag).unwrap());
                spawner.spawn(engine(RECORD.init(record), tag).unwrap());
                #[cfg(feature = "ble")]
                if let Some(wanted) = tag.scan {
                    spawner.spawn(bluetooth::scan(spawner, board.bluetooth, wanted).unwrap());
                }
            }
            Role::Anchor { .. } | Role::Advertiser(_) => {
                REPORTER.journal.state(REPORTER.now_us(), Condition::WrongRecord);
            }
        }
    }
    let supervision = node::supervise(
        &REPORTER,
        |frame| telemetry.write(frame),
        |lit| leds.show(lit),
        || watchdog.feed(),
        |reporter| if works { reporter.all_alive(true) } else { Ok(()) },
        crash::leave,
    );
    join(supervision, REPORTER.keep_telling(hello, embassy_time::Delay)).await;
}
