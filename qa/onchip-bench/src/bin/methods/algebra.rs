//! The costs of libraries that positioning-core does without. It measures square roots one by one, and one step
//! of weighted least squares with twelve anchors, written by hand and with nalgebra.

use core::hint::black_box;

use onchip_bench::cases::DrawnEpoch;
use onchip_bench::instrument::Instrument;
use onchip_bench::step;
use positioning_core::{RangeSample, Real};

/// Measures and prints.
pub fn print(instrument: &mut Instrument) {
    compare(instrument, "core", Real::sqrt);
    compare(instrument, "libm", libm::sqrtf);
    compare(instrument, "micromath", micromath::F32Ext::sqrt);
}

/// One way to write the step. Input: samples and weights. Output: the position.
type Variant<'a> = dyn Fn(&[RangeSample<f32, 2>], &[f32]) -> Option<[f32; 2]> + 'a;

fn compare(instrument: &mut Instrument, library: &str, root: impl Fn(f32) -> f32 + Copy) {
    for argument in step::ROOTS_OF {
        let (cost, answer) = instrument.cost(|| root(black_box(argument)));
        cost.print(format_args!("root {library} {argument}"), &[answer]);
    }
    let epoch = DrawnEpoch::<2>::new(step::ANCHORS, 0);
    let weights = step::weights();
    let mut report = |variant: &str, call: &Variant| {
        let (cost, answer) = instrument.cost(|| call(black_box(epoch.samples()), black_box(&weights)));
        cost.print(format_args!("step {variant} {library}"), &answer.unwrap_or([f32::NAN; 2]));
    };
    report("hand", &|samples, weights| Some(step::by_hand(samples, weights, step::START, root)));
    report("nalgebra-sums", &|samples, weights| step::by_nalgebra_sums(samples, weights, step::START, root));
    report("nalgebra-matrices", &|samples, weights| step::by_nalgebra_matrices(samples, weights, step::START, root));
}
