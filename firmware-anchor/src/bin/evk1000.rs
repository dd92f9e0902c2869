//! The anchor on an EVB1000, by its switches and without a record if need be; the distance to the tag on the display.
#![no_std]
#![no_main]

use boards::evk1000::{self, Board, Bus, Delay, Interrupt, Reset, SharedPanel, Shown};
use boards::node::{self, Reporter, Tasks};
use boards::panel::{Awaiting, Panel};
use embassy_executor::Spawner;
use firmware_anchor::TelemetrySink;
use firmware_common::AnchorProtocol;
use ranging::dw1000::Dw1000;
use static_cell::StaticCell;
use wire::config::Role;
use wire::telemetry::Condition;

type Radio = Dw1000<Bus, Interrupt, Reset, Delay>;

static REPORTER: StaticCell<Reporter> = StaticCell::new();
static RADIO: StaticCell<Radio> = StaticCell::new();
static MACHINE: StaticCell<AnchorProtocol> = StaticCell::new();
static PANEL: StaticCell<SharedPanel> = StaticCell::new();

#[embassy_executor::task]
async fn ranging(
    radio: &'static mut Radio,
    machine: &'static mut AnchorProtocol,
    reporter: &'static Reporter,
    panel: &'static SharedPanel,
) {
    firmware_anchor::run(radio, Delay, machine, Shown { listener: TelemetrySink(reporter), panel }).await;
}

/// Spawns all tasks; where S1-4 asks for a tag, only those that say what is wrong.
fn start(spawner: Spawner) {
    let Board { uwb, mut care, lcd, start, ranging: above, .. } = Board::take();
    let reporter: &_ = REPORTER.init_with(|| Reporter::new(evk1000::uptime_us));
    let (hello, followed) = node::introduce(reporter, evk1000::KIND, wire::telemetry::Role::Anchor, start);
    let mut tasks = Tasks::None;
    if let Some((_, settings)) = followed {
        let awaiting = match settings.role {
            Role::Anchor { .. } => Awaiting::Poll,
            Role::Tag(_) | Role::Advertiser(_) => Awaiting::Switch,
        };
        let panel: &_ = PANEL.init_with(|| SharedPanel::new(Panel::new(awaiting)));
        spawner.spawn(evk1000::display(lcd, panel).unwrap());
        match settings.role {
            Role::Anchor { position_m } => {
                care.leds.show_role(true);
                let radio =
                    RADIO.init_with(|| Dw1000::new(uwb.bus, uwb.interrupt, uwb.reset, uwb.delay, settings.radio));
                let machine = MACHINE.init_with(|| AnchorProtocol::new(&settings, position_m));
                tasks = Tasks::Ranging;
                above.spawn(ranging(radio, machine, reporter, panel).unwrap());
            }
            Role::Tag(_) | Role::Advertiser(_) => reporter.event_log.state(reporter.now_us(), Condition::WrongRecord),
        }
    }
    spawner.spawn(evk1000::supervise(reporter, tasks, care).unwrap());
    spawner.spawn(node::keep_telling(reporter, hello).unwrap());
}

#[embassy_executor::main(entry = "boards::cortex::entry")]
async fn main(spawner: Spawner) {
    start(spawner);
}
