//! Tracks in space: a height that ranges do not determine, and rounds with missing ranges.

use positioning_core::Side;
use positioning_core::engine::{Dimensions, Engine, Measurement, Range, Settings, Solvers};
use rand::Rng;

use crate::support::{distance, normal, rng};

const SPACE: Dimensions<f32> = Dimensions::Space { side: Side::Unknown };
const ROUNDS: u64 = 150;

/// The results of many tags: root mean square errors horizontally and of the height, metres, the share of rounds with
/// a position, and the mean reported deviation of the height, metres.
#[derive(Debug)]
struct Score {
    across: f64,
    height: f64,
    fixed: f64,
    told: f64,
}

/// Walking tags under six anchors at these heights. Each range is lost with this probability. Links have errors of 6
/// cm, and all ranges together one of 10 cm.
fn run(settings: Settings<f32>, heights: [f64; 2], loss: f64) -> Score {
    let mut rng = rng(21);
    let anchors: [[f64; 3]; 6] = core::array::from_fn(|i| {
        let [x, y] = [[0.0, 0.0], [5.0, 0.0], [10.0, 0.0], [10.0, 7.0], [5.0, 7.0], [0.0, 7.0]][i];
        [x, y, heights[i % 2]]
    });
    let (mut across, mut height, mut fixed, mut told, mut rounds) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for _ in 0..40 {
        let mut engine = Engine::new(settings);
        let common = 0.1 * normal(&mut rng);
        let links: [f64; 6] = core::array::from_fn(|_| 0.06 * normal(&mut rng));
        let (from, turn) = (rng.random_range(0.0..6.3), rng.random_range(-0.4..0.4));
        for k in 1..=ROUNDS {
            let now_us = 100_000 * k;
            let angle = from + turn * 0.1 * k as f64;
            let tag = [5.0 + 3.0 * angle.cos(), 3.5 + 2.0 * angle.sin(), 1.2];
            for (anchor, place) in anchors.iter().enumerate() {
                let error = common + links[anchor] + 0.03 * normal(&mut rng);
                if !rng.random_bool(loss) {
                    let range = Range {
                        anchor: anchor as u16,
                        position_m: place.map(|c| c as f32),
                        distance_m: (distance(place, &tag) + error) as f32,
                        deviation_m: 0.03,
                        p_nlos: Some(0.1),
                        excess_m: None,
                    };
                    engine.step(now_us, &Measurement::Range(range));
                }
            }
            rounds += 1.0;
            let Ok(fix) = engine.step(now_us, &Measurement::RoundEnd).fix else { continue };
            let [x, y, z]: [f64; 3] = core::array::from_fn(|axis| f64::from(fix.position[axis]) - tag[axis]);
            fixed += 1.0;
            across += x * x + y * y;
            height += z * z;
            told += f64::from(fix.sigma()[2]);
        }
    }
    Score {
        across: (across / fixed).sqrt(),
        height: (height / fixed).sqrt(),
        fixed: fixed / rounds,
        told: told / fixed,
    }
}

#[test]
fn a_track_under_anchors_at_one_height_errs_no_more_than_rounds_by_themselves_and_has_more_of_them() {
    for loss in [0.0, 0.4] {
        let solved = run(Settings::solve(SPACE, Solvers::robust()), [2.6, 2.6], loss);
        let tracked = run(Settings::track(SPACE), [2.6, 2.6], loss);
        assert!(tracked.across < solved.across, "{loss}: {tracked:?} {solved:?}");
        // With losses the track has nearly twice as many rounds: also those that cannot be solved.
        assert!(tracked.height <= (1.0 + 0.5 * loss) * solved.height, "{loss}: {tracked:?} {solved:?}");
        assert!(tracked.told >= tracked.height, "{loss}: {tracked:?}");
        assert!(tracked.fixed > 0.98, "{loss}: {tracked:?} {solved:?}");
    }
}

#[test]
fn anchors_at_two_heights_tell_the_tags() {
    let solved = run(Settings::solve(SPACE, Solvers::robust()), [2.6, 0.3], 0.3);
    let tracked = run(Settings::track(SPACE), [2.6, 0.3], 0.3);
    assert!(tracked.across < solved.across && tracked.height < solved.height, "{tracked:?} {solved:?}");
    // The height is reported to decimetres, and its error is about as large as that.
    assert!(tracked.height < 0.2 && tracked.told < 0.3, "{tracked:?}");
}

#[test]
fn behind_walls_a_track_in_space_errs_no_more_than_its_rounds_and_its_deviation_tells() {
    let mut rng = rng(22);
    let anchors: [[f64; 3]; 8] = core::array::from_fn(|i| {
        let [x, y] =
            [[0.0, 0.0], [6.0, 0.0], [12.0, 0.0], [12.0, 4.0], [12.0, 8.0], [6.0, 8.0], [0.0, 8.0], [0.0, 4.0]][i];
        [x, y, if i % 2 == 0 { 2.7 } else { 0.4 }]
    });
    let (mut tracked, mut solved, mut consistency, mut rounds) = (0.0, 0.0, 0.0, 0.0);
    for _ in 0..40 {
        let mut engines = [Settings::track(SPACE), Settings::solve(SPACE, Solvers::robust())].map(Engine::<f32>::new);
        // Two links pass walls, which lengthen them by 0.3 to 1 m and add no noise.
        let walls: [usize; 2] = [rng.random_range(0..4), rng.random_range(4..8)];
        let links: [f64; 8] = core::array::from_fn(|i| {
            0.06 * normal(&mut rng) + if walls.contains(&i) { rng.random_range(0.3..1.0) } else { 0.0 }
        });
        let from = rng.random_range(0.0..6.3);
        for k in 1..=ROUNDS {
            let angle = from + 0.02 * k as f64;
            let tag = [6.0 + 3.0 * angle.cos(), 4.0 + 2.0 * angle.sin(), 1.2];
            let fixes = engines.each_mut().map(|engine| {
                for (anchor, place) in anchors.iter().enumerate() {
                    let distance_m = (distance(place, &tag) + links[anchor] + 0.02 * normal(&mut rng)) as f32;
                    let (anchor, position_m) = (anchor as u16, place.map(|c| c as f32));
                    let range =
                        Range { anchor, position_m, distance_m, deviation_m: 0.03, p_nlos: None, excess_m: None };
                    engine.step(100_000 * k, &Measurement::Range(range));
                }
                engine.step(100_000 * k, &Measurement::RoundEnd).fix.expect("eight ranges")
            });
            let off = |axis: usize, fix: usize| f64::from(fixes[fix].position[axis]) - tag[axis];
            let [square, of_solved] = [0, 1].map(|fix| off(0, fix).powi(2) + off(1, fix).powi(2));
            let c = fixes[0].covariance.map(|row| row.map(f64::from));
            let (x, y) = (off(0, 0), off(1, 0));
            let determinant = c[0][0] * c[1][1] - c[0][1] * c[1][0];
            consistency += (c[1][1] * x * x - 2.0 * c[0][1] * x * y + c[0][0] * y * y) / determinant;
            (tracked, solved, rounds) = (tracked + square, solved + of_solved, rounds + 1.0);
        }
    }
    assert!(tracked <= solved, "{} {}", (tracked / rounds).sqrt(), (solved / rounds).sqrt());
    assert!((0.5..4.0).contains(&(consistency / rounds)), "{}", consistency / rounds);
}
