//! The anchor in QEMU on a simulated DW1000, task for task as on a DWM1001.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

use baliza_board_wired::{Board, Delay, Radio};
use firmware_anchor::TelemetrySink;
use firmware_anchor::node::{Anchor, Memory};
use firmware_common::node::{Node, Reporter};
use static_cell::StaticCell;
use wire::telemetry::Role;

static REPORTER: StaticCell<Reporter> = StaticCell::new();
static RADIO: StaticCell<Radio> = StaticCell::new();
static MEMORY: Memory = Memory::new();

#[embassy_executor::task]
async fn ranging(anchor: Anchor<Radio>, delay: Delay) {
    firmware_anchor::run(anchor.radio, delay, anchor.machine, TelemetrySink(anchor.reporter)).await;
}

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    let Board { uwb, delay, start, care } = Board::take();
    let (mut node, configured) = Node::start(&REPORTER, Role::Anchor, start);
    let radio = |config| RADIO.init_with(|| uwb.radio(config));
    if let Some(anchor) = configured.as_ref().and_then(|configured| MEMORY.anchor(&mut node, configured, radio)) {
        care.ranging().spawn(ranging(anchor, delay).unwrap());
    }
    care.run(node)
}
