//! How many positions a second, on DWM1001 boards at 6.81 Mbit/s with 128 preamble symbols, on register-level chips.

use sim::scenario::Scenario;
use system_tests::{Run, STAND, TAG, WALK, hall};

fn rooms(anchors: usize, tags: usize, seconds: f64) -> Run {
    Run::of(Scenario { seconds, ..Scenario::rooms(anchors, tags) })
}

#[test]
fn one_tag_and_four_anchors_make_three_hundred_a_second() {
    let summary = rooms(4, 1, 5.0).summary;
    assert!(summary.fixes_per_s >= 300.0, "{summary:?}");
}

#[test]
fn one_tag_and_eight_anchors_make_a_hundred_and_fifty_a_second() {
    let summary = rooms(8, 1, 5.0).summary;
    assert!(summary.fixes_per_s >= 150.0, "{summary:?}");
}

#[test]
fn fifteen_tags_and_sixteen_anchors_make_three_hundred_together_and_do_not_collide() {
    let mut simulation = sim::scenario::Simulation::new(Scenario::rooms(16, 15));
    simulation.run_until(4.0);
    let joined = simulation.summary();
    let records = simulation.run_until(10.0);
    let summary = simulation.summary();
    assert!((summary.fixes - joined.fixes) as f64 / 6.0 >= 300.0, "{summary:?}");
    assert_eq!(summary.collisions, joined.collisions, "once joined nobody collides");
    let asked = records.iter().filter_map(|record| Some(record.epoch()?.asked));
    assert!(asked.into_iter().all(|asked| (4..=8).contains(&asked)));
}

#[test]
fn a_loss_of_thirty_in_a_hundred_costs_rate_and_never_stalls() {
    let rate = |loss: f64| {
        let run = Run::of_text(&hall(&format!("seconds = 10\nloss = {loss}"), 8, &[WALK]));
        (run.fix_times(TAG, 2.0, 10.0).len() as f64 / 8.0, run.longest_gap(TAG, 2.0, 10.0))
    };
    let ((lossless, _), (lossy, gap)) = (rate(0.0), rate(0.3));
    assert!(lossy >= 0.4 * lossless, "{lossy} a second against {lossless}");
    assert!(gap <= 0.2, "{gap} s without a position");
}

#[test]
fn a_slower_tag_gets_the_rate_it_asks_for() {
    let run = Run::of_text(&hall("seconds = 7\nrate_hz = 10", 4, &[STAND]));
    let rate = run.fix_times(TAG, 2.0, 7.0).len() as f64 / 5.0;
    assert!((9.0..=11.5).contains(&rate), "{rate}");
}

#[test]
fn all_anchors_are_heard_however_many_members_their_beacons_tell_of() {
    let run = rooms(8, 10, 4.0);
    for anchor in 1..=8 {
        let ranges = run.ranges(TAG, anchor, 3.0, 4.0).len();
        assert!(ranges > 20, "{ranges} ranges to anchor {anchor}");
    }
}
