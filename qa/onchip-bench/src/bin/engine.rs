//! Image: the costs of the engine's steps, range by range, for several numbers of links, in the plane and in space.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

use core::hint::black_box;

use onchip_bench::instrument::Instrument;
use onchip_bench::walk::{ANCHORS, Step, WARM_UP, walk};
use semihosting::println;

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    let mut instrument = Instrument::start();
    println!("calibration engine {}", instrument.calibration());
    for space in [false, true] {
        for anchors in ANCHORS {
            let warm_up = WARM_UP * (u32::from(anchors) + 1);
            let mut steps = 0;
            walk(anchors, space, |engine, step, now, measurement| {
                steps += 1;
                if steps > warm_up || step == Step::Start {
                    let cost = instrument.cost_on(engine, |engine| {
                        black_box(engine.step(black_box(now), black_box(measurement)));
                    });
                    let output = engine.step(now, measurement);
                    let position = output.fix.map_or([f32::NAN; 3], |fix| fix.position).map(f32::to_bits);
                    println!(
                        "engine {} {} {anchors} {} {} {:08x} {:08x} {:08x}",
                        step.as_str(),
                        if space { 3 } else { 2 },
                        cost.instructions,
                        cost.stack,
                        position[0],
                        position[1],
                        position[2]
                    );
                    return output;
                }
                engine.step(now, measurement)
            });
        }
    }
    println!("done");
    semihosting::process::exit(0)
}
