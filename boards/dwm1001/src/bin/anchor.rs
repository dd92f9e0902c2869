//! The anchor on a DWM1001. Ranging runs in an executor above the thread's, telemetry and supervision run in the
//! thread's.
#![no_std]
#![no_main]

use baliza_board_dwm1001::{Board, Delay, Radio, supervise};
use embassy_executor::Spawner;
use firmware_anchor::TelemetrySink;
use firmware_anchor::node::{Anchor, Memory};
use firmware_common::node::{Node, Reporter};
use static_cell::StaticCell;
use wire::telemetry::Role;

static REPORTER: StaticCell<Reporter> = StaticCell::new();
static RADIO: StaticCell<Radio> = StaticCell::new();
static MEMORY: Memory = Memory::new();

#[embassy_executor::task]
async fn ranging(anchor: Anchor<Radio>, delay: Delay) {
    firmware_anchor::run(anchor.radio, delay, anchor.machine, TelemetrySink(anchor.reporter)).await;
}

/// Spawns all tasks. Without a usable record it only spawns the task that reports this.
#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let Board { uwb, delay, care, start, ranging: above, .. } = Board::take();
    let (mut node, configured) = Node::start(&REPORTER, Role::Anchor, start);
    let radio = |config| RADIO.init_with(|| uwb.radio(config));
    if let Some(anchor) = configured.as_ref().and_then(|configured| MEMORY.anchor(&mut node, configured, radio)) {
        above.spawn(ranging(anchor, delay).unwrap());
    }
    spawner.spawn(supervise(node, care).unwrap());
}
