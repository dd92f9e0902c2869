//! Image: the costs of the RSSI values of Bluetooth beacons: an advertisement, a scan, every method from RSSI values to
//! a position, and rooms.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

use core::hint::black_box;

use onchip_bench::beacons::{Measure, for_each};
use onchip_bench::instrument::Instrument;
use onchip_bench::rooms;
use semihosting::println;

struct Costs(Instrument);

impl Measure for Costs {
    fn call<S: Clone>(&mut self, what: &str, state: &S, call: impl Fn(&mut S) -> f32) {
        let cost = self.0.cost_on(state, |state| {
            black_box(call(black_box(state)));
        });
        let value = call(&mut state.clone());
        println!("beacons {what} {} {} {:08x}", cost.instructions, cost.stack, value.to_bits());
    }
}

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    let mut instrument = Instrument::start();
    println!("calibration beacons {}", instrument.calibration());
    let mut costs = Costs(instrument);
    for_each(&mut costs);
    rooms::for_each(&mut costs);
    println!("done");
    semihosting::process::exit(0)
}
