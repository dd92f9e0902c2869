//! The anchor in QEMU on a simulated DW1000, task for task as on a DWM1001.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

use boards::node::{self, Reporter};
use boards::wired::{self, Board, Bus, Delay, Interrupt, Reset};
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

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    let Board { uwb, delay, start, care } = Board::take();
    let reporter: &_ = REPORTER.init_with(|| Reporter::new(wired::uptime_us));
    let (hello, followed) = node::introduce(reporter, wired::KIND, wire::telemetry::Role::Anchor, start);
    if let Some((_, settings)) = followed {
        match settings.role {
            Role::Anchor { position_m } => {
                let radio =
                    RADIO.init_with(|| Dw1000::new(uwb.bus, uwb.interrupt, uwb.reset, uwb.delay, settings.radio));
                let machine = MACHINE.init_with(|| AnchorProtocol::new(&settings, position_m));
                care.ranging().spawn(ranging(radio, delay, machine, reporter).unwrap());
            }
            Role::Tag(_) | Role::Advertiser(_) => reporter.event_log.state(reporter.now_us(), Condition::WrongRecord),
        }
    }
    care.background().spawn(node::keep_telling(reporter, hello).unwrap());
    care.run(reporter)
}
