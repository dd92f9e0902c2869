//! Complaints by users of other systems, each as a scenario of whole nodes: the driver on register-level chips.

use system_tests::{Run, STAND, TAG, WALK, anchor, fault, hall, tag};
use wire::telemetry::SolveError;

/// The time after which all nodes have joined, seconds.
const JOINED_S: f64 = 1.0;

/// "More than four anchors or one tag makes it freeze."
#[test]
fn nine_anchors_and_five_tags_do_not_freeze_it() {
    let run = Run::of_text(&hall("seconds = 6", 9, &[WALK; 5]));
    for tag in TAG..TAG + 5 {
        let gap = run.longest_gap(tag, 2.0, 6.0);
        assert!(gap < 0.2, "tag {tag}: {gap} s without a position");
    }
}

/// "A range changes when another anchor is switched on."
#[test]
fn an_anchor_that_is_switched_on_moves_no_other_range() {
    let text = hall("seconds = 6", 5, &[STAND]) + &fault(0.0, 5, "off") + &fault(3.0, 5, "on");
    let run = Run::of_text(&text);
    assert!(run.ranges(TAG, 5, 0.0, 3.0).is_empty(), "it was off");
    assert!(run.ranges(TAG, 5, 3.0, 6.0).len() > 100, "it is on");
    for anchor in 1..=4 {
        let (before, _) = run.range_error(TAG, anchor, JOINED_S, 3.0);
        let (after, _) = run.range_error(TAG, anchor, 4.0, 6.0);
        assert!((after - before).abs() < 0.01, "anchor {anchor}: {before} m, then {after} m");
    }
}

/// "An anchor needs a reset after a tag's reset": neither end needs a reset after the other's reset.
#[test]
fn neither_end_needs_a_reset_after_the_others() {
    let text = hall("seconds = 7", 4, &[STAND]) + &fault(2.0, TAG, "reset") + &fault(4.5, 2, "reset");
    let run = Run::of_text(&text);
    let again = |from_s| run.fix_times(TAG, from_s, from_s + 2.0).first().map(|t_s| t_s - from_s);
    assert!(again(2.0).is_some_and(|s| s < 1.0), "after the tag's reset: {:?} s", again(2.0));
    assert!(again(4.5).is_some_and(|s| s < 1.0), "after the anchor's reset: {:?} s", again(4.5));
    assert!(run.ranges(TAG, 2, 5.5, 7.0).len() > 100, "the anchor that was reset ranges again");
    for anchor in [1, 3, 4] {
        let (before, _) = run.range_error(TAG, anchor, JOINED_S, 2.0);
        let (after, _) = run.range_error(TAG, anchor, 4.5, 7.0);
        assert!((after - before).abs() < 0.01, "anchor {anchor}: {before} m, then {after} m");
    }
}

/// The anchor that coordinates vanishes: another one takes over.
#[test]
fn a_lost_coordinator_is_replaced_within_a_second() {
    // The coordinator after two seconds is one of the four anchors. Each anchor is switched off in its own run.
    for lost in 1..=4 {
        let text = hall("seconds = 6", 5, &[STAND]) + &fault(2.0, lost, "off") + &fault(4.0, lost, "on");
        let run = Run::of_text(&text);
        let gap = run.longest_gap(TAG, JOINED_S, 6.0);
        assert!(gap < 1.0, "anchor {lost} off: {gap} s without a position");
        assert!(run.ranges(TAG, lost, 5.0, 6.0).len() > 30, "anchor {lost} is back");
        for anchor in (1..=5).filter(|anchor| *anchor != lost) {
            let (before, _) = run.range_error(TAG, anchor, JOINED_S, 2.0);
            let (between, _) = run.range_error(TAG, anchor, 2.5, 4.0);
            let (after, _) = run.range_error(TAG, anchor, 5.0, 6.0);
            assert!((between - before).abs() < 0.01, "anchor {anchor} without {lost}: {before} m, then {between} m");
            assert!((after - before).abs() < 0.01, "anchor {anchor} with {lost} back: {before} m, then {after} m");
        }
    }
}

/// "A link at the edge of range dies for good."
#[test]
fn a_tag_that_comes_back_from_beyond_reach_is_found_again() {
    // 300 m away and back at 60 m/s: nothing is received beyond 150 m, and the edge is crossed slowly enough for the
    // link to degrade gradually. The tag is out of range from 2 s to about 10 s.
    let away = "path_m = [[10, 6, 1.2], [310, 6, 1.2], [10, 6, 1.2]]\nspeed_m_s = 60";
    let text = hall("seconds = 14", 4, &[]) + &tag("", away);
    let run = Run::of_text(&text);
    assert!(run.fix_times(TAG, 3.5, 7.0).is_empty(), "nobody hears the tag");
    assert!(run.longest_gap(TAG, 10.0, 14.0) < 0.2, "it is back and stays: {} s", run.longest_gap(TAG, 10.0, 14.0));
}

/// "The tag repeats one value for ever", and "0,0,0 instead of no fix".
#[test]
fn without_anchors_there_is_a_reason_and_no_old_value() {
    let off: String = (1..=4).map(|anchor| fault(2.0, anchor, "off")).collect();
    let run = Run::of_text(&(hall("seconds = 5", 4, &[STAND]) + &off));
    let positions: Vec<[f64; 3]> = run.epochs(TAG).filter_map(|(_, epoch)| epoch.fix.position_m()).collect();
    assert!(positions.len() > 300);
    // Positions are reported in steps of 0.1 mm, so two may be equal by chance.
    assert!(
        positions.windows(5).all(|five| five.iter().any(|one| *one != five[0])),
        "five positions are never the same"
    );
    assert!(positions.iter().all(|position| position[0] > 7.0), "never zero");
    let later: Vec<_> = run.epochs(TAG).filter(|(t_s, _)| *t_s > 2.01).collect();
    assert!(later.len() > 10, "it goes on asking: {}", later.len());
    assert!(later.iter().all(|(_, epoch)| epoch.fix.reason() == Some(SolveError::TooFewAnchors)), "a reason each time");
}

/// "5 s gaps every two minutes", and errors in anything that wraps after 17.2 s.
#[test]
fn five_minutes_have_no_gap() {
    let run = Run::of_text(
        &(hall("seconds = 300\nfidelity = \"air\"", 5, &[])
            + &tag("rate_hz = 10", &format!("path_m = {WALK}\nclosed = true"))),
    );
    let gap = run.longest_gap(TAG, JOINED_S, 300.0);
    assert!(gap < 0.35, "{gap} s without a position");
}

/// Two networks side by side on one channel: neither follows the other, and the ranges of both are undisturbed.
#[test]
fn two_networks_side_by_side_keep_apart() {
    let second: String = [[41.0, 1.0], [59.0, 1.0], [59.0, 11.0], [41.0, 11.0]]
        .map(|[x, y]| anchor([x, y, 2.5], "network = 1"))
        .concat();
    let second = second + &tag("", "network = 1\npath_m = [[50, 6, 1.2]]");
    let second = second + "[[simulation.network]]\npan = 0xBA13\npreamble_code = 10\n";
    let run = Run::of_text(&(hall("seconds = 4", 4, &[STAND]) + &second));
    for (tag, anchors) in [(TAG, 1..=4), (TAG + 1, 5..=8)] {
        assert!(run.fix_times(tag, 2.0, 4.0).len() > 100, "tag {tag}");
        for anchor in 1..=8 {
            let ranges = run.ranges(tag, anchor, 0.0, 4.0).len();
            assert_eq!(ranges > 0, anchors.contains(&anchor), "tag {tag}, anchor {anchor}: {ranges} ranges");
        }
    }
}
