//! The anchor on a chip of Espressif: ranging in a thread above all others, telemetry and supervision in the main one.

use boards::esp::{self, Board, Uwb, crash};
use boards::node::{self, Reporter, Tasks};
use embassy_executor::Spawner;
use embassy_futures::join::join;
use embassy_time::Delay;
use firmware_anchor::Told;
use firmware_common::{AnchorMachine, Settings};
use node_record::Role;
use ranging::dw1000::Dw1000;
use telemetry::{Condition, RecordFault};

static REPORTER: Reporter = Reporter::new(esp::uptime_us);

#[embassy_executor::task]
async fn ranging(uwb: Uwb, settings: Settings, position_m: Option<[f32; 3]>) {
    let radio = Dw1000::new(uwb.bus, uwb.interrupt, uwb.reset, uwb.delay, settings.radio);
    let machine = AnchorMachine::new(&settings, position_m);
    firmware_anchor::run(radio, Delay, machine, Told(&REPORTER)).await;
}

/// The main thread's first task.
#[embassy_executor::task]
pub async fn main(spawner: Spawner) {
    let Board { uwb, mut watchdog, start, mut telemetry, .. } = Board::take(spawner);
    let (hello, followed) = node::introduce(&REPORTER, esp::KIND, telemetry::Role::Anchor, start);
    let mut tasks = Tasks::None;
    if let Some((record, settings)) = followed {
        let complain = |condition| REPORTER.journal.state(REPORTER.now_us(), condition);
        match (settings.role, uwb.wire(&record)) {
            (Role::Anchor { position_m }, Ok(uwb)) => {
                tasks = Tasks::Ranging;
                esp::thread::start(move |thread| thread.spawn(ranging(uwb, settings, position_m).unwrap()));
            }
            (Role::Tag(_) | Role::Advertiser(_), Ok(_)) => complain(Condition::WrongRecord),
            (_, Err(what)) => {
                defmt::error!("{}", what);
                complain(Condition::NoRecord(RecordFault::Invalid));
            }
        }
    }
    let supervision =
        node::supervise(&REPORTER, tasks, |frame| telemetry.write(frame), |_| (), || watchdog.feed(), crash::leave);
    join(supervision, REPORTER.keep_telling(hello, Delay)).await;
}
