//! Links that are blocked, anchors that are many or nearly on a line, single ranges, and jumps.

use positioning_core::engine::{Dimensions, Engine, Measurement, Range, Settings, Solvers, TrackFix, Verdict};
use positioning_core::{Constraints, RangeSample, Side, robust};
use rand::Rng;

use crate::engine::{ANCHORS, PLANE, ROUND_US, true_range};
use crate::support::{distance, normal, rng, samples};

fn range_to(anchor: usize, place: [f64; 3], distance_m: f64) -> Measurement<f32> {
    Measurement::Range(Range {
        anchor: anchor as u16,
        position_m: place.map(|c| c as f32),
        distance_m: distance_m as f32,
        deviation_m: 0.03,
        p_nlos: None,
        excess_m: None,
    })
}

fn off(fix: &TrackFix<f32>, tag: [f64; 2]) -> f64 {
    (f64::from(fix.position[0]) - tag[0]).hypot(f64::from(fix.position[1]) - tag[1])
}

/// The squared error in units of the covariance.
fn normalised(fix: &TrackFix<f32>, tag: [f64; 2]) -> f64 {
    let c = fix.covariance.map(|row| row.map(f64::from));
    let [x, y] = [0, 1].map(|axis| f64::from(fix.position[axis]) - tag[axis]);
    (c[1][1] * x * x - 2.0 * c[0][1] * x * y + c[0][0] * y * y) / (c[0][0] * c[1][1] - c[0][1] * c[1][0])
}

/// One round with these errors.
fn round(engine: &mut Engine<f32>, now_us: u64, tag: [f64; 2], errors: &[f64; 8]) -> Option<TrackFix<f32>> {
    for (anchor, error) in errors.iter().enumerate() {
        engine.step(now_us, &range_to(anchor, ANCHORS[anchor], true_range(anchor, tag) + error));
    }
    engine.step(now_us, &Measurement::RoundEnd).fix.ok()
}

/// A tag inside the anchors, and errors of its links: direct ones of some centimetres, and up to three blocked ones.
fn scene(rng: &mut rand_pcg::Pcg64) -> ([f64; 2], [f64; 8]) {
    let tag = [rng.random_range(1.0..9.0), rng.random_range(1.0..7.0)];
    let blocked: [usize; 3] = core::array::from_fn(|_| rng.random_range(0..16));
    let errors = core::array::from_fn(|anchor| {
        let more = if blocked.contains(&anchor) { rng.random_range(0.2..1.5) } else { 0.0 };
        0.06 * normal(rng) + more
    });
    (tag, errors)
}

#[test]
fn a_track_begins_within_the_deviation_of_the_fix_whatever_the_errors_are() {
    let mut rng = rng(31);
    let mut both = 0;
    for _ in 0..1000 {
        let (tag, errors) = scene(&mut rng);
        let mut solver = Engine::new(Settings::solve(PLANE, Solvers::robust()));
        let mut track = Engine::new(Settings::track(PLANE));
        let fix = round(&mut solver, ROUND_US, tag, &errors);
        let first = round(&mut track, ROUND_US, tag, &errors);
        let Some((fix, first)) = fix.zip(first) else { continue };
        both += 1;
        let step = (first.position[0] - fix.position[0]).hypot(first.position[1] - fix.position[1]);
        let sigma = fix.sigma()[0].hypot(fix.sigma()[1]);
        assert!(step <= sigma, "{step} m, {sigma} m: {errors:?}");
    }
    assert!(both > 990, "{both}");
}

#[test]
fn quiet_lies_of_two_links_cost_a_tag_at_rest_little_and_its_deviation_tells() {
    let mut rng = rng(32);
    let (mut square, mut solved_square, mut consistency) = (0.0, 0.0, 0.0);
    const TAGS: usize = 100;
    for _ in 0..TAGS {
        let tag = [rng.random_range(2.0..8.0), rng.random_range(2.0..6.0)];
        let links: [f64; 8] = core::array::from_fn(|_| 0.06 * normal(&mut rng));
        let liars = [rng.random_range(0..4), rng.random_range(4..8)];
        let mut engine = Engine::new(Settings::track(PLANE));
        let mut solver = Engine::new(Settings::solve(PLANE, Solvers::robust()));
        let mut last = None;
        for k in 1..=50 {
            let errors = core::array::from_fn(|anchor| {
                links[anchor] + 0.02 * normal(&mut rng) + if liars.contains(&anchor) { 0.6 } else { 0.0 }
            });
            last = round(&mut engine, k * ROUND_US, tag, &errors).zip(round(&mut solver, k * ROUND_US, tag, &errors));
        }
        let (fix, solved) = last.expect("eight ranges");
        square += off(&fix, tag).powi(2) / TAGS as f64;
        solved_square += off(&solved, tag).powi(2) / TAGS as f64;
        consistency += normalised(&fix, tag) / TAGS as f64;
    }
    // Plain least squares err by some 0.2 m here.
    assert!(square.sqrt() < 0.1 && square < 1.03 * solved_square, "{} {}", square.sqrt(), solved_square.sqrt());
    assert!((0.3..4.0).contains(&consistency), "{consistency}");
}

#[test]
fn after_a_jump_one_round_is_off_at_most_and_none_is_wrong_and_sure() {
    let mut rng = rng(33);
    for run in 0..50 {
        let from = [rng.random_range(1.0..4.0), rng.random_range(1.0..7.0)];
        let to = [rng.random_range(6.0..9.0), rng.random_range(1.0..7.0)];
        let mut engine = Engine::new(Settings::track(PLANE));
        let mut late = 0;
        for k in 1..60 {
            let tag = if k < 40 { from } else { to };
            let errors = core::array::from_fn(|_| 0.05 * normal(&mut rng));
            let fix = round(&mut engine, k * ROUND_US, tag, &errors).expect("eight ranges");
            late += usize::from(k >= 40 && off(&fix, tag) > 1.0);
            assert!(normalised(&fix, tag) < 25.0, "run {run}, round {k}: {} {:?}", off(&fix, tag), fix.sigma());
        }
        assert!(late <= 1, "run {run}: {late} rounds");
    }
}

#[test]
fn a_round_whose_anchors_are_mixed_up_does_not_carry_the_tag_off() {
    let tag = [3.0, 2.5];
    let mut engine = Engine::new(Settings::track(PLANE));
    for k in 1..80 {
        for anchor in 0..8 {
            // Turned by half a circle: these ranges fit perfectly at [7, 5.5].
            let measured = if k == 50 { true_range((anchor + 4) % 8, tag) } else { true_range(anchor, tag) };
            engine.step(k * ROUND_US, &range_to(anchor, ANCHORS[anchor], measured));
        }
        let fix = engine.step(k * ROUND_US, &Measurement::RoundEnd).fix.expect("eight ranges");
        assert!(normalised(&fix, tag) < 25.0, "round {k}: {fix:?}");
        assert!(k == 50 || off(&fix, tag) < 0.1, "round {k}: {fix:?}");
    }
}

/// Six anchors along a wall of ten metres, at most two centimetres off a line.
const ALONG_A_WALL: [[f64; 3]; 6] =
    [[0.0, 0.01, 2.5], [2.0, -0.02, 2.5], [4.0, 0.02, 2.5], [6.0, -0.01, 2.5], [8.0, 0.0, 2.5], [10.0, 0.01, 2.5]];

#[test]
fn anchors_nearly_on_a_line_leave_two_places_and_the_deviation_reaches_to_both() {
    let mut rng = rng(34);
    let (mut known, mut all, mut wrong) = (0, 0, 0);
    for _ in 0..100 {
        let tag = [rng.random_range(2.0..8.0), rng.random_range(1.5..6.0)];
        let links: [f64; 6] = core::array::from_fn(|_| 0.05 * normal(&mut rng));
        let mut engine = Engine::new(Settings::track(Dimensions::Plane { height: 1.2 }));
        for k in 1..=30 {
            for (anchor, place) in ALONG_A_WALL.iter().enumerate() {
                let measured = distance(place, &[tag[0], tag[1], 1.2]) + links[anchor] + 0.03 * normal(&mut rng);
                engine.step(k * ROUND_US, &range_to(anchor, *place, measured));
            }
            let fix = engine.step(k * ROUND_US, &Measurement::RoundEnd).fix.expect("six ranges");
            all += 1;
            // Along the wall it is known all the while.
            known += usize::from((f64::from(fix.position[0]) - tag[0]).abs() < 0.5);
            wrong += usize::from(normalised(&fix, tag) > 25.0);
        }
    }
    assert!(known > all * 95 / 100 && wrong < all / 10, "{known} and {wrong} of {all}");
}

#[test]
fn single_ranges_one_by_one_make_a_track_as_good_as_rounds() {
    let mean_square = |single: bool| {
        let mut rng = rng(35);
        let links: [f64; 8] = core::array::from_fn(|_| 0.05 * normal(&mut rng));
        let mut engine = Engine::new(Settings::track(PLANE));
        let (mut squares, mut fixes) = (0.0, 0);
        for k in 1..=1600_u64 {
            let now_us = 12_500 * k;
            let angle = 0.4e-6 * now_us as f64;
            let tag = [5.0 + 2.5 * angle.cos(), 4.0 + 2.5 * angle.sin()];
            let anchor = k as usize % 8;
            let measured = true_range(anchor, tag) + links[anchor] + 0.03 * normal(&mut rng);
            engine.step(now_us, &range_to(anchor, ANCHORS[anchor], measured));
            if single || anchor == 7 {
                let fix = engine.step(now_us, &Measurement::RoundEnd).fix;
                if let (Ok(fix), 7) = (fix, anchor) {
                    (squares, fixes) = (squares + off(&fix, tag).powi(2), fixes + 1);
                }
            }
        }
        assert!(fixes > 195, "{fixes}");
        squares / f64::from(fixes)
    };
    let (single, rounds) = (mean_square(true), mean_square(false));
    assert!(single < 1.1 * rounds, "{single} {rounds}");
}

#[test]
fn of_twenty_anchors_the_nearest_sixteen_serve_and_none_is_new_in_each_round() {
    let mut rng = rng(36);
    let anchors: [[f64; 3]; 20] = core::array::from_fn(|i| {
        let angle = i as f64 * core::f64::consts::TAU / 20.0;
        [20.0 * angle.cos(), 20.0 * angle.sin(), 2.5]
    });
    let tag = [6.0, 2.0];
    let links: [f64; 20] = core::array::from_fn(|_| 0.06 * normal(&mut rng));
    let mut engine = Engine::new(Settings::track(Dimensions::Plane { height: 1.2 }));
    let mut ignored = [0; 20];
    let mut sigma = Vec::new();
    for k in 1..=60 {
        for (anchor, place) in anchors.iter().enumerate() {
            let measured = distance(place, &[tag[0], tag[1], 1.2]) + links[anchor] + 0.02 * normal(&mut rng);
            let verdict = engine.step(k * ROUND_US, &range_to(anchor, *place, measured)).verdict;
            ignored[anchor] += usize::from(k > 10 && verdict == Verdict::Ignored);
        }
        let fix = engine.step(k * ROUND_US, &Measurement::RoundEnd).fix.expect("twenty ranges");
        sigma.push(f64::from(fix.sigma()[0]));
        assert!(off(&fix, tag) < 0.12, "round {k}: {fix:?}");
    }
    // The same four are left out all the while.
    assert!(ignored.iter().filter(|count| **count == 50).count() == 4, "{ignored:?}");
    assert_eq!(ignored.iter().sum::<usize>(), 200);
    // The errors of links last, so that sixty rounds say little more than one.
    assert!(sigma[59] > 0.5 * sigma[0], "{sigma:?}");
}

#[test]
fn powers_help_where_they_are_right_and_cost_little_where_they_are_wrong() {
    let constraints = Constraints { side: Side::Unknown, area: None };
    let rmse = |p_nlos: fn(bool) -> Option<f64>| {
        let mut rng = rng(37);
        let mut squares = 0.0;
        for _ in 0..2000 {
            let anchors: Vec<[f64; 2]> = ANCHORS.iter().map(|[x, y, _]| [*x, *y]).collect();
            let tag = [rng.random_range(1.0..9.0), rng.random_range(1.0..7.0)];
            let blocked: [bool; 8] = core::array::from_fn(|_| rng.random_bool(0.25));
            let list = samples::<f64, 2>(&anchors, &tag, |i| {
                0.08 * normal(&mut rng) + if blocked[i] { rng.random_range(0.2..1.2) } else { 0.0 }
            });
            let list: Vec<RangeSample<f64, 2>> =
                list.into_iter().zip(blocked).map(|(sample, blocked)| sample.with_p_nlos(p_nlos(blocked))).collect();
            let fix = robust(&list, &constraints).expect("eight ranges");
            squares += (fix.position[0] - tag[0]).powi(2) + (fix.position[1] - tag[1]).powi(2);
        }
        (squares / 2000.0).sqrt()
    };
    let (unknown, right) = (rmse(|_| None), rmse(|blocked| Some(if blocked { 0.9 } else { 0.1 })));
    let wrong = rmse(|blocked| Some(if blocked { 0.1 } else { 0.9 }));
    assert!(right < 0.95 * unknown && wrong < 2.0 * unknown, "{right} {unknown} {wrong}");
}
