//! Faults of beacons: a beacon vanishes, is moved, is cloned, is mute or sends too much; RSSI values that mean "not
//! known".

use sim::scenario::What;
use system_tests::{Run, TAG, anchor, fault};
use wire::telemetry::{BeaconEvidence, Condition, Message, SolveError};

use super::{ROUND, STANDS, beacon, by_beacons, errors, room};

/// The first beacon's address, by which faults name it.
const FIRST: u16 = 0x2001;

fn off(at_s: f64, node: u16) -> String {
    fault(at_s, node, "off")
}

/// What tags are told of the first beacon.
fn told(position_m: &str) -> String {
    format!("[[beacon]]\nmajor = 1\nminor = 1\nposition_m = {position_m}\n")
}

/// A beacon that tags are not told of.
fn stranger(position: [f64; 2], more: &str) -> String {
    beacon(position, &format!("minor = 1\n{more}[node.simulation]\nlisted = false"))
}

/// The error of a walk through the room, root mean square over some seeds, metres, and the ratio of its square to the
/// variance in the covariance.
fn walked(beacons: &[&str], more: &str) -> (f64, f64) {
    let runs = (1..=4).map(|seed: u64| {
        let head = format!("seconds = 60\nseed = {seed}");
        let run = Run::of_text(&(room(&head, beacons) + ROUND + more));
        errors(&by_beacons(&run, 0.0, 60.0))
    });
    let (squares, normalised) = runs.fold((0.0, 0.0), |sum, (rmse_m, n)| (sum.0 + rmse_m * rmse_m, sum.1 + n));
    ((squares / 4.0).sqrt(), normalised / 4.0)
}

#[test]
fn a_beacon_that_vanishes_is_missed_and_the_others_go_on() {
    let run = Run::of_text(&(room("seconds = 30", &[]) + ROUND + &off(10.0, FIRST)));
    assert!(run.longest_gap(TAG, 0.0, 30.0) < 1.1);
    let heard = |from_s, to_s| {
        let epochs = by_beacons(&run, from_s, to_s);
        epochs.iter().filter_map(|(_, epoch)| epoch.fix.used()).map(u16::count_ones).max()
    };
    assert_eq!((heard(5.0, 10.0), heard(11.0, 30.0)), (Some(6), Some(5)));
}

#[test]
fn when_all_vanish_there_is_a_reason_and_no_old_value() {
    let all: String = (FIRST..FIRST + 6).map(|beacon| off(10.0, beacon)).collect();
    let run = Run::of_text(&(room("seconds = 20", &[]) + STANDS + &all));
    let later = by_beacons(&run, 11.0, 20.0);
    assert!(later.len() > 5, "{}", later.len());
    assert!(later.iter().all(|(_, epoch)| epoch.fix.reason() == Some(SolveError::TooFewAnchors)), "{later:?}");
}

/// The root mean square error of an estimate at the room's middle during the walk, metres. On the sides of 8 m, 2 m
/// from the middle, it is √(2² + 4² ⁄ 3). On the sides of 4 m, 4 m from the middle, it is √(4² + 2² ⁄ 3). Together it
/// is √((16 · 9.33 + 8 · 17.33) ⁄ 24).
const GUESS_M: f64 = 3.46;
/// The maximum mean ratio of squared errors to reported variances. 1 means that the variances are right. Shadowing
/// lasts, and four walks through it still leave a third of that open.
const HONEST: f64 = 1.7;

#[test]
fn a_mute_beacon_is_as_if_it_were_not_there() {
    let (error_m, normalised) = walked(&[], &off(0.0, FIRST));
    assert!(error_m < GUESS_M && normalised < HONEST, "{error_m} m, {normalised}");
}

#[test]
fn a_beacon_that_was_moved_is_doubted() {
    // The beacon is carried to the other end of the room, 11 m; the list still has its old position.
    let (error_m, normalised) = walked(&[], &told("[11.0, 7.0, 2.2]"));
    // One wrong position in six beacons may double the variance.
    assert!(error_m < 1.2 * GUESS_M && normalised < 2.0 * HONEST, "{error_m} m, {normalised}");
}

/// A hall of 30 m × 8 m with eight beacons around. The first has the numbers 1-1.
fn hall(simulation: &str) -> String {
    const PLACES: [[f64; 2]; 8] =
        [[0.3, 0.3], [10.0, 0.3], [20.0, 0.3], [29.7, 0.3], [29.7, 7.7], [20.0, 7.7], [10.0, 7.7], [0.3, 7.7]];
    let mut text = format!("[simulation]\nfidelity = \"air\"\n{simulation}\n");
    text += &PLACES.map(|place| beacon(place, "")).concat();
    text + "[[node]]\nrole = \"tag\"\nheight_m = 1.2\nscan_interval_ms = 1000\n[node.simulation]\n\
            path_m = [[2, 2, 1.2], [28, 2, 1.2], [28, 6, 1.2], [2, 6, 1.2]]\nspeed_m_s = 0.8\nclosed = true\n"
}

#[test]
fn a_beacon_that_was_moved_is_named_and_believed_when_it_is_back() {
    // The beacon is carried from the end where it is listed to the other end. After 80 s it is carried back, which is
    // simulated by a second beacon.
    let at_home = stranger([29.0, 4.0], "");
    let on = fault(80.0, FIRST + 8, "on");
    for seed in 1..=3 {
        let text = hall(&format!("seconds = 240\nseed = {seed}")) + &told("[29.0, 4.0, 2.2]");
        let run = Run::of_text(&(text + &at_home + &off(0.0, FIRST + 8) + &off(80.0, FIRST) + &on));
        let words = run.words(TAG);
        let named = |word: &Condition| matches!(word, Condition::BeaconMoved(BeaconEvidence { minor: 1, .. }));
        let believed = |word: &Condition| matches!(word, Condition::BeaconRestored(BeaconEvidence { minor: 1, .. }));
        let found = words.iter().find(|(t_s, word)| *t_s < 80.0 && named(word));
        let (named_s, _) = found.unwrap_or_else(|| panic!("seed {seed}: {words:?}"));
        assert!(words.iter().any(|(t_s, word)| *t_s > 80.0 && believed(word)), "seed {seed}: {words:?}");
        assert!(words.iter().all(|(_, word)| named(word) || believed(word)), "seed {seed}: {words:?}");
        // Seven beacons give the positions in that time.
        let epochs = by_beacons(&run, named_s + 1.0, 80.0);
        let used = epochs.iter().filter_map(|(_, epoch)| epoch.fix.used()).map(u16::count_ones);
        assert!(used.max().is_some_and(|used| used <= 7), "seed {seed}");
    }
}

#[test]
fn among_good_beacons_nobody_is_named() {
    let standing = Run::of_text(&(room("seconds = 300", &[]) + STANDS));
    let walking = Run::of_text(&hall("seconds = 180"));
    assert!(standing.words(TAG).is_empty() && walking.words(TAG).is_empty());
}

#[test]
fn a_clone_is_named_where_anchors_give_the_position() {
    let corners = [[0.2, 0.2, 2.6], [11.8, 0.2, 1.8], [11.8, 7.8, 2.6], [0.2, 7.8, 1.8]];
    let anchors = corners.map(|at| anchor(at, "")).concat();
    let run = Run::of_text(&(room("seconds = 60", &[]) + &stranger([11.0, 7.0], "") + &anchors + ROUND));
    let words = run.words(TAG);
    let (_, first) = words.first().expect("a word");
    assert!(matches!(first, Condition::BeaconDuplicated(BeaconEvidence { minor: 1, .. })), "{words:?}");
}

#[test]
fn a_clone_makes_its_twin_doubtful_and_no_more() {
    // Another beacon with the numbers of the first, in the opposite corner.
    let (error_m, normalised) = walked(&[], &stranger([11.0, 7.0], ""));
    assert!(error_m < GUESS_M && normalised < HONEST, "{error_m} m, {normalised}");
}

#[test]
fn a_beacon_that_screams_drowns_nobody() {
    // Fifty advertisements per second, and 15 dB louder than listed.
    let screaming = ["interval_ms = 20\nmeasured_power_dbm = -44"];
    let listed = told("[0.3, 0.3, 2.2]\nrssi_1m_dbm = -59");
    let run = Run::of_text(&(room("seconds = 30", &screaming) + ROUND + &listed));
    let epochs = by_beacons(&run, 2.0, 30.0);
    let all = epochs.iter().filter_map(|(_, epoch)| epoch.fix.used()).filter(|used| used.count_ones() >= 5);
    assert!(all.count() > 40, "the others are heard");
    let (error_m, normalised) = walked(&screaming, &listed);
    // A tag that used only this beacon would estimate a position in its corner, 5.7 m and 3.7 m from the middle:
    // √(3.46² + 5.7² + 3.7²) = 7.6 m off.
    assert!(error_m < 0.75 * 7.6 && normalised < 2.0 * HONEST, "{error_m} m, {normalised}");
}

#[test]
fn an_rssi_of_127_or_0_is_none() {
    // Half of all values. Each, taken as an RSSI, would be a distance of zero.
    for none in [127, 0] {
        let head = format!("seconds = 60\n[simulation.bluetooth]\nunknown_rssi = 0.5\nunknown_rssi_dbm = {none}");
        let run = Run::of_text(&(room(&head, &[]) + ROUND));
        let (error_m, normalised) = errors(&by_beacons(&run, 0.0, 60.0));
        assert!(error_m < GUESS_M && normalised < HONEST, "{none}: {error_m} m, {normalised}");
    }
    // All values: there is no position, and no epoch reports that before the first position.
    let head = "seconds = 10\n[simulation.bluetooth]\nunknown_rssi = 1.0\nunknown_rssi_dbm = 0";
    let run = Run::of_text(&(room(head, &[]) + STANDS));
    assert!(run.fix_times(TAG, 0.0, 10.0).is_empty());
    assert!(run.summary.bluetooth.is_some_and(|bluetooth| bluetooth.adverts_heard > 300));
}

#[test]
fn adverts_of_every_malformed_length_are_nobodys() {
    // Fifty advertisements per second, with the identity of the first beacon and an RSSI as if next to the tag. All 285
    // variants are sent in six seconds.
    let broken = stranger([11.0, 7.0], "interval_ms = 20\nmeasured_power_dbm = -40\n") + "format = \"malformed\"\n";
    let alone = "interval_ms = 20\nsimulation = { format = \"malformed\" }";
    let run = Run::of_text(&(room("seconds = 20", &[alone; 6]) + STANDS));
    assert!(run.epochs(TAG).next().is_none(), "an epoch of nothing");
    assert!(
        !run.records.iter().any(|record| matches!(record.what, What::Message(Message::Sighting(_)))),
        "a sighting of nothing"
    );
    assert!(run.summary.bluetooth.is_some_and(|bluetooth| bluetooth.adverts_heard > 1000), "the air is full");
    // Among valid advertisements it is only noise on the air.
    let (error_m, normalised) = walked(&[], &broken);
    assert!(error_m < GUESS_M && normalised < HONEST, "{error_m} m, {normalised}");
}

#[test]
fn two_beacons_of_one_identity_cannot_be_listed() {
    let text = room("", &["minor = 7", "minor = 7"]) + STANDS;
    let error = sim::scenario::Scenario::parse(&text).expect_err("twice the same");
    assert!(error.message.contains("two beacons 1-7"), "{error}");
}
