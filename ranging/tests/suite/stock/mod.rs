//! Our tag and our anchor against stock EVK1000 boards with every known software, implemented from their description:
//! they receive only in their windows, are strict in their delays, and have bytes of their own.

mod anchor;
mod kit;
mod tag;

use std::rc::Rc;

use crate::air::{ANTENNA_DELAY, Air, Boxed, boxed, moments};
use anchor::StockAnchor;
use kit::{Kit, Software};
use ranging::decaranging::{Anchor, AnchorConfig, INIT_DELAY, Tag, TagConfig};
use ranging::exchange::Link;
use ranging::native::ReplyDelay;
use ranging::{PhyConfig, RadioDuration};
use tag::StockTag;
use wire::uwb::decaranging::Variant;

/// The reply delay of a board on the air of these tests.
const QUICK: ReplyDelay = ReplyDelay {
    answer: RadioDuration::from_micros(250),
    listen_again: RadioDuration::from_micros(40),
    transmit: RadioDuration::from_micros(150),
};
const TAG_EUI: u64 = 0xDECA_0200_0000_1234;
const ANCHOR_EUI: u64 = 0xDECA_0100_0000_0042;
const ANCHOR: u16 = 0x0042;

fn config(phy: PhyConfig) -> TagConfig {
    TagConfig {
        eui: TAG_EUI,
        variant: Variant::Standard,
        phy,
        turnaround: QUICK,
        antenna_delay: RadioDuration::from_ticks(ANTENNA_DELAY),
        period: RadioDuration::from_micros(100_000),
    }
}

fn our_tag(phy: PhyConfig) -> Boxed {
    boxed(Tag::new(config(phy)))
}

fn our_anchor(phy: PhyConfig) -> Boxed {
    boxed(Anchor::new(AnchorConfig {
        address: ANCHOR,
        eui: ANCHOR_EUI,
        phy,
        turnaround: QUICK,
        antenna_delay: RadioDuration::from_ticks(ANTENNA_DELAY),
        init_delay: INIT_DELAY,
    }))
}

/// Every software, with short and long addresses, in a mode of 6.81 Mbit/s and one of 110 kbit/s.
fn kits() -> Vec<Kit> {
    let mut kits = Vec::new();
    for mode in [8, 5] {
        let phy = PhyConfig::evk1000_mode(mode).unwrap();
        for software in [Software::Older { reply_ms: 150 }, Software::NewerMicros, Software::NewerMillis] {
            kits.extend([false, true].map(|long| Kit { software, phy, long, init_ms: 150, strict: false }));
        }
        kits.push(Kit { software: Software::Older { reply_ms: 150 }, phy, long: false, init_ms: 750, strict: false });
        kits.push(Kit { software: Software::Older { reply_ms: 5 }, phy, long: false, init_ms: 150, strict: false });
    }
    kits
}

fn air_of(kit: &Kit, seed: u64) -> Air {
    let mut air = Air::new(kit.phy, seed);
    // The power at which the range bias of the mode's pulse rate is zero.
    air.power_dbm = if kit.phy == PhyConfig::FAST { -81.5 } else { -86.25 };
    air
}

fn errors(air: &Air, node: usize, from: f64, truth: f64) -> Vec<f64> {
    let ranges = air.rounds(node, from).into_iter().flat_map(|(_, ranges)| ranges);
    ranges.map(|range| f64::from(range.distance_m) - truth).collect()
}

fn assert_accurate(errors: &[f64], least: usize, what: &str) {
    let (bias, deviation) = moments(errors);
    assert!(errors.len() >= least, "{what}: {} ranges", errors.len());
    assert!(bias.abs() < 0.01 && deviation < 0.03, "{what}: bias {bias:.4} m, deviation {deviation:.4} m");
}

/// The sum of older software, over both rounds, has an error of a quarter of the difference of replies that the clock
/// offset causes: for 150 ms and 40 ppm it is 1.8 cm. Truncation to whole ticks adds 0.25 · 4.7 mm · ½ for the sum and
/// ½ · 4.7 mm for newer software: that is within the tolerance.
fn board_error(software: Software) -> f64 {
    match software {
        Software::Older { reply_ms } => 0.25 * 40e-6 * 40e-6 * f64::from(reply_ms) * 1e-3 * 299_702_547.0,
        Software::NewerMicros | Software::NewerMillis => 0.0,
    }
}

#[test]
fn our_tag_pairs_and_ranges_with_every_stock_anchor() {
    for (seed, kit) in (200..).zip(kits()) {
        let what = format!("{kit:?}");
        let mut air = air_of(&kit, seed);
        let shown = Rc::default();
        air.add([0.0, 0.0, 1.0], 20.0, StockAnchor::boxed(kit, ANCHOR_EUI, &shown));
        let ours = air.add([7.0, 0.0, 1.0], -20.0, our_tag(kit.phy));
        air.run_until(45.0);
        let links = air.links(ours);
        assert!(matches!(links[..], [(time, Link::Paired(0x0042))] if time < 1.0), "{what}: {links:?}");
        let truth = 7.0 + board_error(kit.software);
        assert_accurate(&errors(&air, ours, 0.0, truth), 80, &what);
        let board: Vec<f64> = shown.borrow().iter().map(|metres: &f64| metres - truth).collect();
        assert_accurate(&board, 80, &format!("{what}, the board"));
    }
}

#[test]
fn our_anchor_pairs_and_ranges_with_every_stock_tag() {
    let strict = kits().into_iter().map(|kit| Kit { strict: true, ..kit });
    for (seed, kit) in (230..).zip(kits().into_iter().chain(strict)) {
        let what = format!("{kit:?}");
        let mut air = air_of(&kit, seed);
        let shown = Rc::default();
        let ours = air.add([0.0, 0.0, 1.0], 20.0, our_anchor(kit.phy));
        air.add([12.0, 0.0, 1.0], -20.0, StockTag::boxed(kit, TAG_EUI, &shown));
        air.run_until(50.0);
        let links = air.links(ours);
        // Paired at the third blink at the latest.
        assert!(matches!(links[..], [(time, Link::Paired(0x1234))] if time < 3.0), "{what}: {links:?}");
        assert_accurate(&errors(&air, ours, 0.0, 12.0), 80, &what);
        let board: Vec<f64> = shown.borrow().iter().map(|metres: &f64| metres - 12.0).collect();
        assert_accurate(&board, 80, &format!("{what}, the board"));
    }
}

#[test]
fn lost_frames_cost_their_exchanges_and_nothing_else() {
    for (seed, kit) in (260..).zip(kits()) {
        let what = format!("{kit:?}");
        let truth = 9.0 + board_error(kit.software);
        for (stock_is_tag, truth) in [(false, truth), (true, 9.0)] {
            let mut air = air_of(&kit, seed);
            let shown = Rc::default();
            let [stock, ours] = if stock_is_tag {
                [StockTag::boxed(kit, TAG_EUI, &shown), our_anchor(kit.phy)]
            } else {
                [StockAnchor::boxed(kit, ANCHOR_EUI, &shown), our_tag(kit.phy)]
            };
            let ours = air.add([0.0, 0.0, 1.0], 20.0, ours);
            air.add([9.0, 0.0, 1.0], -20.0, stock);
            // A stock tag that was taken does not blink any more.
            air.run_until(4.0);
            air.loss = 0.1;
            air.run_until(60.0);
            let errors = errors(&air, ours, 4.0, truth);
            // For each of about 120 polls three frames must be received, for a tag a fourth one: 0.9⁴ = 66 %.
            assert!(errors.len() > 60, "{what}: {}", errors.len());
            assert!(errors.iter().all(|error| error.abs() < 0.15), "{what}: {errors:?}");
            let links = air.links(ours);
            assert_eq!(links.len(), 1, "{what}: {links:?}");
        }
    }
}

fn older(mode: u8) -> Kit {
    let phy = PhyConfig::evk1000_mode(mode).unwrap();
    Kit { software: Software::Older { reply_ms: 150 }, phy, long: false, init_ms: 150, strict: false }
}

#[test]
fn ranging_inits_leave_at_once_and_150_and_750_ms_after_the_blink() {
    let kit = Kit { init_ms: 1, ..older(8) };
    let mut air = air_of(&kit, 300);
    let anchor = air.add([0.0, 0.0, 1.0], 20.0, our_anchor(kit.phy));
    // A tag whose window is too early for any init.
    let tag = air.add([9.0, 0.0, 1.0], -20.0, StockTag::boxed(kit, TAG_EUI, &Rc::default()));
    air.run_until(2.9);
    let of = |node: usize| air.sent.iter().filter(move |flight| flight.sender == node);
    let blinks: Vec<f64> = of(tag).map(|flight| flight.rmarker).collect();
    assert_eq!(blinks.len(), 3);
    // The first init is late, so that newer software does not receive it.
    for (blink, expected_us) in blinks.into_iter().zip([151_500.0, 150_000.0, 150_000.0]) {
        let after = of(anchor).map(|flight| (flight.rmarker - blink) * 1e6).filter(|us| (0.0..900_000.0).contains(us));
        let after: Vec<f64> = after.collect();
        let [first, second, third] = after[..] else { panic!("{after:?}") };
        assert!(first < 1_000.0, "{after:?}");
        // From RMARKER to RMARKER; an antenna delay is 0.3 µs, and the clock 20 ppm fast.
        for (us, expected_us) in [(second, expected_us), (third, 750_000.0)] {
            assert!((us - expected_us).abs() < expected_us * 20e-6 + 1.0, "{after:?}, not {expected_us}");
        }
    }
}

#[test]
fn older_software_that_took_two_delays_is_answered_as_it_read_them() {
    let kit = older(8);
    let mut air = air_of(&kit, 301);
    let shown = Rc::default();
    let ours = air.add([0.0, 0.0, 1.0], 20.0, our_anchor(kit.phy));
    let tag = air.add([12.0, 0.0, 1.0], -20.0, StockTag::boxed(kit, TAG_EUI, &shown));
    // The init after the first blink, in milliseconds, is lost; the one after the second is of newer software.
    air.run_until(0.1);
    air.loss = 1.0;
    air.run_until(0.9);
    air.loss = 0.0;
    air.run_until(60.0);
    // Two replies of 443 ms, the microseconds named, and 1 ms to the next poll: 58.85 s / 0.887 s.
    let errors = errors(&air, ours, 0.0, 12.0);
    assert!((64..68).contains(&errors.len()), "{}", errors.len());
    assert!(moments(&errors).0.abs() < 0.02 && shown.borrow().len() >= 40);
    // After a reset of the tag the anchor has the correct delay: 150 ms, and an exchange every 0.4 s.
    air.switch_on(tag, StockTag::boxed(kit, TAG_EUI, &shown));
    air.run_until(120.0);
    assert!(air.rounds(ours, 60.0)[0].0 < 60.6);
    assert!(air.rounds(ours, 60.0).len() > 120, "{}", air.rounds(ours, 60.0).len());
}

#[test]
fn a_reset_of_our_anchor_needs_none_of_the_stock_tag() {
    for (seed, kit) in (310..).zip(kits()) {
        let mut air = air_of(&kit, seed);
        let ours = air.add([0.0, 0.0, 1.0], 20.0, our_anchor(kit.phy));
        air.add([12.0, 0.0, 1.0], -20.0, StockTag::boxed(kit, TAG_EUI, &Rc::default()));
        air.run_until(10.0);
        air.switch_on(ours, our_anchor(kit.phy));
        air.run_until(50.0);
        let rounds = air.rounds(ours, 10.0);
        assert!(rounds.first().is_some_and(|(time, _)| *time < 16.0), "{kit:?}: {:?}", rounds.first());
        assert!(rounds.len() > 60, "{kit:?}: {}", rounds.len());
    }
}

#[test]
fn while_a_stock_tag_waits_another_tag_ranges() {
    let kit = older(8);
    let mut air = air_of(&kit, 302);
    let anchor = air.add([0.0, 0.0, 1.0], 20.0, our_anchor(kit.phy));
    let period = RadioDuration::from_micros(73_313);
    let ours =
        air.add([7.0, 0.0, 1.0], -20.0, boxed(Tag::new(TagConfig { eui: TAG_EUI + 1, period, ..config(kit.phy) })));
    air.run_until(2.0);
    air.add([0.0, 12.0, 1.0], 5.0, StockTag::boxed(kit, TAG_EUI, &Rc::default()));
    air.run_until(32.0);
    let to = |peer: u16| {
        let rounds = air.rounds(anchor, 4.0).into_iter().flat_map(|(_, ranges)| ranges);
        rounds.filter(move |range| range.peer == peer).map(|range| f64::from(range.distance_m)).collect::<Vec<_>>()
    };
    // 28 s at 13.6 a second, at all phases of the other's period. Every 0.4 s there is the stock tag's exchange of 0.3
    // s, during which the anchor does not receive for 4 ms three times, 3 %.
    let [of_ours, of_stock] = [to(0x1235), to(0x1234)];
    assert!(of_ours.len() > 370, "{}", of_ours.len());
    assert!(of_stock.len() > 50, "{}", of_stock.len());
    assert!(of_ours.iter().all(|metres| (metres - 7.0).abs() < 0.15));
    assert!(of_stock.iter().all(|metres| (metres - 12.0).abs() < 0.15));
    assert!(errors(&air, ours, 4.0, 7.0).len() > 370);
}

#[test]
fn our_tag_and_our_anchor_range_by_whatever_init_is_heard() {
    // The first frame after the blink is lost. The frame 150 ms after the first blink is for older software, whose
    // exchanges last 0.3 s; the one 150 ms after the second is for newer software. In the other case they range every
    // 0.1 s.
    for (seed, blinks, at_least) in [(320, 0, 750), (321, 1, 250), (322, 2, 750)] {
        let kit = older(8);
        let mut air = air_of(&kit, seed);
        let anchor = air.add([0.0, 0.0, 1.0], 20.0, our_anchor(kit.phy));
        let tag = air.add([7.0, 0.0, 1.0], -20.0, our_tag(kit.phy));
        for blink in 0..blinks {
            air.loss = 0.0;
            air.run_until(f64::from(blink) + 0.0005);
            air.loss = 1.0;
            air.run_until(f64::from(blink) + if blink + 1 < blinks { 0.9 } else { 0.1 });
        }
        air.loss = 0.0;
        air.run_until(80.0);
        for (node, peer) in [(anchor, 0x1234), (tag, ANCHOR)] {
            let links = air.links(node);
            assert!(matches!(links[..], [(_, Link::Paired(known))] if known == peer), "{blinks}: {links:?}");
            let errors = errors(&air, node, 0.0, 7.0);
            assert_accurate(&errors, at_least, &format!("{blinks} blinks"));
        }
    }
}
