//! Tag or anchor on an EVB1000, as S1-4 selects at the start. It needs no record. The display shows the distance.
#![no_std]
#![no_main]

use baliza_board_evk1000::panel::{Awaiting, Panel};
use baliza_board_evk1000::{Board, OnPanel, Radio, SharedPanel, Shown, display, supervise};
use embassy_executor::Spawner;
use embassy_time::Delay;
use firmware_anchor::node::Anchor;
use firmware_common::node::{Node, Reporter};
use firmware_tag::node::{NlosModelStore, RangingParts, Tag};
use static_cell::StaticCell;
use wire::telemetry::Role;

static REPORTER: StaticCell<Reporter> = StaticCell::new();
static RADIO: StaticCell<Radio> = StaticCell::new();
static TAG: firmware_tag::node::Memory = firmware_tag::node::Memory::new();
static NLOS_MODEL: NlosModelStore = NlosModelStore::new();
static ANCHOR: firmware_anchor::node::Memory = firmware_anchor::node::Memory::new();
static PANEL: StaticCell<SharedPanel> = StaticCell::new();

#[embassy_executor::task]
async fn tag_ranging(tag: &'static Tag, exchange: RangingParts<Radio>, panel: &'static SharedPanel) {
    tag.range(exchange, Delay, &tag.sink().with_observer(OnPanel(panel))).await;
}

#[embassy_executor::task]
async fn engine(tag: &'static Tag, panel: &'static SharedPanel) {
    tag.locate(Delay, &tag.sink().with_observer(OnPanel(panel))).await;
}

#[embassy_executor::task]
async fn anchor_ranging(anchor: Anchor<Radio>, panel: &'static SharedPanel) {
    let listener = firmware_anchor::TelemetrySink(anchor.reporter);
    firmware_anchor::run(anchor.radio, Delay, anchor.machine, Shown { listener, panel }).await;
}

/// Spawns all tasks.
#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let Board { uwb, switches, mut care, lcd, start, mut flash, ranging: above, .. } = Board::take();
    let (role, awaiting) =
        if switches.anchor { (Role::Anchor, Awaiting::Poll) } else { (Role::Tag, Awaiting::Response) };
    care.leds.show_role(switches.anchor);
    let panel: &_ = PANEL.init_with(|| SharedPanel::new(Panel::new(awaiting)));
    spawner.spawn(display(lcd, panel).unwrap());
    let (mut node, configured) = Node::start(&REPORTER, role, start);
    let radio = |config| RADIO.init_with(|| uwb.radio(config));
    match configured {
        // The record's role comes from the switches.
        Some(configured) if switches.anchor => {
            if let Some(anchor) = ANCHOR.anchor(&mut node, &configured, radio) {
                above.spawn(anchor_ranging(anchor, panel).unwrap());
            }
        }
        Some(configured) => {
            if let Some((exchange, tag)) = TAG.tag(&mut node, configured, radio) {
                tag.nlos_model = NLOS_MODEL.fill(&mut flash, node.board);
                above.spawn(tag_ranging(tag, exchange, panel).unwrap());
                spawner.spawn(engine(tag, panel).unwrap());
            }
        }
        None => {}
    }
    spawner.spawn(supervise(node, care).unwrap());
}
