//! A tag that walks round in the room.

use std::sync::OnceLock;

use small_air::room;
use wire::config::Solver;
use wire::telemetry::{Condition, Fix, Message};

use super::live;

/// The tag's reports. One run serves all tests.
fn told() -> &'static [Message] {
    static TOLD: OnceLock<Vec<Message>> = OnceLock::new();
    TOLD.get_or_init(|| live(room::record(Solver::Track), room::LIFE_US, room::tag).0)
}

fn fixes(told: &[Message]) -> Vec<Fix> {
    told.iter().filter_map(|message| if let Message::Fix(fix) = message { Some(*fix) } else { None }).collect()
}

#[test]
fn a_tag_tells_who_it_is_joins_and_finds_itself_where_it_is() {
    let told = told();
    let kinds: Vec<&str> = told.iter().take(2).map(Message::kind).collect();
    assert_eq!(kinds, ["reset", "hello"]);
    let joined = told.iter().find_map(|message| match message {
        Message::State(state) if matches!(state.is, Condition::Joined(_)) => Some(state.t_us),
        _ => None,
    });
    let joined_us = joined.expect("the tag joins");
    assert!(joined_us < 1_000_000, "{joined_us}");

    let found: Vec<(u64, f64)> = fixes(told)
        .iter()
        .filter_map(|fix| {
            let position = fix.position_m()?;
            // The tag's position when it sent its poll.
            let truth = room::walk(fix.t_us - u64::from(fix.age_us));
            let square: f64 = (0..3).map(|axis| (position[axis] - f64::from(truth[axis]) / 1000.0).powi(2)).sum();
            Some((fix.t_us, square.sqrt()))
        })
        .collect();
    // Twenty a second since the tag has joined and has received all anchors.
    let expected = 20 * (room::LIFE_US - joined_us - 200_000) / 1_000_000;
    assert!(found.len() as u64 + 8 >= expected, "{} of {expected}", found.len());
    let mean_square = found.iter().map(|(_, error)| error * error).sum::<f64>() / found.len() as f64;
    // The position's own standard deviation is 6 cm.
    assert!(mean_square.sqrt() < 0.08, "{} m", mean_square.sqrt());
}

#[test]
fn ages_and_rounds_are_those_of_the_exchange() {
    let told = told();
    let fixes = fixes(told);
    // In this air a node answers 220 µs after a frame's end, and can receive again after 30 µs. It asks for an eighth
    // and 30 µs more, 278 and 64 µs; the slots have 288 and 64. A poll, six answers and the reading of the last one
    // then take 138 + (83 + 288 + 138) + 5 · (190 + 64 + 3) + 51 + 120 = 2103 µs, and no time for computing. The slots
    // of the network's start are longer.
    let measured = fixes.iter().filter(|fix| fix.asked == 6 && fix.t_us > 2_000_000);
    let whole: Vec<u32> = measured.map(|fix| fix.age_us).collect();
    assert!(whole.len() > 60);
    assert!(
        whole.iter().all(|age| (1_600..2_300).contains(age)),
        "{:?} to {:?}",
        whole.iter().min(),
        whole.iter().max()
    );
    // No round is lost between the tasks.
    for pair in fixes.windows(2) {
        assert_eq!(pair[1].round, pair[0].round.wrapping_add(1));
    }
}

#[test]
fn what_is_counted_is_what_was_told() {
    let told = told();
    let counters =
        told.iter().find_map(|message| if let Message::Counters(counters) = message { Some(*counters) } else { None });
    let counters = counters.expect("told after five seconds");
    let polls = fixes(told).iter().filter(|fix| fix.t_us <= counters.t_us).count() as u32;
    // A request for slots or two beside the polls.
    assert!((polls..polls + 4).contains(&counters.sent), "{} sent, {polls} polls", counters.sent);
    let ranges = told.iter().filter(|message| matches!(message, Message::Range(range) if range.t_us <= counters.t_us));
    // Sync frames beside the answers: those of all six anchors until the tag has joined, then at least one in two
    // superframes.
    assert!(counters.received > ranges.count() as u32 + 24, "{}", counters.received);
    assert_eq!(
        (counters.late, counters.radio_failures, counters.rounds_dropped, counters.telemetry_dropped),
        (0, 0, 0, 0)
    );
}
