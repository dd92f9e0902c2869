//! Random rooms for the tests: anchors, a tag, and the ranges between them.

use positioning_core::{RangeSample, Real};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

pub fn rng(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

/// A standard normal number, by Box and Muller.
pub fn normal(rng: &mut Pcg64) -> f64 {
    let (u, v): (f64, f64) = (rng.random_range(f64::MIN_POSITIVE..1.0), rng.random());
    (-2.0 * u.ln()).sqrt() * (core::f64::consts::TAU * v).cos()
}

pub fn distance<const D: usize>(a: &[f64; D], b: &[f64; D]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// A room of 12 × 9 × 3 m: `count` anchors along its walls at mixed heights, and a tag inside.
pub fn room<const D: usize>(rng: &mut Pcg64, count: usize) -> (Vec<[f64; D]>, [f64; D]) {
    let size = [12.0, 9.0, 3.0];
    let anchors = (0..count)
        .map(|i| {
            // Spread by the golden ratio, so that no set of them is nearly on a line.
            let along = (i as f64 * 0.618_034 + 0.1 * rng.random::<f64>()).fract() * 42.0;
            let [x, y] = match along {
                s if s < 12.0 => [s, 0.0],
                s if s < 21.0 => [12.0, s - 12.0],
                s if s < 33.0 => [33.0 - s, 9.0],
                s => [0.0, 42.0 - s],
            };
            let place = [x, y, if i % 2 == 0 { 0.3 } else { 2.7 } + 0.3 * rng.random::<f64>()];
            core::array::from_fn(|axis| place[axis])
        })
        .collect();
    let tag = core::array::from_fn(|axis| rng.random_range(0.1..0.9) * size[axis]);
    (anchors, tag)
}

/// Ranges from `tag` to `anchors`, each changed by `error`.
pub fn samples<T: Real, const D: usize>(
    anchors: &[[f64; D]],
    tag: &[f64; D],
    mut error: impl FnMut(usize) -> f64,
) -> Vec<RangeSample<T, D>> {
    anchors
        .iter()
        .enumerate()
        .map(|(i, anchor)| RangeSample {
            los: Some(true),
            ..RangeSample::new(anchor.map(T::of), T::of(distance(anchor, tag) + error(i)))
        })
        .collect()
}

/// Distance of a fix from the true position.
pub fn error<T: Real, const D: usize>(position: &[T; D], tag: &[f64; D]) -> f64 {
    distance(&position.map(T::to_f64), tag)
}
