//! Image: the costs of telling blocked paths from direct ones: the features of an impulse response, and every
//! classifier.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

use core::hint::black_box;

use onchip_bench::instrument::Instrument;
use onchip_bench::response::{features, for_each_classifier, response};
use positioning_core::nlos::Feature;
use semihosting::println;

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    let mut instrument = Instrument::start();
    println!("calibration nlos {}", instrument.calibration());
    let response = response();
    let (cost, features) = instrument.cost(|| features(black_box(&response)));
    let skewness = features.get(Feature::SkewnessNear).unwrap_or(f32::NAN);
    println!("nlos features {} {} {:08x}", cost.instructions, cost.stack, skewness.to_bits());
    for_each_classifier(&mut |name, classifier| {
        let (cost, p) = instrument.cost(|| black_box(classifier).nlos_probability(black_box(&features)));
        println!("nlos {name} {} {} {:08x}", cost.instructions, cost.stack, p.unwrap_or(f32::NAN).to_bits());
    });
    println!("done");
    semihosting::process::exit(0)
}
