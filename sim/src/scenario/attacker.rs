//! An attacker, and whether nodes believe it.
//!
//! The attacker knows all of a network but its key, and hears every frame. It sends as many frames as the network does,
//! or another share of them: recorded ones, at any time or in the same place of a later superframe; the last ones in
//! another order; recent ones with some bits changed; and frames that it makes itself, with a code under no key. It is
//! better than any hardware: it is quick, it receives everything, and its clock is true.
//!
//! A node has believed a frame if it is in another state afterwards, or does something else, than after a frame that it
//! cannot read. So the judge knows nothing of how nodes refuse frames. Left out is what a node only counts: refused frames,
//! and the candidates of an election, which it follows after ten superframes at the earliest.

use std::cell::{Cell, RefCell};
use std::collections::{HashMap, VecDeque};
use std::fmt::Debug;
use std::rc::Rc;

use rand::Rng;
use rand::seq::IndexedRandom;
use ranging::exchange::{Event, Protocol};
use ranging::native::{Layout, MAX_ROUND, Network, NetworkKey, Timing};
use ranging::{RadioDuration, RadioInstant, RxFrame};
use wire::uwb::native::{
    Challenge, Confirmation, Frame, Message, OWNED_SYNC_SLOTS, Poll, Request, Response, Share, SyncFrame, software_code,
};
use wire::uwb::{BROADCAST, FrameBuffer};

use super::Scenario;
use crate::air::{AirClient, Path, Phy, PortId, ReceptionEvent, Sniffed, TxStart};
use crate::clock::TICKS_PER_PS;
use crate::direct::{air_phy, emit, radiated_dbm};
use crate::random::{Purpose, Stream, stream};
use crate::{TrueTime, World};

pub use site::Attacker;

/// What comes longer than this after an attacker's frame is another one with the same bytes. A node handles a frame sooner,
/// and a frame is recorded earlier before it is repeated.
const HANDLED_WITHIN_PS: u64 = 5_000_000_000;
/// Frames that an attacker remembers.
const REMEMBERED: usize = 20_000;
/// What a node only counts.
const COUNTERS: [&str; 2] = ["refused: ", "candidate: "];
/// The byte of a native frame that says what it is.
const CODE_AT: usize = 9;

/// The frames of all attackers of a scenario, and what became of them.
#[derive(Default)]
pub(super) struct Attack {
    /// The end of the last one with these bytes (without check bytes).
    sent: RefCell<HashMap<Box<[u8]>, TrueTime>>,
    /// Those that a node may still handle, oldest first: the others are forgotten.
    order: RefCell<VecDeque<(TrueTime, Box<[u8]>)>>,
    frames: Cell<u64>,
    accepted: Cell<u64>,
}

impl Attack {
    /// How many frames were sent, and how often a node has believed one.
    pub(super) fn figures(&self) -> (u64, u64) {
        (self.frames.get(), self.accepted.get())
    }

    fn note(&self, bytes: &[u8], end: TrueTime) {
        self.frames.set(self.frames.get() + 1);
        let (mut sent, mut order) = (self.sent.borrow_mut(), self.order.borrow_mut());
        sent.insert(bytes.into(), end);
        order.push_back((end, bytes.into()));
        while let Some((old, bytes)) = order.pop_front_if(|(of, _)| end.ps_since(*of) > HANDLED_WITHIN_PS) {
            if sent.get(&bytes) == Some(&old) {
                sent.remove(&bytes);
            }
        }
    }

    fn has_sent(&self, bytes: &[u8], now: TrueTime) -> bool {
        let sent = self.sent.borrow();
        sent.get(bytes).is_some_and(|end| *end <= now && now.ps_since(*end) < HANDLED_WITHIN_PS)
    }

    /// Sees a protocol before each of its steps, and counts the attackers' frames that it believes.
    pub(super) fn judge<P: Protocol + Clone + Debug>(
        self: &Rc<Self>,
        world: &World,
    ) -> impl Fn(&P, RadioInstant, &Event<'_>) + use<P> {
        let (attack, world) = (Rc::clone(self), world.clone());
        move |protocol, now, event| {
            let Event::Received(frame) = event else { return };
            if !attack.has_sent(frame.bytes, world.now()) {
                return;
            }
            let mut unreadable = frame.bytes.to_vec();
            if let Some(code) = unreadable.get_mut(CODE_AT) {
                *code = 0xFF;
            }
            let after = |bytes: &[u8]| {
                let mut protocol = protocol.clone();
                let of = |bytes| RxFrame { bytes, ..*frame };
                let does = format!("{:?}", protocol.step(now, Event::Received(of(bytes))));
                // An anchor may postpone a frame until it receives the next one.
                let then = format!("{:?}", protocol.step(now, Event::Received(of(&unreadable))));
                [does, then, without_counters(&format!("{protocol:?}"))]
            };
            if after(frame.bytes) != after(&unreadable) {
                attack.accepted.set(attack.accepted.get() + 1);
            }
        }
    }
}

/// A state in words, without the values of what a node only counts.
fn without_counters(state: &str) -> String {
    COUNTERS.iter().fold(state.to_owned(), |state, name| {
        let mut parts = state.split(name);
        let first = parts.next().map(str::to_owned).unwrap_or_default();
        parts.fold(first, |all, part| all + part.get(value_length(part)..).unwrap_or_default())
    })
}

/// How long the value is with which a text begins: up to a comma or a bracket that closes an outer one.
fn value_length(text: &str) -> usize {
    let mut depth = 0;
    let ends = |(_, byte): &(usize, u8)| {
        depth += i32::from(matches!(byte, b'{' | b'(' | b'[')) - i32::from(matches!(byte, b'}' | b')' | b']'));
        depth < 0 || depth == 0 && *byte == b','
    };
    text.bytes().enumerate().find(ends).map_or(text.len(), |(at, _)| at)
}

/// A client of the air that only sends.
struct Deaf;

impl AirClient for Deaf {
    fn on_air(&mut self, _: &World, _: TrueTime, _: ReceptionEvent) {}
}

/// A frame that the attacker has recorded.
#[derive(Clone)]
struct Recorded {
    marker: TrueTime,
    bytes: Rc<[u8]>,
}

/// What the attacker knows of the network.
struct Striker {
    world: World,
    port: PortId,
    phy: Phy,
    network: Network,
    attack: Rc<Attack>,
    random: Stream,
    recorded: VecDeque<Recorded>,
    /// The last sync frame of each anchor, and when it came.
    sync_frames: Vec<(u16, SyncFrame, TrueTime)>,
    superframe_ps: u64,
    tags: Vec<u16>,
    last_poll: Option<(u16, Poll, TrueTime)>,
    /// Its transmitter sends until then.
    busy_until: Rc<Cell<TrueTime>>,
}

/// Starts an attacker, the `number`-th of the scenario.
pub(super) fn start(world: &World, scenario: &Scenario, (number, attacker): (usize, &Attacker), attack: &Rc<Attack>) {
    let Attacker { position_m, network, rate, from_s } = *attacker;
    let record = scenario.anchors.iter().find(|anchor| anchor.network == network);
    let Some(record) = record.map(|anchor| scenario.anchor_record(anchor)) else { return };
    let Ok(mut followed) = Network::try_from(&record) else { return };
    // Only its presence matters.
    followed.key = record.network.key.map(|_| NetworkKey::new([0; 16], 0, software_code));
    let (port, _) = world.add_client(Path::Fixed(position_m), |_| Rc::new(RefCell::new(Deaf)));
    let mut striker = Striker {
        world: world.clone(),
        port,
        phy: air_phy(&followed.phy),
        network: followed,
        attack: Rc::clone(attack),
        random: stream(world.seed(), Purpose::Attacker, number as u64),
        recorded: VecDeque::new(),
        sync_frames: Vec::new(),
        superframe_ps: 0,
        tags: Vec::new(),
        last_poll: None,
        busy_until: Rc::default(),
    };
    let from = TrueTime::from_secs_f64(from_s);
    let mut owed = 0.0;
    world.sniff(move |frame| {
        if frame.marker < from || !striker.receive(frame) {
            return;
        }
        owed += rate;
        while owed >= 1.0 {
            owed -= 1.0;
            striker.strike();
        }
    });
}

impl Striker {
    /// Receives a frame. Returns whether it is one of the network's.
    fn receive(&mut self, frame: &Sniffed) -> bool {
        let bytes = frame.bytes.get(..frame.bytes.len().saturating_sub(2)).unwrap_or_default();
        let Ok(parsed) = Frame::parse(bytes) else { return false };
        if frame.sender == self.port || parsed.pan != self.network.pan || self.attack.has_sent(bytes, frame.end) {
            return false;
        }
        if self.recorded.len() >= REMEMBERED {
            self.recorded.pop_front();
        }
        self.recorded.push_back(Recorded { marker: frame.marker, bytes: Rc::from(bytes) });
        match parsed.message {
            Message::SyncFrame(sync_frame) => {
                let known = self.sync_frames.iter().position(|(source, ..)| *source == parsed.source);
                if let Some((_, before, at)) = known.map(|place| self.sync_frames.swap_remove(place))
                    && sync_frame.superframe == before.superframe.wrapping_add(1)
                    && sync_frame.slot == before.slot
                {
                    self.superframe_ps = frame.marker.ps_since(at);
                }
                self.sync_frames.push((parsed.source, sync_frame, frame.marker));
            }
            Message::Poll(poll) => {
                if !self.tags.contains(&parsed.source) {
                    self.tags.push(parsed.source);
                }
                self.last_poll = Some((parsed.source, poll, frame.marker));
            }
            Message::Response(_)
            | Message::Request(_)
            | Message::Final { .. }
            | Message::Challenge(_)
            | Message::RelayFrame(_) => {}
        }
        true
    }

    /// One of the last recorded frames.
    fn recent(&mut self, last: usize) -> Option<Recorded> {
        let count = self.recorded.len();
        let place = self.random.random_range(count.saturating_sub(last)..count.max(1));
        self.recorded.get(place).cloned()
    }

    /// A time soon.
    fn soon(&mut self, micros: std::ops::Range<u64>) -> TrueTime {
        let micros = self.random.random_range(micros);
        self.world.now().plus_ps(micros * 1_000_000)
    }

    /// The place of a frame in a later superframe.
    fn in_its_place(&mut self, recorded: &Recorded) -> TrueTime {
        let superframes = self.random.random_range(1..=3_u64);
        recorded.marker.plus_ps(superframes * self.superframe_ps)
    }

    fn strike(&mut self) {
        match self.random.random_range(0..5) {
            0 => {
                let Some(recorded) = self.recent(REMEMBERED) else { return };
                let at = self.soon(6_000..30_000);
                self.send(&recorded.bytes, at);
            }
            1 => {
                let Some(recorded) = self.recent(8) else { return };
                let at = self.soon(6_000..20_000);
                self.send(&recorded.bytes, at);
            }
            2 => {
                let Some(recorded) = self.recent(64) else { return };
                let at = self.in_its_place(&recorded);
                self.send(&recorded.bytes, at);
            }
            3 => {
                let Some(recorded) = self.recent(64) else { return };
                let mut bytes = recorded.bytes.to_vec();
                for _ in 0..self.random.random_range(1..=3) {
                    let bit = self.random.random_range(0..8 * bytes.len());
                    bytes[bit / 8] ^= 1 << (bit % 8);
                }
                let at = if self.random.random() { self.in_its_place(&recorded) } else { self.soon(300..5_000) };
                self.send(&bytes, at);
            }
            _ => {
                if let Some((bytes, at)) = self.forge() {
                    self.send(&bytes, at);
                }
            }
        }
    }

    /// A frame as a node of the network might send it, and a good time for it.
    fn forge(&mut self) -> Option<(Vec<u8>, TrueTime)> {
        let &(anchor, ref sync_frame, at) = self.sync_frames.choose(&mut self.random)?;
        let (sync_frame, tag) = (sync_frame.clone(), *self.tags.choose(&mut self.random).unwrap_or(&0x1FFF));
        let wish = Layout::from_tag_byte(self.random.random());
        let (source, destination, message, at) = match self.random.random_range(0..6) {
            0 => {
                // The anchor's next sync frame, which says that another has taken over.
                let coordinator = if self.random.random() { anchor } else { self.random.random_range(1..0x100) };
                let (term, superframe) = (sync_frame.term.wrapping_add(1), sync_frame.superframe.wrapping_add(1));
                let told = SyncFrame { term, superframe, coordinator, age: 0, hops: 0, ..sync_frame };
                (anchor, BROADCAST, Message::SyncFrame(told), at.plus_ps(self.superframe_ps))
            }
            1 => {
                // The same in a slot that is free, of an anchor that is not there.
                let slot = self.random.random_range(0..OWNED_SYNC_SLOTS as u8);
                let timing = Timing::of(&self.network, sync_frame.layout);
                let [from, to] = [sync_frame.slot, slot].map(|slot| picoseconds(timing.sync_frame(slot.into())));
                let superframe = sync_frame.superframe.wrapping_add(1);
                let told = SyncFrame { slot, superframe, age: 0, ..sync_frame };
                let at = at.plus_ps((self.superframe_ps + to).saturating_sub(from));
                (self.random.random_range(1..0x100), BROADCAST, Message::SyncFrame(told), at)
            }
            2 => {
                // A response in the slot of an anchor that the last poll has asked.
                let (tag, poll, at) = self.last_poll.clone()?;
                let place = self.random.random_range(0..poll.anchors.len().clamp(1, MAX_ROUND));
                let timing = Timing::of(&self.network, sync_frame.layout);
                let reply = timing.reply_in(poll.first_slot() + place);
                let response = Response {
                    has_message: false,
                    passes_nothing_on: false,
                    round: poll.round as u8,
                    lease: Confirmation::Ended,
                    poll_rx: RadioInstant::from_ticks(self.random.random()),
                    reply,
                    last_final: None,
                };
                let source = poll.anchors.get(place)?.address;
                (source, tag, Message::Response(response), at.plus_ps(picoseconds(reply)))
            }
            3 => {
                let share = *[Share::Greedy, Share::Release, Share::Slots(2)].choose(&mut self.random)?;
                (tag, BROADCAST, Message::Request(Request { share, wish }), self.soon(300..5_000))
            }
            4 => {
                let (tag, poll, _) = self.last_poll.clone()?;
                let round = poll.round.wrapping_add(1);
                if self.random.random() {
                    (tag, BROADCAST, Message::Poll(Poll { round, wish, ..poll }), self.soon(300..5_000))
                } else {
                    (tag, BROADCAST, Message::Final { round: poll.round }, self.soon(300..5_000))
                }
            }
            _ => {
                let session = sync_frame.session.map_or(0, |session| session.number);
                let challenge = Challenge { session, number: self.random.random() };
                (anchor, BROADCAST, Message::Challenge(challenge), self.soon(300..5_000))
            }
        };
        let mut out = FrameBuffer::new();
        Frame { sequence: self.random.random(), pan: self.network.pan, destination, source, message }.emit(&mut out);
        if self.network.key.is_some() {
            out.authenticate(|_| self.random.random());
        }
        Some((out.bytes().to_vec(), at))
    }

    /// Sends a frame so that its RMARKER leaves at an instant, unless there is no time, or another one is being sent.
    fn send(&self, bytes: &[u8], marker: TrueTime) {
        let (world, port, phy, bytes) = (self.world.clone(), self.port, self.phy, bytes.to_vec());
        let (attack, busy_until) = (Rc::clone(&self.attack), Rc::clone(&self.busy_until));
        let start = TrueTime::from_ps(marker.as_ps().saturating_sub(of_ticks(phy.shr_ticks())));
        if start <= world.now() {
            return;
        }
        self.world.spawn(async move {
            world.sleep_until(start).await;
            if busy_until.get() > start {
                return;
            }
            let on_air = bytes.len() + 2;
            let end = marker.plus_ps(of_ticks(phy.phr_ticks() + phy.payload_ticks(on_air)));
            busy_until.set(end);
            attack.note(&bytes, end);
            let power_dbm = radiated_dbm(&phy, on_air);
            let sent = TxStart { phy, ranging: true, start, marker, power_dbm, sender_ppm: 0.0 };
            emit(&world, port, sent, &bytes, |_| end).await;
        });
    }
}

/// Picoseconds of ticks of a DW1000.
fn of_ticks(ticks: u64) -> u64 {
    (ticks as f64 / TICKS_PER_PS) as u64
}

fn picoseconds(duration: RadioDuration) -> u64 {
    of_ticks(duration.ticks() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_node_only_counts_is_no_part_of_its_state() {
        let state = "Anchor { refused: 12, next: Some(3), election: E { term: 1, candidate: Some(C { is: (1, 2) }) }, last: 4 }";
        let expected = "Anchor { , next: Some(3), election: E { term: 1, }, last: 4 }";
        assert_eq!(without_counters(state), expected);
        let state = "Tag { table: T { refused: Refused { a: 1, b: [2, 3] }, last: 5 }, refused: 1 }";
        assert_eq!(without_counters(state), "Tag { table: T { , last: 5 }, }");
    }

    #[test]
    fn an_attackers_frame_is_known_for_some_milliseconds() {
        let attack = Attack::default();
        let at = |ms: u64| TrueTime::from_micros(1_000 * ms);
        attack.note(b"poll", at(10));
        assert_eq!([9, 10, 14, 15].map(|ms| attack.has_sent(b"poll", at(ms))), [false, true, true, false]);
        assert!(!attack.has_sent(b"final", at(10)));
        attack.note(b"poll", at(13));
        attack.note(b"final", at(17));
        // The first one is forgotten, the second is not.
        assert_eq!([15, 17].map(|ms| attack.has_sent(b"poll", at(ms))), [true, true]);
        assert_eq!(attack.figures(), (3, 0));
    }
}
