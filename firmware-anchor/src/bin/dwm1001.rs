//! The anchor on a DWM1001: ranging in an executor above the thread's, telemetry and supervision in the thread's.
#![no_std]
#![no_main]

use boards::dwm1001::{self, Board, Bus, Delay, Interrupt, Reset};
use boards::node::{self, Reporter, Tasks};
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

#[embassy_executor::task]
async fn ranging(
    radio: &'static mut Radio,
    delay: Delay,
    machine: &'static mut AnchorProtocol,
    reporter: &'static Reporter,
) {
    firmware_anchor::run(radio, delay, machine, TelemetrySink(reporter)).await;
}

/// Spawns all tasks; without a record to follow, only those that tell so.
fn start(spawner: Spawner) {
    let Board { uwb, delay, care, start, ranging: above, flash: _, may_rest: _, motion: _ } = Board::take();
    let reporter: &_ = REPORTER.init_with(|| Reporter::new(dwm1001::uptime_us));
    let (hello, followed) = node::introduce(reporter, dwm1001::KIND, wire::telemetry::Role::Anchor, start);
    let mut tasks = Tasks::None;
    if let Some((_, settings)) = followed {
        match settings.role {
            Role::Anchor { position_m } => {
                let radio =
                    RADIO.init_with(|| Dw1000::new(uwb.bus, uwb.interrupt, uwb.reset, uwb.delay, settings.radio));
                let machine = MACHINE.init_with(|| AnchorProtocol::new(&settings, position_m));
                tasks = Tasks::Ranging;
                above.spawn(ranging(radio, delay, machine, reporter).unwrap());
            }
            Role::Tag(_) | Role::Advertiser(_) => reporter.event_log.state(reporter.now_us(), Condition::WrongRecord),
        }
    }
    spawner.spawn(dwm1001::supervise(reporter, tasks, care).unwrap());
    spawner.spawn(node::keep_telling(reporter, hello).unwrap());
}

#[embassy_executor::main(entry = "boards::cortex::entry")]
async fn main(spawner: Spawner) {
    start(spawner);
}
