//! Image: only its size matters, it never runs. It contains the methods that `ONCHIP_METHODS` selects at compile time:
//! "none", "all", or the index of one in [`Method::ALL`]. `ONCHIP_DIMS` selects the number of dimensions. The
//! difference to the size of the image with none is the code of the methods with all that they call.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

use core::hint::black_box;

use onchip_bench::cases::DrawnEpoch;
use positioning_core::{Constraints, Method, solve};
use semihosting::println;

const METHODS: &str = env!("ONCHIP_METHODS");
const IN_SPACE: bool = matches!(env!("ONCHIP_DIMS").as_bytes(), b"3");

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    if IN_SPACE {
        hold::<3>()
    } else {
        hold::<2>()
    }
    semihosting::process::exit(0)
}

fn hold<const D: usize>() {
    let epoch = black_box(DrawnEpoch::<D>::new(8, 0));
    let samples = epoch.samples();
    let constraints = black_box(Constraints::default());
    // Every image prints the first number of the result, so that the formatting is not counted.
    let bits = match METHODS.as_bytes() {
        b"none" => samples[0].range.to_bits(),
        b"all" => black_box(Method::ALL)
            .iter()
            .map(|&method| solve(method, samples, &constraints).map_or(0, |fix| black_box(fix).position[0].to_bits()))
            .fold(0, u32::wrapping_add),
        _ => solve(ONE, samples, &constraints).map_or(0, |fix| black_box(fix).position[0].to_bits()),
    };
    println!("{bits:08x}");
}

/// The method of an image with only one method.
const ONE: Method = match usize::from_str_radix(METHODS, 10) {
    Ok(place) => Method::ALL[place],
    Err(_) => Method::ALL[0],
};
