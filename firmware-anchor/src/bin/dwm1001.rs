//! The anchor on a DWM1001: ranging in an executor above the thread's, telemetry and supervision in the thread's.
#![no_std]
#![no_main]

use boards::cortex::crash;
use boards::dwm1001::{self, Board, Delay, Uwb};
use boards::node::{self, Reporter};
use embassy_executor::Spawner;
use firmware_anchor::Told;
use firmware_common::{AnchorMachine, Settings};
use node_record::Role;
use ranging::dw1000::Dw1000;
use telemetry::Condition;

static REPORTER: Reporter = Reporter::new(dwm1001::uptime_us);

#[embassy_executor::task]
async fn ranging(uwb: Uwb, delay: Delay, settings: Settings, position_m: Option<[f32; 3]>) {
    let radio = Dw1000::new(uwb.bus, uwb.interrupt, uwb.reset, uwb.delay, settings.radio);
    let machine = AnchorMachine::new(&settings, position_m);
    firmware_anchor::run(radio, delay, machine, Told(&REPORTER)).await;
}

#[embassy_executor::main(entry = "boards::cortex::entry")]
async fn main(_spawner: Spawner) {
    let Board { uwb, delay, mut leds, mut watchdog, start, mut telemetry, ranging: executor } = Board::take();
    let (hello, followed) = node::introduce(&REPORTER, dwm1001::KIND, telemetry::Role::Anchor, start);
    let mut works = false;
    if let Some((_, settings)) = followed {
        match settings.role {
            Role::Anchor { position_m } => {
                works = true;
                executor.spawn(ranging(uwb, delay, settings, position_m).unwrap());
            }
            Role::Tag(_) | Role::Advertiser(_) => REPORTER.journal.state(REPORTER.now_us(), Condition::WrongRecord),
        }
    }
    let supervision = node::supervise(
        &REPORTER,
        |frame| telemetry.write(frame),
        |lit| leds.show(lit),
        || watchdog.feed(),
        |reporter| if works { reporter.all_alive(false) } else { Ok(()) },
        crash::leave,
    );
    embassy_futures::join::join(supervision, REPORTER.keep_telling(hello, embassy_time::Delay)).await;
}
