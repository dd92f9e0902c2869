//! The anchor on a chip of Espressif. Ranging runs in a thread above all others, telemetry and supervision run in the
//! main thread.
#![no_std]
#![no_main]

use baliza_board_esp32::{Board, Radio, supervise, thread};
use embassy_executor::Spawner;
use embassy_time::Delay;
use firmware_anchor::TelemetrySink;
use firmware_anchor::node::{Anchor, Memory};
use firmware_common::node::{Node, Reporter};
use static_cell::StaticCell;
use wire::telemetry::Role;

static REPORTER: StaticCell<Reporter> = StaticCell::new();
static RADIO: StaticCell<Radio> = StaticCell::new();
static MEMORY: Memory = Memory::new();

#[embassy_executor::task]
async fn ranging(anchor: Anchor<Radio>) {
    firmware_anchor::run(anchor.radio, Delay, anchor.machine, TelemetrySink(anchor.reporter)).await;
}

/// Spawns all tasks. Without a usable record it only spawns the task that reports this.
fn start(spawner: Spawner) {
    let board = Board::take(spawner);
    let (mut node, configured) = Node::start(&REPORTER, Role::Anchor, board.start);
    if let Some(configured) = configured {
        #[cfg(feature = "wifi")]
        board.care.gateway.set(board.wifi.start(spawner, &configured));
        match board.uwb.wire(&configured.record) {
            Ok(uwb) => {
                let radio = |config| RADIO.init_with(|| uwb.radio(config));
                if let Some(anchor) = MEMORY.anchor(&mut node, &configured, radio) {
                    thread::start(move |above| above.spawn(ranging(anchor).unwrap()));
                }
            }
            Err(what) => node.refuse(&what),
        }
    }
    spawner.spawn(supervise(node, board.care).unwrap());
}

baliza_board_esp32::entry!(start);
