//! Input from a broken node, a bad file or an attacker: the result is a valid position or a reason, and never a
//! panic.

use crate::support::{rng, room, samples};
use positioning_core::{Area, Constraints, Fix, Method, RangeSample, Real, Side, SolveError, solve};
use rand::Rng;
use rand_pcg::Pcg64;

fn nasty<T: Real>(rng: &mut Pcg64) -> T {
    match rng.random_range(0..16) {
        0 => T::of(f64::NAN),
        1 => T::of(f64::INFINITY),
        2 => T::of(f64::NEG_INFINITY),
        3 => T::of(0.0),
        4 => T::of(-0.0),
        5 => T::of(f64::from(f32::MAX)),
        6 => T::of(f64::from(f32::MIN_POSITIVE)),
        7 => T::of(1e5),
        8 => T::of(-1e5),
        9 => T::of(rng.random_range(-3000.0..3000.0)),
        _ => T::of(rng.random_range(-2.0..30.0)),
    }
}

/// Mostly a plausible room with something wrong in it; sometimes only invalid numbers.
fn case<T: Real, const D: usize>(rng: &mut Pcg64) -> (Vec<RangeSample<T, D>>, Constraints<T, D>) {
    let count = rng.random_range(0..=17);
    let (anchors, tag) = room::<D>(rng, count);
    let mut list = samples::<T, D>(&anchors, &tag, |_| 0.1);
    for _ in 0..rng.random_range(0..4) {
        if count == 0 {
            break;
        }
        let (i, j) = (rng.random_range(0..count), rng.random_range(0..count));
        match rng.random_range(0..8) {
            0 => list[i].range = nasty(rng),
            1 => list[i].anchor[rng.random_range(0..D)] = nasty(rng),
            2 => list[i].anchor = list[j].anchor,
            3 => list[i] = list[j],
            4 => list[i].sigma = nasty(rng),
            5 => list[i].los = None,
            7 => list[i].p_blocked = nasty(rng),
            6 => list.iter_mut().for_each(|s| s.range = T::ZERO),
            _ => {
                let axis = rng.random_range(0..D);
                let shared = nasty(rng);
                list.iter_mut().for_each(|s| s.anchor[axis] = shared);
            }
        }
    }
    if rng.random_range(0..50) == 0 {
        for sample in &mut list {
            *sample = RangeSample {
                anchor: core::array::from_fn(|_| nasty(rng)),
                range: nasty(rng),
                sigma: nasty(rng),
                p_blocked: nasty(rng),
                los: rng.random::<bool>().then_some(true),
            };
        }
    }
    let side = if rng.random() { Side::Unknown } else { Side::Of(core::array::from_fn(|_| nasty(rng))) };
    let area = (rng.random_range(0..4) == 0)
        .then(|| Area { min: core::array::from_fn(|_| nasty(rng)), max: core::array::from_fn(|_| nasty(rng)) });
    (list, Constraints { side, area })
}

fn is_sound<T: Real, const D: usize>(fix: &Fix<T, D>, count: usize) -> bool {
    let finite = |values: &[T]| values.iter().all(|v| v.is_finite());
    finite(&fix.position)
        && fix.covariance.iter().all(|row| finite(row))
        && fix.sigma().iter().all(|&s| s.is_finite() && s >= T::ZERO)
        && finite(&fix.dilution_of_precision)
        && fix.quality >= T::ZERO
        && fix.quality <= T::ONE
        && fix.used.len() <= count
}

fn never_panics<T: Real, const D: usize>(seed: u64, cases: usize) {
    let mut rng = rng(seed);
    for round in 0..cases {
        let (list, constraints) = case::<T, D>(&mut rng);
        let method = Method::ALL[round % Method::ALL.len()];
        if let Ok(fix) = solve(method, &list, &constraints) {
            assert!(is_sound(&fix, list.len()), "{method} {round}: {fix:?} of {list:?} within {constraints:?}");
        }
    }
}

#[test]
fn half_a_million_hostile_planes() {
    never_panics::<f32, 2>(21, 500_000);
}

#[test]
fn half_a_million_hostile_spaces() {
    never_panics::<f32, 3>(22, 500_000);
}

#[test]
fn hostile_input_in_double_precision() {
    never_panics::<f64, 3>(23, 100_000);
}

fn reason(list: &[RangeSample<f32, 2>]) -> Vec<SolveError> {
    let mut reasons: Vec<SolveError> =
        Method::ALL.iter().filter_map(|&m| solve(m, list, &Constraints::default()).err()).collect();
    if reasons.len() == Method::ALL.len() {
        reasons.dedup();
    }
    reasons
}

fn ranges(list: &[([f32; 2], f32)]) -> Vec<RangeSample<f32, 2>> {
    list.iter().map(|&(anchor, range)| RangeSample { los: Some(true), ..RangeSample::new(anchor, range) }).collect()
}

#[test]
fn every_method_says_why_there_is_no_fix() {
    let corner = [([0.0, 0.0], 3.0), ([6.0, 0.0], 4.2), ([6.0, 6.0], 5.0), ([0.0, 6.0], 4.0)];
    assert_eq!(reason(&ranges(&corner[..2])), [SolveError::TooFewAnchors]);
    assert_eq!(reason(&[]), [SolveError::TooFewAnchors]);
    assert_eq!(reason(&vec![RangeSample::new([0.0, 1.0], 1.0); 17]), [SolveError::TooManyAnchors]);
    assert_eq!(reason(&ranges(&[corner[0], corner[1], ([6.0, 6.0], f32::NAN)])), [SolveError::NotFinite]);
    assert_eq!(reason(&ranges(&[corner[0], corner[1], ([6.0, f32::INFINITY], 5.0)])), [SolveError::NotFinite]);
    assert_eq!(reason(&ranges(&[([2.0, 3.0], 1.0); 5])), [SolveError::CoincidentAnchors]);
    let line = [([0.0, 0.0], 3.0), ([2.0, 2.0], 2.0), ([4.0, 4.0], 4.0), ([8.0, 8.0], 8.0)];
    assert_eq!(reason(&ranges(&line)), [SolveError::CollinearAnchors]);
    // Ten metres between the anchors and one metre to each.
    let apart = [([0.0, 0.0], 1.0), ([10.0, 0.0], 1.0), ([10.0, 10.0], 1.0), ([0.0, 10.0], 1.0)];
    assert_eq!(reason(&ranges(&apart)), [SolveError::RangesDisjoint]);
}

#[test]
fn one_anchor_twice_is_no_harm() {
    let list =
        ranges(&[([0.0, 0.0], 5.0), ([8.0, 0.0], 5.0), ([8.0, 6.0], 5.0), ([0.0, 6.0], 5.0), ([0.0, 6.0], 5.02)]);
    for method in Method::ALL {
        let fix = solve(method, &list, &Constraints::default()).unwrap_or_else(|e| panic!("{method}: {e}"));
        // The centre of the rectangle is 5 m from each corner.
        assert!((fix.position[0] - 4.0).abs() < 0.05 && (fix.position[1] - 3.0).abs() < 0.05, "{method} {fix:?}");
    }
}

/// A reflection makes one range of eight a kilometre long: the default does not notice.
#[test]
fn robust_ignores_a_kilometre() {
    let mut rng = rng(24);
    for _ in 0..200 {
        let (anchors, tag) = room::<2>(&mut rng, 8);
        let list = samples::<f32, 2>(&anchors, &tag, |i| if i == 3 { 1000.0 } else { 0.0 });
        let fix = solve(Method::Robust, &list, &Constraints::default()).expect("a fix");
        assert!(crate::support::error(&fix.position, &tag) < 0.3, "{:?} for {tag:?}", fix.position);
        assert!(!fix.used.contains(3));
    }
}
