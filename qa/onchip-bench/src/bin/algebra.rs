//! Image: the costs of libraries that positioning-core does without. It measures square roots one by one, and one step
//! of weighted least squares with twelve anchors, written by hand and with nalgebra.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

use core::hint::black_box;

use onchip_bench::cases::Epoch;
use onchip_bench::instrument::Instrument;
use onchip_bench::step;
use positioning_core::{RangeSample, Real};
use semihosting::println;

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    let mut instrument = Instrument::start();
    println!("calibration algebra {}", instrument.calibration());
    compare(&mut instrument, "core", Real::sqrt);
    compare(&mut instrument, "libm", libm::sqrtf);
    compare(&mut instrument, "micromath", micromath::F32Ext::sqrt);
    println!("done");
    semihosting::process::exit(0)
}

/// One way to write the step. Input: samples and weights. Output: the position.
type Variant<'a> = dyn Fn(&[RangeSample<f32, 2>], &[f32]) -> Option<[f32; 2]> + 'a;

fn compare(instrument: &mut Instrument, library: &str, root: impl Fn(f32) -> f32 + Copy) {
    for argument in step::ROOTS_OF {
        let (cost, answer) = instrument.cost(|| root(black_box(argument)));
        println!("root {library} {argument} {} {:08x}", cost.instructions, answer.to_bits());
    }
    let epoch = Epoch::<2>::new(step::ANCHORS, 0);
    let weights = step::weights();
    let mut report = |variant: &str, call: &Variant| {
        let (cost, answer) = instrument.cost(|| call(black_box(epoch.samples()), black_box(&weights)));
        let [x, y] = answer.unwrap_or([f32::NAN; 2]).map(f32::to_bits);
        println!("step {variant} {library} {} {} {x:08x} {y:08x}", cost.instructions, cost.stack);
    };
    report("hand", &|samples, weights| Some(step::by_hand(samples, weights, step::START, root)));
    report("nalgebra-sums", &|samples, weights| step::by_nalgebra_sums(samples, weights, step::START, root));
    report("nalgebra-matrices", &|samples, weights| step::by_nalgebra_matrices(samples, weights, step::START, root));
}
