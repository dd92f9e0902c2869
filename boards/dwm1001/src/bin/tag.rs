//! The tag on a DWM1001. Ranging runs in an executor above the thread's. Engine, motion sensor, Bluetooth, telemetry
//! and supervision run in the thread's.
#![no_std]
#![no_main]

#[cfg(not(feature = "ble"))]
use baliza_board_dwm1001::{Advertiser, make_code};
use baliza_board_dwm1001::{Board, Delay, Radio, motion, supervise};
use embassy_executor::Spawner;
#[cfg(not(feature = "ble"))]
use firmware_common::node::Configured;
use firmware_common::node::{Node, Reporter};
#[cfg(not(feature = "ble"))]
use firmware_tag::advertise::Sender;
use firmware_tag::motion::lis2dh12::{Lis2dh12, Sa0Pad};
use firmware_tag::node::{Memory, NlosModelStore, RangingParts, Tag};
use static_cell::StaticCell;
#[cfg(not(feature = "ble"))]
use wire::config::PollContent;
use wire::telemetry::Role;

static REPORTER: StaticCell<Reporter> = StaticCell::new();
static RADIO: StaticCell<Radio> = StaticCell::new();
static MEMORY: Memory = Memory::new();
static NLOS_MODEL: NlosModelStore = NlosModelStore::new();

#[embassy_executor::task]
async fn ranging(tag: &'static Tag, exchange: RangingParts<Radio>, delay: Delay) {
    tag.range(exchange, delay, &tag.sink()).await;
}

#[embassy_executor::task]
async fn engine(tag: &'static Tag) {
    tag.locate(embassy_time::Delay, &tag.sink()).await;
}

/// Runs only if the record has a rate for a tag that lies still.
#[embassy_executor::task]
async fn follow_motion(tag: &'static Tag, parts: motion::Parts) {
    let (bus, int1) = parts.into_bus_and_line();
    let sensor = Lis2dh12::new(bus, Sa0Pad::High, int1, embassy_time::Delay);
    tag.follow_motion(sensor, embassy_time::Delay, &tag.sink()).await;
}

/// Runs only if the record asks for it.
#[cfg(not(feature = "ble"))]
#[embassy_executor::task]
async fn advertise(tag: &'static Tag, sender: Sender, radio: Advertiser) {
    tag.advertise(sender, radio, embassy_time::Delay).await;
}

#[cfg(feature = "ble")]
mod bluetooth {
    use baliza_board_dwm1001::bluetooth::{Parts, Scanner};
    use embassy_executor::Spawner;
    use embassy_futures::join::join;
    use firmware_tag::node::Tag;
    use firmware_tag::scan::Plan;

    /// Scans, and passes received advertisements to the engine.
    #[embassy_executor::task]
    pub async fn scan(tag: &'static Tag, spawner: Spawner, parts: Parts, plan: Plan) {
        let sink = tag.sink();
        match Scanner::start(parts, spawner).await {
            Ok(scanner) => {
                let listening = scanner.listen(|heard| tag.receive(heard.data, heard.rssi, &sink));
                join(listening, tag.scan(plan, &scanner, embassy_time::Delay, &sink)).await;
            }
            Err(error) => defmt::error!("no Bluetooth, ranging goes on: {}", error),
        }
    }
}

/// Spawns all tasks. Without a usable record it only spawns the task that reports this.
#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let mut board = Board::take();
    let (mut node, configured) = Node::start(&REPORTER, Role::Tag, board.start);
    let radio = |config| RADIO.init_with(|| board.uwb.radio(config));
    if let Some((exchange, tag)) = configured.as_ref().and_then(|configured| MEMORY.tag(&mut node, configured, radio)) {
        tag.nlos_model = NLOS_MODEL.fill(&mut board.flash, node.board);
        #[cfg(feature = "ble")]
        MEMORY.use_beacon_models(tag, wire::config::decode_models(baliza_board_dwm1001::models()), &node);
        if board.may_rest && tag.config.sleep {
            board.delay.rest();
        }
        board.ranging.spawn(ranging(tag, exchange, board.delay).unwrap());
        spawner.spawn(engine(tag).unwrap());
        if tag.config.still_rate_chz.is_some() {
            spawner.spawn(follow_motion(tag, board.motion).unwrap());
        }
        #[cfg(not(feature = "ble"))]
        if let (PollContent::Advertised, Some(Configured { record, settings })) = (tag.config.tells, &configured) {
            let sender = Sender::new(record, settings.address, make_code);
            spawner.spawn(advertise(tag, sender, Advertiser::new(board.bluetooth)).unwrap());
        }
        #[cfg(feature = "ble")]
        if let Some(wanted) = tag.config.scan {
            spawner.spawn(bluetooth::scan(tag, spawner, board.bluetooth, wanted.into()).unwrap());
        }
    }
    spawner.spawn(supervise(node, board.care).unwrap());
}
