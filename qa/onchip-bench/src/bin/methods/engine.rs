//! The costs of the engine's steps, range by range, for several numbers of links, in the plane and in space.

use core::hint::black_box;

use onchip_bench::instrument::Instrument;
use onchip_bench::walk::{ANCHORS, WARM_UP, WalkStep, walk};

/// Measures and prints.
pub fn print(instrument: &mut Instrument) {
    for space in [false, true] {
        for anchors in ANCHORS {
            let warm_up = WARM_UP * (u32::from(anchors) + 1);
            let mut steps = 0;
            walk(anchors, space, |engine, step, now, measurement| {
                steps += 1;
                if steps > warm_up || step == WalkStep::Start {
                    let cost = instrument.cost_on(engine, |engine| {
                        black_box(engine.step(black_box(now), black_box(measurement)));
                    });
                    let output = engine.step(now, measurement);
                    let dims = if space { 3 } else { 2 };
                    let position = output.fix.map_or([f32::NAN; 3], |fix| fix.position);
                    cost.print(format_args!("engine {} {dims} {anchors}", step.as_str()), &position);
                    return output;
                }
                engine.step(now, measurement)
            });
        }
    }
}
