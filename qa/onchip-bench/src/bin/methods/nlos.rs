//! The costs of telling blocked paths from direct ones: the features of an impulse response, and every
//! classifier.

use core::hint::black_box;

use onchip_bench::instrument::Instrument;
use onchip_bench::response::{features, for_each_classifier, response};
use positioning_core::nlos::Feature;
use semihosting::println;

/// Measures and prints.
pub fn print(instrument: &mut Instrument) {
    let response = response();
    let (cost, features) = instrument.cost(|| features(black_box(&response)));
    let skewness = features.get(Feature::SkewnessNear).unwrap_or(f32::NAN);
    println!("nlos features {} {} {:08x}", cost.instructions, cost.stack, skewness.to_bits());
    for_each_classifier(&mut |name, classifier| {
        let (cost, p) = instrument.cost(|| black_box(classifier).nlos_probability(black_box(&features)));
        println!("nlos {name} {} {} {:08x}", cost.instructions, cost.stack, p.unwrap_or(f32::NAN).to_bits());
    });
}
