//! The costs of telling blocked paths from direct ones: the features of an impulse response, and every
//! classifier.

use core::hint::black_box;

use onchip_bench::instrument::Instrument;
use onchip_bench::response::{features, for_each_classifier, response};
use positioning_core::nlos::Feature;

/// Measures and prints.
pub fn print(instrument: &mut Instrument) {
    let response = response();
    let (cost, features) = instrument.cost(|| features(black_box(&response)));
    let skewness = features.get(Feature::SkewnessNear).unwrap_or(f32::NAN);
    cost.print(format_args!("nlos features"), &[skewness]);
    for_each_classifier(&mut |name, classifier| {
        let (cost, p) = instrument.cost(|| black_box(classifier).nlos_probability(black_box(&features)));
        cost.print(format_args!("nlos {name}"), &[p.unwrap_or(f32::NAN)]);
    });
}
