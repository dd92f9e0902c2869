//! The tag on a chip of Espressif. Ranging runs in a thread above all others. Engine, Bluetooth scan, telemetry and
//! supervision run in the main thread.
#![no_std]
#![no_main]

use baliza_board_esp32::{Board, Radio, supervise, thread};
use embassy_executor::Spawner;
use embassy_time::Delay;
use firmware_common::node::{Node, Reporter};
use firmware_tag::node::{Memory, NlosModelStore, RangingParts, Tag};
use static_cell::StaticCell;
use wire::telemetry::Role;

static REPORTER: StaticCell<Reporter> = StaticCell::new();
static RADIO: StaticCell<Radio> = StaticCell::new();
static MEMORY: Memory = Memory::new();
static NLOS_MODEL: NlosModelStore = NlosModelStore::new();

#[embassy_executor::task]
async fn ranging(tag: &'static Tag, exchange: RangingParts<Radio>) {
    tag.range(exchange, Delay, &tag.sink()).await;
}

#[embassy_executor::task]
async fn engine(tag: &'static Tag) {
    tag.locate(Delay, &tag.sink()).await;
}

#[cfg(feature = "ble")]
mod bluetooth {
    use baliza_board_esp32::bluetooth::{Parts, Scanner};
    use embassy_futures::join::join;
    use embassy_time::Delay;
    use firmware_tag::node::Tag;
    use firmware_tag::scan::Plan;

    /// Scans, and passes received advertisements to the engine.
    #[embassy_executor::task]
    pub async fn scan(tag: &'static Tag, parts: Parts, plan: Plan) {
        let sink = tag.sink();
        match Scanner::start(parts) {
            Ok(scanner) => {
                let listening = scanner.listen(|heard| tag.receive(heard.data, heard.rssi, &sink));
                join(listening, tag.scan(plan, &scanner, Delay, &sink)).await;
            }
            Err(error) => defmt::error!("no Bluetooth, ranging goes on: {}", error),
        }
    }
}

/// Spawns all tasks. Without a usable record it only spawns the task that reports this.
fn start(spawner: Spawner) {
    let mut board = Board::take(spawner);
    let (mut node, configured) = Node::start(&REPORTER, Role::Tag, board.start);
    if let Some(configured) = configured {
        #[cfg(feature = "wifi")]
        board.care.gateway.set(board.wifi.start(spawner, &configured));
        match board.uwb.wire(&configured.record) {
            Ok(uwb) => {
                let radio = |config| RADIO.init_with(|| uwb.radio(config));
                if let Some((exchange, tag)) = MEMORY.tag(&mut node, &configured, radio) {
                    tag.nlos_model = NLOS_MODEL.fill(&mut board.flash, node.board);
                    #[cfg(feature = "ble")]
                    MEMORY.use_beacon_models(tag, baliza_board_esp32::models(&mut board.flash), &node);
                    let tag: &'static Tag = tag;
                    thread::start(move |above| above.spawn(ranging(tag, exchange).unwrap()));
                    spawner.spawn(engine(tag).unwrap());
                    #[cfg(feature = "ble")]
                    if let Some(wanted) = tag.config.scan {
                        spawner.spawn(bluetooth::scan(tag, board.bluetooth, wanted.into()).unwrap());
                    }
                }
            }
            Err(what) => node.refuse(&what),
        }
    }
    spawner.spawn(supervise(node, board.care).unwrap());
}

baliza_board_esp32::entry!(start);
