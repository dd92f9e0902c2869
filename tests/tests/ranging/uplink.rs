//! The positions that anchors receive in tags' polls are those of the tags.

use sim::scenario::{Record, Scenario, Simulation, What};
use system_tests::{STAND, hall, tag};
use wire::telemetry::{Fix, Message, TagFix};

/// What a tag with this record and four anchors in a hall report.
fn run(seconds: f64, record: &str) -> Vec<Record> {
    let text = hall(&format!("seconds = {seconds}"), 4, &[]) + &tag(record, &format!("path_m = {STAND}"));
    Simulation::new(Scenario::parse(&text).expect("the test's scenario")).run_until(seconds)
}

/// The tag's fixes and what the anchors told of them, of the second half of a run of `seconds` with four anchors in a hall.
fn told(seconds: f64, record: &str) -> (Vec<Fix>, Vec<(u16, f64, TagFix)>) {
    let (mut fixes, mut told) = (Vec::new(), Vec::new());
    for record in run(seconds, &format!("tell_position = true\n{record}")) {
        match record.what {
            What::Epoch(epoch) => fixes.push(epoch.fix),
            What::Message(Message::TagFix(fix)) if record.t_s > seconds / 2.0 => {
                told.push((record.node, record.t_s, fix))
            }
            What::Message(_) | What::Fault(_) => {}
        }
    }
    (fixes, told)
}

#[test]
fn every_anchor_tells_the_positions_of_a_tag() {
    for (seconds, record, period_s) in
        [(6.0, "rate_hz = 10", 0.1), (4.0, "", 0.0), (60.0, "rate_hz = 0.5\nsleep = true", 2.0)]
    {
        let (fixes, told) = told(seconds, record);
        for anchor in 1..=4 {
            let of_anchor: Vec<_> = told.iter().filter(|(node, ..)| *node == anchor).collect();
            // A single poll may meet a sync frame of the anchor's own.
            let expected = if period_s > 0.0 { seconds / 2.0 / period_s } else { 350.0 * seconds / 2.0 };
            assert!(of_anchor.len() as f64 > 0.95 * expected - 1.0, "{record}, anchor {anchor}: {}", of_anchor.len());
            for (_, _, told) in of_anchor {
                let (poll, told) = (told.round, told.fix().expect("a position"));
                // A tag that has time to compute tells the last round.
                assert!(period_s == 0.0 || poll.wrapping_sub(told.round) == 1, "{record}: {poll} tells {}", told.round);
                let fix = fixes.iter().find(|fix| fix.round == told.round).expect("a round of the tag");
                let ([x, y, z], [of_x, of_y, of_z]) = (told.position_m().unwrap(), fix.position_m().unwrap());
                // Whole millimetres.
                assert!([x - of_x, y - of_y, z - of_z].iter().all(|off| off.abs() <= 0.0006), "{told:?} {fix:?}");
                for (told_m, of_m) in told.deviation_m().unwrap().into_iter().zip(fix.deviation_m().unwrap()) {
                    assert!((of_m..=1.0626 * of_m + 0.0003).contains(&told_m), "{told_m} of {of_m}");
                }
            }
        }
    }
}

#[test]
fn a_tag_that_tells_positions_is_no_slower() {
    let rate = |tells: bool| {
        let records = run(4.0, &format!("tell_position = {tells}"));
        records.iter().filter(|record| matches!(record.what, What::Epoch(_))).count() as f64
    };
    let (silent, telling) = (rate(false), rate(true));
    assert!(telling > 0.98 * silent, "{telling} of {silent} rounds");
}
