//! The costs of every positioning method, for every number of anchors, in the plane and in space, epoch by
//! epoch, with the positions found.

use core::hint::black_box;

use onchip_bench::cases::{ANCHORS, DrawnEpoch, EPOCHS};
use onchip_bench::instrument::Instrument;
use positioning_core::{Constraints, Method};

/// Measures and prints.
pub fn print(instrument: &mut Instrument) {
    for method in Method::ALL {
        for anchors in ANCHORS {
            for number in 0..EPOCHS {
                measure::<2>(instrument, method, anchors, number);
                measure::<3>(instrument, method, anchors, number);
            }
        }
    }
}

fn measure<const D: usize>(instrument: &mut Instrument, method: Method, anchors: usize, number: u32) {
    let epoch = DrawnEpoch::<D>::new(anchors, number);
    // The method's own function, so that the measured stack is its own and not that of the largest method.
    let solver = black_box(method.solver::<f32, D>());
    let constraints = Constraints::default();
    let (cost, answer) = instrument.cost(|| solver(black_box(epoch.samples()), black_box(&constraints)));
    match answer {
        Ok(fix) => cost.print(format_args!("solve {method} {D} {anchors} {number}"), &fix.position),
        Err(reason) => cost.print(format_args!("solve {method} {D} {anchors} {number} {reason}"), &[]),
    }
}
