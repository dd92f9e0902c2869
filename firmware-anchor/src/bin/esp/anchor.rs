//! The anchor on a chip of Espressif: ranging in a thread above all others, telemetry and supervision in the main one.

use boards::esp::{self, Board, Bus, Interrupt, Reset};
use boards::node::{self, Reporter, Tasks};
use embassy_executor::Spawner;
use embassy_time::Delay;
use firmware_anchor::TelemetrySink;
use firmware_common::AnchorProtocol;
use ranging::dw1000::Dw1000;
use static_cell::StaticCell;
use wire::config::Role;
use wire::telemetry::{Condition, RecordError};

type Radio = Dw1000<Bus, Interrupt, Reset, Delay>;

static REPORTER: StaticCell<Reporter> = StaticCell::new();
static RADIO: StaticCell<Radio> = StaticCell::new();
static MACHINE: StaticCell<AnchorProtocol> = StaticCell::new();

#[embassy_executor::task]
async fn ranging(radio: &'static mut Radio, machine: &'static mut AnchorProtocol, reporter: &'static Reporter) {
    firmware_anchor::run(radio, Delay, machine, TelemetrySink(reporter)).await;
}

/// Spawns all tasks; without a record to follow, only those that tell so.
pub fn start(spawner: Spawner) {
    let Board { uwb, care, start, .. } = Board::take(spawner);
    let reporter: &_ = REPORTER.init_with(|| Reporter::new(esp::uptime_us));
    let (hello, followed) = node::introduce(reporter, esp::KIND, wire::telemetry::Role::Anchor, start);
    let mut tasks = Tasks::None;
    if let Some((record, settings)) = followed {
        let complain = |condition| reporter.event_log.state(reporter.now_us(), condition);
        match (settings.role, uwb.wire(&record)) {
            (Role::Anchor { position_m }, Ok(uwb)) => {
                tasks = Tasks::Ranging;
                let radio =
                    RADIO.init_with(|| Dw1000::new(uwb.bus, uwb.interrupt, uwb.reset, uwb.delay, settings.radio));
                let machine = MACHINE.init_with(|| AnchorProtocol::new(&settings, position_m));
                esp::thread::start(move |above| above.spawn(ranging(radio, machine, reporter).unwrap()));
            }
            (Role::Tag(_) | Role::Advertiser(_), Ok(_)) => complain(Condition::WrongRecord),
            (_, Err(what)) => {
                defmt::error!("{}", what);
                complain(Condition::NoRecord(RecordError::Invalid));
            }
        }
    }
    spawner.spawn(esp::supervise(reporter, tasks, care).unwrap());
    spawner.spawn(node::keep_telling(reporter, hello).unwrap());
}
