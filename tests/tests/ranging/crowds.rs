//! Many tags in one network: leases of slots.

use std::collections::HashSet;

use sim::scenario::{Fidelity, Scenario, Simulation, Summary};
use wire::telemetry::{Condition, Message};

/// Tags that walk in one room of sixteen anchors and range this often, in hundredths of a hertz.
fn crowd(tags: usize, rate_chz: u32, fidelity: Fidelity, seconds: f64) -> Scenario {
    let mut scenario = Scenario { seconds, fidelity, ..Scenario::rooms_at(16, tags, f64::from(rate_chz) / 100.0) };
    assert_eq!(scenario.networks.len(), 1);
    scenario.change_tags(|tag| tag.rate_chz = Some(rate_chz));
    scenario
}

fn summary(scenario: Scenario) -> Summary {
    let seconds = scenario.seconds;
    let mut simulation = Simulation::new(scenario);
    simulation.run_until(seconds);
    simulation.summary()
}

#[test]
fn a_hundred_tags_that_appear_at_once_have_slots_within_seconds() {
    for fidelity in [Fidelity::Air, Fidelity::Spi] {
        // 1.2 s until the network has its layout, then 33 leases a second: a sync frame has ten entries, two for a new
        // lease and one for its first poll. The last tags were unlucky with their requests.
        let summary = summary(crowd(100, 100, fidelity, 8.0));
        assert!(summary.tags_joined == 100, "{fidelity:?}: {summary:?}");
    }
}

#[test]
fn two_hundred_and_fifty_tags_range_once_a_second_in_a_hall_and_any_anchor_tells_where_they_are() {
    // With a key: its frames are longer, and its nodes slower. 25 of 26 round slots are just enough.
    let key = "[network]\nkey = \"8f3a11c20b6e4d57a9e0c1d2b3f40617\"\n".to_owned();
    let scenario = Scenario::parse(&(key + include_str!("../../../examples/hall.toml"))).expect("the example");
    let mut simulation = Simulation::new(Scenario { seconds: 40.0, ..scenario });
    let records = simulation.run_until(40.0);
    let summary = simulation.summary();
    assert!(summary.tags_joined == 250 && summary.joined_s < Some(15.0), "{summary:?}");
    assert!(summary.slots_with_fix > Some(0.99), "{summary:?}");
    // Nobody loses a lease, and nobody polls at the time of another.
    let is_lost = |condition: Condition| matches!(condition, Condition::Unlisted | Condition::NetworkFull);
    let messages = || records.iter().flat_map(|record| record.messages().map(move |message| (record, message)));
    let lost: Vec<_> =
        messages().filter(|(_, message)| matches!(message, Message::State(state) if is_lost(state.is))).collect();
    assert!(lost.is_empty(), "{lost:?}");
    // One anchor has a cable. What a tag tells in its next poll, a second later, arrives.
    assert!(summary.uplink_share > Some(0.98) && summary.uplink_p99_s < Some(1.1), "{summary:?}");
    // In the last twenty seconds.
    for anchor in [1, 16] {
        let told = messages().filter_map(|(record, message)| match message {
            Message::TagFix(fix) if record.node == anchor && record.t_s > 20.0 => Some((fix.tag, fix.round)),
            _ => None,
        });
        let told: HashSet<_> = told.collect();
        assert!(told.len() as f64 > 0.98 * 250.0 * 20.0, "anchor {anchor}: {} positions", told.len());
    }
}

/// The example's hall, with this many tags that blink.
fn blinking(tags: usize, seconds: f64, network: &str) -> Scenario {
    let text = include_str!("../../../examples/blinks.toml").replace("count = 1000", &format!("count = {tags}"));
    Scenario { seconds, ..Scenario::parse(&(network.to_owned() + &text)).expect("the example") }
}

#[test]
fn tags_that_blink_are_located_by_a_station() {
    let key = "[network]\nkey = \"8f3a11c20b6e4d57a9e0c1d2b3f40617\"\n";
    for (network, seeds) in [("", 1..=1), (key, 2..=4)] {
        let mut shares = Vec::new();
        for seed in seeds {
            let summary = summary(Scenario { seed, ..blinking(150, 30.0, network) });
            assert!(summary.tags_joined == 150 && summary.joined_s < Some(10.0), "{summary:?}");
            assert!(summary.p50_m < Some(0.15) && summary.p90_m < Some(0.35), "{summary:?}");
            shares.extend(summary.slots_with_fix);
        }
        // Of each tag the first blink comes up to a second after it has its turns, and the last one's position is not there
        // yet: 0.8 of 24 seconds. While the network measures how quick its nodes are, each change of the layout costs
        // blinks: by chance more or fewer.
        let mean = shares.iter().sum::<f64>() / shares.len() as f64;
        assert!(mean > 0.95, "{shares:?}");
    }
}

#[test]
fn tags_that_blink_and_sleep_draw_little() {
    let scenario = blinking(4, 240.0, "");
    let mut scenario = Scenario { fidelity: Fidelity::Spi, ..scenario };
    scenario.change_tags(|tag| tag.sleep = true);
    let summary = summary(scenario);
    assert!(summary.slots_with_fix > Some(0.95), "{summary:?}");
    // 0.065 mA in the long run; the first minute, in which it learns how it wakes, takes more. Sending alone takes 0.014.
    assert!(summary.tag_mean_current_ma < Some(0.1), "{summary:?}");
}

#[test]
fn two_hundred_anchors_in_twelve_halls_are_one_network() {
    let text = include_str!("../../../examples/cells.toml").replace("count = 250", "count = 60");
    let scenario = Scenario::parse(&text).expect("the example");
    assert_eq!((scenario.networks.len(), scenario.anchors.len(), scenario.tags.len()), (1, 204, 60));
    let summary = summary(Scenario { seconds: 15.0, ..scenario });
    // The network settles in three seconds, and each tag asks for a lease a few times. Before anchors without a sync slot
    // gave way to those with one, 16 of 60 joined in this time.
    assert!(summary.tags_joined == 60, "{summary:?}");
    assert!(summary.slots_with_fix > Some(0.95), "{summary:?}");
    // They find their positions by more anchors than those with sync slots. A hall of 16 has a P90 of 0.2 m, and walls
    // lengthen ranges.
    assert!(summary.p90_m < Some(0.6), "{summary:?}");
}
