//! Attacks on native mode by one DW1000 without any key, successful or not: forged sync frames, requests and responses
//! on a small simulated air. `docs/use/security.md` describes the remaining attacks.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;

use crate::air::anchors::{self, corner};
use crate::air::{ANTENNA_DELAY, Air, Boxed, Owned};
use ranging::exchange::{Event, Link, Protocol};
use ranging::native::{
    Layout, Network, PollContent, Rate, Refused, Scheme, Tag, TagConfig, TdoaTag, TdoaTagConfig, Timing,
};
use ranging::{PhyConfig, RadioDuration, RadioInstant, Start};
use wire::uwb::layout::Span;
use wire::uwb::native::{
    Confirmation, Frame, Member, Message, Period, Position, Request, Response, Share, SyncFrame, Turns,
};
use wire::uwb::{BROADCAST, FrameBuffer};

pub(crate) const NETWORK: Network = Network::new(0xBA1A, PhyConfig::FAST);
/// Metres that light travels in air in a tick: metres per second divided by ticks per second.
const METRES_PER_TICK: f64 = 299_702_547.0 / 63_897_600_000.0;

fn anchor(address: u16, position: [f64; 3], rounds: Option<Rate>) -> Boxed {
    anchors::anchor(NETWORK, address, position, rounds)
}

/// Anchors 1, 2, … on a circle of 10 m, their drifts ±20 ppm in turn.
pub(crate) fn room(air: &mut Air, anchors: u16, rounds: Option<Rate>) -> Vec<usize> {
    anchors::room(air, NETWORK, anchors, rounds)
}

/// A protocol on the air, and a handle to read what it refused.
pub(crate) fn shared<M: Protocol + 'static>(machine: M) -> (Boxed, Rc<RefCell<M>>) {
    let handle = Rc::new(RefCell::new(machine));
    let inner = Rc::clone(&handle);
    let on_air = move |now, pace, event: Event<'_>| {
        let mut machine = inner.borrow_mut();
        machine.pace(pace);
        machine.step(now, event).into()
    };
    (Box::new(on_air), handle)
}

/// A tag at (1, 2, 1) m.
pub(crate) fn tag(air: &mut Air, address: u16, rate: Rate) -> (usize, Rc<RefCell<Tag>>) {
    let config = TagConfig {
        address,
        network: NETWORK,
        anchors: 8,
        rate,
        scheme: Scheme::SingleSided,
        tells: PollContent::Nothing,
        blinks: false,
    };
    let (machine, handle) = shared(Tag::new(config));
    (air.add([1.0, 2.0, 1.0], -20.0, machine), handle)
}

fn ticks(ticks: i64) -> RadioDuration {
    RadioDuration::from_ticks(ticks)
}

pub(crate) fn bytes(source: u16, destination: u16, message: Message) -> Vec<u8> {
    let mut out = FrameBuffer::new();
    Frame { sequence: 9, pan: NETWORK.pan, destination, source, message }.emit(&mut out);
    out.bytes().to_vec()
}

/// The frames to send and their times from the superframe's beginning. `forge` gets the first sync frame received in a
/// superframe, and the last one of each anchor.
pub(crate) type Forge = Box<dyn FnMut(&Timing, &SyncFrame, &BTreeMap<u16, SyncFrame>) -> Vec<(RadioDuration, Vec<u8>)>>;

/// Listens, and from `armed` on sends the forged frames. It follows the layout in the sync frames.
pub(crate) fn forger(armed: &Rc<Cell<bool>>, mut forge: Forge) -> Boxed {
    let armed = Rc::clone(armed);
    let mut known = BTreeMap::new();
    let mut queue: VecDeque<(RadioInstant, Vec<u8>)> = VecDeque::new();
    let mut done = None;
    Box::new(move |now, _, event| {
        if let Event::Received(frame) = event
            && let Ok(Frame { source, message: Message::SyncFrame(sync_frame), .. }) = Frame::parse(frame.bytes)
        {
            known.insert(source, sync_frame.clone());
            if armed.get() && done != Some(sync_frame.superframe) && !sync_frame.layout_is_new {
                done = Some(sync_frame.superframe);
                let timing = Timing::of(&NETWORK, sync_frame.layout);
                let start = frame.rx_time.plus(ticks(-timing.sync_frame(sync_frame.slot.into()).ticks()));
                let mut forged = forge(&timing, &sync_frame, &known);
                forged.sort_by_key(|(at, _)| *at);
                queue.extend(forged.into_iter().map(|(at, bytes)| (start.plus(at).plus(ticks(-ANTENNA_DELAY)), bytes)));
            }
        }
        while let Some((at, _)) = queue.front() {
            if at.since(now).as_micros() < 300 {
                queue.pop_front();
                continue;
            }
            if at.since(now).as_micros() > 1000 {
                break;
            }
            if let Some((at, frame)) = queue.pop_front() {
                return Owned::Transmit { frame, start: Start::At(at), listen: true };
            }
        }
        let window = queue.front().map_or(2000, |(at, _)| (at.since(now).as_micros() - 700).clamp(50, 2000)) as u32;
        Owned::Receive { start: Start::Now, window: RadioDuration::from_micros(window), keep_listening: true }
    })
}

/// Repeats every anchor's sync frame with a position five metres aside, in a shared slot or in a free one claimed for
/// it.
fn five_metres_aside(own_slots: bool) -> Forge {
    Box::new(move |timing, heard, known| {
        let anchors =
            known.iter().filter(|(source, sync_frame)| **source < 100 && sync_frame.position.is_some()).take(4);
        let forge = |(i, (&source, sync_frame)): (usize, (&u16, &SyncFrame))| {
            let [x, y, z] = sync_frame.position.expect("a position").metres();
            // Free slots: the anchors 1 to 4 have 1 to 4.
            let slot = if own_slots { 10 + i } else { 16 + i };
            let mut slot_owners = heard.slot_owners;
            if let Some(owner) = slot_owners.get_mut(slot) {
                *owner = source as u8 + 1;
            }
            let position = Position::from_metres([x + 5.0, y, z]);
            let forged = SyncFrame { slot: slot as u8, slot_owners, position, ..heard.clone() };
            (timing.sync_frame(slot), bytes(source, BROADCAST, Message::SyncFrame(forged)))
        };
        anchors.enumerate().map(forge).collect()
    })
}

/// The number of a tag's ranges with a position that is not the anchor's, and the number of all its ranges.
fn displaced(air: &Air, node: usize, from: f64, anchors: u16) -> (usize, usize) {
    let ranges = air.rounds(node, from).into_iter().flat_map(|(_, ranges)| ranges);
    let known: Vec<_> = ranges.filter_map(|range| Some((range.peer, range.position_m?))).collect();
    let off = known.iter().filter(|(peer, [x, ..])| (f64::from(*x) - corner(peer - 1, anchors)[0]).abs() > 0.011);
    (off.count(), known.len())
}

#[test]
fn forged_sync_frames_move_no_anchor_of_a_tag_that_has_heard_the_true_ones() {
    for (seed, own_slots) in [(1, false), (2, true)] {
        let mut air = Air::new(NETWORK.phy, seed);
        room(&mut air, 4, None);
        let (node, handle) = tag(&mut air, 0x100, Rate::Greedy);
        let armed = Rc::new(Cell::new(false));
        air.add([0.0, 3.0, 1.0], 5.0, forger(&armed, five_metres_aside(own_slots)));
        air.run_until(2.0);
        assert_eq!(handle.borrow().refused(), Refused::default());
        let before = air.rounds(node, 1.0).len();
        armed.set(true);
        air.run_until(8.0);
        let (off, all) = displaced(&air, node, 2.0, 4);
        assert!(off == 0 && all > 4000, "own slots {own_slots}: {off} of {all}");
        assert!(air.rounds(node, 7.0).len() * 10 > before * 9, "{before}, then {}", air.rounds(node, 7.0).len());
        // Four in a superframe for six seconds, minus those that collide.
        let refused = handle.borrow().refused();
        assert!(refused.positions > 150, "{refused:?}");
    }
}

/// In each superframe a stranger asks for relay slots, in a shared slot or in a free one claimed for it. Notes whether the
/// network has some.
fn relay_slots_for_nothing(own_slot: bool, seen: &Rc<Cell<bool>>) -> Forge {
    let seen = Rc::clone(seen);
    Box::new(move |timing, heard, known| {
        seen.set(seen.get() || known.values().any(|told| told.has_relay_slots));
        let slot = if own_slot { 10 } else { 16 };
        let mut slot_owners = heard.slot_owners;
        if let Some(owner) = slot_owners.get_mut(slot) {
            *owner = 201;
        }
        let request = None;
        let told =
            SyncFrame { hops: 3, slot: slot as u8, slot_owners, request, wishes_relay_slots: true, ..heard.clone() };
        vec![(timing.sync_frame(slot), bytes(200, BROADCAST, Message::SyncFrame(told)))]
    })
}

#[test]
fn a_stranger_gets_relay_slots_only_by_patience_and_they_cost_an_eighth() {
    for own_slot in [false, true] {
        let mut air = Air::new(NETWORK.phy, 3);
        room(&mut air, 4, None);
        let (node, _) = tag(&mut air, 0x100, Rate::Greedy);
        let (armed, seen) = (Rc::new(Cell::new(false)), Rc::new(Cell::new(false)));
        air.add([0.0, 3.0, 1.0], 5.0, forger(&armed, relay_slots_for_nothing(own_slot, &seen)));
        air.run_until(3.0);
        let before = air.rounds(node, 2.0).len();
        armed.set(true);
        air.run_until(6.0);
        assert!(!seen.get(), "not before three seconds");
        air.run_until(10.0);
        assert_eq!(seen.get(), own_slot);
        let after = air.rounds(node, 9.0).len();
        assert!(after * 8 > before * 6, "own slot {own_slot}: {before}, then {after}");
    }
}

#[test]
fn a_later_term_does_not_end_a_network_whose_coordinator_is_heard() {
    // One sync frame in `every` superframes, that many terms ahead, of another coordinator or of none better.
    for (seed, every, ahead) in [(3, 1, 100), (4, 3, 100), (5, 3, 1), (6, 1, 2)] {
        let mut air = Air::new(NETWORK.phy, seed);
        let anchors = room(&mut air, 4, None);
        let (node, handle) = tag(&mut air, 0x100, Rate::Greedy);
        let armed = Rc::new(Cell::new(false));
        let mut term = None;
        let forge: Forge = Box::new(move |timing, heard, _| {
            if heard.superframe % every != 0 {
                return Vec::new();
            }
            let forged = SyncFrame {
                slot: 19,
                term: *term.get_or_insert(heard.term.wrapping_add(ahead)),
                coordinator: 0x0BAD,
                age: 0,
                hops: 0,
                version: heard.version.wrapping_add(1),
                countdown: 0,
                members: Default::default(),
                position: None,
                request: None,
                ..heard.clone()
            };
            vec![(timing.sync_frame(19), bytes(0x0BAD, BROADCAST, Message::SyncFrame(forged)))]
        });
        air.add([0.0, 3.0, 1.0], 5.0, forger(&armed, forge));
        air.run_until(2.0);
        let before = air.rounds(node, 1.0).len();
        armed.set(true);
        air.run_until(8.0);
        let name = format!("one in {every}, {ahead} ahead");
        for second in 2..8 {
            let rounds = air.rounds(node, f64::from(second)).into_iter();
            let rounds = rounds.filter(|(time, _)| *time < f64::from(second) + 1.0).count();
            assert!(rounds * 10 > before * 9, "{name}: {before}, then {rounds} from {second} s on");
        }
        let news = anchors.iter().chain([&node]).flat_map(|&each| air.links(each)).filter(|(time, _)| *time > 2.0);
        assert_eq!(news.count(), 0, "{name}");
        let refused = handle.borrow().refused();
        assert!(refused.coordinators >= 15, "{name}: {refused:?}");
    }
}

#[test]
fn tags_that_do_not_exist_neither_stay_nor_keep_others_out() {
    let mut air = Air::new(NETWORK.phy, 7);
    room(&mut air, 4, None);
    let (old, _) = tag(&mut air, 0x200, Rate::Every(RadioDuration::from_micros(50_000)));
    let armed = Rc::new(Cell::new(false));
    let (mut number, full) = (0u16, Rc::new(Cell::new(0)));
    let most = Rc::clone(&full);
    let forge: Forge = Box::new(move |timing, heard, _| {
        let invented = heard.members.iter().filter(|member| member.tag >= 0x4000).count();
        most.set(most.get().max(invented));
        number += 1;
        let invent = |i: u16| 0x4000 + (2 * number + i) % 24;
        let request = Request { share: Share::Slots(1), wish: Layout::LEAST };
        // A relay that no other node receives reports that it received them all, and passes one more request on.
        let relay = SyncFrame {
            slot: 18,
            hops: heard.hops.saturating_add(3),
            heard: u16::MAX,
            position: None,
            request: Some(Member { tag: invent(1), share: Share::Slots(1) }),
            ..heard.clone()
        };
        vec![
            (timing.request(1), bytes(invent(0), BROADCAST, Message::Request(request))),
            (timing.sync_frame(18), bytes(0x4999, BROADCAST, Message::SyncFrame(relay))),
        ]
    });
    air.add([0.0, 3.0, 1.0], 5.0, forger(&armed, forge));
    air.run_until(1.5);
    armed.set(true);
    air.run_until(15.0);
    // The flood continues while another tag comes.
    let (node, _) = tag(&mut air, 0x100, Rate::Every(RadioDuration::from_micros(50_000)));
    air.run_until(25.0);
    let joined = air.links(node).into_iter().find(|(_, link)| matches!(link, Link::Joined(_)));
    let joined = joined.expect("a place").0;
    assert!(joined < 20.0, "after {} s", joined - 15.0);
    // Twenty a second are requested.
    assert!(air.rounds(node, 20.0).len() > 90, "{} rounds in 5 s", air.rounds(node, 20.0).len());
    assert!(air.rounds(old, 20.0).len() > 90, "{} rounds in 5 s", air.rounds(old, 20.0).len());
    assert!((2..=8).contains(&full.get()), "{} invented members", full.get());
}

/// A forger's sync frame and its sender, made of the coordinator's newest one.
type ForgeOne = fn(&SyncFrame) -> (u16, SyncFrame);

/// Another list of the coordinator, `ahead` of its own.
fn other_list(told: &SyncFrame, ahead: u8, countdown: u8) -> SyncFrame {
    SyncFrame { version: told.version.wrapping_add(ahead), countdown, members: Default::default(), ..told.clone() }
}

/// The same members with the slowest layout.
fn slowest(told: &SyncFrame, ahead: u8, countdown: u8) -> SyncFrame {
    let layout = Layout { answer: Span::LONGEST, listen_again: Span::LONGEST, scheme: Scheme::DoubleSided };
    SyncFrame {
        members: told.members.clone(),
        layout,
        layout_is_new: countdown > 0,
        ..other_list(told, ahead, countdown)
    }
}

/// The rounds of a node in the second from this one on.
pub(crate) fn rounds_in_second(air: &Air, node: usize, from: u32) -> usize {
    let from = f64::from(from);
    air.rounds(node, from).into_iter().filter(|(time, _)| *time < from + 1.0).count()
}

/// A request in this tag's name, sent once.
fn request_once(source: u16, request: Request) -> Forge {
    let mut is_sent = false;
    Box::new(move |timing, _, _| {
        let is_first = !std::mem::replace(&mut is_sent, true);
        let frame = || (timing.request(1), bytes(source, BROADCAST, Message::Request(request)));
        is_first.then(frame).into_iter().collect()
    })
}

/// Four anchors and a greedy tag; a forged sync frame at 3 s and every six seconds after it. The tag's rounds in
/// the second before, in each second after, and the lists that it has refused.
fn beside(forge: ForgeOne) -> (usize, Vec<usize>, u32) {
    let mut air = Air::new(NETWORK.phy, 7);
    room(&mut air, 4, None);
    let (node, handle) = tag(&mut air, 0x100, Rate::Greedy);
    let armed = Rc::new(Cell::new(false));
    let mut last: Option<u16> = None;
    let forge: Forge = Box::new(move |timing, heard, known| {
        let Some(told) = known.get(&heard.coordinator) else { return Vec::new() };
        if last.is_some_and(|last| heard.superframe.wrapping_sub(last) < 60) {
            return Vec::new();
        }
        last = Some(heard.superframe);
        let superframe = heard.superframe;
        let (source, forged) =
            forge(&SyncFrame { superframe, slot: 19, position: None, request: None, ..told.clone() });
        vec![(timing.sync_frame(19), bytes(source, BROADCAST, Message::SyncFrame(forged)))]
    });
    air.add([0.0, 3.0, 1.0], 5.0, forger(&armed, forge));
    air.run_until(3.0);
    armed.set(true);
    air.run_until(12.0);
    let in_second = |from| rounds_in_second(&air, node, from);
    let lists = handle.borrow().refused().lists;
    (in_second(2), (3..12).map(in_second).collect(), lists)
}

#[test]
fn no_single_frame_keeps_a_tag_from_ranging() {
    let forgeries: [(&str, ForgeOne, bool); 9] = [
        ("no members, far ahead, at once", |told| (told.coordinator, other_list(told, 127, 0)), true),
        ("no members, far ahead, announced", |told| (told.coordinator, other_list(told, 127, 4)), true),
        ("no members, the next list, at once", |told| (told.coordinator, other_list(told, 1, 0)), true),
        ("no members, the next list, announced", |told| (told.coordinator, other_list(told, 1, 4)), true),
        ("no members, by a stranger", |told| (0x0BAD, SyncFrame { hops: 2, ..other_list(told, 1, 4) }), true),
        ("another layout, far ahead, at once", |told| (told.coordinator, slowest(told, 127, 0)), true),
        ("another layout, the next list, announced", |told| (told.coordinator, slowest(told, 1, 4)), true),
        (
            "a stranger's request of the slowest layout",
            |told| (0x0BAD, SyncFrame { hops: 3, wish: slowest(told, 0, 0).layout, ..told.clone() }),
            false,
        ),
        (
            "all sync slots claimed",
            |told| (0x0BAD, SyncFrame { hops: 3, slot_owners: [77; 16], ..told.clone() }),
            false,
        ),
    ];
    for (name, forge, is_refused) in forgeries {
        let (before, after, lists) = beside(forge);
        assert!(before > 400, "{name}: {before}");
        let slowest = after.iter().min().copied().unwrap_or(0);
        assert!(slowest * 10 > before * 9, "{name}: {before}, then {after:?}");
        assert_eq!(lists > 0, is_refused, "{name}: {lists}");
    }
}

#[test]
fn a_tag_whose_slots_were_released_in_its_name_says_so_and_has_them_again_within_two_seconds() {
    let mut air = Air::new(NETWORK.phy, 13);
    room(&mut air, 4, None);
    let (node, _) = tag(&mut air, 0x100, Rate::Greedy);
    let armed = Rc::new(Cell::new(false));
    // With no other member the list could be changed back at once.
    tag(&mut air, 0x101, Rate::Greedy);
    let release = Request { share: Share::Release, wish: Layout::LEAST };
    air.add([0.0, 3.0, 1.0], 5.0, forger(&armed, request_once(0x100, release)));
    air.run_until(3.0);
    armed.set(true);
    air.run_until(6.0);
    let links: Vec<_> = air.links(node).into_iter().filter(|(time, _)| *time > 3.0).collect();
    let [(lost, Link::Unlisted), (joined, Link::Joined(_))] = links[..] else { panic!("{links:?}") };
    assert!(joined - lost < 2.0, "{links:?}");
}

/// A node that transmits with an anchor's address.
#[derive(Clone, Copy)]
struct Impostor {
    address: u16,
    position: [f32; 3],
    /// The amount that it adds to the distance by its reported reply, metres.
    told_m: f64,
    /// How much later than in its slot it answers, microseconds.
    late_us: f64,
}

impl Impostor {
    /// Answers every poll that names its address, and sends a sync frame with it.
    fn boxed(self) -> Boxed {
        let (mut sent_for, mut timing) = (None, None);
        Box::new(move |now, _, event| {
            if let Event::Received(heard) = event
                && let Ok(frame) = Frame::parse(heard.bytes)
            {
                match (frame.message, timing) {
                    (Message::Poll(poll), Some(timing)) => {
                        let place = poll.anchors.iter().position(|asked| asked.address == self.address);
                        if let Some(slot) = place {
                            let timing: Timing = timing;
                            let due = timing.reply_in(slot).ticks() + (self.late_us * 63_897.6) as i64;
                            let start = heard.rx_time.plus(ticks(due - ANTENNA_DELAY));
                            let departure = crate::air::STAMPS.departure(start);
                            // d = c (round − reply) / 2; a late answer is reported as on time.
                            let add = (self.told_m * 2.0 / METRES_PER_TICK) as i64;
                            let late = (self.late_us * 63_897.6) as i64;
                            let reply = ticks(departure.since(heard.rx_time).ticks() - late - add);
                            let response = Response {
                                round: poll.round as u8,
                                lease: Confirmation::None,
                                has_message: false,
                                passes_nothing_on: false,
                                poll_rx: heard.rx_time,
                                reply,
                                last_final: None,
                            };
                            let frame = bytes(self.address, frame.source, Message::Response(response));
                            return Owned::Transmit { frame, start: Start::At(start), listen: true };
                        }
                    }
                    (Message::SyncFrame(sync_frame), _)
                        if sent_for != Some(sync_frame.superframe) && !sync_frame.layout_is_new =>
                    {
                        sent_for = Some(sync_frame.superframe);
                        let now_counts = Timing::of(&NETWORK, sync_frame.layout);
                        timing = Some(now_counts);
                        let between =
                            now_counts.sync_frame(12).ticks() - now_counts.sync_frame(sync_frame.slot.into()).ticks();
                        let start = heard.rx_time.plus(ticks(between - ANTENNA_DELAY));
                        if start.since(now).as_micros() > 300 {
                            let mut slot_owners = sync_frame.slot_owners;
                            slot_owners[12] = self.address as u8 + 1;
                            let forged = SyncFrame {
                                slot: 12,
                                slot_owners,
                                position: Position::from_metres(self.position),
                                hops: sync_frame.hops.saturating_add(1),
                                heard: 0,
                                request: None,
                                ..sync_frame
                            };
                            let frame = bytes(self.address, BROADCAST, Message::SyncFrame(forged));
                            return Owned::Transmit { frame, start: Start::At(start), listen: true };
                        }
                    }
                    _ => {}
                }
            }
            Owned::Receive { start: Start::Now, window: RadioDuration::from_micros(2000), keep_listening: true }
        })
    }
}

#[test]
fn a_response_cannot_shorten_a_distance_by_more_than_the_transmitters_step() {
    // First with correct values; then with a false reply; then with an early or late answer.
    for (told_m, late_us, is_taken) in [
        (0.0, 0.0, true),
        (-8.0, 0.0, false),
        (8.0, 0.0, false),
        (100.0, 0.0, false),
        (1400.0, 0.0, false),
        (-1400.0, 0.0, false),
        (0.0, -6.0, false),
        (0.0, -0.2, false),
        (0.0, 6.0, false),
    ] {
        let mut air = Air::new(NETWORK.phy, 8);
        room(&mut air, 4, None);
        let (node, handle) = tag(&mut air, 0x100, Rate::Greedy);
        let impostor = Impostor { address: 0x77, position: [0.0, -9.0, 2.0], told_m, late_us };
        let at = air.add([0.0, 3.0, 1.0], 5.0, impostor.boxed());
        air.run_until(3.0);
        let ranges: Vec<_> = air.rounds(node, 1.5).into_iter().flat_map(|(_, ranges)| ranges).collect();
        let forged: Vec<_> = ranges.iter().filter(|range| range.peer == 0x77).collect();
        let name = format!("told {told_m} m, late {late_us} us");
        if is_taken {
            let truth = air.distance(node, at);
            assert!(forged.len() > 100, "{name}: {}", forged.len());
            assert!(forged.iter().all(|range| (f64::from(range.distance_m) - truth).abs() < 1.5), "{name}: {truth}");
        } else {
            assert!(forged.is_empty(), "{name}: {}, first {:?}", forged.len(), forged[0].distance_m);
            assert!(handle.borrow().refused().off_slot > 100, "{name}: {:?}", handle.borrow().refused());
        }
        assert!(ranges.len() - forged.len() > 1000, "{name}: {} honest ranges", ranges.len() - forged.len());
    }
}

#[test]
fn another_crystal_does_not_answer_for_a_known_anchor() {
    let mut air = Air::new(NETWORK.phy, 9);
    let anchors = room(&mut air, 4, None);
    let (node, handle) = tag(&mut air, 0x100, Rate::Every(RadioDuration::from_micros(50_000)));
    air.run_until(4.0);
    // Anchor 1 (+20 ppm) is switched off; another node (+5 ppm) at another position takes its address.
    air.switch_off(anchors[0]);
    let position = corner(0, 4).map(|m| m as f32);
    air.add([0.0, 3.0, 1.0], 5.0, Impostor { address: 1, position, told_m: 0.0, late_us: 0.0 }.boxed());
    air.run_until(6.0);
    let of_first = |from: f64| {
        let ranges = air.rounds(node, from).into_iter().flat_map(|(_, ranges)| ranges);
        ranges.filter(|range| range.peer == 1).count()
    };
    // Twenty rounds a second: the fifty after which its carrier would be accepted take more than two seconds.
    assert_eq!(of_first(4.1), 0);
    assert!(handle.borrow().refused().carriers > 20, "{:?}", handle.borrow().refused());
    assert!(air.rounds(node, 4.1).iter().filter(|(_, ranges)| ranges.len() == 3).count() > 30);
}

#[test]
fn forged_sync_frames_move_no_anchor_of_a_listening_tag() {
    for (seed, own_slots) in [(10, false), (11, true)] {
        let mut air = Air::new(NETWORK.phy, seed);
        room(&mut air, 4, Some(Rate::Every(RadioDuration::from_micros(100_000))));
        let (machine, handle) = shared(TdoaTag::new(TdoaTagConfig { network: NETWORK, period: None }));
        let node = air.add([1.0, 2.0, 1.0], -20.0, machine);
        let armed = Rc::new(Cell::new(false));
        air.add([0.0, 3.0, 1.0], 5.0, forger(&armed, five_metres_aside(own_slots)));
        air.run_until(2.0);
        armed.set(true);
        air.run_until(6.0);
        let differences: Vec<_> = air.heard(node, 2.5).into_iter().flat_map(|(_, all)| all).collect();
        assert!(differences.len() > 200, "{}", differences.len());
        let off = |x: f32, peer: u16| (f64::from(x) - corner(peer - 1, 4)[0]).abs() > 0.011;
        let displaced = differences.iter().filter(|one| off(one.position_m[0], one.peer)).count();
        assert_eq!(displaced, 0, "own slots {own_slots}");
        assert!(handle.borrow().refused().positions > 50, "{:?}", handle.borrow().refused());
    }
}

#[test]
fn two_networks_that_have_worked_for_long_still_merge_when_they_come_to_hear_each_other() {
    let mut air = Air::new(NETWORK.phy, 12);
    air.reach = 60.0;
    let place = |i: u16, x: f64| {
        let [dx, y, z] = corner(i, 3);
        [x + dx, y, z]
    };
    // The coordinators are switched off once here, three times there: one term, and three.
    let mut nodes: Vec<usize> = Vec::new();
    for (first, x) in [(1, 0.0), (11, 200.0)] {
        nodes.extend((0..3).map(|i| air.add(place(i, x), 10.0, anchor(first + i, place(i, x), None))));
    }
    let (near, _) = tag(&mut air, 0x100, Rate::Greedy);
    air.run_until(3.0);
    let coordinates =
        |air: &Air, node: usize| air.links(node).last().is_some_and(|(_, link)| *link == Link::Coordinating);
    for _ in 0..3 {
        let end = air.now;
        let leader = nodes[3..].iter().copied().find(|&node| coordinates(&air, node)).expect("a coordinator");
        air.switch_off(leader);
        air.run_until(end + 1.5);
        let i = leader as u16 - nodes[3] as u16;
        air.switch_on(leader, anchor(11 + i, place(i, 200.0), None));
        air.run_until(end + 3.0);
    }
    let together = air.now;
    for (i, &node) in nodes[3..].iter().enumerate() {
        air.move_to(node, place(i as u16, 20.0));
    }
    // Ten seconds of patience, and the time that a new node needs.
    air.run_until(together + 15.0);
    let before = air.collisions;
    air.run_until(together + 18.0);
    assert_eq!(nodes.iter().filter(|&&node| coordinates(&air, node)).count(), 1);
    assert_eq!(air.collisions, before);
    let rounds = air.rounds(near, together + 16.0);
    assert!(rounds.len() > 200 && rounds.iter().all(|(_, ranges)| ranges.len() == 6), "{} rounds", rounds.len());
}

#[test]
fn a_stranger_who_requests_slots_and_the_slowest_layout_once_costs_a_tag_nothing() {
    let mut air = Air::new(NETWORK.phy, 7);
    room(&mut air, 4, None);
    let (node, _) = tag(&mut air, 0x100, Rate::Greedy);
    let armed = Rc::new(Cell::new(false));
    let wish = Layout { listen_again: Span::LONGEST, scheme: Scheme::DoubleSided, ..Layout::LEAST };
    let request = Request { share: Share::Leased(Turns::rounds(Period::at_most(100))), wish };
    air.add([0.0, 3.0, 1.0], 5.0, forger(&armed, request_once(0x300, request)));
    air.run_until(3.0);
    armed.set(true);
    air.run_until(8.0);
    let in_second = |from| rounds_in_second(&air, node, from);
    let (before, after) = (in_second(2), (3..8).map(in_second).min().unwrap_or(0));
    assert!(before > 400 && after * 10 > before * 9, "{before}, then {after}");
}

/// A sender without a receiver that sends a frame ten times a second.
fn beacon(frame: Vec<u8>) -> Boxed {
    Box::new(move |now, _, _| {
        let start = Start::At(now.plus(RadioDuration::from_micros(100_000)));
        Owned::Transmit { frame: frame.clone(), start, listen: false }
    })
}

#[test]
fn an_anchor_in_whose_name_a_stranger_coordinates_starts_two_seconds_late() {
    let begin = |forged: Option<Vec<u8>>| {
        let mut air = Air::new(NETWORK.phy, 50);
        if let Some(forged) = forged {
            air.add([0.0, 3.0, 1.0], 5.0, beacon(forged));
        }
        let node = air.add(corner(0, 4), 20.0, anchor(1, corner(0, 4), None));
        air.run_until(4.0);
        let links = air.links(node);
        let [(begin, Link::Coordinating)] = links[..] else { panic!("{links:?}") };
        let told = air.sent.iter().filter(|flight| flight.sender == node).find_map(|flight| {
            match Frame::parse(&flight.bytes).ok()?.message {
                Message::SyncFrame(sync_frame) => Some(sync_frame),
                _ => None,
            }
        });
        (begin, told.expect("it sends"))
    };
    let (undisturbed, told) = begin(None);
    let (disturbed, _) = begin(Some(bytes(0x0BAD, BROADCAST, Message::SyncFrame(told))));
    assert!(undisturbed < 0.5 && (1.9..2.3).contains(&disturbed), "{undisturbed} s, {disturbed} s");
}
