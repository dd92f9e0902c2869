//! Tags with a fixed low rate, on a small simulated air: their receiver is on only briefly, and no accuracy is lost.

use crate::air::anchors::{self, drift};
use crate::air::{Air, Boxed, boxed, boxed_sleeper, moments};
use ranging::exchange::Link;
use ranging::native::{Network, PollContent, Rate, Scheme, Tag, TagConfig};
use ranging::{PhyConfig, RadioDuration};

const NETWORK: Network = Network::new(0xBA1A, PhyConfig::FAST);

fn anchor(i: u16) -> Boxed {
    anchors::anchor(NETWORK, i + 1, corner(i), None)
}

fn corner(i: u16) -> [f64; 3] {
    let angle = f64::from(i) * std::f64::consts::FRAC_PI_4;
    [10.0 * angle.cos(), 10.0 * angle.sin(), 2.0 + f64::from(i % 2)]
}

fn room(air: &mut Air, anchors: u16) -> Vec<usize> {
    (0..anchors).map(|i| air.add(corner(i), drift(i), anchor(i))).collect()
}

fn machine(address: u16, rate: Rate) -> Tag {
    let scheme = Scheme::SingleSided;
    Tag::new(TagConfig {
        address,
        network: NETWORK,
        anchors: 8,
        rate,
        scheme,
        tells: PollContent::Nothing,
        blinks: false,
    })
}

fn every_ms(millis: u32) -> Rate {
    Rate::Every(RadioDuration::from_micros(1_000 * millis))
}

/// A tag whose radio sleeps.
fn sleeper(address: u16, period_ms: u32) -> Boxed {
    let mut tag = machine(address, every_ms(period_ms));
    tag.doze();
    boxed_sleeper(tag)
}

/// Rounds a second, the fraction of time with the receiver on, and the errors' mean and deviation, metres, from `from`
/// on.
fn figures(air: &mut Air, tag: usize, anchors: &[usize], from: f64, to: f64) -> (f64, f64, (f64, f64)) {
    air.run_until(from);
    let before = air.received(tag);
    air.run_until(to);
    let rounds = air.rounds(tag, from);
    let error = |range: &ranging::exchange::Range| {
        f64::from(range.distance_m) - air.distance(tag, anchors[usize::from(range.peer) - 1])
    };
    let errors: Vec<f64> = rounds.iter().flat_map(|(_, ranges)| ranges.iter().map(error)).collect();
    let share = (air.received(tag) - before) / (to - from);
    (rounds.len() as f64 / (to - from), share, moments(&errors))
}

#[test]
fn ten_rounds_a_second_need_the_receiver_for_a_fiftieth_of_the_time() {
    for (seed, tag, deviation_m) in [(1, boxed(machine(0x100, every_ms(100))), 0.03), (2, sleeper(0x100, 100), 0.08)] {
        let mut air = Air::new(NETWORK.phy, seed);
        let anchors = room(&mut air, 4);
        let node = air.add([1.0, 2.0, 1.0], -20.0, tag);
        let (rate, share, (bias, deviation)) = figures(&mut air, node, &anchors, 5.0, 35.0);
        assert!(rate > 9.9, "{rate} rounds a second");
        // Four responses each time, 1.1 ms, and every second time a sync frame of 0.4 ms: 1.3 % of 100 ms.
        assert!((0.008..0.02).contains(&share), "{share}");
        assert!(bias.abs() < 0.01 && deviation < deviation_m, "{bias}, {deviation}");
        assert_eq!(air.collisions, 0);
    }
}

#[test]
fn a_round_a_second_needs_the_receiver_for_a_five_hundredth_of_the_time() {
    let mut air = Air::new(NETWORK.phy, 3);
    let anchors = room(&mut air, 4);
    let node = air.add([1.0, 2.0, 1.0], 20.0, sleeper(0x100, 1_000));
    let (rate, share, (bias, deviation)) = figures(&mut air, node, &anchors, 60.0, 360.0);
    assert!(rate > 0.98, "{rate} rounds a second");
    // 1.0 ms for the responses, and 0.5 ms for a sync frame before every second round.
    assert!((0.0011..0.0014).contains(&share), "{share}");
    assert!(bias.abs() < 0.02 && deviation < 0.1, "{bias}, {deviation}");
}

#[test]
fn losses_cost_ranges_and_few_rounds() {
    for (seed, period_ms, least) in [(4, 100, 8.0), (5, 1_000, 0.8)] {
        let mut air = Air::new(NETWORK.phy, seed);
        let anchors = room(&mut air, 6);
        let node = air.add([1.0, 2.0, 1.0], 20.0, sleeper(0x100, period_ms));
        air.run_until(5.0);
        air.loss = 0.2;
        let (rate, share, _) = figures(&mut air, node, &anchors, 5.0, 65.0);
        assert!(rate > least, "every {period_ms} ms: {rate} rounds a second");
        assert!(share < 0.2, "every {period_ms} ms: {share}");
    }
}

#[test]
fn an_anchor_that_is_gone_is_asked_no_more_and_the_others_sync_frames_serve() {
    for period_ms in [100, 500] {
        let mut air = Air::new(NETWORK.phy, 6);
        let anchors = room(&mut air, 5);
        let node = air.add([1.0, 2.0, 1.0], 20.0, sleeper(0x100, period_ms));
        air.run_until(10.0);
        air.switch_off(anchors[2]);
        air.run_until(30.0);
        let rounds = air.rounds(node, 10.0);
        let expected = 20_000.0 / f64::from(period_ms);
        assert!(rounds.len() as f64 > 0.9 * expected, "{} of {expected}", rounds.len());
        assert!(rounds.iter().all(|(_, ranges)| ranges.len() == 4));
        let asked = air.reports.iter().rev().find_map(|report| match &report.what {
            crate::air::What::Round { asked, .. } if report.node == node => Some(*asked),
            _ => None,
        });
        assert_eq!(asked, Some(4), "the fifth is forgotten");
    }
}

#[test]
fn an_anchor_that_comes_is_found_soon_where_few_are_known() {
    let mut air = Air::new(NETWORK.phy, 7);
    room(&mut air, 3);
    let node = air.add([1.0, 2.0, 1.0], 20.0, sleeper(0x100, 100));
    air.run_until(10.0);
    assert!(air.rounds(node, 9.0).iter().all(|(_, ranges)| ranges.len() == 3));
    air.add(corner(3), drift(3), anchor(3));
    air.run_until(14.0);
    // A second until it has a slot, then once in twenty superframes.
    assert!(air.rounds(node, 13.0).iter().all(|(_, ranges)| ranges.len() == 4));
}

#[test]
fn members_come_and_go_without_a_collision() {
    let mut air = Air::new(NETWORK.phy, 8);
    room(&mut air, 4);
    let node = air.add([1.0, 2.0, 1.0], 20.0, sleeper(0x100, 100));
    air.run_until(5.0);
    let others: Vec<usize> = (1..6)
        .map(|i| air.add([f64::from(i) - 3.0, 1.0, 1.0], drift(i), sleeper(0x100 + i, 100 * u32::from(i))))
        .collect();
    let greedy = air.add([0.0, -1.0, 1.0], -10.0, boxed(machine(0x200, Rate::Greedy)));
    air.run_until(10.0);
    air.switch_off(greedy);
    air.switch_off(others[0]);
    let joined = |tag: usize| air.links(tag).iter().any(|(_, link)| matches!(link, Link::Joined(_)));
    assert!(others.iter().all(|&tag| joined(tag)));
    let before = air.collisions;
    air.run_until(20.0);
    assert_eq!(air.collisions, before);
    assert!(air.rounds(node, 5.0).len() > 135, "{} of 150", air.rounds(node, 5.0).len());
    assert!(air.rounds(others[1], 10.0).len() > 45, "{} of 50", air.rounds(others[1], 10.0).len());
}

#[test]
fn a_tag_without_a_network_hardly_listens_and_finds_one_that_comes() {
    let mut air = Air::new(NETWORK.phy, 9);
    let node = air.add([1.0, 2.0, 1.0], 20.0, sleeper(0x100, 1_000));
    air.run_until(600.0);
    // Two seconds and 120 ms of each 64 s, and of the shorter pauses before.
    assert!((2.5..4.0).contains(&air.received(node)), "{} s", air.received(node));
    room(&mut air, 4);
    air.run_until(680.0);
    assert!(air.rounds(node, 600.0).len() >= 10);
}
