//! Positions a second on one core of the desktop: 8 anchors in the plane, `f32`, half of the ranges blocked.
//!
//! `cargo bench -p baliza-bench`. One element is one position.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use positioning_core::{Constraints, Method, RangeSample, solve};
use sim::alavi_pahlavan::{ANCHORS, anchors_m};

const SOLVED: usize = 1000;
const USED: usize = 8;

/// Points of the room in P. M. de Rojas Malpartida's thesis, with ranges to 8 of its 12 anchors: two of every three.
fn epochs() -> Vec<[RangeSample<f32, 2>; USED]> {
    let anchors = anchors_m();
    let points = papers::thesis::points(SOLVED, 1);
    let used = |i: usize| (3 * i / 2) % ANCHORS;
    let sample = |range: &sim::alavi_pahlavan::Range, anchor: [f64; 2]| RangeSample {
        los: Some(range.detected),
        ..RangeSample::new(anchor.map(|coordinate| coordinate as f32), range.range_m as f32)
    };
    points.iter().map(|point| std::array::from_fn(|i| sample(&point.ranges[used(i)], anchors[used(i)]))).collect()
}

fn fixes(criterion: &mut Criterion) {
    let epochs = epochs();
    let mut group = criterion.benchmark_group("fixes, 8 anchors, 2D, f32");
    group.throughput(Throughput::Elements(SOLVED as u64));
    for method in Method::ALL {
        group.bench_function(method.as_str(), |bencher| {
            bencher.iter(|| {
                for samples in &epochs {
                    let _ = black_box(solve(black_box(method), black_box(samples), &Constraints::default()));
                }
            });
        });
    }
    group.finish();
}

criterion_group!(benches, fixes);
criterion_main!(benches);
