//! Tag or anchor on an EVB1000, as S1-4 selects at the start. It needs no record. The display shows the distance.
#![no_std]
#![no_main]

use baliza_board_evk1000::panel::{Awaiting, Panel};
use baliza_board_evk1000::{Board, OnPanel, Radio, RoleListener, SharedPanel, Shown, display, supervise};
use embassy_executor::Spawner;
use embassy_time::Delay;
use firmware_anchor::node::Anchor;
use firmware_common::node::{Node, Reporter};
use firmware_tag::node::{NlosModelStore, RangingParts, Tag};
use ranging::exchange::Protocol;
use static_cell::StaticCell;
use wire::telemetry;

static REPORTER: StaticCell<Reporter> = StaticCell::new();
static RADIO: StaticCell<Radio> = StaticCell::new();
static TAG: firmware_tag::node::Memory = firmware_tag::node::Memory::new();
static NLOS_MODEL: NlosModelStore = NlosModelStore::new();
// There is no room for more leases beside a tag's tables. The image of an anchor alone has 1,024.
static ANCHOR: firmware_anchor::node::Memory<128> = firmware_anchor::node::Memory::new();
static PANEL: StaticCell<SharedPanel> = StaticCell::new();

/// What the task that owns the radio does.
enum Role {
    Tag(&'static Tag, RangingParts<Radio>),
    Anchor(Anchor<Radio>),
}

#[embassy_executor::task]
async fn ranging(role: Role, panel: &'static SharedPanel) {
    let sink;
    let (radio, mut machine, mut listener): (_, &mut dyn Protocol, _) = match role {
        Role::Tag(tag, exchange) => {
            sink = tag.sink().with_observer(OnPanel(panel));
            (exchange.radio, exchange.machine, RoleListener::Tag(tag.listener(&sink)))
        }
        Role::Anchor(Anchor { radio, machine, reporter }) => {
            let listener = firmware_anchor::TelemetrySink(reporter);
            (radio, machine, RoleListener::Anchor(Shown { listener, panel }))
        }
    };
    ranging::node::run(radio, &mut Delay, &mut machine, &mut listener).await;
}

#[embassy_executor::task]
async fn engine(tag: &'static Tag, panel: &'static SharedPanel) {
    tag.locate(Delay, &tag.sink().with_observer(OnPanel(panel))).await;
}

/// Spawns all tasks.
#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let Board { uwb, switches, mut care, lcd, start, mut flash, ranging: above, .. } = Board::take();
    let (role, awaiting) = if switches.anchor {
        (telemetry::Role::Anchor, Awaiting::Poll)
    } else {
        (telemetry::Role::Tag, Awaiting::Response)
    };
    care.leds.show_role(switches.anchor);
    let panel: &_ = PANEL.init_with(|| SharedPanel::new(Panel::new(awaiting)));
    spawner.spawn(display(lcd, panel).unwrap());
    let (mut node, configured) = Node::start(&REPORTER, role, start);
    let radio = |config| RADIO.init_with(|| uwb.radio(config));
    match &configured {
        // The record's role comes from the switches.
        Some(configured) if switches.anchor => {
            if let Some(anchor) = ANCHOR.anchor(&mut node, configured, radio) {
                above.spawn(ranging(Role::Anchor(anchor), panel).unwrap());
            }
        }
        Some(configured) => {
            if let Some((exchange, tag)) = TAG.tag(&mut node, configured, radio) {
                tag.nlos_model = NLOS_MODEL.fill(&mut flash, node.board);
                above.spawn(ranging(Role::Tag(tag, exchange), panel).unwrap());
                spawner.spawn(engine(tag, panel).unwrap());
            }
        }
        None => {}
    }
    spawner.spawn(supervise(node, care).unwrap());
}
