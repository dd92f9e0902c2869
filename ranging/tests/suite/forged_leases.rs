//! Attacks on leases by one DW1000 without any key: what forged sync frames and requests do to tags that range once a
//! superframe or less often, in a room and in a hall whose coordinator the tags do not reach.

use std::cell::Cell;
use std::rc::Rc;

use crate::air::Air;
use crate::air::anchors::{self, corner, drift};
use crate::attack::{Forge, NETWORK, bytes, forger, tag};
use ranging::RadioDuration;
use ranging::exchange::Link;
use ranging::native::{Layout, Rate, Timing};
use wire::uwb::BROADCAST;
use wire::uwb::native::{
    Confirmation, Frame, Grant, Lease, LeasedPoll, Message, Period, Request, Share, SyncFrame, Turn, Turns,
};

/// Addresses of the tags, and how often they range, milliseconds. A superframe is 100 ms: periods of 1, 2 and 10.
const TAGS: [(u16, u32); 3] = [(0x100, 100), (0x101, 200), (0x102, 1_000)];
/// A sync slot that no anchor owns, and a shared one.
const FREE: u8 = 12;
const SHARED: u8 = 19;

/// Where the nodes are. The first anchor coordinates.
#[derive(Clone, Copy, Debug)]
enum Site {
    /// Four anchors, and all nodes receive each other.
    Room,
    /// The coordinator is 55 m from the tags and the attacker 45 m, and frames reach 40 m. Four anchors are in between.
    Hall,
}

const SITES: [Site; 2] = [Site::Room, Site::Hall];

impl Site {
    /// Its anchors.
    fn open(self, seed: u64) -> (Air, Vec<usize>) {
        let mut air = Air::new(NETWORK.phy, seed);
        let places = match self {
            Self::Room => (0..4).map(|i| corner(i, 4)).collect(),
            Self::Hall => {
                air.reach = 40.0;
                vec![[0.0, 0.0, 2.0], [25.0, 8.0, 3.0], [25.0, -8.0, 2.0], [35.0, 8.0, 2.0], [35.0, -8.0, 3.0]]
            }
        };
        let anchors = (1..).zip(places).map(|(address, place)| {
            let node = air.add(place, drift(address), anchors::anchor(NETWORK, address, place, None));
            air.run_until(1.0);
            node
        });
        let anchors = anchors.collect();
        (air, anchors)
    }

    fn tag(self, air: &mut Air, address: u16, rate: Rate) -> usize {
        let (node, _) = tag(air, address, rate);
        air.move_to(node, self.of_tags());
        node
    }

    fn of_tags(self) -> [f64; 3] {
        match self {
            Self::Room => [1.0, 2.0, 1.0],
            Self::Hall => [55.0, 1.0, 1.0],
        }
    }

    fn tags(self, air: &mut Air) -> Vec<usize> {
        TAGS.iter().map(|&(address, millis)| self.tag(air, address, every(millis))).collect()
    }

    /// The attacker, from now on.
    fn attack(self, air: &mut Air, forge: Forge) {
        let place = match self {
            Self::Room => [0.0, 3.0, 1.0],
            Self::Hall => [45.0, 0.0, 1.0],
        };
        air.add(place, 5.0, forger(&Rc::new(Cell::new(true)), forge));
    }
}

fn every(millis: u32) -> Rate {
    Rate::Every(RadioDuration::from_micros(1_000 * millis))
}

fn period(millis: u32) -> Period {
    Period::at_most((millis / 100) as u16)
}

/// A node's rounds with ranges to two anchors at least, in this time.
fn rounds(air: &Air, node: usize, from: f64, to: f64) -> usize {
    air.rounds(node, from).into_iter().filter(|(time, ranges)| *time < to && ranges.len() >= 2).count()
}

/// Whether the tags range as often as they want to in this time, with a round lost in so many or one more.
fn assert_range(air: &Air, nodes: &[usize], [from, to]: [f64; 2], lost_one_in: usize, name: &str) {
    for (&node, (_, millis)) in nodes.iter().zip(TAGS) {
        let expected = ((to - from) * 1000.0 / f64::from(millis)) as usize;
        let rounds = rounds(air, node, from, to);
        assert!(rounds + 1 + expected / lost_one_in >= expected, "{name}: {rounds} of {expected}");
    }
}

/// How long after `from` a node first had slots.
fn joined(air: &Air, node: usize, from: f64) -> Option<f64> {
    let mut links = air.links(node).into_iter();
    links.find(|(_, link)| matches!(link, Link::Joined(_))).map(|(time, _)| time - from)
}

/// Responses to a tag that say this of its lease: when.
fn responses(air: &Air, tag: u16, lease: Confirmation) -> Vec<f64> {
    let says = |bytes: &[u8]| match Frame::parse(bytes) {
        Ok(Frame { destination, message: Message::Response(response), .. }) => {
            destination == tag && response.lease == lease
        }
        Ok(_) | Err(_) => false,
    };
    air.sent.iter().filter(|flight| says(&flight.bytes)).map(|flight| flight.begin).collect()
}

/// The turns that were granted to these tags.
fn granted(air: &Air) -> Vec<Lease> {
    let frames = air.sent.iter().filter_map(|flight| Frame::parse(&flight.bytes).ok());
    let leases = frames.flat_map(|frame| match frame.message {
        Message::SyncFrame(sync_frame) => sync_frame.leases.into_iter().collect(),
        _ => Vec::new(),
    });
    let leases: Vec<Lease> = leases.filter(|lease| lease.grant == Grant::New).collect();
    TAGS.iter().filter_map(|(tag, _)| leases.iter().rev().find(|lease| lease.tag == *tag).copied()).collect()
}

/// A sync frame as this node's, in its own slot or in a shared one, so many hops from the coordinator.
fn claim(source: u16, slot: u8, hops: u8, heard: &SyncFrame) -> SyncFrame {
    let mut slot_owners = heard.slot_owners;
    if let Some(owner) = slot_owners.get_mut(usize::from(slot)) {
        *owner = (source % 255) as u8 + 1;
    }
    SyncFrame {
        slot,
        slot_owners,
        hops,
        heard: 0,
        position: None,
        request: None,
        leases: Default::default(),
        polls: Default::default(),
        ..heard.clone()
    }
}

/// A frame and its time from the superframe's beginning.
type Timed = (RadioDuration, Vec<u8>);

fn in_slot(timing: &Timing, source: u16, sync_frame: SyncFrame) -> Timed {
    (timing.sync_frame(sync_frame.slot.into()), bytes(source, BROADCAST, Message::SyncFrame(sync_frame)))
}

/// Sync frames in the coordinator's name with these entries, in this slot of so many superframes.
fn entries(slot: u8, superframes: usize, leases: Vec<Lease>) -> Forge {
    let mut left = superframes;
    Box::new(move |timing, heard, _| {
        if left == 0 {
            return Vec::new();
        }
        left -= 1;
        let leases = leases.iter().copied().collect();
        let forged = SyncFrame { age: 0, leases, ..claim(heard.coordinator, slot, 0, heard) };
        vec![in_slot(timing, heard.coordinator, forged)]
    })
}

/// False entries for all tags: turns in slots that are never leased, a refusal, or the end of their turns.
fn false_entries(air: &Air, grant: Grant) -> Vec<Lease> {
    let falsify = |lease: Lease| {
        let slot = if grant == Grant::Ended { lease.turn.slot } else { 60 };
        Lease { turn: Turn { slot, ..lease.turn }, grant, ..lease }
    };
    granted(air).into_iter().map(falsify).collect()
}

#[test]
fn a_tag_that_holds_a_lease_loses_nothing_to_false_entries() {
    for site in SITES {
        for grant in [Grant::New, Grant::Kept, Grant::Refused, Grant::Ended] {
            // Once, in each superframe, and as an anchor with a slot of its own, which other anchors believe.
            for (slot, superframes) in [(SHARED, 1), (SHARED, 200), (FREE, 200)] {
                if (slot, grant) == (FREE, Grant::Ended) {
                    continue;
                }
                let (mut air, _) = site.open(1);
                let nodes = site.tags(&mut air);
                air.run_until(6.0);
                let forged = false_entries(&air, grant);
                assert_eq!(forged.len(), TAGS.len());
                site.attack(&mut air, entries(slot, superframes, forged));
                air.run_until(26.0);
                // 200, 100 and 20 rounds in 20 s.
                let name = format!("{site:?}, {grant:?} in slot {slot} of {superframes}");
                assert_range(&air, &nodes, [6.0, 26.0], usize::MAX, &name);
            }
        }
    }
}

#[test]
fn false_ends_that_anchors_believe_cost_a_tag_a_few_rounds_and_then_nothing() {
    for site in SITES {
        let (mut air, _) = site.open(2);
        let nodes = site.tags(&mut air);
        air.run_until(6.0);
        let forged = false_entries(&air, Grant::Ended);
        // The first frame takes the slot. The anchors believe the others, and tell the tags so.
        site.attack(&mut air, entries(FREE, 3, forged));
        air.run_until(28.0);
        for (tag, _) in TAGS {
            let ended = responses(&air, tag, Confirmation::Ended);
            // In its next turn, at most a second later. The coordinator's answer to its request corrects the anchors.
            assert!(!ended.is_empty() && ended.iter().all(|&time| time < 8.0), "{site:?}, {tag:x}: {ended:?}");
        }
        // A request, the answer in the next superframe, and a relay of it: three rounds, two times, of 200.
        assert_range(&air, &nodes, [6.0, 26.0], 33, &format!("{site:?}"));
    }
}

#[test]
fn who_was_granted_false_turns_has_true_ones_in_seconds() {
    for site in SITES {
        // In leased slots, where anchors answer, for a second; in slots that are never leased, and refusals, always.
        let cases = [
            (20, Grant::New, 10),
            (20, Grant::Kept, 10),
            (60, Grant::New, usize::MAX),
            (0, Grant::Refused, usize::MAX),
        ];
        for (slot, grant, superframes) in cases {
            let (mut air, _) = site.open(3);
            air.run_until(3.0);
            let forged = TAGS.iter().zip(slot..).map(|(&(tag, millis), slot)| {
                let turn = Turn::new(slot, 0, period(millis), 0);
                Lease { tag, turn, grant }
            });
            site.attack(&mut air, entries(SHARED, superframes, forged.collect()));
            let nodes = site.tags(&mut air);
            air.run_until(33.0);
            let name = format!("{site:?}, {grant:?}, slot {slot}");
            for (tag, millis) in TAGS {
                // An anchor answers the first poll, at most a period after the grant, and says nothing of the lease. It
                // holds for a period and 40 superframes. Then the tag asks, for 8 superframes, gets turns after 8, and
                // is confirmed after two periods.
                let superframes = f64::from(40 + 8 + 8 + 4 * millis / 100);
                let renewed = responses(&air, tag, Confirmation::Renewed).first().map(|time| time - 3.0);
                let renewed = renewed.unwrap_or_else(|| panic!("{name}: {tag:x} has no true turns"));
                assert!(renewed < superframes / 10.0, "{name}: {tag:x} after {renewed} s");
            }
            assert_range(&air, &nodes, [13.0, 33.0], 20, &name);
        }
    }
}

#[test]
fn false_grants_of_another_tags_turns_cost_neither_tag_its_rounds() {
    for site in SITES {
        let (mut air, _) = site.open(4);
        let nodes = site.tags(&mut air);
        air.run_until(6.0);
        let held = granted(&air)[0];
        site.attack(&mut air, entries(SHARED, usize::MAX, vec![Lease { tag: 0x200, ..held }]));
        let new = site.tag(&mut air, 0x200, every(100));
        air.run_until(26.0);
        // Both poll at once until the new one has received more true entries: in one superframe or two of 200.
        assert_range(&air, &nodes, [6.0, 26.0], 100, &format!("{site:?}"));
        // It joins in a second.
        let rounds = rounds(&air, new, 7.0, 26.0);
        assert!(rounds >= 188, "{site:?}: {rounds} of 190");
    }
}

#[test]
fn requests_in_a_tags_name_cost_neither_the_tag_nor_others_their_slots() {
    let other_period = Share::Leased(Turns::rounds(Period::at_most(50)));
    for site in SITES {
        for share in [Share::Release, other_period, Share::Leased(Turns::rounds(Period::ONE)), Share::Greedy] {
            for superframes in [1, 400] {
                let (mut air, _) = site.open(4);
                let nodes = site.tags(&mut air);
                let (greedy, handle) = tag(&mut air, 0x200, Rate::Greedy);
                air.move_to(greedy, site.of_tags());
                air.run_until(6.0);
                handle.borrow_mut().set_rate(None);
                let mut left = superframes;
                let forge: Forge = Box::new(move |timing, _, _| {
                    left -= 1;
                    let request = Message::Request(Request { share, wish: Layout::LEAST });
                    let in_name = |(i, (tag, _))| (timing.request(3 * i), bytes(tag, BROADCAST, request.clone()));
                    TAGS.into_iter().enumerate().filter(|_| left >= 0).map(in_name).collect()
                });
                site.attack(&mut air, forge);
                // Its thousands of rounds meanwhile would take long to simulate.
                air.run_until(43.0);
                handle.borrow_mut().set_rate(Some(Rate::Greedy));
                air.run_until(46.0);
                let name = format!("{site:?}, {share:?} in {superframes}");
                assert_range(&air, &nodes, [6.0, 46.0], 10, &name);
                // False leases end within 62 superframes, or the 322 of a lease whose polls were taken for another's.
                let [before, after] = [[4.0, 6.0], [44.0, 46.0]].map(|[from, to]| rounds(&air, greedy, from, to));
                let is_whole = superframes > 1 || after * 100 >= before * 99;
                assert!(before > 800 && is_whole, "{name}: {before}, then {after}");
            }
        }
    }
}

#[test]
fn invented_tags_neither_drive_tags_out_nor_keep_new_ones_from_leases() {
    // Requests in a superframe, their period, and how soon new tags join, seconds. A tag that asks again is the next one
    // for whom there is a place on probation. A lease with the longest period takes one until its first turn, all of
    // them in different superframes; one with every superframe for 63 superframes, ten at a time. Of more requests, most
    // replace each other before they come again.
    for (seed, requests, length, soon) in [(5, 3, Period::MOST, 5.0), (6, 3, 1, 8.0), (7, 6, Period::MOST, 20.0)] {
        let (mut air, _) = Site::Room.open(seed);
        let nodes = Site::Room.tags(&mut air);
        air.run_until(6.0);
        let mut invented = 0x4000;
        let forge: Forge = Box::new(move |timing, _, _| {
            let request = Request { share: Share::Leased(Turns::rounds(Period::at_most(length))), wish: Layout::LEAST };
            let invent = |i: usize| {
                invented += 1;
                (timing.request(2 * i), bytes(invented, BROADCAST, Message::Request(request)))
            };
            (0..requests).map(invent).collect()
        });
        Site::Room.attack(&mut air, forge);
        let name = format!("{requests} of period {length} a superframe");
        for address in 0x300..0x304 {
            // All places on probation are taken.
            let begin = air.now + 10.0;
            air.run_until(begin);
            let new = Site::Room.tag(&mut air, address, every(100));
            air.run_until(begin + soon);
            let joined = joined(&air, new, begin);
            assert!(joined.is_some(), "{name}: not in {soon} s");
            air.run_until(begin + soon + 5.0);
            let rounds = rounds(&air, new, begin + soon, begin + soon + 5.0);
            assert!(rounds >= 45, "{name}: {rounds} of 50");
        }
        assert_range(&air, &nodes, [6.0, air.now], 10, &name);
    }
}

#[test]
fn a_false_relay_that_passes_polls_on_costs_no_tag_its_lease() {
    // Of tags that are gone, or of six other invented ones in each superframe.
    let cases =
        [(Site::Room, SHARED, true), (Site::Room, FREE, true), (Site::Hall, FREE, true), (Site::Hall, FREE, false)];
    for (site, slot, are_gone) in cases {
        let (mut air, _) = site.open(9);
        let nodes = site.tags(&mut air);
        let more: Vec<_> = (0x200..0x20C).map(|address| site.tag(&mut air, address, every(200))).collect();
        let gone: Vec<_> = (0x300..0x306).map(|address| site.tag(&mut air, address, every(200))).collect();
        air.run_until(8.0);
        gone.iter().for_each(|&node| air.switch_off(node));
        let mut invented = 0x4000;
        let forge: Forge = Box::new(move |timing, heard, _| {
            invented += 6;
            let first = if are_gone { 0x300 } else { invented };
            let polls = (first..first + 6).map(|tag| LeasedPoll { tag, wish: 0 }).collect();
            vec![in_slot(timing, 0x0BAD, SyncFrame { polls, ..claim(0x0BAD, slot, 3, heard) })]
        });
        site.attack(&mut air, forge);
        air.run_until(48.0);
        let new = site.tag(&mut air, 0x310, every(100));
        air.run_until(54.0);
        let name = format!("{site:?}, slot {slot}, gone {are_gone}");
        // A lease that is not renewed ends after 322 superframes: it would be lost by now.
        let news = nodes.iter().chain(&more).flat_map(|&node| air.links(node));
        let news: Vec<_> = news.filter(|(time, _)| *time > 8.0).collect();
        assert!(news.is_empty(), "{name}: {news:?}");
        assert_range(&air, &nodes, [8.0, 48.0], usize::MAX, &name);
        let joined = joined(&air, new, 48.0);
        assert!(joined.is_some_and(|after| after < 5.0), "{name}: {joined:?}");
    }
}

/// Ten leases of invented tags in each of so many superframes, each with the longest period and its turn far ahead.
fn invented_leases(superframes: usize, grant: Grant) -> Forge {
    let (mut left, mut tag) = (superframes, 0x4000);
    let period = Period::at_most(Period::MOST);
    Box::new(move |timing, heard, known| {
        tag += 10;
        let turn = |i: u16| Turn::new(5, 0, period, (heard.superframe + 5_000 + i) % Period::MOST);
        let leases = (0..10).map(|i| Lease { tag: tag + i, turn: turn(i), grant }).collect();
        let mut forge = entries(FREE, usize::from(left > 0), leases);
        left = left.saturating_sub(1);
        forge(timing, heard, known)
    })
}

#[test]
fn replicas_full_of_false_leases_serve_true_ones() {
    // 103 superframes fill 1024 places. The attack ends then, or goes on.
    for (grant, superframes) in [(Grant::New, 110), (Grant::Kept, 110), (Grant::Kept, 1000)] {
        let (mut air, _) = Site::Hall.open(10);
        let nodes = Site::Hall.tags(&mut air);
        air.run_until(6.0);
        Site::Hall.attack(&mut air, invented_leases(superframes, grant));
        air.run_until(18.0);
        let new = [(0x200, 100), (0x201, 1_000)];
        let new = new.map(|(address, millis)| Site::Hall.tag(&mut air, address, every(millis)));
        air.run_until(48.0);
        let name = format!("{grant:?} in {superframes}");
        assert_range(&air, &nodes, [6.0, 48.0], 10, &name);
        let joined = new.map(|node| joined(&air, node, 18.0));
        assert!(joined.iter().all(|after| after.is_some_and(|after| after < 5.0)), "{name}: {joined:?}");
        let rounds = new.map(|node| rounds(&air, node, 28.0, 48.0));
        assert!(rounds[0] >= 180 && rounds[1] >= 18, "{name}: {rounds:?} of 200 and 20");
    }
}

#[test]
fn an_anchor_that_takes_over_with_false_leases_grants_true_ones() {
    let (mut air, anchors) = Site::Room.open(11);
    let nodes = Site::Room.tags(&mut air);
    air.run_until(6.0);
    Site::Room.attack(&mut air, invented_leases(110, Grant::Kept));
    air.run_until(18.0);
    air.switch_off(anchors[0]);
    air.run_until(20.0);
    // False leases of the longest period would hold for three terms, 61,440 superframes.
    let new = Site::Room.tag(&mut air, 0x200, every(100));
    air.run_until(40.0);
    assert_range(&air, &nodes, [6.0, 40.0], 10, "before and after");
    let joined = joined(&air, new, 20.0);
    assert!(joined.is_some_and(|after| after < 5.0), "{joined:?}");
    assert!(rounds(&air, new, 30.0, 40.0) >= 90);
}
