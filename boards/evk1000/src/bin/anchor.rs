//! The anchor on an EVB1000. Its switches configure it, and it needs no record. The display shows the distance to the
//! tag.
#![no_std]
#![no_main]

use baliza_board_evk1000::panel::{Awaiting, Panel};
use baliza_board_evk1000::{Board, Radio, SharedPanel, Shown, display, supervise};
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
static PANEL: StaticCell<SharedPanel> = StaticCell::new();

#[embassy_executor::task]
async fn ranging(anchor: Anchor<Radio>, panel: &'static SharedPanel) {
    let listener = TelemetrySink(anchor.reporter);
    firmware_anchor::run(anchor.radio, Delay, anchor.machine, Shown { listener, panel }).await;
}

/// Spawns all tasks. If S1-4 selects a tag, it only spawns the tasks that report the fault.
#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let Board { uwb, switches, mut care, lcd, start, ranging: above, .. } = Board::take();
    let (mut node, configured) = Node::start(&REPORTER, Role::Anchor, start);
    let awaiting = if switches.anchor { Awaiting::Poll } else { Awaiting::Switch };
    let panel: &_ = PANEL.init_with(|| SharedPanel::new(Panel::new(awaiting)));
    spawner.spawn(display(lcd, panel).unwrap());
    let radio = |config| RADIO.init_with(|| uwb.radio(config));
    if let Some(anchor) = configured.as_ref().and_then(|configured| MEMORY.anchor(&mut node, configured, radio)) {
        care.leds.show_role(true);
        above.spawn(ranging(anchor, panel).unwrap());
    }
    spawner.spawn(supervise(node, care).unwrap());
}
