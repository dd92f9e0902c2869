//! The engine as its callers use it: gates that reopen, restarts, and hostile input.

use nalgebra::Matrix3;
use positioning_core::engine::{
    BeaconPosition, Dimensions, Engine, Measurement, Missing, Range, Settings, Solvers, Start, Tdoa, Verdict,
};
use positioning_core::{Blocked, Constraints, Method, Motion, Noise, RangeSample, Side, flatten, robust};
use rand::Rng;
use rand_pcg::Pcg64;

use crate::support::{distance, normal, rng};

/// A room of 10 m × 8 m with eight anchors at two heights, metres.
pub(crate) const ANCHORS: [[f64; 3]; 8] = [
    [0.0, 0.0, 2.6],
    [5.0, 0.0, 0.4],
    [10.0, 0.0, 2.6],
    [10.0, 4.0, 0.4],
    [10.0, 8.0, 2.6],
    [5.0, 8.0, 0.4],
    [0.0, 8.0, 2.6],
    [0.0, 4.0, 0.4],
];
pub(crate) const HEIGHT: f64 = 1.2;
pub(crate) const PLANE: Dimensions<f32> = Dimensions::Plane { height: HEIGHT as f32 };
/// The time between two rounds, microseconds.
pub(crate) const ROUND_US: u64 = 100_000;

fn range(anchor: usize, distance: f64, blocked: Option<f32>) -> Measurement<f32> {
    Measurement::Range(Range {
        anchor: anchor as u16,
        position_m: ANCHORS[anchor].map(|c| c as f32),
        distance_m: distance as f32,
        deviation_m: 0.03,
        p_nlos: blocked,
        excess_m: None,
    })
}

pub(crate) fn true_range(anchor: usize, tag: [f64; 2]) -> f64 {
    distance(&ANCHORS[anchor], &[tag[0], tag[1], HEIGHT])
}

/// One round of ranges, each changed by `error`, and its end. Returns the horizontal error, metres.
fn round(engine: &mut Engine<f32>, now_us: u64, tag: [f64; 2], mut error: impl FnMut(usize) -> f64) -> Option<f64> {
    for anchor in 0..ANCHORS.len() {
        engine.step(now_us, &range(anchor, true_range(anchor, tag) + error(anchor), None));
    }
    let fix = engine.step(now_us, &Measurement::RoundEnd).fix.ok()?;
    Some((f64::from(fix.position[0]) - tag[0]).hypot(f64::from(fix.position[1]) - tag[1]))
}

/// A tag that moves in a circle of 2.5 m at 1 m/s.
fn circle(now_us: u64) -> [f64; 2] {
    let angle = 1.0e-6 * now_us as f64 / 2.5;
    [5.0 + 2.5 * angle.cos(), 4.0 + 2.5 * angle.sin()]
}

#[test]
fn one_range_in_ten_may_be_anything() {
    let error = |share: f64| {
        let mut rng = rng(3);
        let mut engine = Engine::new(Settings::track(PLANE));
        let links: Vec<f64> = ANCHORS.iter().map(|_| 0.05 * normal(&mut rng)).collect();
        let mut squares = Vec::new();
        for k in 1..600_u64 {
            let tag = circle(k * ROUND_US);
            let error = round(&mut engine, k * ROUND_US, tag, |anchor| {
                let wild = rng.random_range(0.0..100.0) - true_range(anchor, tag);
                if rng.random_bool(share) { wild } else { links[anchor] + 0.03 * normal(&mut rng) }
            });
            squares.extend(error.map(|error| error * error));
        }
        assert!(squares.len() > 595);
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    let (clean, wild) = (error(0.0), error(0.1));
    assert!(clean < 0.1 && wild < 1.2 * clean, "{clean} {wild}");
}

/// An engine that has tracked a tag at rest for 49 rounds.
fn tracked_at(tag: [f64; 2]) -> Engine<f32> {
    let mut engine = Engine::new(Settings::track(PLANE));
    for k in 1..50 {
        round(&mut engine, k * ROUND_US, tag, |_| 0.0);
    }
    engine
}

#[test]
fn a_link_that_becomes_longer_is_refused_and_then_taken_for_what_it_is() {
    let tag = [4.0, 3.0];
    let mut engine = tracked_at(tag);
    let mut verdicts = Vec::new();
    for k in 50..90 {
        for anchor in 0..ANCHORS.len() {
            let excess = if anchor == 2 { 1.5 } else { 0.0 };
            let output = engine.step(k * ROUND_US, &range(anchor, true_range(anchor, tag) + excess, None));
            if anchor == 2 {
                verdicts.push(output.verdict);
            }
        }
        let fix = engine.step(k * ROUND_US, &Measurement::RoundEnd).fix.expect("a track");
        let error = (f64::from(fix.position[0]) - tag[0]).hypot(f64::from(fix.position[1]) - tag[1]);
        assert!(error < 0.1, "round {k}: {error}");
    }
    assert_eq!(verdicts[0], Verdict::Refused);
    assert!(verdicts.contains(&Verdict::Readmitted));
    assert!(verdicts[20..].iter().all(|verdict| *verdict == Verdict::Used), "{verdicts:?}");
}

#[test]
fn ranges_that_are_shortened_alike_are_refused_for_ever_and_move_nothing() {
    let tag = [4.0, 3.0];
    let mut engine = tracked_at(tag);
    for k in 50..450 {
        for anchor in 0..ANCHORS.len() {
            let excess = if anchor == 2 { -1.5 } else { 0.0 };
            let output = engine.step(k * ROUND_US, &range(anchor, true_range(anchor, tag) + excess, None));
            let expected = if anchor == 2 { Verdict::Refused } else { Verdict::Used };
            assert_eq!(output.verdict, expected, "round {k}, anchor {anchor}");
        }
        let fix = engine.step(k * ROUND_US, &Measurement::RoundEnd).fix.expect("a track");
        let error = (f64::from(fix.position[0]) - tag[0]).hypot(f64::from(fix.position[1]) - tag[1]);
        assert!(error < 0.05, "round {k}: {error}");
    }
    // The true range is accepted again at once.
    let output = engine.step(450 * ROUND_US, &range(2, true_range(2, tag), None));
    assert_eq!(output.verdict, Verdict::Used);
}

#[test]
fn a_tag_that_is_carried_off_is_found_again() {
    let mut engine = tracked_at([2.0, 2.0]);
    let mut started = false;
    for k in 50..56 {
        for anchor in 0..ANCHORS.len() {
            engine.step(k * ROUND_US, &range(anchor, true_range(anchor, [8.0, 6.5]), None));
        }
        started |= engine.step(k * ROUND_US, &Measurement::RoundEnd).verdict == Verdict::Started(Start::Contradicted);
    }
    let error = round(&mut engine, 56 * ROUND_US, [8.0, 6.5], |_| 0.0).expect("a track");
    assert!(started && error < 0.1, "{started} {error}");
}

#[test]
fn silence_makes_a_track_doubtful_then_ends_it_and_a_round_begins_another() {
    let mut engine = Engine::new(Settings::track(PLANE));
    for k in 1..20 {
        round(&mut engine, k * ROUND_US, [4.0, 3.0], |_| 0.0);
    }
    let last = 19 * ROUND_US;
    let sigma = |engine: &mut Engine<f32>, later: u64| {
        let fix = engine.step(last + later, &Measurement::RoundEnd).fix;
        fix.map(|fix| (fix.sigma()[0], fix.age_us))
    };
    let (soon, age) = sigma(&mut engine, 1_000).expect("a track");
    let (later, _) = sigma(&mut engine, 2_000_000).expect("a track");
    assert!(later > 3.0 * soon && age == 1_000, "{soon} {later} {age}");
    assert_eq!(
        sigma(&mut engine, 3_600_000_000),
        Err(Missing::SolveError(positioning_core::SolveError::TooFewAnchors))
    );
    let error = round(&mut engine, last + 3_600_100_000, [7.0, 6.0], |_| 0.0).expect("a track");
    assert!(error < 0.1, "{error}");
}

#[test]
fn a_clock_that_begins_anew_ends_the_track_and_a_little_disorder_does_not() {
    let mut engine = Engine::new(Settings::track(PLANE));
    for k in 100..120 {
        round(&mut engine, k * ROUND_US, [4.0, 3.0], |_| 0.0);
    }
    let output = engine.step(119 * ROUND_US - 5_000, &range(0, true_range(0, [4.0, 3.0]), None));
    assert_eq!(output.verdict, Verdict::Used);
    let output = engine.step(7, &range(0, true_range(0, [4.0, 3.0]), None));
    assert_eq!((output.verdict, output.fix), (Verdict::Held, Err(Missing::Lost(Start::Clock))));
}

#[test]
fn a_tag_without_memory_gets_what_the_solver_says() {
    let settings = Settings::solve(PLANE, Solvers::of(Method::Robust)).with_noise(Noise::white());
    let mut engine = Engine::new(settings);
    let mut rng = rng(5);
    for k in 1..50 {
        let tag = [rng.random_range(1.0..9.0), rng.random_range(1.0..7.0)];
        let ranges: Vec<f64> = (0..8).map(|a| true_range(a, tag) + 0.05 * normal(&mut rng)).collect();
        let samples: Vec<RangeSample<f32, 2>> = (0..8)
            .map(|a| {
                let place = ANCHORS[a].map(|c| c as f32);
                let plane = flatten(ranges[a] as f32, place[2] - HEIGHT as f32);
                RangeSample { sigma: 0.03, ..RangeSample::new([place[0], place[1]], plane) }
            })
            .collect();
        for (anchor, &length) in ranges.iter().enumerate() {
            assert_eq!(engine.step(k * ROUND_US, &range(anchor, length, None)).verdict, Verdict::Held);
        }
        let found = engine.step(k * ROUND_US, &Measurement::RoundEnd).fix.expect("eight ranges");
        let expected = robust(&samples, &Constraints::default()).expect("eight ranges");
        assert_eq!([found.position[0], found.position[1]], expected.position);
        assert_eq!((found.used, found.quality), (expected.used, expected.quality));
        assert_eq!([found.covariance[0][0], found.covariance[0][1]], expected.covariance[0]);
    }
    assert_eq!(
        engine.step(60 * ROUND_US, &Measurement::RoundEnd).fix.map(|fix| fix.used),
        Err(Missing::SolveError(positioning_core::SolveError::TooFewAnchors))
    );
}

#[test]
fn blocked_ranges_are_ignored_unless_a_round_would_keep_too_few() {
    let run = |at_least: u8, mode_solve: bool| {
        let blocked = Blocked::Ignore { threshold: 0.5, at_least };
        let base = if mode_solve { Settings::solve(PLANE, Solvers::of(Method::Nls)) } else { Settings::track(PLANE) };
        let mut engine = Engine::new(base.with_blocked(blocked));
        let mut used = 0;
        for k in 1..4 {
            for anchor in 0..ANCHORS.len() {
                // Anchors 0, 2 and 4 are direct. Of the others, 7 is the least blocked, and 6 the next.
                let score = if [0, 2, 4].contains(&anchor) { 0.1 } else { 1.0 - 0.05 * anchor as f32 };
                engine.step(k * ROUND_US, &range(anchor, true_range(anchor, [4.0, 3.0]), Some(score)));
            }
            used = engine.step(k * ROUND_US, &Measurement::RoundEnd).fix.expect("enough ranges").used.0;
        }
        used
    };
    for mode_solve in [false, true] {
        assert_eq!(run(0, mode_solve), 0b0001_0101);
        assert_eq!(run(5, mode_solve), 0b1101_0101);
    }
}

#[test]
fn a_range_is_corrected_only_where_the_settings_say_so() {
    for (mitigate, expected) in [(false, 0.5), (true, 0.0)] {
        let mut engine = Engine::new(Settings { mitigate, ..Settings::solve(PLANE, Solvers::of(Method::Nls)) });
        for anchor in [0, 2, 4] {
            let position_m = ANCHORS[anchor].map(|c| c as f32);
            let distance_m = true_range(anchor, [4.0, 3.0]) as f32 + 0.5;
            let excess_m = Some(0.5);
            let measured = Range { anchor: 0, position_m, distance_m, deviation_m: 0.03, p_nlos: None, excess_m };
            engine.step(1, &Measurement::Range(measured));
        }
        let fix = engine.step(1, &Measurement::RoundEnd).fix.expect("three ranges");
        let found = distance(&[fix.position[0].into(), fix.position[1].into()], &[4.0, 3.0]);
        assert!(if mitigate { found < 0.01 } else { found > 0.4 * expected }, "{mitigate} {found}");
    }
}

/// A tag at rest.
fn lying(dimensions: Dimensions<f32>) -> Settings<f32> {
    let mut settings = Settings::track(dimensions);
    settings.filter.motion = Motion::Static { wander: 0.0 };
    settings
}

/// The tag's position by a map of RSSI values.
fn located(covariance_m2: [f32; 3], lasting: f32) -> Measurement<f32> {
    Measurement::BeaconPosition(BeaconPosition { position_m: [4.0, 4.0], covariance_m2, lasting })
}

#[test]
fn a_position_of_a_map_starts_a_track_and_its_error_lasts() {
    let settings = || lying(Dimensions::Plane { height: 1.0 });
    let mut engine = Engine::new(settings());
    assert_eq!(engine.step(1, &located([4.0, 0.0, 4.0], 1.0)).verdict, Verdict::Held);
    let start = engine.step(1, &Measurement::RoundEnd);
    assert_eq!(start.verdict, Verdict::Started(Start::First));
    assert_eq!(start.fix.expect("a track").position, [4.0, 4.0, 1.0]);

    // Known within 3 m before. A thousand values with a lasting error of 2 m count as one: 2 · 3 ⁄ √13 = 1.664 m.
    // With noise: 2 ⁄ √1000 = 0.063 m.
    for (lasting, expected) in [(1.0, 1.664), (0.0, 0.063)] {
        let mut engine = Engine::new(Settings { start_variance: Some(9.0), ..settings() });
        for k in 1..=1000_u64 {
            engine.step(1 + 100 * k, &located([4.0, 0.0, 4.0], lasting));
            engine.step(1 + 100 * k, &Measurement::RoundEnd);
        }
        let sigma = engine.step(100_002, &Measurement::RoundEnd).fix.expect("a track").sigma()[0];
        assert!((sigma - expected).abs() < 0.03 * expected + 0.005, "{lasting}: {sigma} m");
    }
}

#[test]
fn a_position_of_a_map_that_is_none_is_refused_and_in_space_ignored() {
    let mut engine = Engine::new(Settings::<f32>::track(Dimensions::Plane { height: 1.0 }));
    for (covariance, lasting) in
        [([0.0, 0.0, 1.0], 0.5), ([1.0, 2.0, 1.0], 0.5), ([1.0, f32::NAN, 1.0], 0.5), ([1.0, 0.0, 1.0], 1.5)]
    {
        assert_eq!(engine.step(1, &located(covariance, lasting)).verdict, Verdict::NotSane, "{covariance:?}");
    }
    let mut engine = Engine::new(Settings::<f32>::track(Dimensions::Space { side: Side::Unknown }));
    assert_eq!(engine.step(1, &located([1.0, 0.0, 1.0], 0.5)).verdict, Verdict::Ignored);
}

fn nasty(rng: &mut Pcg64) -> f32 {
    match rng.random_range(0..14) {
        0 => f32::NAN,
        1 => f32::INFINITY,
        2 => f32::NEG_INFINITY,
        3 => 0.0,
        4 => f32::MAX,
        5 => f32::MIN_POSITIVE,
        6 => 1e5,
        7 => -1e5,
        8 => rng.random_range(-3000.0..3000.0),
        _ => rng.random_range(-2.0..12.0),
    }
}

fn hostile(rng: &mut Pcg64, tag: [f64; 2]) -> Measurement<f32> {
    let anchor = rng.random_range(0..40_u16);
    let known = usize::from(anchor) % ANCHORS.len();
    let position_m =
        if rng.random_bool(0.05) { [nasty(rng), nasty(rng), nasty(rng)] } else { ANCHORS[known].map(|c| c as f32) };
    let bad = rng.random_bool(0.2);
    let p_nlos = rng.random_bool(0.5).then(|| nasty(rng));
    match rng.random_range(0..12) {
        0..=2 => Measurement::BeaconPosition(BeaconPosition {
            position_m: [nasty(rng), nasty(rng)],
            covariance_m2: core::array::from_fn(|_| nasty(rng)),
            lasting: nasty(rng),
        }),
        3 => Measurement::Tdoa(Tdoa {
            anchor,
            position_m,
            reference: rng.random_range(0..4),
            reference_m: ANCHORS[0].map(|c| c as f32),
            difference_m: nasty(rng),
            deviations_m: [nasty(rng), nasty(rng)],
            p_nlos: [p_nlos, None],
        }),
        4 => Measurement::RoundEnd,
        _ => Measurement::Range(Range {
            anchor,
            position_m,
            distance_m: if bad { nasty(rng) } else { true_range(known, tag) as f32 },
            deviation_m: if bad { nasty(rng) } else { 0.03 },
            p_nlos,
            excess_m: rng.random_bool(0.2).then(|| nasty(rng)),
        }),
    }
}

#[test]
fn whatever_comes_there_is_a_position_with_a_covariance_or_a_reason() {
    let mut rng = rng(17);
    for run in 0..150 {
        let dimensions = if run % 2 == 0 { PLANE } else { Dimensions::Space { side: Side::Unknown } };
        let two_variances = Blocked::TwoVariances { threshold: 0.5, direct_m2: 0.5, blocked_m2: 3.0 };
        let blocked = [Blocked::Alike, Blocked::Weigh, two_variances, Blocked::Ignore { threshold: 0.5, at_least: 4 }];
        let motion = [
            Motion::Static { wander: 0.1 },
            Motion::ConstantVelocity { acceleration: 1.0 },
            Motion::Adaptive { calm: 0.1, brisk: 2.0 },
        ];
        let mut settings = Settings { mitigate: run % 5 == 0, ..Settings::track(dimensions) };
        let filter = &mut settings.filter;
        (filter.blocked, filter.motion, filter.iterations) = (blocked[run % 4], motion[run % 3], (run % 6) as u8);
        let mut engine = Engine::new(settings);
        let mut now: u64 = rng.random_range(0..10_000_000);
        for _ in 0..400 {
            now = match rng.random_range(0..200) {
                0 => rng.random(),
                1 => now.saturating_sub(rng.random_range(0..5_000_000)),
                2 => now.saturating_add(rng.random_range(0..100_000_000_000)),
                _ => now.saturating_add(rng.random_range(0..50_000)),
            };
            let measurement = hostile(&mut rng, [4.0, 3.0]);
            if let Ok(fix) = engine.step(now, &measurement).fix {
                let covariance = Matrix3::from_fn(|r, c| f64::from(fix.covariance[r][c]));
                let least = covariance.symmetric_eigenvalues().min();
                let finite = fix.position.iter().chain(&fix.velocity).all(|number| number.is_finite());
                assert!(finite && least >= -1e-5 * covariance.trace(), "{measurement:?} {fix:?} {least}");
            }
        }
        // It then works as before.
        let begin = now.saturating_add(20_000_000).min(u64::MAX - 100 * ROUND_US);
        let mut error = None;
        for k in 0..20 {
            error = round(&mut engine, begin + k * ROUND_US, [4.0, 3.0], |_| 0.0);
        }
        if begin == now.saturating_add(20_000_000) && run % 2 == 0 {
            assert!(error.is_some_and(|error| error < 0.5), "run {run}: {error:?}");
        }
    }
}
