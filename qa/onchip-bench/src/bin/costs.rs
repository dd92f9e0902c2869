//! Image: the costs of all code that a node runs, as simulations account for them.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

use core::hint::black_box;

use onchip_bench::beacons::{self, Measure};
use onchip_bench::costs::{Mean, driver, executor, protocol, tag};
use onchip_bench::instrument::Instrument;
use onchip_bench::response::{features, response};
use rtt_target::{ChannelMode, rtt_init, set_defmt_channel};
use semihosting::println;
use wire::uwb::native::{integrity_code, software_code};

/// Prints the cost of a computation as the cost of a tag.
struct Costs<'a>(&'a mut Instrument);

impl Measure for Costs<'_> {
    fn call<S: Clone>(&mut self, what: &str, state: &S, call: impl Fn(&mut S) -> f32) {
        let cost = self.0.cost_on(state, |state| {
            black_box(call(black_box(state)));
        });
        println!("cost tag.{what} {}", cost.instructions);
    }
}

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    // There is room for all lines: no probe takes them out.
    let channels = rtt_init! { up: { 0: { size: 4096, mode: ChannelMode::NoBlockSkip, name: "defmt" } } };
    set_defmt_channel(channels.up.0);
    let mut instrument = Instrument::start();
    println!("calibration costs {}", instrument.calibration());
    let response = response();
    let (cost, _) = instrument.cost(|| features(black_box(&response)));
    println!("cost tag.features {}", cost.instructions);
    beacons::for_advert(&mut Costs(&mut instrument));

    let costs = driver::measure();
    let resume = costs.resume.get().unwrap_or_default();
    let wake = executor::measure().get().unwrap_or_default();
    println!("cost executor.wake {}", wake + resume);
    for (name, mean) in [
        ("transaction", &costs.transaction),
        ("now", &costs.now),
        ("send-now", &costs.send_now),
        ("send-at", &costs.send_at),
        ("sent", &costs.sent),
        ("receive-begin", &costs.receive_begin),
        ("receive-go-on", &costs.receive_go_on),
        ("receive-frame", &costs.receive_frame),
        ("receive-timeout", &costs.receive_timeout),
        ("idle", &costs.idle),
    ] {
        print("driver", name, mean);
    }

    let costs = protocol::measure();
    for (name, mean) in [
        ("poll-made", &costs.poll_made),
        ("poll-answered", &costs.poll_answered),
        ("response-received", &costs.response_received),
        ("round-ended", &costs.round_ended),
        ("beacon-received", &costs.beacon_received),
        ("beacon-made", &costs.beacon_made),
        ("overheard", &costs.overheard),
        ("scheduled", &costs.scheduled),
    ] {
        print("machine", name, mean);
    }
    // A response of 21 bytes to a poll: four blocks.
    let (key, nonce, response) = (&[7; 16], &[8; 13], [&[9; 8][..], &[10; 21]]);
    let made =
        instrument.cost(|| integrity_code(&mut |block| _ = black_box(block), black_box(nonce), black_box(response))).0;
    println!("cost code.made {}", made.instructions);
    let software = instrument.cost(|| software_code(black_box(key), black_box(nonce), black_box(response))).0;
    println!("cost code.in-software {}", software.instructions);
    print("tag", "handover", &costs.handover);

    let mut publish_range = Mean::new();
    for (name, tracks, space) in [
        ("track-plane", true, false),
        ("track-space", true, true),
        ("solve-plane", false, false),
        ("solve-space", false, true),
    ] {
        for ranges in tag::RANGES {
            let costs = tag::measure(ranges, tracks, space);
            println!("cost tag.{name}-{ranges} {}", costs.round.get().unwrap_or_default());
            publish_range = costs.publish_range;
        }
    }
    print("tag", "publish-range", &publish_range);
    println!("cost tag.line {}", tag::measure_line());
    println!("done");
    semihosting::process::exit(0)
}

fn print(group: &str, name: &str, mean: &Mean) {
    match mean.get() {
        Some(instructions) => println!("cost {group}.{name} {instructions}"),
        None => panic!("{group}.{name} was never measured"),
    }
}
