//! Tracks whose anchors leave two sides alike, and tracks at high rates: what they say of their errors.

use positioning_core::engine::{Dimensions, Engine, Measurement, Range, Settings, Solvers};
use positioning_core::{Method, Side};
use rand_pcg::Pcg64;

use crate::support::{distance, normal, rng};

const PLANE: Dimensions<f32> = Dimensions::Plane { height: 1.2 };
const SPACE: Dimensions<f32> = Dimensions::Space { side: Side::Unknown };
const SEEDS: u64 = 20;

/// What a run shows of a track after its first three seconds.
#[derive(Debug, Default)]
pub struct Score {
    pub positions: u32,
    /// Errors of more than four deviations of all axes together.
    pub beyond_4_sigma: u32,
    /// Errors of more than a metre with a deviation below 0.3 m.
    pub confident_and_wrong: u32,
    /// The sum of squared errors, m².
    square: f64,
    /// The sum of squared errors over variances.
    nees: f64,
    /// Positions higher than 3.3 m.
    high: u32,
}

impl Score {
    pub fn rmse(&self) -> f64 {
        (self.square / f64::from(self.positions)).sqrt()
    }

    pub fn nees(&self) -> f64 {
        self.nees / f64::from(self.positions)
    }
}

/// A point on a closed path of these corners, walked at 1 m/s.
fn walk(corners: &[[f64; 2]], t_s: f64) -> [f64; 3] {
    let side = |k: usize| [corners[k % corners.len()], corners[(k + 1) % corners.len()]];
    let length = |[a, b]: [[f64; 2]; 2]| distance(&a, &b);
    let around: f64 = (0..corners.len()).map(|k| length(side(k))).sum();
    let (mut left, mut k) = (t_s % around, 0);
    while left > length(side(k)) {
        left -= length(side(k));
        k += 1;
    }
    let [a, b] = side(k);
    let part = left / length([a, b]);
    [a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]), 1.2]
}

/// Tracks a tag on a path for `seconds` among anchors, of which `is_on` tells those in reach. Their positions are
/// surveyed to 3 cm. Each link has an error of 8 cm that is another one each second, which is about a metre; each range
/// has 3 cm of noise.
pub fn run(
    settings: Settings<f32>,
    anchors: &[[f64; 3]],
    corners: &[[f64; 2]],
    (rate_hz, seconds): (u64, u64),
    seed: u64,
    is_on: impl Fn(usize, f64) -> bool,
) -> Score {
    let mut rng = rng(seed);
    let surveyed: Vec<[f64; 3]> = anchors.iter().map(|place| place.map(|c| c + 0.03 * normal(&mut rng))).collect();
    let errors: Vec<Vec<f64>> =
        (0..=seconds).map(|_| anchors.iter().map(|_| 0.08 * normal(&mut rng)).collect()).collect();
    let axes = if matches!(settings.dimensions, Dimensions::Plane { .. }) { 2 } else { 3 };
    let mut engine = Engine::new(settings);
    let mut score = Score::default();
    for k in 0..rate_hz * seconds {
        let t_s = k as f64 / rate_hz as f64;
        let now_us = 1_000_000 * k / rate_hz;
        let tag = walk(corners, t_s);
        for (anchor, place) in anchors.iter().enumerate().filter(|(anchor, _)| is_on(*anchor, t_s)) {
            let range = range(anchor, &surveyed[anchor], distance(place, &tag), t_s, &errors, &mut rng);
            engine.step(now_us, &Measurement::Range(range));
        }
        let Ok(fix) = engine.step(now_us, &Measurement::RoundEnd).fix else { continue };
        if t_s < 3.0 {
            continue;
        }
        let square: f64 = (0..axes).map(|axis| (f64::from(fix.position[axis]) - tag[axis]).powi(2)).sum();
        let variance: f64 = (0..axes).map(|axis| f64::from(fix.covariance[axis][axis])).sum();
        score.positions += 1;
        score.beyond_4_sigma += u32::from(square > 16.0 * variance);
        score.confident_and_wrong += u32::from(square > 1.0 && variance < 0.09);
        score.square += square;
        score.nees += square / variance;
        score.high += u32::from(fix.position[2] > 3.3);
    }
    score
}

/// A range whose link's error changes from that of one second to that of the next.
fn range(
    anchor: usize,
    place: &[f64; 3],
    distance_m: f64,
    t_s: f64,
    errors: &[Vec<f64>],
    rng: &mut Pcg64,
) -> Range<f32> {
    let (second, part) = (t_s as usize, t_s.fract());
    let next = errors.get(second + 1).map_or(0.0, |of| of[anchor]);
    let error = (1.0 - part) * errors[second][anchor] + part * next;
    Range {
        anchor: anchor as u16,
        position_m: place.map(|c| c as f32),
        distance_m: (distance_m + error + 0.03 * normal(rng)) as f32,
        deviation_m: 0.03,
        p_nlos: None,
        excess_m: None,
    }
}

const ROOM: [[f64; 3]; 6] =
    [[0.2, 0.2, 2.6], [11.8, 0.2, 1.8], [11.8, 7.8, 2.6], [0.2, 7.8, 1.8], [6.0, 0.2, 2.4], [6.0, 7.8, 2.4]];
pub const WALL: [[f64; 3]; 4] = [[0.5, 0.2, 2.05], [4.2, 0.2, 1.9], [7.8, 0.2, 1.98], [11.5, 0.2, 2.33]];

#[test]
fn a_track_along_a_wall_of_anchors_says_that_it_does_not_know_its_side() {
    let corners = [[2.0, 0.8], [10.0, 0.8], [10.0, 4.2], [2.0, 4.2]];
    let (mut tracked, mut beyond_4_sigma, mut positions) = (0, 0, 0);
    for seed in 1..=SEEDS {
        let score = run(Settings::track(PLANE), &WALL, &corners, (10, 120), seed, |_, _| true);
        // Anchors that are surveyed within millimetres of a line make no position: `collinear-anchors`.
        tracked += u32::from(score.positions > 1_100);
        assert!(score.positions > 1_100 || score.positions == 0, "{seed}: {score:?}");
        beyond_4_sigma += score.beyond_4_sigma;
        positions += score.positions;
        assert_eq!(score.confident_and_wrong, 0, "{seed}: {score:?}");
        assert!(score.positions == 0 || score.nees() < 4.0, "{seed}: {score:?}");
    }
    assert!(tracked > 15, "{tracked} of {SEEDS}");
    assert!(100 * beyond_4_sigma <= positions, "{beyond_4_sigma} of {positions}");
}

#[test]
fn a_track_that_turns_near_a_wall_of_anchors_keeps_both_sides() {
    // The two hypotheses come to one side of the line where the tag turns, 0.4 m from it.
    let corners = [[2.0, 1.0], [10.0, 0.6], [10.0, 4.0]];
    for seed in 1..=SEEDS {
        let score = run(Settings::track(PLANE), &WALL, &corners, (10, 120), seed, |_, _| true);
        assert_eq!(score.confident_and_wrong, 0, "{seed}: {score:?}");
        assert!(score.positions == 0 || score.nees() < 4.0, "{seed}: {score:?}");
    }
}

#[test]
fn a_track_on_the_wrong_side_of_a_wall_comes_back_when_a_link_insists_on_being_too_short() {
    let anchors = [[0.0, 8.0, 2.5], [6.0, 8.0, 1.5], [12.0, 8.0, 2.5], [0.0, 0.0, 2.5]];
    let (tag, image) = ([9.0, 5.0, 1.2], [9.0, 11.0, 1.2]);
    let mut rng = rng(41);
    let mut engine = Engine::new(Settings::track(PLANE));
    let errors = [vec![0.0; 4], vec![0.0; 4]];
    let mut off_m = [0.0; 60];
    for (k, off_m) in off_m.iter_mut().enumerate() {
        for (anchor, place) in anchors.iter().enumerate() {
            // For two seconds, a fault makes the range of the only anchor that tells the sides as long as at the image.
            let seen = if anchor == 3 && k < 20 { &image } else { &tag };
            let range = range(anchor, place, distance(place, seen), 0.0, &errors, &mut rng);
            engine.step(100_000 * k as u64, &Measurement::Range(range));
        }
        let fix = engine.step(100_000 * k as u64, &Measurement::RoundEnd).fix.expect("four ranges");
        *off_m = distance(&fix.position.map(f64::from), &tag);
    }
    // Twice the distance of 3 m to the wall.
    assert!((off_m[19] - 6.0).abs() < 0.5, "{off_m:?}");
    // Half a second of patience, and some rounds in which the ranges decide.
    assert!(off_m[30..].iter().all(|off_m| *off_m < 0.5), "{off_m:?}");
}

#[test]
fn a_track_that_crosses_the_line_of_its_last_two_anchors_follows_both_sides() {
    let corners = [[2.0, 2.0], [10.0, 2.0], [10.0, 6.0], [2.0, 6.0]];
    let (mut beyond_4_sigma, mut positions) = (0, 0);
    for seed in 1..=SEEDS {
        // From 40 s to 80 s, two of six anchors are left, in corners that face each other across the path.
        let score = run(Settings::track(PLANE), &ROOM, &corners, (10, 120), seed, |anchor, t_s| {
            !(40.0..80.0).contains(&t_s) || [2, 5].contains(&anchor)
        });
        beyond_4_sigma += score.beyond_4_sigma;
        positions += score.positions;
        assert_eq!(score.confident_and_wrong, 0, "{seed}: {score:?}");
        assert!(score.nees() < 4.0 && score.positions > 1_100, "{seed}: {score:?}");
    }
    assert!(100 * beyond_4_sigma <= positions, "{beyond_4_sigma} of {positions}");
}

#[test]
fn a_walk_at_full_rate_errs_no_more_than_at_10_hz() {
    let corners = [[4.0, 3.0], [9.0, 6.0], [4.0, 6.0]];
    let (mut slow, mut fast) = (0.0, 0.0);
    for seed in 1..=5 {
        let [of_slow, of_fast] = [10, 400]
            .map(|rate_hz| run(Settings::track(PLANE), &ROOM[..4], &corners, (rate_hz, 40), seed, |_, _| true));
        assert_eq!(of_fast.confident_and_wrong, 0, "{seed}: {of_fast:?}");
        slow += of_slow.rmse();
        fast += of_fast.rmse();
    }
    assert!(fast < 1.05 * slow, "{fast} {slow}");
}

#[test]
fn in_space_a_track_before_a_wall_of_anchors_says_that_it_does_not_know_its_side() {
    // Eight anchors within centimetres of a vertical plane, at heights that differ.
    let wall: [[f64; 3]; 8] =
        core::array::from_fn(|k| [0.5 + 1.5 * k as f64, 0.1 * (k % 3) as f64, [1.8, 2.6, 2.1, 2.4][k % 4]]);
    let corners = [[2.0, 1.0], [10.0, 1.0], [10.0, 4.2], [2.0, 4.2]];
    let (mut confident_and_wrong, mut beyond_4_sigma, mut positions) = (0, 0, 0);
    for seed in 1..=SEEDS {
        let score = run(Settings::track(SPACE), &wall, &corners, (10, 60), seed, |_, _| true);
        assert!(score.nees() < 4.0 && score.positions > 500, "{seed}: {score:?}");
        confident_and_wrong += score.confident_and_wrong;
        beyond_4_sigma += score.beyond_4_sigma;
        positions += score.positions;
    }
    assert!(100 * beyond_4_sigma <= positions, "{beyond_4_sigma} of {positions}");
    assert!(1000 * confident_and_wrong <= positions, "{confident_and_wrong} of {positions}");
}

#[test]
fn a_track_below_a_ceiling_of_anchors_does_not_climb_above_it() {
    let ceiling: [[f64; 3]; 5] = [[1.0, 1.0, 3.0], [7.0, 1.5, 3.0], [6.5, 6.0, 3.0], [1.5, 6.5, 3.0], [4.0, 3.5, 3.0]];
    // The tag passes the anchors at a distance, where ranges tell little of its height.
    let corners = [[-4.0, -4.0], [14.0, -4.0], [14.0, 12.0], [-4.0, 12.0]];
    for seed in 1..=SEEDS {
        let score = run(Settings::track(SPACE), &ceiling, &corners, (10, 60), seed, |_, _| true);
        assert!(score.positions > 500 && 100 * score.high <= score.positions, "{seed}: {score:?}");
    }
}

#[test]
fn a_fix_of_two_places_is_at_one_of_them() {
    // 6 m before anchors that are within 8 cm of a line at y = 0.275: the image is at y = −5.6 or so.
    let wall: [[f64; 3]; 4] = core::array::from_fn(|k| [WALL[k][0], 0.2 + 0.15 * (k % 2) as f64, WALL[k][2]]);
    let corners = [[3.0, 6.2], [9.0, 6.2]];
    let settings = Settings::solve(PLANE, Solvers::of(Method::Robust));
    let mut rng = rng(5);
    let errors = [vec![0.0; 4], vec![0.0; 4]];
    let mut ambiguous = 0;
    for k in 0..100 {
        let tag = walk(&corners, 0.12 * f64::from(k));
        let mut engine = Engine::new(settings);
        for (anchor, place) in wall.iter().enumerate() {
            let range = range(anchor, place, distance(place, &tag), 0.0, &errors, &mut rng);
            engine.step(0, &Measurement::Range(range));
        }
        let Ok(fix) = engine.step(0, &Measurement::RoundEnd).fix else { panic!("round {k}") };
        let (y, sigma) = (f64::from(fix.position[1]), fix.sigma()[1]);
        assert!((y.abs() - 5.9).abs() < 0.6, "round {k}: {y}");
        ambiguous += u32::from(sigma > 2.0);
    }
    assert!(ambiguous > 50, "{ambiguous}");
}
