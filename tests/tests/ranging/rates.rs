//! Positions per second, at 6.81 Mbit/s with 128 preamble symbols, on register-level chips and on processors whose code
//! takes time. The boards are DWM1001 unless stated otherwise.

use std::time::Duration;

use sim::scenario::{AirModel, Scenario};
use sim::{BoardProfile, Interrupts};
use system_tests::{Run, STAND, TAG, WALK, hall, tag};
use wire::config::Scheme;

/// The default room on the ideal air. On an air as recorded, fading makes powers unequal, and nodes join later.
fn room(anchors: usize, tags: usize) -> Scenario {
    Scenario { air: AirModel::Ideal, ..Scenario::rooms(anchors, tags) }
}

fn rooms(anchors: usize, tags: usize, seconds: f64) -> Run {
    Run::of(Scenario { seconds, ..room(anchors, tags) })
}

#[test]
fn one_tag_and_four_anchors_make_three_hundred_and_fifty_a_second() {
    let summary = rooms(4, 1, 8.0).summary;
    assert!(summary.fixes_per_s >= 350.0, "{summary:?}");
}

#[test]
fn one_tag_and_eight_anchors_make_a_hundred_and_eighty_a_second() {
    let summary = rooms(8, 1, 8.0).summary;
    assert!(summary.fixes_per_s >= 180.0, "{summary:?}");
}

/// Checks that all anchors of a round answer in 95 of a hundred rounds, from `from` seconds on. Returns positions per
/// second.
fn positions_of_whole_rounds(run: &Run, anchors: usize, from: f64, to: f64) -> f64 {
    let rounds: Vec<usize> = run
        .epochs(TAG)
        .filter(|(t_s, epoch)| (from..to).contains(t_s) && epoch.fix.asked > 0)
        .map(|(_, epoch)| epoch.ranges.len())
        .collect();
    let whole = rounds.iter().filter(|ranges| **ranges == anchors).count();
    assert!(whole * 100 >= rounds.len() * 95, "{whole} of {} rounds with all anchors", rounds.len());
    for anchor in 1..=anchors as u16 {
        assert!(!run.ranges(TAG, anchor, from, to).is_empty(), "anchor {anchor} is silent");
    }
    run.fix_times(TAG, from, to).len() as f64 / (to - from)
}

#[test]
fn no_anchor_is_silent_on_boards_two_and_four_times_slower_nor_on_others() {
    for (board, least) in [
        (BoardProfile::DWM1001, 350.0),
        (BoardProfile::DWM1001.slowed(2.0), 200.0),
        (BoardProfile::DWM1001.slowed(4.0), 80.0),
        (BoardProfile::ESP32C3, 150.0),
        (BoardProfile::EVB1000, 100.0),
    ] {
        let run = Run::of(Scenario { seconds: 5.0, board, ..room(4, 1) });
        let positions = positions_of_whole_rounds(&run, 4, 2.0, 5.0);
        assert!(positions >= least, "{} times {}: {positions} positions a second", board.name, board.slowdown);
    }
}

#[test]
fn double_sided_rounds_keep_their_rate() {
    for (anchors, least) in [(4, 280.0), (8, 140.0)] {
        let mut scenario = Scenario { seconds: 5.0, ..room(anchors, 1) };
        scenario.change_tags(|tag| tag.scheme = Some(Scheme::DoubleSided));
        let positions = positions_of_whole_rounds(&Run::of(scenario), anchors, 2.0, 5.0);
        assert!(positions >= least, "{anchors} anchors: {positions} positions a second");
    }
}

#[test]
fn ten_seconds_from_switching_on_have_the_promised_rate_whatever_the_seed() {
    let dwm1001 = BoardProfile::DWM1001;
    for (anchors, tags, board, scheme, least) in [
        (4, 1, dwm1001, Scheme::SingleSided, 350.0),
        (4, 1, dwm1001.slowed(2.0), Scheme::SingleSided, 200.0),
        (4, 1, dwm1001.slowed(4.0), Scheme::SingleSided, 80.0),
        (8, 1, dwm1001, Scheme::SingleSided, 180.0),
        (8, 1, dwm1001.slowed(2.0), Scheme::SingleSided, 100.0),
        (4, 1, dwm1001, Scheme::DoubleSided, 280.0),
        (8, 1, dwm1001, Scheme::DoubleSided, 140.0),
        (4, 1, BoardProfile::ESP32C3, Scheme::SingleSided, 150.0),
        (4, 1, BoardProfile::EVB1000, Scheme::SingleSided, 100.0),
        (16, 15, dwm1001, Scheme::SingleSided, 250.0),
    ] {
        for seed in [1, 2, 94] {
            let mut scenario = Scenario { seed, board, ..Scenario::rooms(anchors, tags) };
            scenario.change_tags(|tag| tag.scheme = Some(scheme));
            let summary = Run::of(scenario).summary;
            let which = format!("{} times {}, {tags} × {anchors}, seed {seed}", board.name, board.slowdown);
            assert!(summary.fixes_per_s >= least, "{which}: {summary:?}");
        }
    }
}

#[test]
fn interrupts_that_stall_a_tag_now_and_then_cost_a_tenth_of_its_rate_at_most() {
    // Four beacons, so that the tag scans.
    let beacon = |x: u8| format!("[[node]]\nrole = \"beacon\"\nposition_m = [{x}.0, 1.0, 2.0]\n");
    let beacons: String = (1..=4).map(beacon).collect();
    let walk = format!("path_m = {WALK}\nclosed = true");
    let rate = |per_second: f64, each: Duration| {
        let text = hall("seconds = 10", 4, &[]) + &tag("scan_interval_ms = 1000", &walk) + &beacons;
        let mut scenario = Scenario::parse(&text).expect("it is valid");
        let scanning = Interrupts { per_second, each };
        scenario.tags[0].board = Some(BoardProfile { scanning, ..scenario.board });
        Run::of(scenario).summary.fixes_per_s
    };
    let undisturbed = rate(0.0, Duration::ZERO);
    for (per_second, each_us) in [(2.0, 1_000), (10.0, 3_000), (20.0, 1_000), (50.0, 500)] {
        let disturbed = rate(per_second, Duration::from_micros(each_us));
        assert!(disturbed >= 0.9 * undisturbed, "{per_second} × {each_us} µs: {disturbed} of {undisturbed}");
    }
}

#[test]
fn a_tag_whose_engine_is_slow_makes_no_rounds_in_vain() {
    // A board without FPU, whose engine takes longer for a round than ranging takes.
    let summary = Run::of(Scenario { board: BoardProfile::EVB1000, ..room(4, 1) }).summary;
    // Ten sync frames per second from each anchor; a poll and four responses per round.
    let beacons = 10.0 * 4.0 * summary.seconds;
    let rounds = (summary.frames_sent as f64 - beacons) / 5.0;
    assert!(summary.fixes as f64 >= 0.9 * rounds, "of {rounds} rounds: {summary:?}");
}

#[test]
fn an_esp32_tag_receives_all_dwm1001_anchors_although_one_is_four_times_slower() {
    let mut scenario = Scenario { seconds: 6.0, ..room(4, 1) };
    scenario.tags[0].board = Some(BoardProfile::ESP32C3);
    scenario.anchors[2].board = Some(BoardProfile::DWM1001.slowed(4.0));
    let positions = positions_of_whole_rounds(&Run::of(scenario), 4, 3.0, 6.0);
    assert!(positions >= 80.0, "{positions} positions a second");
}

#[test]
fn fifteen_tags_and_sixteen_anchors_make_two_hundred_and_fifty_together_and_do_not_collide() {
    let mut simulation = sim::scenario::Simulation::new(room(16, 15));
    simulation.run_until(4.0);
    let joined = simulation.summary();
    let records = simulation.run_until(10.0);
    let summary = simulation.summary();
    assert!((summary.fixes - joined.fixes) as f64 / 6.0 >= 250.0, "{summary:?}");
    assert_eq!(summary.collisions, joined.collisions, "once joined nobody collides");
    let asked = records.iter().filter_map(|record| Some(record.epoch()?.fix.asked));
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
    let run = Run::of_text(&(hall("seconds = 7", 4, &[]) + &tag("rate_hz = 10", &format!("path_m = {STAND}"))));
    let rate = run.fix_times(TAG, 2.0, 7.0).len() as f64 / 5.0;
    assert!((9.0..=11.5).contains(&rate), "{rate}");
}

#[test]
fn all_anchors_are_received_with_any_number_of_members_in_their_beacons() {
    let run = rooms(8, 10, 4.0);
    for anchor in 1..=8 {
        let ranges = run.ranges(TAG, anchor, 3.0, 4.0).len();
        assert!(ranges > 20, "{ranges} ranges to anchor {anchor}");
    }
}
