//! The same scenario on chips and directly on the air, on slow boards and on one without costs: the same rounds.

use sim::BoardProfile;
use sim::scenario::{Fidelity, Record, Scenario, Simulation};
use wire::config::{Network, ReplyDelay};

/// The results of a second of rounds, once all nodes have joined.
#[derive(Debug)]
struct Rounds {
    fixes_per_s: f64,
    /// Ranges per round, or differences including their reference.
    heard: f64,
    asked: f64,
    collisions: u64,
}

fn rounds(scenario: Scenario) -> Rounds {
    const FROM_S: f64 = 1.5;
    const TO_S: f64 = 4.5;
    let mut simulation = Simulation::new(Scenario { seconds: TO_S, ..scenario });
    simulation.run_until(FROM_S);
    let joined = simulation.summary();
    let records = simulation.run_until(TO_S);
    let summary = simulation.summary();
    let epochs: Vec<_> = records.iter().filter_map(Record::epoch).collect();
    let mean = |sum: usize| sum as f64 / epochs.len() as f64;
    Rounds {
        fixes_per_s: (summary.fixes - joined.fixes) as f64 / (TO_S - FROM_S),
        heard: mean(epochs.iter().map(|epoch| epoch.ranges.len() + epoch.differences.len()).sum()),
        asked: mean(epochs.iter().map(|epoch| usize::from(epoch.fix.asked)).sum()),
        collisions: summary.collisions - joined.collisions,
    }
}

/// A superframe lasts 100 ms at least: one round more or less in each is at most this many a second.
const A_ROUND_PER_SUPERFRAME: f64 = 10.0;

/// The number of ranges per round must agree within 3 %, where frames are lost within 6 %: of eight answers to a poll each
/// comes with a probability of 0.9 · 0.9, deviation 1.1, so that the means of 180 rounds differ by 1.8 % with a deviation
/// of one. The number of positions per second must agree within 5 % if
/// both have the same slots, or within one round per superframe, because a superframe's last round fits or not. Nodes may also measure which slots they need; a network then keeps slots that are up to
/// three steps of their code longer, of 3 to 6 % each. One of the two runs may keep such slots and the other not.
fn alike(has_same_slots: bool, loss: f64, a: &Rounds, b: &Rounds) -> bool {
    let near = |a: f64, b: f64, share: f64| (a - b).abs() <= share * b;
    let is_of_last_round = (a.fixes_per_s - b.fixes_per_s).abs() <= A_ROUND_PER_SUPERFRAME;
    let has_same_rate = near(a.fixes_per_s, b.fixes_per_s, if has_same_slots { 0.05 } else { 0.18 });
    (has_same_rate || is_of_last_round) && near(a.heard, b.heard, if loss > 0.0 { 0.06 } else { 0.03 })
}

/// The same network with fixed slots for boards with these reply delays.
fn pinned(scenario: Scenario, answer_us: u16, listen_again_us: u16) -> Scenario {
    let turnaround = Some(ReplyDelay { answer_us, listen_again_us, transmit_us: 250 });
    let networks = scenario.networks.iter().map(|network| Network { turnaround, ..*network });
    Scenario { networks: networks.collect(), ..scenario }
}

#[test]
fn chips_and_air_make_the_same_rounds_on_every_board() {
    for board in [BoardProfile::DWM1001, BoardProfile::EVB1000, BoardProfile::INSTANT] {
        for (anchors, tags) in [(4, 1), (8, 1), (8, 3)] {
            let of = |level, loss| rounds(Scenario { fidelity: level, board, loss, ..Scenario::rooms(anchors, tags) });
            let (chips, air) = (of(Fidelity::Spi, 0.0), of(Fidelity::Air, 0.0));
            let is_free = board == BoardProfile::INSTANT;
            assert!(
                alike(is_free, 0.0, &air, &chips),
                "{board:?}, {anchors} anchors, {tags} tags: {air:?} and {chips:?}"
            );
            for all in [&chips, &air] {
                // While the slots are still being allocated, a slow board may miss one.
                let missed = if board == BoardProfile::EVB1000 { 0.03 * all.asked } else { 1e-9 };
                assert!((all.heard - all.asked).abs() < missed, "{board:?}: an answer is missed: {all:?}");
                assert_eq!(all.collisions, 0, "{board:?}: {all:?}");
            }
            let (chips, air) = (of(Fidelity::Spi, 0.1), of(Fidelity::Air, 0.1));
            assert!(
                alike(is_free, 0.1, &air, &chips),
                "{board:?}, {anchors} anchors, {tags} tags: {air:?} and {chips:?}"
            );
        }
    }
}

#[test]
fn with_the_same_slots_chips_and_air_make_the_same_rounds() {
    // A little more than the boards request for themselves.
    for (board, answer_us, listen_again_us) in [(BoardProfile::DWM1001, 450, 120), (BoardProfile::EVB1000, 700, 550)] {
        for (anchors, tags, loss) in [(4, 1, 0.0), (8, 1, 0.0), (8, 3, 0.0), (4, 1, 0.1), (8, 3, 0.1)] {
            let of = |level| {
                let scenario = Scenario { fidelity: level, board, loss, ..Scenario::rooms(anchors, tags) };
                rounds(pinned(scenario, answer_us, listen_again_us))
            };
            let (chips, air) = (of(Fidelity::Spi), of(Fidelity::Air));
            let what = format!("{}, {anchors} anchors, {tags} tags, {loss} lost", board.name);
            assert!(alike(true, loss, &air, &chips), "{what}: {air:?} and {chips:?}");
        }
    }
}

#[test]
fn a_listening_tag_receives_the_last_response_too() {
    for board in [BoardProfile::DWM1001, BoardProfile::EVB1000] {
        let of = |level| rounds(Scenario { fidelity: level, board, ..Scenario::listening(5, 2) });
        let (chips, air) = (of(Fidelity::Spi), of(Fidelity::Air));
        assert!(alike(false, 0.0, &air, &chips), "{board:?}: {air:?} and {chips:?}");
        for all in [&chips, &air] {
            // The reference is reported with the differences.
            let missed = if board == BoardProfile::EVB1000 { 0.03 * all.asked } else { 0.01 };
            assert!((all.heard - all.asked - 1.0).abs() < missed, "{board:?}: an answer is missed: {all:?}");
        }
    }
}
