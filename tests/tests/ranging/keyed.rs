//! Networks with a key on simulated chips: every code takes its processor time.

use sim::scenario::{Record, Scenario, Simulation, What};
use system_tests::{STAND, anchor, hall, tag};
use wire::telemetry::{Counters, Fix, Message};

const KEY: &str = "[network]\nkey = \"8f3a11c20b6e4d57a9e0c1d2b3f40617\"\n";

/// The fixes of a tag.
fn fixes(records: &[Record], tag: u16, from_s: f64) -> Vec<Fix> {
    let epochs = records.iter().filter(|record| record.node == tag && record.t_s >= from_s);
    epochs
        .filter_map(|record| match &record.what {
            What::Epoch(epoch) => Some(epoch.fix),
            What::Message(_) | What::Fault(_) => None,
        })
        .collect()
}

/// The last counters of a node.
fn counters(records: &[Record], node: u16) -> Counters {
    let of_node = records.iter().rev().filter(|record| record.node == node);
    let counters = |record: &Record| match record.what {
        What::Message(Message::Counters(counters)) => Some(counters),
        _ => None,
    };
    of_node.filter_map(counters).next().expect("counters")
}

#[test]
fn tags_with_a_key_range_sleep_and_report() {
    for (seconds, record, least_hz) in [
        (10.0, "", 300.0),
        (10.0, "scheme = \"double-sided\"", 200.0),
        (10.0, "rate_hz = 10\ntell_position = true", 9.8),
        (10.0, "rate_hz = 10\nscheme = \"double-sided\"", 9.8),
        (90.0, "rate_hz = 0.5\nsleep = true\ntell_position = true", 0.48),
    ] {
        // Data go in two polls.
        let user = format!("path_m = {STAND}\ndata_every_s = 5");
        let text = format!("{KEY}{}", hall(&format!("seconds = {seconds}"), 4, &[])) + &tag(record, &user);
        let mut simulation = Simulation::new(Scenario::parse(&text).expect("the test's scenario"));
        let records = simulation.run_until(seconds);
        let fixes = fixes(&records, 0x1001, seconds / 2.0);
        let found = fixes.iter().filter(|fix| fix.position_m().is_some()).count();
        assert!(found as f64 >= least_hz * seconds / 2.0 - 1.0, "{record}: {found} in {} s", seconds / 2.0);
        let share = simulation.summary().data_share.expect("data");
        assert!(share > 0.9, "{record}: {share} of the data");
        // Before a tag that sleeps has learned how long it takes to wake, a poll may come before its slot.
        let most = u32::from(record.contains("sleep"));
        for node in [0x1001, 1, 2, 3, 4] {
            assert!(counters(&records, node).refused <= most, "{record}: node {node}");
        }
    }
}

#[test]
fn every_board_has_the_time_for_codes() {
    for (board, slowdown, least_hz) in [
        ("esp32c3", 1, 150.0),
        ("esp32c6", 1, 150.0),
        ("dwm1001", 2, 130.0),
        ("evk1000", 1, 50.0),
        ("evk1000", 2, 20.0),
    ] {
        let simulation = format!("seconds = 8\nboard = \"{board}\"\ncpu_slowdown = {slowdown}");
        let text = format!("{KEY}{}", hall(&simulation, 4, &[STAND]));
        let records = Simulation::new(Scenario::parse(&text).expect("the test's scenario")).run_until(8.0);
        let found =
            fixes(&records, 0x1001, 4.0).iter().filter(|fix| fix.used().map_or(0, u16::count_ones) == 4).count();
        assert!(found as f64 >= least_hz * 4.0, "{board} {slowdown} times slower: {found} in 4 s");
        for node in [0x1001, 1, 2, 3, 4] {
            assert_eq!(counters(&records, node).refused, 0, "{board}: node {node}");
        }
    }
}

#[test]
fn two_sites_with_one_pan_and_different_keys_refuse_each_other() {
    let mut text = format!("{KEY}[simulation]\nair = \"ideal\"\nseconds = 10\n");
    text += "[[simulation.network]]\nkey = \"17f340d2c1e0a9574d6e0bc2113a8f04\"\n";
    for (network, x) in [(0, 0.0), (1, 1.0)] {
        for (corner, [dx, dy]) in [[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]].into_iter().enumerate() {
            text += &anchor([x + dx, dy, 2.0 + 0.2 * corner as f64], &format!("network = {network}"));
        }
    }
    for network in [0, 1] {
        text += &tag("rate_hz = 10", &format!("path_m = {STAND}\nnetwork = {network}"));
    }
    let records = Simulation::new(Scenario::parse(&text).expect("the test's scenario")).run_until(10.0);
    for tag in [0x1001, 0x1002] {
        // They share the air without knowing of each other: some frames collide.
        let found = fixes(&records, tag, 5.0).iter().filter(|fix| fix.position_m().is_some()).count();
        assert!(found >= 30, "{tag:04X}: {found}");
    }
    for node in [1, 8] {
        // At least the sync frames of the others, less what collides.
        assert!(counters(&records, node).refused > 100, "node {node}: {}", counters(&records, node).refused);
    }
}

#[test]
fn nobody_believes_an_attacker_who_knows_all_but_the_key() {
    let attacked = |text: &str, seconds: f64| {
        let scenario = Scenario::parse(text).expect("the example");
        let mut simulation = Simulation::new(Scenario { seconds, ..scenario });
        simulation.run_until(seconds);
        simulation.summary()
    };
    let text = include_str!("../../../examples/attack.toml");
    let summary = attacked(text, 40.0);
    // As many as the network's: 40 sync frames and 4 · 10 rounds of five frames a second, and 5 s are quiet. One in a few comes
    // while another is sent.
    assert!(summary.forged_frames > Some(35 * 120) && summary.forged_accepted == Some(0), "{summary:?}");
    assert!(summary.tags_joined == 4 && summary.slots_with_fix > Some(0.8), "{summary:?}");
    // The judge is not blind: without a key forged frames are believed, some each second.
    let (_, plain) = text.split_once("[[node]]").expect("a network and nodes");
    let summary = attacked(&format!("[[node]]{plain}"), 15.0);
    assert!(summary.forged_accepted > Some(10), "{summary:?}");
}
