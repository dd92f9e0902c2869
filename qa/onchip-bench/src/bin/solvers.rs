//! Image: the costs of every positioning method, for every number of anchors, in the plane and in space, epoch by
//! epoch, with the positions found.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

use core::hint::black_box;

use onchip_bench::cases::{ANCHORS, EPOCHS, Epoch};
use onchip_bench::instrument::Instrument;
use positioning_core::{Constraints, Method};
use semihosting::{print, println};

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    let mut instrument = Instrument::start();
    println!("calibration solvers {}", instrument.calibration());
    for method in Method::ALL {
        for anchors in ANCHORS {
            for number in 0..EPOCHS {
                measure::<2>(&mut instrument, method, anchors, number);
                measure::<3>(&mut instrument, method, anchors, number);
            }
        }
    }
    println!("done");
    semihosting::process::exit(0)
}

fn measure<const D: usize>(instrument: &mut Instrument, method: Method, anchors: usize, number: u32) {
    let epoch = Epoch::<D>::new(anchors, number);
    // The method's own function, so that the measured stack is its own and not that of the largest method.
    let solver = black_box(method.solver::<f32, D>());
    let constraints = Constraints::default();
    let (cost, answer) = instrument.cost(|| solver(black_box(epoch.samples()), black_box(&constraints)));
    print!("solve {method} {D} {anchors} {number} {} {} ", cost.instructions, cost.stack);
    match answer {
        Ok(fix) => {
            print!("fix");
            for component in fix.position {
                print!(" {:08x}", component.to_bits());
            }
            println!();
        }
        Err(reason) => println!("none {reason}"),
    }
}
