//! The tag in QEMU on a simulated DW1000, task for task as on a DWM1001 without Bluetooth.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

use baliza_board_wired::{Board, Delay, Radio};
use firmware_common::node::{Node, Reporter};
use firmware_tag::node::{Memory, RangingParts, Tag};
use static_cell::StaticCell;
use wire::telemetry::Role;

static REPORTER: StaticCell<Reporter> = StaticCell::new();
static RADIO: StaticCell<Radio> = StaticCell::new();
static MEMORY: Memory = Memory::new();

#[embassy_executor::task]
async fn ranging(tag: &'static Tag, exchange: RangingParts<Radio>, delay: Delay) {
    tag.range(exchange, delay, &tag.sink()).await;
}

#[embassy_executor::task]
async fn engine(tag: &'static Tag) {
    tag.locate(embassy_time::Delay, &tag.sink()).await;
}

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    let Board { uwb, delay, start, care } = Board::take();
    let (mut node, configured) = Node::start(&REPORTER, Role::Tag, start);
    let radio = |config| RADIO.init_with(|| uwb.radio(config));
    if let Some((exchange, tag)) = configured.as_ref().and_then(|configured| MEMORY.tag(&mut node, configured, radio)) {
        care.ranging().spawn(ranging(tag, exchange, delay).unwrap());
        care.background().spawn(engine(tag).unwrap());
    }
    care.run(node)
}
