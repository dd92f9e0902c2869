//! What is known of the building: the height at which a tag is carried, and the area in which it can be.

use positioning_core::engine::{Dimensions, Settings, Solvers};
use positioning_core::{Area, RangeSample};

use crate::sides::{Score, WALL, run};

const CORNERS: [[f64; 2]; 4] = [[2.0, 2.0], [10.0, 2.0], [10.0, 6.0], [2.0, 6.0]];

/// Anchors above the corners of the walk: 2.8 m above the tag, which passes below them. There an error of the height is a
/// large one of the distance in the plane.
const ABOVE: [[f64; 3]; 4] = [[2.0, 2.5, 3.9], [10.0, 2.5, 4.1], [10.0, 5.5, 3.9], [2.0, 5.5, 4.1]];

/// Walks at 1.2 m of a tag that is said to be by `low` metres lower, ± `height_sigma`: the greatest NEES of a walk, and the
/// share of positions beyond four deviations.
fn said_lower(settings: impl Fn(Dimensions<f32>) -> Settings<f32>, low: f32, height_sigma: f32) -> (f64, f64) {
    let scores: [Score; 5] = core::array::from_fn(|seed| {
        let settings = Settings { height_sigma, ..settings(Dimensions::Plane { height: 1.2 - low }) };
        run(settings, &ABOVE, &CORNERS, (10, 60), seed as u64, |_, _| true)
    });
    let sum = |of: fn(&Score) -> u32| f64::from(scores.iter().map(of).sum::<u32>());
    let worst = scores.iter().map(Score::nees).fold(0.0, f64::max);
    (worst, sum(|score| score.beyond_4_sigma) / sum(|score| score.positions))
}

#[test]
fn a_height_that_is_wrong_within_its_deviation_makes_no_confident_error() {
    let solve = |dimensions| Settings::solve(dimensions, Solvers::robust());
    for low in [-0.6, 0.6] {
        let of_track = [0.0, 0.35].map(|height_sigma| said_lower(Settings::track, low, height_sigma));
        let of_solve = [0.0, 0.35].map(|height_sigma| said_lower(solve, low, height_sigma));
        assert!(of_track[0].0 > 4.0, "{low}: {of_track:?}");
        for [exact, uncertain] in [of_track, of_solve] {
            assert!(uncertain.0 < 4.0 && uncertain.1 < 0.01, "{low}: {uncertain:?}, taken as exact {exact:?}");
        }
    }
}

#[test]
fn an_error_of_the_height_widens_a_flattened_range() {
    // 5 m from an anchor 3 m above are 4 m in the plane; 0.2 m of height are 0.2 · 3 ⁄ 4 = 0.15 m of them.
    let range = RangeSample { sigma: 0.2, ..RangeSample::new([0.0, 0.0], 5.0) };
    let [exact, uncertain] = [0.0, 0.2].map(|height_sigma| range.flattened(3.0, height_sigma));
    assert_eq!((exact.range, exact.sigma, uncertain.range), (4.0, 0.2, 4.0));
    let close = |a: f64, b: f64| (a - b).abs() < 1e-12;
    assert!(close(uncertain.sigma, 0.25), "{uncertain:?}");
}

#[test]
fn a_track_along_a_wall_stays_on_the_side_on_which_the_building_is() {
    let corners = [[2.0, 0.8], [10.0, 0.8], [10.0, 4.2], [2.0, 4.2]];
    let within = Area { min: [0.0, 0.0, f32::NEG_INFINITY], max: [12.0, 8.0, f32::INFINITY] };
    let settings = Settings { area: Some(within), ..Settings::track(Dimensions::Plane { height: 1.2 }) };
    let mut known: Vec<Score> =
        (1..=10).map(|seed| run(settings, &WALL, &corners, (10, 120), seed, |_, _| true)).collect();
    // Anchors that are surveyed within millimetres of a line make no position.
    known.retain(|score| score.positions > 0);
    assert!(known.len() > 7, "{known:?}");
    let is_right = |score: &Score| score.rmse() < 0.5 && score.nees() < 4.0 && score.confident_and_wrong == 0;
    assert!(known.iter().all(is_right), "{known:?}");
}
