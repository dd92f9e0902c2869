//! The positions and data that anchors receive in tags' polls are those of the tags.

use std::collections::{HashMap, HashSet};

use sim::scenario::{Record, Scenario, Simulation, Summary, What};
use system_tests::{STAND, fault, hall, tag};
use wire::telemetry::{Fix, Message, TagData, TagFix};

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
fn a_tag_that_tells_positions_is_hardly_slower() {
    let rate = |tells: bool| {
        let records = run(4.0, &format!("tell_position = {tells}"));
        records.iter().filter(|record| matches!(record.what, What::Epoch(_))).count() as f64
    };
    let (silent, telling) = (rate(false), rate(true));
    // 16 bytes more: 16 µs each to write and to read them, and up to two steps of the layout's answer, 16 µs each, of a round
    // of 2.7 ms: 2.4 %.
    assert!(telling > 0.97 * silent, "{telling} of {silent} rounds");
}

/// What became of the data that a tag's user sends `every_s`, in `seconds`: the share that arrived, the rounds and fixes of
/// the tag, and the data that one anchor reported.
fn sends(seconds: f64, anchors: usize, every_s: f64, record: &str) -> (f64, Vec<Fix>, Vec<TagData>) {
    let user = format!("path_m = {STAND}\ndata_every_s = {every_s}");
    let text = hall(&format!("seconds = {seconds}"), anchors, &[]) + &tag(record, &user);
    let mut simulation = Simulation::new(Scenario::parse(&text).expect("the test's scenario"));
    let (mut fixes, mut data) = (Vec::new(), Vec::new());
    for record in simulation.run_until(seconds) {
        match record.what {
            What::Epoch(epoch) => fixes.push(epoch.fix),
            What::Message(Message::TagData(told)) if record.node == 1 => data.push(told),
            What::Message(_) | What::Fault(_) => {}
        }
    }
    (simulation.summary().data_share.expect("data"), fixes, data)
}

#[test]
fn data_of_a_tags_user_reach_the_anchors_as_they_were_sent() {
    for (seconds, anchors, every_s, record) in [
        (10.0, 4, 0.25, "rate_hz = 10\ntell_position = true"),
        (10.0, 8, 0.25, "tell_position = true"),
        (10.0, 4, 0.25, "tell_distances = true\nscheme = \"double-sided\""),
        (120.0, 4, 5.0, "rate_hz = 0.5\nsleep = true"),
    ] {
        let (share, fixes, data) = sends(seconds, anchors, every_s, record);
        // Each goes in two polls. The tag joins in the first second.
        assert!(share > 0.97, "{record}: {share}");
        for told in &data {
            let expected: [u8; 24] = std::array::from_fn(|i| if i % 2 == 0 { told.number } else { !told.number });
            assert_eq!(told.data(), expected, "{record}");
        }
        // Numbers in order, each twice at most.
        for pair in data.windows(2) {
            assert!(pair[1].number.wrapping_sub(pair[0].number) <= 2, "{record}: {pair:?}");
        }
        // Rounds with data ask one anchor fewer only where eight are asked; all have answers, and a position.
        let asked = |count| fixes.iter().filter(|fix| fix.asked == count).count();
        if anchors == 8 {
            assert!(asked(7) >= data.len() * 9 / 10 && asked(7) < fixes.len() / 10, "{} of {}", asked(7), fixes.len());
        } else {
            assert!(asked(4) > fixes.len() * 9 / 10, "{record}: {} of {}", asked(4), fixes.len());
        }
        let found = fixes.iter().filter(|fix| fix.position_m().is_some()).count();
        assert!(found as f64 > 0.97 * fixes.len() as f64 - 2.0, "{record}: {found} of {}", fixes.len());
    }
}

#[test]
fn a_user_who_sends_more_than_fits_is_refused_and_the_tag_ranges_on() {
    // Ten superframes a second carry data, each twice: five a second of a hundred.
    let (share, fixes, data) = sends(6.0, 8, 0.01, "");
    assert!((0.03..0.07).contains(&share) && data.len() > 40, "{share}, {}", data.len());
    let (_, silent, _) = sends(6.0, 8, 5.5, "");
    assert!(fixes.len() as f64 > 0.97 * silent.len() as f64, "{} of {} rounds", fixes.len(), silent.len());
}

/// What became of the positions of the tags in the four halls of the example, of which one anchor has a cable, with more
/// text and with these seconds.
fn halls(seconds: f64, more: &str) -> (Scenario, Vec<Record>, Summary) {
    let text = format!("{more}\n{}", include_str!("../../../examples/halls.toml"));
    // How soon halls with a key find each other depends on the seed: the share of a minute is 0.94 to 0.98.
    let scenario = Scenario { seconds, seed: 2, ..Scenario::parse(&text).expect("the example") };
    let mut simulation = Simulation::new(scenario.clone());
    let records = simulation.run_until(seconds);
    (scenario, records, simulation.summary())
}

/// How many positions tags have found between two times, and how many of them these anchors have told.
fn arrived(records: &[Record], (from_s, to_s): (f64, f64), tells: impl Fn(u16) -> bool) -> (usize, usize) {
    let found = records.iter().filter(|record| (from_s..to_s).contains(&record.t_s)).filter_map(|record| {
        Some((record.node, record.epoch().filter(|epoch| epoch.fix.position_m().is_some())?.fix.round))
    });
    let told = records.iter().filter(|record| tells(record.node)).filter_map(|record| match record.what {
        What::Message(Message::TagFix(told)) => Some((told.tag, told.fix()?.round)),
        _ => None,
    });
    let (found, told): (Vec<_>, HashSet<_>) = (found.collect(), told.collect());
    (found.len(), found.iter().filter(|of| told.contains(of)).count())
}

#[test]
fn anchors_pass_positions_on_through_four_halls_to_the_one_with_a_cable() {
    for key in ["", "[network]\nkey = \"8f3a11c20b6e4d57a9e0c1d2b3f40617\"\n"] {
        let (scenario, records, summary) = halls(60.0, key);
        // A tag tells its position a second later, in its next poll.
        let (found, told) = arrived(&records, (10.0, 56.0), |node| scenario.has_host(node));
        assert!(found > 1_300 && told as f64 > 0.985 * found as f64, "{told} of {found}");
        // In the first seconds the halls have coordinators of their own, and nobody knows a way: 5 % of a minute's positions.
        assert!(summary.uplink_share > Some(0.93) && summary.uplink_p99_s < Some(3.5), "{summary:?}");
        let (mut relayed, mut doubled) = (0, 0);
        let mut reported = HashSet::new();
        for record in records.iter().filter(|record| scenario.has_host(record.node)) {
            let What::Message(Message::TagFix(told)) = record.what else { continue };
            doubled += usize::from(!reported.insert((told.tag, told.round)));
            relayed += usize::from(told.age_us > 0);
            // Of a poll in its own hall or in the next ones, up to five seconds ago.
            assert!(told.age_us <= 5_200_000, "{told:?}");
        }
        assert!(relayed > reported.len() / 2, "{relayed} of {}", reported.len());
        // What comes a hundred reports later by another way is reported again; the station removes it.
        assert!(doubled <= reported.len() / 100, "{doubled} of {} twice", reported.len());
    }
}

#[test]
fn what_is_passed_on_has_the_time_of_its_poll() {
    let (_, records, _) = halls(30.0, "");
    // An anchor reports a poll when it has received it, and the one with a cable when it was passed on to it.
    let told = |with_cable: bool| {
        records.iter().filter_map(move |record| match record.what {
            What::Message(Message::TagFix(told)) if (record.node == 2) == with_cable => {
                Some(((told.tag, told.round), record.t_s - f64::from(told.age_us) / 1e6))
            }
            _ => None,
        })
    };
    let received: HashMap<(u16, u16), f64> = told(false).collect();
    let errors: Vec<f64> = told(true).filter_map(|(of, t_s)| Some((t_s - received.get(&of)?).abs())).collect();
    // 1/256 of a superframe, a step of a node, and what a report takes.
    let worst = errors.iter().copied().fold(0.0, f64::max);
    assert!(errors.len() > 500 && worst < 0.003, "{} positions, {worst} s", errors.len());
}

#[test]
fn another_anchor_with_a_cable_takes_over_within_three_seconds() {
    // One more cable at the other end, and the first one's anchor fails.
    let text = include_str!("../../../examples/halls.toml").to_owned() + &fault(30.0, 2, "off");
    let mut scenario = Scenario::parse(&text).expect("the example");
    scenario.anchors.last_mut().expect("anchors").gateway = true;
    let last = scenario.anchors.last().map(|anchor| anchor.address);
    let mut simulation = Simulation::new(Scenario { seconds: 60.0, ..scenario });
    let records = simulation.run_until(60.0);
    // From three seconds on.
    let (found, told) = arrived(&records, (33.0, 57.0), |node| Some(node) == last);
    assert!(found > 650 && told as f64 > 0.97 * found as f64, "{told} of {found}");
}

#[test]
fn data_of_users_are_passed_on_too() {
    let text = include_str!("../../../examples/halls.toml").replace("count = 30", "count = 20\ndata_every_s = 5");
    let scenario = Scenario::parse(&text).expect("the example");
    let mut simulation = Simulation::new(scenario);
    simulation.run_until(60.0);
    let summary = simulation.summary();
    assert!(summary.data_share > Some(0.97), "{summary:?}");
}

/// What became of the messages in four halls with one cable, where a host sends each of 20 tags one so often.
fn messages(every_s: f64, keys: &str, seconds: f64) -> Summary {
    let text = include_str!("../../../examples/halls.toml");
    let text = text.replace("count = 30", &format!("count = 20\nmessages_every_s = {every_s}"));
    let scenario = Scenario::parse(&(keys.to_owned() + &text)).expect("the example");
    let mut simulation = Simulation::new(scenario);
    simulation.run_until(seconds);
    simulation.summary()
}

#[test]
fn messages_of_a_host_reach_tags_in_all_halls_and_positions_arrive_meanwhile() {
    for keys in ["", "[network]\nkey = \"8f3a11c20b6e4d57a9e0c1d2b3f40617\"\n"] {
        // Two messages a second.
        let summary = messages(10.0, keys, 100.0);
        assert_eq!(summary.message_share, Some(1.0), "{keys}: {summary:?}");
        // Half are answered in the second poll, 2 s after they were sent; a lost one is sent again after 3 s.
        assert!(summary.message_p99_s < Some(6.0), "{keys}: {summary:?}");
        assert!(summary.uplink_share > Some(0.97), "{keys}: {summary:?}");
    }
}

#[test]
fn tags_that_sleep_for_ten_seconds_get_their_messages() {
    let text = include_str!("../../../examples/halls.toml").replace("rate_hz = 1", "rate_hz = 0.1\nsleep = true");
    let text = text.replace("count = 30", "count = 20\nmessages_every_s = 120");
    let mut simulation = Simulation::new(Scenario::parse(&text).expect("the example"));
    simulation.run_until(500.0);
    let summary = simulation.summary();
    assert_eq!(summary.message_share, Some(1.0), "{summary:?}");
    // A poll in which an anchor says that it has a message, and the next one with the answer: 20 s. Each may be lost, or
    // asks anchors that do not have it.
    assert!(summary.message_p99_s < Some(120.0), "{summary:?}");
}

#[test]
fn a_message_reaches_a_sleeping_tag_on_chips_with_a_key_and_costs_it_little() {
    let run = |messages: &str| {
        let user = format!("path_m = {STAND}\n{messages}");
        let text = hall("seconds = 120", 4, &[]) + &tag("rate_hz = 0.5\nsleep = true\ntell_position = true", &user);
        let text = format!("[network]\nkey = \"8f3a11c20b6e4d57a9e0c1d2b3f40617\"\n{text}");
        let mut simulation = Simulation::new(Scenario::parse(&text).expect("the test's scenario"));
        simulation.run_until(120.0);
        simulation.summary()
    };
    let (without, with) = (run(""), run("messages_every_s = 10"));
    assert_eq!((without.message_share, with.message_share), (None, Some(1.0)), "{with:?}");
    assert!(with.message_p99_s < Some(12.0) && with.slots_with_fix > Some(0.95), "{with:?}");
    // For each message a sync frame, 0.7 ms of 60 mA: 42 µC, and the anchor's answers name it: in ten seconds some 5 µA.
    let more_ma = with.tag_mean_current_ma.expect("chips") - without.tag_mean_current_ma.expect("chips");
    assert!(more_ma < 0.02, "{more_ma} mA more");
}
