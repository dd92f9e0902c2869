//! Image: the costs of methods call by call, with their results.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

mod algebra;
mod beacons;
mod engine;
mod exchange;
mod nlos;
mod solvers;

use onchip_bench::instrument::Instrument;
use semihosting::println;

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    let mut instrument = Instrument::start();
    println!("calibration methods {}", instrument.calibration());
    for print in [solvers::print, algebra::print, exchange::print, nlos::print, beacons::print, engine::print] {
        print(&mut instrument);
    }
    println!("done");
    semihosting::process::exit(0)
}
