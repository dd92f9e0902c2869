//! The tag in QEMU on a simulated DW1000, task for task as on a DWM1001 without Bluetooth.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

use boards::node::{self, Guard, Reporter};
use boards::wired::{self, Board, Bus, Delay, Interrupt, Reset};
use firmware_common::TagProtocol;
use firmware_tag::{AnchorPlace, Locator, RateControl, TelemetrySink};
use ranging::dw1000::Dw1000;
use static_cell::StaticCell;
use wire::config::{Role, Tag};
use wire::telemetry::Condition;

type Radio = Dw1000<Bus, Interrupt, Reset, Delay>;
type TaskChannels = firmware_tag::TaskChannels<Guard>;

static REPORTER: StaticCell<Reporter> = StaticCell::new();
static CHANNELS: StaticCell<TaskChannels> = StaticCell::new();
static RADIO: StaticCell<Radio> = StaticCell::new();
static MACHINE: StaticCell<TagProtocol> = StaticCell::new();
static ANCHORS: StaticCell<heapless::Vec<AnchorPlace, { wire::config::MAX_ANCHORS }>> = StaticCell::new();

/// What the tag's tasks share.
#[derive(Clone, Copy)]
struct Shared {
    channels: &'static TaskChannels,
    reporter: &'static Reporter,
    tag: Tag,
}

impl Shared {
    fn sink(&self) -> TelemetrySink<'static, Guard, { node::TELEMETRY_BYTES }> {
        TelemetrySink::new(self.reporter, self.tag.report_ranges)
    }
}

#[embassy_executor::task]
async fn ranging(radio: &'static mut Radio, delay: Delay, machine: &'static mut TagProtocol, shared: Shared) {
    firmware_tag::ranging(radio, delay, machine, shared.channels, &shared.sink()).await;
}

#[embassy_executor::task]
async fn engine(shared: Shared, anchors: &'static [AnchorPlace]) {
    let locator = Locator::new(shared.tag.height_m, anchors).by(shared.tag.solver);
    let rates = RateControl::of(&shared.tag);
    firmware_tag::engine(shared.channels, embassy_time::Delay, locator, rates, &shared.sink()).await;
}

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    let Board { uwb, delay, start, care } = Board::take();
    let reporter: &_ = REPORTER.init_with(|| Reporter::new(wired::uptime_us));
    let (hello, followed) = node::introduce(reporter, wired::KIND, wire::telemetry::Role::Tag, start);
    if let Some((record, settings)) = followed {
        match settings.role {
            Role::Tag(tag) => {
                let radio =
                    RADIO.init_with(|| Dw1000::new(uwb.bus, uwb.interrupt, uwb.reset, uwb.delay, settings.radio));
                let machine = MACHINE.init_with(|| TagProtocol::new(&settings, &tag));
                let anchors = ANCHORS.init_with(|| firmware_tag::places(&record));
                let shared = Shared { channels: CHANNELS.init_with(TaskChannels::new), reporter, tag };
                care.ranging().spawn(ranging(radio, delay, machine, shared).unwrap());
                care.background().spawn(engine(shared, anchors).unwrap());
            }
            Role::Anchor { .. } | Role::Advertiser(_) => {
                reporter.event_log.state(reporter.now_us(), Condition::WrongRecord);
            }
        }
    }
    care.background().spawn(node::keep_telling(reporter, hello).unwrap());
    care.run(reporter)
}
