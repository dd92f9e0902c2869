//! Image: what every positioning method costs, for every number of anchors, in the plane and in space, epoch by epoch, and
//! the positions it found.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

use core::hint::black_box;

use onchip_bench::cases::{ANCHORS, EPOCHS, Epoch};
use onchip_bench::instrument::Instrument;
use positioning_core::{Constraints, Fix, Method, NoFix, RangeSample};
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
    let solver = black_box(solver::<D>(method));
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

type Solver<const D: usize> = fn(&[RangeSample<f32, D>], &Constraints<f32, D>) -> Result<Fix<f32, D>, NoFix>;

/// The method's own function, so that its stack is its own and not that of the largest.
fn solver<const D: usize>(method: Method) -> Solver<D> {
    match method {
        Method::BoundingBox => positioning_core::bounding_box,
        Method::Lls => positioning_core::lls,
        Method::Nls => positioning_core::nls,
        Method::NlsCcv => positioning_core::nls_ccv,
        Method::BWls => positioning_core::b_wls,
        Method::BWlsC => positioning_core::b_wls_c,
        Method::BWlsR => positioning_core::b_wls_r,
        Method::BbNls => positioning_core::bb_nls,
        Method::BbNlsC => positioning_core::bb_nls_c,
        Method::BbNlsR => positioning_core::bb_nls_r,
        Method::Robust => positioning_core::robust,
    }
}
