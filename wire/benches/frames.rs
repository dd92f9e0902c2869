//! How many frames per second one core of the desktop decodes and encodes. `cargo bench -p telemetry`. One element is
//! one frame.

use std::hint::black_box;

use baliza_wire::telemetry::{Decoder, Diagnostics, Doubt, Fix, MAX_FRAME, Message, Outcome, Range, Solver, encode};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

const FRAMES: u32 = 1000;

fn fix(i: u32) -> Message {
    let place = [3.21 + 0.001 * i as f32, 4.05, 1.5];
    let covariance = [[0.0036, 0.0008, 0.0], [0.0008, 0.0025, -0.003], [0.0, -0.003, 0.0144]];
    Message::Fix(Fix {
        t_us: 3_600_000_000 + 100_000 * u64::from(i),
        round: i as u16,
        age_us: 8500,
        asked: 6,
        outcome: Outcome::position(place, covariance, 0b11_1011, 0.9),
        solver: Solver::Track,
        doubt: Doubt::None,
    })
}

fn range(i: u32) -> Message {
    let diagnostics = Diagnostics {
        rx_power_cdbm: -7925,
        first_path_power_cdbm: -8150,
        first_path_index_64ths: 47_712,
        first_path_amplitudes: [9000, 10_500, 8000],
        cir_power: 12_000,
        preamble_count: 118,
        noise_deviation: 52,
        clock_offset_cppm: -235,
    };
    Message::Range(Range {
        t_us: 3_600_000_000 + 100_000 * u64::from(i),
        round: i as u16,
        peer: 258,
        distance_tenth_mm: 54_321,
        deviation_tenth_mm: 350,
        position_tenth_mm: Some([0, -125_000, 24_000]),
        diagnostics,
    })
}

fn frames(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("frames");
    group.throughput(Throughput::Elements(FRAMES.into()));
    for (name, message) in [("fixes", fix as fn(u32) -> Message), ("ranges", range)] {
        let messages: Vec<Message> = (0..FRAMES).map(message).collect();
        let mut buffer = [0; MAX_FRAME];
        let stream: Vec<u8> = messages.iter().flat_map(|message| encode(message, &mut buffer).to_vec()).collect();
        group.bench_function(format!("decode {name}"), |bencher| {
            bencher.iter(|| {
                let mut decoder = Decoder::new();
                let whole = black_box(&stream).iter().filter_map(|byte| decoder.feed(*byte)).filter(Result::is_ok);
                assert_eq!(whole.map(black_box).count(), FRAMES as usize);
            });
        });
        group.bench_function(format!("encode {name}"), |bencher| {
            bencher.iter(|| {
                for message in &messages {
                    black_box(encode(black_box(message), &mut buffer));
                }
            });
        });
    }
    group.finish();
}

criterion_group!(benches, frames);
criterion_main!(benches);
