//! Tags that only listen, on a small simulated air: accuracy under drift, rates, losses, restarts.

use crate::air::{Air, Boxed, STAMPS, anchors, boxed, boxed_on, mischief, moments};
use ranging::exchange::{Difference, Link};
use ranging::native::{Network, PollContent, Rate, Scheme, Tag, TagConfig, TdoaTag, TdoaTagConfig};
use ranging::{PhyConfig, RadioDuration, StampModel};
use wire::uwb::native::{Frame, Message};

const NETWORK: Network = Network::new(0xBA1A, PhyConfig::FAST);

/// The stamp model of a radio with a bias.
fn biased() -> StampModel {
    StampModel { range_bias: baliza_dw1000::bias::of(&NETWORK.phy), ..STAMPS }
}

fn listener() -> Boxed {
    boxed_on(&biased(), TdoaTag::new(TdoaTagConfig { network: NETWORK, period: None }))
}

/// Anchors 1, 2, … on a circle of 10 m, their drifts ±20 ppm in turn, each asking `hz` times a second.
fn room(air: &mut Air, anchors: u16, hz: u32) -> Vec<usize> {
    anchors::room(air, NETWORK, anchors, Some(times_a_second(hz)))
}

fn times_a_second(hz: u32) -> Rate {
    Rate::Every(RadioDuration::from_micros(1_000_000 / hz))
}

/// Errors of all differences received from `from` on and their reported deviations, metres. All frames on this air have
/// the same power, so it does not have the bias of a clear path between anchors, which the protocol corrects: this
/// function adds the bias back.
fn errors(air: &Air, tag: usize, anchors: &[usize], from: f64) -> Vec<(f64, f64)> {
    let bias = biased().range_bias;
    let node = |address: u16| anchors[usize::from(address) - 1];
    let of = |reference: u16, difference: &Difference| {
        let [there, here] = [node(difference.peer), node(reference)];
        let truth = air.distance(tag, there) - air.distance(tag, here);
        let expected = f64::from(bias.expected(air.distance(there, here) as f32));
        let common = 0.03;
        (f64::from(difference.difference_m) + expected - truth, f64::from(difference.deviation_m).hypot(common))
    };
    let heard = air.heard(tag, from);
    heard.iter().flat_map(|(reference, all)| all.iter().map(|one| of(*reference, one)).collect::<Vec<_>>()).collect()
}

/// No error exceeds five times the reported deviation.
fn assert_honest(errors: &[(f64, f64)]) {
    let wrong: Vec<_> = errors.iter().filter(|(error, deviation)| error.abs() > 5.0 * deviation).collect();
    assert!(wrong.is_empty(), "{} of {}: {wrong:?}", wrong.len(), errors.len());
}

#[test]
fn differences_are_right_under_drift_and_as_uncertain_as_they_say() {
    let mut air = Air::new(NETWORK.phy, 1);
    let anchors = room(&mut air, 8, 10);
    let tag = air.add([1.0, 2.0, 1.0], -20.0, listener());
    air.run_until(4.0);
    let errors: Vec<f64> = errors(&air, tag, &anchors, 2.0).into_iter().map(|(error, _)| error).collect();
    let (bias, deviation) = moments(&errors);
    // Three timestamps of 0.1 ns: √3 · 3 cm = 5.2 cm, plus the errors of the clocks' rates.
    assert!(errors.len() > 900, "{} differences", errors.len());
    assert!(bias.abs() < 0.01, "bias {bias:.4} m");
    assert!((0.045..0.07).contains(&deviation), "deviation {deviation:.4} m");
    let told: Vec<f64> =
        air.heard(tag, 2.0).iter().flat_map(|(_, all)| all.clone()).map(|one| f64::from(one.deviation_m)).collect();
    let (told, _) = moments(&told);
    // Without the common timestamp: √(5.2² − 3²) = 4.2 cm.
    assert!((0.04..0.06).contains(&told), "told {told:.4} m");
}

#[test]
fn anchors_tell_how_far_they_measured_each_other() {
    let mut air = Air::new(NETWORK.phy, 8);
    let anchors = room(&mut air, 5, 10);
    air.run_until(4.0);
    let bias = f64::from(biased().range_bias.metres(air.power_dbm));
    let mut told = 0;
    for flight in air.sent.iter().filter(|flight| flight.begin > 3.0) {
        let Ok(Frame { message: Message::Poll(poll), .. }) = Frame::parse(&flight.bytes) else { continue };
        for asked in poll.anchors {
            let metres = asked.distance.metres().expect("each was measured a few times");
            let truth = air.distance(flight.sender, anchors[usize::from(asked.address) - 1]);
            // Twenty ranges and more, each with two timestamps of 3 cm halved and the carrier's 3 cm: a centimetre; and
            // 2 mm of rounding.
            assert!((f64::from(metres) + bias - truth).abs() < 0.04, "{metres} m of {truth} m");
            told += 1;
        }
    }
    // Five anchors, ten rounds in the second, four others each.
    assert!(told > 180, "{told} distances");
}

#[test]
fn every_listener_hears_every_round_and_nothing_collides() {
    let mut air = Air::new(NETWORK.phy, 2);
    let anchors = room(&mut air, 8, 10);
    let tags: Vec<usize> =
        (0..20).map(|i| air.add([f64::from(i) / 3.0 - 3.0, 1.0, 1.0], f64::from(i) - 10.0, listener())).collect();
    // A tag that ranges, at the same time.
    let ranging = TagConfig {
        address: 0x100,
        network: NETWORK,
        anchors: 8,
        rate: Rate::Greedy,
        scheme: Scheme::SingleSided,
        tells: PollContent::Nothing,
        blinks: false,
    };
    let ranging = air.add([2.0, 2.0, 1.0], 5.0, boxed(Tag::new(ranging)));
    air.run_until(3.0);
    for tag in tags {
        let rounds = air.heard(tag, 2.0);
        // Eight anchors, ten rounds a second each.
        assert!(rounds.len() >= 76, "{} rounds", rounds.len());
        assert!(rounds.iter().all(|(_, differences)| differences.len() == 7), "{rounds:?}");
    }
    assert!(air.rounds(ranging, 2.0).len() > 150, "{}", air.rounds(ranging, 2.0).len());
    assert_eq!(air.collisions, 0);
    drop(anchors);
}

#[test]
fn loss_costs_differences_and_not_their_truth() {
    let mut air = Air::new(NETWORK.phy, 3);
    let anchors = room(&mut air, 6, 10);
    let tag = air.add([-1.0, 3.0, 1.5], 10.0, listener());
    air.run_until(1.0);
    air.loss = 0.3;
    air.corruption = 0.05;
    air.run_until(5.0);
    let errors = errors(&air, tag, &anchors, 1.0);
    assert!(errors.len() > 200, "{} differences", errors.len());
    assert_honest(&errors);
}

#[test]
fn strange_frames_give_no_wrong_difference() {
    // Only the check bytes show that low bits of a timestamp were flipped. With this random seed other bits are
    // flipped.
    let mut air = Air::new(NETWORK.phy, 40);
    let anchors = room(&mut air, 6, 10);
    let tag = air.add([-1.0, 3.0, 1.5], 10.0, listener());
    air.run_until(1.0);
    air.add([4.0, 4.0, 1.0], 3.0, mischief(9));
    air.run_until(4.0);
    let errors = errors(&air, tag, &anchors, 1.0);
    assert!(errors.len() > 100, "{} differences", errors.len());
    assert_honest(&errors);
}

#[test]
fn a_restarted_anchor_is_heard_rightly_again() {
    let mut air = Air::new(NETWORK.phy, 5);
    let anchors = room(&mut air, 5, 10);
    let tag = air.add([1.0, 2.0, 1.0], 0.0, listener());
    air.run_until(2.0);
    air.switch_on(
        anchors[2],
        anchors::anchor(NETWORK, 3, [-8.090_169_943_749_473, 5.877_852_522_924_733, 2.0], Some(times_a_second(10))),
    );
    air.run_until(5.0);
    let errors = errors(&air, tag, &anchors, 2.0);
    assert_honest(&errors);
    let of_the_third = air.heard(tag, 4.0).iter().flat_map(|(_, all)| all.clone()).filter(|one| one.peer == 3).count();
    assert!(of_the_third > 20, "{of_the_third} differences with the third anchor");
}

#[test]
fn a_period_lets_the_radio_rest() {
    let mut air = Air::new(NETWORK.phy, 6);
    room(&mut air, 8, 10);
    let machine = TdoaTag::new(TdoaTagConfig { network: NETWORK, period: Some(RadioDuration::from_micros(200_000)) });
    let tag = air.add([1.0, 2.0, 1.0], 0.0, boxed_on(&biased(), machine));
    air.run_until(4.0);
    let rounds = air.heard(tag, 2.0).len();
    assert!((7..=10).contains(&rounds), "{rounds} rounds in two seconds");
}

#[test]
fn a_tag_without_anchors_says_so() {
    let mut air = Air::new(NETWORK.phy, 7);
    let anchors = room(&mut air, 4, 10);
    let tag = air.add([1.0, 2.0, 1.0], 0.0, listener());
    air.run_until(2.0);
    for anchor in anchors {
        air.switch_off(anchor);
    }
    air.run_until(4.0);
    let links: Vec<Link> = air.links(tag).into_iter().map(|(_, link)| link).collect();
    assert!(matches!(links[..], [Link::Synchronised(_), Link::Unsynchronised]), "{links:?}");
    assert!(air.heard(tag, 3.0).is_empty());
}
