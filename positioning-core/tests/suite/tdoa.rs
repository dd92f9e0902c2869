//! Differences of arrival compared with full matrices.

use nalgebra::{DMatrix, DVector, Matrix2};
use positioning_core::engine::{BeaconPosition, Dimensions, Engine, Measurement, Settings, Tdoa};
use positioning_core::{Blocked, Motion, SolveError, TdoaSample, hyperbolic};

use crate::support::{distance, normal, rng};

/// The anchors; the reference anchor is first, metres.
const ANCHORS: [[f64; 3]; 5] = [[0.0, 0.0, 2.8], [8.0, 0.5, 2.5], [7.5, 6.0, 2.9], [0.5, 6.5, 0.4], [4.0, 7.0, 1.5]];
/// Deviations of their arrivals, metres.
const SIGMAS: [f64; 5] = [0.2, 0.1, 0.3, 0.15, 0.25];

fn difference(anchor: usize, at: &[f64; 3]) -> f64 {
    distance(&ANCHORS[anchor], at) - distance(&ANCHORS[0], at)
}

/// Equation 6 of García et al.: σ₁² everywhere, plus σᵢ² on the diagonal.
fn covariance() -> DMatrix<f64> {
    DMatrix::from_fn(4, 4, |r, c| SIGMAS[0].powi(2) + if r == c { SIGMAS[r + 1].powi(2) } else { 0.0 })
}

/// The Jacobian by x and y, by central differences.
fn jacobian(at: &[f64; 3]) -> DMatrix<f64> {
    DMatrix::from_fn(4, 2, |row, axis| {
        let moved = |step: f64| {
            let mut at = *at;
            at[axis] += step;
            difference(row + 1, &at)
        };
        (moved(1e-5) - moved(-1e-5)) / 2e-5
    })
}

fn samples(differences: &[f64]) -> Vec<TdoaSample<f64>> {
    (1..5).map(|i| TdoaSample { anchor: ANCHORS[i], difference: differences[i - 1], sigma: SIGMAS[i] }).collect()
}

#[test]
fn the_start_is_the_weighted_least_squares_of_full_matrices() {
    let mut rng = rng(2);
    for tag in [[3.0, 2.0, 1.0], [6.0, 5.0, 1.4], [1.0, 4.0, 0.8]] {
        let measured: Vec<f64> = (1..5).map(|i| difference(i, &tag) + 0.05 * normal(&mut rng)).collect();
        let fix = hyperbolic(&samples(&measured), ANCHORS[0], SIGMAS[0], Some(tag[2]), None).expect("four differences");
        // Gauss-Newton with full matrices, from the true position.
        let weight = covariance().try_inverse().expect("a covariance");
        let mut at = tag;
        for _ in 0..50 {
            let j = jacobian(&at);
            let e = DVector::from_fn(4, |i, _| measured[i] - difference(i + 1, &at));
            let normal = j.transpose() * &weight * &j;
            let step = normal.try_inverse().expect("regular") * (j.transpose() * &weight * e);
            at[0] += step[0];
            at[1] += step[1];
        }
        assert!((fix.position[0] - at[0]).hypot(fix.position[1] - at[1]) < 1e-4, "{fix:?} {at:?}");
        let j = jacobian(&at);
        let expected = (j.transpose() * &weight * j).try_inverse().expect("regular");
        for (r, c) in [(0, 0), (0, 1), (1, 1)] {
            assert!((fix.covariance[r][c] / expected[(r, c)] - 1.0).abs() < 1e-3);
        }
        assert_eq!((fix.covariance[2], fix.position[2]), ([0.0; 3], tag[2]));
    }
}

#[test]
fn in_space_five_anchors_are_enough_and_four_are_not_without_height() {
    let tag = [3.0, 4.0, 1.2];
    let measured: Vec<f64> = (1..5).map(|i| difference(i, &tag)).collect();
    let fix = hyperbolic(&samples(&measured), ANCHORS[0], 0.1, None, Some([4.0, 3.0, 1.0])).expect("four differences");
    assert!(distance(&fix.position, &tag) < 1e-3, "{fix:?}");
    let few = &samples(&measured)[..2];
    assert_eq!(hyperbolic(few, ANCHORS[0], 0.1, None, None).map(|fix| fix.position), Err(SolveError::TooFewAnchors));
    let mut broken = samples(&measured);
    broken[1].difference = f64::NAN;
    assert_eq!(hyperbolic(&broken, ANCHORS[0], 0.1, None, None).map(|fix| fix.position), Err(SolveError::NotFinite));
    let same = [TdoaSample { anchor: [1.0, 1.0, 1.0], difference: 0.0, sigma: 0.1 }; 4];
    assert_eq!(hyperbolic(&same, [1.0; 3], 0.1, None, None).map(|fix| fix.position), Err(SolveError::Diverged));
}

#[test]
fn differences_one_by_one_make_the_update_of_their_full_covariance() {
    let tag = [3.0, 2.0, 1.0];
    let plain = Settings::<f64> {
        start_variance: Some(0.5),
        ..Settings::plain(Dimensions::Plane { height: 1.0 }, Motion::Static { wander: 0.0 }, Blocked::Alike, 1)
    };
    let mut engine = Engine::new(plain);
    // Very near the true position, so that all linearisations are the same.
    let start = [3.000_02, 1.999_99, 1.0];
    engine.step(
        1,
        &Measurement::BeaconPosition(BeaconPosition {
            position_m: [start[0], start[1]],
            covariance_m2: [0.5, 0.1, 0.4],
            lasting: 0.0,
        }),
    );
    engine.step(1, &Measurement::RoundEnd);
    let mut fix = None;
    for i in 1..5 {
        let tdoa = Tdoa {
            anchor: i as u16,
            position_m: ANCHORS[i],
            reference: 0,
            reference_m: ANCHORS[0],
            difference_m: difference(i, &tag),
            deviations_m: [SIGMAS[0], SIGMAS[i]],
            p_nlos: [None; 2],
        };
        fix = engine.step(1, &Measurement::Tdoa(tdoa)).fix.ok();
    }
    let fix = fix.expect("a track");
    // The start has a variance of 0.5 m², and the position by beacons has its own covariance.
    let by_beacons = DMatrix::from_row_slice(2, 2, &[0.5, 0.1, 0.1, 0.4]).try_inverse().expect("regular");
    let p = (DMatrix::identity(2, 2) / 0.5 + by_beacons).try_inverse().expect("regular");
    // Equation 5 with equation 6.
    let h = jacobian(&start);
    let gain = &p * h.transpose() * (&h * &p * h.transpose() + covariance()).try_inverse().expect("regular");
    let e = DVector::from_fn(4, |i, _| difference(i + 1, &tag) - difference(i + 1, &start));
    let moved = &gain * e;
    let after = (DMatrix::identity(2, 2) - gain * h) * p;
    let found = Matrix2::from_fn(|r, c| fix.covariance[r][c]);
    assert!((found - Matrix2::from_fn(|r, c| after[(r, c)])).amax() < 1e-5, "{found} {after}");
    let step = [fix.position[0] - start[0], fix.position[1] - start[1]];
    assert!((step[0] - moved[0]).abs() < 1e-7 && (step[1] - moved[1]).abs() < 1e-7, "{step:?} {moved}");
}

#[test]
fn a_track_of_differences_starts_by_itself_and_holds() {
    let mut rng = rng(9);
    let mut engine = Engine::new(Settings::<f32>::track(Dimensions::Plane { height: 1.0 }));
    let mut worst: f64 = 0.0;
    for k in 1..300_u64 {
        let angle = 0.02 * k as f64;
        let tag = [4.0 + 2.0 * angle.cos(), 3.5 + 2.0 * angle.sin(), 1.0];
        let reference = 0.03 * normal(&mut rng);
        for i in 1..5 {
            let tdoa = Tdoa {
                anchor: i as u16,
                position_m: ANCHORS[i].map(|c| c as f32),
                reference: 0,
                reference_m: ANCHORS[0].map(|c| c as f32),
                difference_m: (difference(i, &tag) + 0.03 * normal(&mut rng) - reference) as f32,
                deviations_m: [0.03; 2],
                p_nlos: [None; 2],
            };
            engine.step(50_000 * k, &Measurement::Tdoa(tdoa));
        }
        let fix = engine.step(50_000 * k, &Measurement::RoundEnd).fix.expect("a track");
        let error = (f64::from(fix.position[0]) - tag[0]).hypot(f64::from(fix.position[1]) - tag[1]);
        worst = worst.max(if k > 20 { error } else { 0.0 });
    }
    assert!(worst < 0.15, "{worst}");
}
