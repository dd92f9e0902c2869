//! The solvers against independent implementations: the formulas of P. M. de Rojas Malpartida's thesis (Universidad
//! de Sevilla, 2021) with full matrices, its grid search, and numbers computed by hand.

use crate::support::{distance, normal, rng, room, samples};
use nalgebra::{DMatrix, DVector};
use positioning_core::{Area, Constraints, Method, RangeSample, Side, SolveError, flatten, solve};

const AREA: Area<f64, 2> = Area { min: [0.0, 0.0], max: [12.0, 9.0] };

fn noisy_room(rng: &mut rand_pcg::Pcg64, count: usize) -> Vec<RangeSample<f64, 2>> {
    let (anchors, tag) = room::<2>(rng, count);
    samples(&anchors, &tag, |i| 0.05 * normal(rng) + if i % 3 == 1 { 0.96 + 0.6 * normal(rng).abs() } else { 0.0 })
}

/// 6-4, written with folds over the corners.
fn min_max(samples: &[RangeSample<f64, 2>]) -> [f64; 2] {
    [0, 1].map(|axis| {
        let low = samples.iter().map(|s| s.anchor[axis] - s.range).fold(f64::MIN, f64::max);
        let high = samples.iter().map(|s| s.anchor[axis] + s.range).fold(f64::MAX, f64::min);
        (low + high) / 2.0
    })
}

/// ½ (AᵀWA)⁻¹ AᵀWp with W the inverse of the whole covariance matrix (6-12, 6-13), as annexes K to M compute it.
fn dense_linear(samples: &[RangeSample<f64, 2>], sigma: Option<&[f64]>) -> [f64; 2] {
    let r = (0..samples.len()).min_by(|&i, &j| samples[i].range.total_cmp(&samples[j].range)).expect("samples");
    let others: Vec<usize> = (0..samples.len()).filter(|&i| i != r).collect();
    let n = others.len();
    let k = |i: usize| samples[i].anchor[0].powi(2) + samples[i].anchor[1].powi(2);
    let a = DMatrix::from_fn(n, 2, |row, axis| samples[others[row]].anchor[axis] - samples[r].anchor[axis]);
    let p = DVector::from_fn(n, |row, _| {
        samples[r].range.powi(2) - samples[others[row]].range.powi(2) - (k(r) - k(others[row]))
    });
    let w = sigma.map_or_else(
        || DMatrix::identity(n, n),
        |sigma| {
            let v = |i: usize| 4.0 * sigma[i].powi(2) * samples[i].range.powi(2) + 2.0 * sigma[i].powi(4);
            let c = DMatrix::from_fn(n, n, |row, col| v(r) + if row == col { v(others[row]) } else { 0.0 });
            c.try_inverse().expect("a covariance")
        },
    );
    let z = (a.transpose() * &w * &a).try_inverse().expect("anchors off a line") * a.transpose() * &w * p * 0.5;
    [z[0], z[1]]
}

/// |d − ‖z − a‖|, with the solver's centimetre added.
fn deviations(samples: &[RangeSample<f64, 2>], z: &[f64; 2]) -> Vec<f64> {
    samples.iter().map(|s| (s.range - distance(&s.anchor, z)).hypot(0.01)).collect()
}

#[test]
fn closed_forms_agree_with_full_matrices() {
    let mut rng = rng(11);
    for round in 0..500 {
        let samples = noisy_room(&mut rng, 4 + round % 13);
        let boxed = min_max(&samples);
        let sigma = deviations(&samples, &boxed);
        let least = sigma.iter().copied().fold(f64::MAX, f64::min);
        let corrected: Vec<f64> = sigma.iter().map(|&s| if s < 0.45 { least } else { s }).collect();
        let b_wls = dense_linear(&samples, Some(&sigma));
        let expected = [
            (Method::BoundingBox, boxed),
            (Method::Lls, dense_linear(&samples, None)),
            (Method::BWls, b_wls),
            (Method::BWlsC, dense_linear(&samples, Some(&corrected))),
            (Method::BWlsR, dense_linear(&samples, Some(&deviations(&samples, &b_wls)))),
        ];
        for (method, z) in expected {
            match solve(method, &samples, &Constraints::default()) {
                Ok(fix) => {
                    assert!(distance(&fix.position, &z) < 1e-6, "{method} {round}: {:?} not {z:?}", fix.position)
                }
                // A closed form with a large error by blocked ranges is refused, correctly.
                Err(reason) => assert_eq!(reason, SolveError::RangesDisjoint, "{method} {round} at {z:?}"),
            }
        }
    }
}

/// The thesis' search: the point of a 0.1 m grid with the least Σ β (d − ‖z − a‖)² (annexes I, J, N, O).
fn grid_search(samples: &[RangeSample<f64, 2>], beta: &[f64]) -> ([f64; 2], f64) {
    let cost = |z: [f64; 2]| -> f64 {
        samples.iter().zip(beta).map(|(s, b)| b * (s.range - distance(&s.anchor, &z)).powi(2)).sum()
    };
    let mut best = ([0.0; 2], f64::MAX);
    for i in 0..=120 {
        for j in 0..=90 {
            let z = [0.1 * f64::from(i), 0.1 * f64::from(j)];
            if cost(z) < best.1 {
                best = (z, cost(z));
            }
        }
    }
    best
}

#[test]
fn iterations_end_where_the_grid_search_does() {
    let mut rng = rng(12);
    let mut apart = Vec::new();
    for round in 0..150 {
        let mut samples = noisy_room(&mut rng, 5 + round % 8);
        for (i, sample) in samples.iter_mut().enumerate() {
            sample.los = Some(i % 3 != 1);
        }
        let sigma = deviations(&samples, &min_max(&samples));
        let least = sigma.iter().copied().fold(f64::MAX, f64::min);
        let reciprocal: Vec<f64> = sigma.iter().map(|s| 1.0 / s).collect();
        let corrected: Vec<f64> =
            sigma.iter().zip(&samples).map(|(s, d)| 1.0 / if s * d.range <= 0.45 { least } else { *s }).collect();
        let b_wls = dense_linear(&samples, Some(&sigma));
        let again: Vec<f64> = deviations(&samples, &b_wls).iter().map(|s| 1.0 / s).collect();
        let oracle: Vec<f64> = samples.iter().map(|s| if s.los == Some(true) { 1.0 } else { 0.005 }).collect();
        for (method, beta) in [
            (Method::Nls, vec![1.0; samples.len()]),
            (Method::NlsCcv, oracle),
            (Method::BbNls, reciprocal),
            (Method::BbNlsC, corrected),
            (Method::BbNlsR, again),
        ] {
            let inside = Constraints { side: Side::Unknown, area: Some(AREA) };
            let fix = solve(method, &samples, &inside).unwrap_or_else(|e| panic!("{method} {round}: {e}"));
            let (point, grid_cost) = grid_search(&samples, &beta);
            let cost: f64 = samples
                .iter()
                .zip(&beta)
                .map(|(s, b)| b * (s.range - distance(&s.anchor, &fix.position)).powi(2))
                .sum();
            // Either the same minimum, without the grid's step, or (rarely) another local one.
            apart.push((distance(&fix.position, &point), cost <= grid_cost));
        }
    }
    let same = apart.iter().filter(|(d, lower)| *lower && *d < 0.15).count();
    assert!(same * 100 >= apart.len() * 98, "{same} of {}", apart.len());
}

/// Anchors (0,0), (4,0), (0,4), tag (1,1), exact ranges √2, √10, √10. Boxes: x from max(−√2, 4 − √10, −√10) = 0.83772
/// to min(√2, …) = 1.41421: 1.12597, and y the same.
#[test]
fn bounding_box_by_hand() {
    let samples: Vec<RangeSample<f64, 2>> = [([0.0, 0.0], 2.0_f64), ([4.0, 0.0], 10.0), ([0.0, 4.0], 10.0)]
        .map(|(anchor, square)| RangeSample::new(anchor, square.sqrt()))
        .to_vec();
    let fix = solve(Method::BoundingBox, &samples, &Constraints::default()).expect("a fix");
    assert!(distance(&fix.position, &[1.125_97, 1.125_97]) < 1e-5, "{:?}", fix.position);
}

/// Four anchors around the tag at distance 5, along ±x and ±y: JᵀJ = 2·1, so each axis has a dilution of √½. With
/// residuals of ±0.1 m on each, the sandwich is ½ · (4 ⁄ 2 · 0.01 + 0.01) = 0.015 m² per axis (freedom N ⁄ (N − D) =
/// 2, prior variance 0.1² m²).
#[test]
fn covariance_and_dilution_by_hand() {
    let samples: Vec<RangeSample<f64, 2>> =
        [([5.0, 0.0], 5.1), ([-5.0, 0.0], 5.1), ([0.0, 5.0], 4.9), ([0.0, -5.0], 4.9)]
            .map(|(anchor, range)| RangeSample::new(anchor, range))
            .to_vec();
    let fix = solve(Method::Nls, &samples, &Constraints::default()).expect("a fix");
    assert!(distance(&fix.position, &[0.0, 0.0]) < 1e-6, "{:?}", fix.position);
    for axis in 0..2 {
        assert!((fix.dilution_of_precision[axis] - 0.5_f64.sqrt()).abs() < 1e-6, "{:?}", fix.dilution_of_precision);
        assert!((fix.covariance[axis][axis] - 0.015).abs() < 1e-6, "{:?}", fix.covariance);
    }
    assert_eq!(fix.used.len(), 4);
    // Each range keeps 9 σ² ⁄ (9 σ² + r²) = 0.09 ⁄ 0.10.
    assert!((fix.quality - 0.9).abs() < 1e-6, "{}", fix.quality);
}

/// √(5² − 4²) = 3. A range shorter than the height, or one that is not valid, gives the documented least distance.
#[test]
fn ranges_flatten_by_pythagoras() {
    assert_eq!(flatten(5.0_f64, -4.0), 3.0);
    assert_eq!(flatten(2.0_f64, 3.0), 0.1);
    assert_eq!(flatten(-0.2_f64, 0.0), 0.2);
    assert!(flatten(f64::NAN, 1.0).is_nan());
}

/// Ranges with white noise alone: a 95 % ellipse contains the true position in about 95 of 100 cases for the plain
/// methods. For the default method it does so more often, since that expects more than white noise.
#[test]
fn covariances_cover_the_truth() {
    let mut rng = rng(13);
    for (method, least, most) in [(Method::Nls, 0.90, 0.99), (Method::Lls, 0.88, 0.99), (Method::Robust, 0.93, 1.0)] {
        let mut inside = 0;
        for _ in 0..1000 {
            let (anchors, tag) = room::<2>(&mut rng, 8);
            let ranges = samples::<f64, 2>(&anchors, &tag, |_| 0.1 * normal(&mut rng));
            let fix = solve(method, &ranges, &Constraints::default()).expect("a fix");
            let e = [fix.position[0] - tag[0], fix.position[1] - tag[1]];
            let [[a, b], [_, d]] = fix.covariance;
            let mahalanobis = (d * e[0] * e[0] - 2.0 * b * e[0] * e[1] + a * e[1] * e[1]) / (a * d - b * b);
            // χ² of two degrees of freedom: 95 % below 5.991.
            inside += usize::from(mahalanobis < 5.991);
        }
        let share = inside as f64 / 1000.0;
        assert!((least..=most).contains(&share), "{method}: {share}");
    }
}
