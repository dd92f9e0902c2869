//! Networks with a key on a small simulated air: what they do as networks without one do, and what attackers cannot do
//! who know everything but the key.

use std::cell::RefCell;
use std::rc::Rc;

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use crate::air::anchors::{self, corner, drift};
use crate::air::{ANTENNA_DELAY, Air, Boxed, Flight, Owned, boxed, boxed_sleeper, moments};
use crate::attack::shared;
use ranging::exchange::{Event, Link, Protocol};
use ranging::native::{
    Anchor, AnchorConfig, AnchorTables, Network, NetworkKey, PollContent, Rate, Scheme, Tag, TagConfig, TdoaTag,
    TdoaTagConfig,
};
use ranging::{PhyConfig, RadioDuration, Start};
use wire::uwb::native::{Frame, Message, software_code};

const KEY: [u8; 16] = [7; 16];

/// The network of a node whose seed is this one.
fn network(key: [u8; 16], seed: u64) -> Network {
    let key = Some(NetworkKey::new(key, seed, software_code));
    Network { key, ..Network::new(0xBA1A, PhyConfig::FAST) }
}

fn config(address: u16, rate: Rate, scheme: Scheme, seed: u64) -> TagConfig {
    TagConfig {
        address,
        network: network(KEY, seed),
        anchors: 8,
        rate,
        scheme,
        tells: PollContent::Nothing,
        blinks: false,
    }
}

/// Ten rounds a second.
const TEN: Rate = Rate::Every(RadioDuration::from_micros(100_000));

/// Anchors 1, 2, … in their corners, with a run's seeds.
fn room(air: &mut Air, anchors: u16, rounds: Option<Rate>, run: u64) -> Vec<usize> {
    let seed = |i: u16| run << 16 | u64::from(i);
    (0..anchors)
        .map(|i| {
            let place = corner(i, anchors);
            air.add(place, drift(i), anchors::anchor(network(KEY, seed(i)), i + 1, place, rounds))
        })
        .collect()
}

/// A tag, and a handle to read what it refused.
fn tag(air: &mut Air, config: TagConfig) -> (usize, Rc<RefCell<Tag>>) {
    let (machine, handle) = shared(Tag::new(config));
    (air.add([1.0, 2.0, 1.0], -20.0, machine), handle)
}

/// Rounds with three ranges from `from` to `to`.
fn fixes(air: &Air, node: usize, from: f64, to: f64) -> usize {
    air.rounds(node, from).iter().filter(|(time, ranges)| *time < to && ranges.len() >= 3).count()
}

/// The sessions of the sync frames that these nodes sent since `from`.
fn sessions(air: &Air, nodes: &[usize], from: f64) -> Vec<u32> {
    let sent = air.sent.iter().filter(|flight| flight.begin >= from && nodes.contains(&flight.sender));
    let mut sessions: Vec<u32> = sent
        .filter_map(|flight| match Frame::parse(&flight.bytes).ok()?.message {
            Message::SyncFrame(sync_frame) => sync_frame.session.map(|session| session.number),
            _ => None,
        })
        .collect();
    sessions.sort_unstable();
    sessions.dedup();
    sessions
}

#[test]
fn tags_range_as_without_a_key() {
    for (scheme, least) in [(Scheme::SingleSided, 290), (Scheme::DoubleSided, 200)] {
        let mut air = Air::new(PhyConfig::FAST, 1);
        let anchors = room(&mut air, 4, None, 1);
        let (node, handle) = tag(&mut air, config(0x100, Rate::Greedy, scheme, 9));
        air.run_until(4.0);
        assert!(fixes(&air, node, 3.0, 4.0) > least, "{scheme:?}: {}", fixes(&air, node, 3.0, 4.0));
        assert_eq!(handle.borrow().refused().total(), 0);
        // Anchors that are switched on together need a second to be one network.
        assert_eq!(sessions(&air, &anchors, 2.0).len(), 1);
        let truth = air.distance(node, anchors[1]);
        let ranges = air.rounds(node, 2.0).into_iter().flat_map(|(_, ranges)| ranges);
        let errors: Vec<f64> =
            ranges.filter(|range| range.peer == 2).map(|range| f64::from(range.distance_m) - truth).collect();
        let (bias, deviation) = moments(&errors);
        assert!(bias.abs() < 0.01 && deviation < 0.03, "{bias:.4} ± {deviation:.4} m");
    }
}

#[test]
fn leases_sleep_and_listening_work_with_a_key() {
    let mut air = Air::new(PhyConfig::FAST, 2);
    let anchors = room(&mut air, 4, None, 2);
    let mut sleeper =
        Tag::new(config(0x101, Rate::Every(RadioDuration::from_micros(2_000_000)), Scheme::SingleSided, 5));
    sleeper.doze();
    let sleeper = air.add([2.0, 1.0, 1.0], 10.0, boxed_sleeper(sleeper));
    let (ten, handle) = tag(&mut air, config(0x102, TEN, Scheme::SingleSided, 6));
    air.run_until(60.0);
    // One in two seconds, and ten a second.
    assert!(fixes(&air, sleeper, 20.0, 60.0) >= 18, "{}", fixes(&air, sleeper, 20.0, 60.0));
    assert!(fixes(&air, ten, 20.0, 60.0) >= 390, "{}", fixes(&air, ten, 20.0, 60.0));
    assert_eq!(handle.borrow().refused().total(), 0);
    assert_eq!(sessions(&air, &anchors, 2.0).len(), 1);

    let mut air = Air::new(PhyConfig::FAST, 3);
    room(&mut air, 4, Some(TEN), 3);
    let listener = TdoaTag::new(TdoaTagConfig { network: network(KEY, 4), period: None });
    let listener = air.add([1.0, 2.0, 1.0], -20.0, boxed(listener));
    air.run_until(6.0);
    let heard = air.heard(listener, 3.0);
    // Four anchors range ten times a second, and three answer.
    let whole = heard.iter().filter(|(_, differences)| differences.len() == 3).count();
    assert!(whole > 100, "{whole} of {}", heard.len());
}

#[test]
fn another_key_or_none_is_no_part_of_the_network() {
    let mut air = Air::new(PhyConfig::FAST, 4);
    let anchors = room(&mut air, 4, None, 4);
    let (inside, _) = tag(&mut air, config(0x100, TEN, Scheme::SingleSided, 9));
    let others = [
        config(0x101, TEN, Scheme::SingleSided, 10),
        TagConfig { network: network([8; 16], 11), ..config(0x102, TEN, Scheme::SingleSided, 11) },
        TagConfig { network: Network::new(0xBA1A, PhyConfig::FAST), ..config(0x103, TEN, Scheme::SingleSided, 12) },
    ]
    .map(|config| tag(&mut air, config));
    air.run_until(5.0);
    assert!(fixes(&air, inside, 2.0, 5.0) >= 28);
    let [same, other, none] =
        others.map(|(node, handle)| (fixes(&air, node, 0.0, 5.0), handle.borrow().refused().codes));
    assert!(same.0 > 20 && same.1 == 0, "{same:?}");
    // Each sync frame that it receives is refused, and said.
    for (rounds, codes) in [other, none] {
        assert!(rounds == 0 && codes > 100, "{rounds}, {codes}");
    }
    assert_eq!(sessions(&air, &anchors, 2.0).len(), 1);
}

/// Sends a frame of `forge` every ten milliseconds in the mean, and listens in between.
fn attacker(seed: u64, mut forge: impl FnMut(&mut Pcg64, &[Vec<u8>]) -> Option<Vec<u8>> + 'static) -> Boxed {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut kept: Vec<Vec<u8>> = Vec::new();
    let mut next = None;
    Box::new(move |now, _, event| {
        if let Event::Received(frame) = event {
            kept.push(frame.bytes.to_vec());
            if kept.len() > 2000 {
                kept.remove(0);
            }
        }
        let draw = |rng: &mut Pcg64| now.plus(RadioDuration::from_micros(rng.random_range(1_000..19_000)));
        let at = *next.get_or_insert_with(|| draw(&mut rng));
        if at.since(now) <= RadioDuration::ZERO {
            next = Some(draw(&mut rng));
            if let Some(frame) = forge(&mut rng, &kept) {
                return Owned::Transmit { frame, start: Start::Now, listen: true };
            }
        }
        let window = next.map_or(RadioDuration::ZERO, |next| next.since(now)).max(RadioDuration::from_micros(50));
        Owned::Receive { start: Start::Now, window, keep_listening: true }
    })
}

#[test]
fn replayed_and_changed_frames_change_nothing() {
    let any = |rng: &mut Pcg64, kept: &[Vec<u8>]| kept.get(rng.random_range(0..kept.len().max(1))).cloned();
    let mutated = move |rng: &mut Pcg64, kept: &[Vec<u8>]| {
        let mut frame = any(rng, kept)?;
        for _ in 0..rng.random_range(1..4) {
            let bit = rng.random_range(72..frame.len() * 8);
            frame[bit / 8] ^= 1 << (bit % 8);
        }
        Some(frame)
    };
    let latest =
        |rng: &mut Pcg64, kept: &[Vec<u8>]| kept.len().checked_sub(rng.random_range(1..4)).map(|at| kept[at].clone());
    // Without an attacker, and with one each.
    let forgers: [Option<Boxed>; 4] =
        [None, Some(attacker(1, any)), Some(attacker(2, mutated)), Some(attacker(3, latest))];
    let mut undisturbed = 0;
    for (i, forger) in forgers.into_iter().enumerate() {
        let mut air = Air::new(PhyConfig::FAST, 5);
        let anchors = room(&mut air, 4, None, 5);
        let (node, handle) = tag(&mut air, config(0x100, Rate::Greedy, Scheme::SingleSided, 9));
        air.run_until(2.0);
        let is_attacked = forger.is_some();
        if let Some(forger) = forger {
            air.add([3.0, 3.0, 1.0], 5.0, forger);
        }
        air.run_until(12.0);
        let made = fixes(&air, node, 2.0, 12.0);
        if !is_attacked {
            undisturbed = made;
            continue;
        }
        // Collisions cost some rounds.
        assert!(made * 10 > undisturbed * 8, "attack {i}: {made} of {undisturbed}");
        assert!(handle.borrow().refused().codes > 0, "attack {i}");
        assert_eq!(sessions(&air, &anchors, 2.0).len(), 1, "attack {i}");
        let lost = air.links(node).iter().filter(|(time, link)| *time > 2.0 && *link == Link::Unsynchronised).count();
        assert_eq!(lost, 0, "attack {i}");
        for (time, ranges) in air.rounds(node, 2.0) {
            for range in ranges {
                let truth = air.distance(node, anchors[usize::from(range.peer) - 1]);
                let error = f64::from(range.distance_m) - truth;
                assert!(error.abs() < 0.3, "attack {i}: {error:.2} m at {time:.2} s");
            }
        }
    }
}

/// Sends recorded frames at their times, from the first one on, for ever.
fn replay(recorded: Vec<Flight>) -> Boxed {
    let first = recorded[0].rmarker;
    let length = recorded[recorded.len() - 1].rmarker - first;
    let (mut begin, mut next, mut turn) = (None, 0, 0.0);
    Box::new(move |now, _, _| {
        let begin = *begin.get_or_insert(now.plus(RadioDuration::from_micros(1_000)));
        loop {
            if next == recorded.len() {
                (next, turn) = (0, turn + length + 0.001);
            }
            let micros = ((turn + recorded[next].rmarker - first) * 1e6) as i64;
            // Instants can be ordered within 8 s: the test is shorter.
            let at = begin.plus(RadioDuration::from_ticks(micros * 63_898 - ANTENNA_DELAY));
            match at.since(now).as_micros() {
                early if early < 250 => next += 1,
                late if late > 600 => {
                    return Owned::WaitUntil(now.plus(RadioDuration::from_micros((late - 500).min(4_000_000) as u32)));
                }
                _ => {
                    next += 1;
                    let frame = recorded[next - 1].bytes.clone();
                    return Owned::Transmit { frame, start: Start::At(at), listen: false };
                }
            }
        }
    })
}

/// Four seconds of a network under the same key that ran before, with a later term: its first coordinator was replaced.
fn recorded() -> Vec<Flight> {
    let mut air = Air::new(PhyConfig::FAST, 6);
    let before = room(&mut air, 4, None, 1000);
    air.run_until(2.0);
    let coordinator = before
        .iter()
        .copied()
        .find(|node| air.links(*node).iter().any(|(_, link)| *link == Link::Coordinating))
        .expect("one of them");
    air.switch_off(coordinator);
    air.run_until(7.0);
    air.sent.into_iter().filter(|flight| flight.begin > 3.0).collect()
}

#[test]
fn a_recorded_network_takes_nobody_over() {
    let mut air = Air::new(PhyConfig::FAST, 7);
    let anchors = room(&mut air, 3, None, 7);
    let (node, _) = tag(&mut air, config(0x100, TEN, Scheme::SingleSided, 9));
    air.run_until(2.0);
    let before = sessions(&air, &anchors, 1.8);
    air.add([3.0, 3.0, 1.0], 0.0, replay(recorded()));
    air.run_until(3.0);
    // A node that starts meanwhile finds the network that is there.
    let place = corner(3, 4);
    let late_anchor = air.add(place, 20.0, anchors::anchor(network(KEY, 77), 4, place, None));
    let (late_tag, _) = tag(&mut air, config(0x101, TEN, Scheme::SingleSided, 10));
    air.run_until(10.0);
    assert_eq!(sessions(&air, &anchors, 2.0), before);
    assert_eq!(sessions(&air, &[late_anchor], 8.5), before);
    // The replay collides with some frames.
    assert!(fixes(&air, node, 2.0, 9.0) >= 50, "{}", fixes(&air, node, 2.0, 9.0));
    // It may follow the recorded network at first.
    assert!(fixes(&air, late_tag, 8.0, 10.0) >= 10, "{}", fixes(&air, late_tag, 8.0, 10.0));
}

#[test]
fn a_recorded_network_alone_gives_no_position_and_keeps_no_anchor_from_starting() {
    let mut air = Air::new(PhyConfig::FAST, 8);
    let recorded = recorded();
    let old: Vec<u32> = recorded
        .iter()
        .filter_map(|flight| match Frame::parse(&flight.bytes).ok()?.message {
            Message::SyncFrame(sync_frame) => sync_frame.session.map(|session| session.number),
            _ => None,
        })
        .collect();
    air.add([3.0, 3.0, 1.0], 0.0, replay(recorded));
    let (node, _) = tag(&mut air, config(0x100, TEN, Scheme::SingleSided, 9));
    air.run_until(1.0);
    let anchors = room(&mut air, 3, None, 8);
    air.run_until(8.0);
    assert_eq!(fixes(&air, node, 0.0, 3.0), 0);
    let now = sessions(&air, &anchors, 7.0);
    assert!(now.len() == 1 && !old.contains(&now[0]), "{now:?}");
}

#[test]
fn networks_with_the_same_key_that_meet_become_one() {
    let mut air = Air::new(PhyConfig::FAST, 9);
    let anchors = room(&mut air, 2, None, 9);
    // Too far to hear the first two.
    air.reach = 30.0;
    let far: Vec<usize> = (2..4)
        .map(|i| {
            let [x, y, z] = corner(i, 4);
            let place = [x + 200.0, y, z];
            air.add(place, drift(i), anchors::anchor(network(KEY, 90 + u64::from(i)), i + 1, place, None))
        })
        .collect();
    let (node, _) = tag(&mut air, config(0x100, TEN, Scheme::SingleSided, 9));
    air.run_until(3.0);
    assert_ne!(sessions(&air, &anchors, 2.0), sessions(&air, &far, 2.0));
    for (i, node) in (2..4).zip(&far) {
        air.move_to(*node, corner(i, 4));
    }
    air.run_until(12.0);
    let all: Vec<usize> = anchors.iter().chain(&far).copied().collect();
    assert_eq!(sessions(&air, &all, 10.0).len(), 1);
    assert!(fixes(&air, node, 10.0, 12.0) >= 15, "{}", fixes(&air, node, 10.0, 12.0));
}

#[test]
fn an_anchor_counts_frames_without_its_code() {
    let config = AnchorConfig {
        address: 1,
        network: network(KEY, 1),
        antenna_delay: RadioDuration::from_ticks(ANTENNA_DELAY),
        position_m: None,
        rounds: None,
    };
    let (machine, handle) = shared(Anchor::new(config, AnchorTables::default()));
    let mut air = Air::new(PhyConfig::FAST, 10);
    air.add(corner(0, 4), 20.0, machine);
    let place = corner(1, 4);
    air.add(place, -20.0, anchors::anchor(Network::new(0xBA1A, PhyConfig::FAST), 2, place, None));
    air.run_until(3.0);
    // A sync frame in each superframe.
    assert!((15..60).contains(&handle.borrow().refused_frames()), "{}", handle.borrow().refused_frames());
}
