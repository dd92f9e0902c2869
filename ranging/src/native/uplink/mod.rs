//! How what tags tell in their polls gets from anchor to anchor to a gateway: an anchor whose host reads what it
//! reports.
//!
//! Each sync frame says how far the nearest gateway is, and names the next anchor on the way by its sync slot. A hop
//! costs as many transmissions as it needs in the mean (D. De Couto et al., A high-throughput path metric for
//! multi-hop wireless routing, MobiCom 2003): 1/(p² q) with a share p of sync frames that come and say that their
//! sender receives this anchor, as an entry must arrive, and the word that it was taken; and a share q of sendings
//! that were taken.
//!
//! The anchor that a poll names first relays what it carries: the tag names one that answers, and that is near to a
//! gateway. There are up to two entries in each of its sync frames, until the next anchor says that it has taken
//! them. Where more waits, the coordinator makes the last round slots relay slots: there the owner of each sync slot
//! sends a frame of four more entries, to the next anchor alone. A gateway says which polls it has received itself:
//! its neighbours wait for this, and pass on the others.
//!
//! Each anchor keeps a short queue. It drops what is older than five seconds, the oldest entry when it is full, and
//! a tag's older position when a newer one comes. The coordinator's sync frames are full of news of leases while
//! tags join: its entries come behind them, and a way through it costs more.
//!
//! No way is a circle: an anchor goes only through neighbours that are nearer to a gateway than it has been itself
//! since it found a way. If there is none any more, it says for some superframes that it knows no way, so that
//! nobody goes through it, and looks for another one. Meanwhile entries wait. Nothing is repeated that was taken: an
//! anchor that falls silent with entries in its queue loses these.

mod demand;
mod neighbour;
mod waiting;

use heapless::Vec;

use self::demand::Demand;
use self::neighbour::{MOST, Neighbour};
use self::waiting::{Reported, Sending, Waiting, is_data};
use super::anchor_position::hash;
use super::spread;
use crate::RadioDuration;
use crate::exchange::Polled;
use wire::serial_number::SerialNumber;
use wire::uwb::native::{Carried, MAX_RELAYED, OWNED_SYNC_SLOTS, Relay, RelayFrame, Relayed, SyncFrame};

/// Entries that wait.
const MAX_WAITING: usize = 32;
/// An anchor is busy if this many wait: it takes no entries of others, which go another way or wait. They leave within four
/// superframes: without relay slots, and with them.
const BUSY: usize = 8;
const BUSY_WITH_RELAY_SLOTS: usize = 24;
/// An entry is dropped after this many superframes: five seconds at 6.81 Mbit/s.
const OLDEST_SUPERFRAMES: u8 = 50;
/// A neighbour that was silent for this many superframes is no way.
const FORGOTTEN_AFTER: u32 = 5;
/// A neighbour that has not taken entries is taken to have taken some, once in this many superframes: it may be better now.
const HOPE_EVERY: u16 = 4;
/// Ways that cost at most this much more than the best one are used in turn with it.
const ALIKE: u8 = Relay::HOP / 2;
/// What a way through the coordinator costs more: other ways are preferred, and less than a hop, so that nobody loses a
/// way to an anchor that has become the coordinator.
const TOLL: u8 = ALIKE + 1;
/// An anchor that has lost its way says so for this many superframes, until all neighbours know.
const PAUSE: u8 = 7;
/// A gateway's last entries: what comes by two ways is reported once.
const REPORTED_SETS: usize = 24;
const REPORTED_IN_SET: usize = 4;

/// What an anchor knows of the way to a gateway, and what waits for it.
#[derive(Clone, Debug)]
pub struct Uplink {
    address: u16,
    has_host: bool,
    /// This anchor coordinates: its sync frames are for news of leases first.
    coordinates: bool,
    /// The present superframe.
    number: u16,
    /// The cost of the way to a gateway in this superframe.
    cost: Option<u8>,
    /// The least cost since the way was found.
    least_cost: u8,
    /// Superframes until another way is looked for.
    pause: u8,
    neighbours: Vec<Neighbour, OWNED_SYNC_SLOTS>,
    /// The oldest first.
    queue: Vec<Waiting, MAX_WAITING>,
    /// Round slots (bit i: slot i) with a poll in this superframe, and in the one before: to be said by a gateway.
    heard: [u64; 2],
    /// Sync slots (bit i: slot i) whose entries were taken in this superframe, and in the one before.
    taken: [u16; 2],
    /// The same for those of relay frames.
    taken_frames: [u16; 2],
    /// There are relay slots in this superframe.
    has_relay_slots: bool,
    demand: Demand,
    /// The last superframe in which a relay frame was made.
    relayed: Option<u16>,
    /// What a gateway has reported lately, each in a set that follows from tag and round, the newest first.
    reported: [[Option<Reported>; REPORTED_IN_SET]; REPORTED_SETS],
}

/// Whether an anchor in slot `own` has opened a frame of slot `other` before its own is made: that of the slot just before
/// it may open afterwards.
const fn comes_before(other: u8, own: u8) -> bool {
    other + 1 < own
}

/// Superframes from when a poll came, in 1/256 of a superframe, to the beginning of the superframe `number`.
const fn superframes_since(at: u16, number: u16) -> u8 {
    (number as u8).wrapping_sub((at >> 8) as u8)
}

impl Uplink {
    /// No neighbours, and nobody reads.
    #[inline(always)]
    pub const fn new(address: u16) -> Self {
        Self {
            address,
            has_host: false,
            coordinates: false,
            number: 0,
            cost: None,
            least_cost: MOST,
            pause: 0,
            neighbours: Vec::new(),
            queue: Vec::new(),
            heard: [0; 2],
            taken: [0; 2],
            taken_frames: [0; 2],
            has_relay_slots: false,
            demand: Demand::NONE,
            relayed: None,
            reported: [[None; REPORTED_IN_SET]; REPORTED_SETS],
        }
    }

    /// Another network is followed, or the time is lost.
    pub fn clear(&mut self) {
        (self.cost, self.least_cost, self.pause) = (None, MOST, 0);
        self.neighbours.clear();
        self.queue.clear();
        (self.heard, self.taken, self.taken_frames) = ([0; 2], [0; 2], [0; 2]);
        (self.has_relay_slots, self.demand, self.relayed) = (false, Demand::NONE, None);
    }

    /// Whether a host reads what this anchor reports.
    pub fn set_host(&mut self, has_host: bool) {
        self.has_host = has_host;
    }

    /// Advances to a superframe.
    pub fn advance(&mut self, number: u16) {
        let begun = SerialNumber(number).steps_from(core::mem::replace(&mut self.number, number));
        if begun == 0 {
            return;
        }
        if begun > OLDEST_SUPERFRAMES.into() {
            return self.clear();
        }
        let superframes = begun as u8;
        let before = |taken: [u16; 2]| [0, if begun == 1 { taken[0] } else { 0 }];
        self.heard = [0, if begun == 1 { self.heard[0] } else { 0 }];
        (self.taken, self.taken_frames) = (before(self.taken), before(self.taken_frames));
        self.demand.advance(superframes, self.to_send(), self.cost.is_some());
        for neighbour in &mut self.neighbours {
            for heard in [&mut neighbour.heard, &mut neighbour.hears] {
                *heard = heard.checked_shl(superframes.into()).unwrap_or(0);
            }
            if number.is_multiple_of(HOPE_EVERY) {
                neighbour.took = neighbour.took << 1 | 1;
            }
        }
        self.neighbours.retain(|neighbour| neighbour.heard.trailing_zeros() <= FORGOTTEN_AFTER);
        self.queue.retain(|waiting| superframes_since(waiting.entry.at, number) <= OLDEST_SUPERFRAMES);
        self.pause = self.pause.saturating_sub(superframes);
        self.find_way();
    }

    /// Finds what the way to a gateway costs.
    fn find_way(&mut self) {
        if self.has_host {
            (self.cost, self.least_cost) = (Some(0), 0);
            return;
        }
        let cost = self.ways().map(|(cost, _)| cost).min().filter(|_| self.pause == 0);
        // A way that is no circle may have become much worse than another one.
        let least = self.neighbours.iter().filter_map(Neighbour::way).min();
        let cost = cost.filter(|cost| least.is_none_or(|least| *cost <= least.saturating_add(Relay::HOP)));
        if cost.is_none() && self.cost.is_some() {
            (self.least_cost, self.pause) = (MOST, PAUSE);
        }
        self.least_cost = self.least_cost.min(cost.map_or(MOST, |cost| self.told_cost(cost)));
        self.cost = cost;
    }

    /// The cost of this anchor's way as others are told it.
    fn told_cost(&self, cost: u8) -> u8 {
        if self.coordinates && !self.has_host { cost.saturating_add(TOLL).min(MOST - 1) } else { cost }
    }

    /// The neighbours that may be next on a way, and what it costs.
    fn ways(&self) -> impl Iterator<Item = (u8, &Neighbour)> {
        let nearer = self.neighbours.iter().filter(|of| of.cost.is_some_and(|cost| cost < self.least_cost));
        nearer.filter_map(|neighbour| Some((neighbour.way()?, neighbour)))
    }

    /// The next anchor on the way. If there are several, it is another one for each of these turns: so each has as much to
    /// pass on.
    fn next(&self, turn: u16) -> Option<&Neighbour> {
        self.cost.filter(|cost| *cost > 0)?;
        let ways = self.ways().map(|(cost, neighbour)| (neighbour.is_busy, cost, neighbour));
        let mut ways: Vec<(bool, u8, &Neighbour), OWNED_SYNC_SLOTS> = ways.collect();
        // Who is busy comes last.
        let (are_busy, least) = ways.iter().map(|(is_busy, cost, _)| (*is_busy, *cost)).min()?;
        ways.retain(|(is_busy, cost, _)| *is_busy == are_busy && *cost <= least.saturating_add(ALIKE));
        let place = usize::from(turn).checked_rem(ways.len())?;
        ways.get(place).map(|(.., neighbour)| *neighbour)
    }

    /// The same for the entries of this superframe, sent by an anchor with this sync slot: another one than that of others,
    /// and than that of the own sync frame for those of a relay frame.
    #[inline(never)]
    fn next_now(&self, own: u8, is_in_relay_frame: bool) -> Option<&Neighbour> {
        self.next(self.number.wrapping_add(own.into()).wrapping_add(is_in_relay_frame.into()))
    }

    /// A sync frame came in its sender's own slot. This anchor sends its own in slot `own`.
    pub fn receive(&mut self, source: u16, sync_frame: &SyncFrame, own: Option<u8>) {
        self.advance(sync_frame.superframe);
        let told = sync_frame.relay.as_ref();
        let (slot, cost) = (sync_frame.slot, told.map(|relay| relay.cost));
        let reported = own.and_then(|own| sync_frame.slot_owners.get(usize::from(own)));
        let hears = u16::from(reported == Some(&hash(self.address)));
        let is_busy = told.is_some_and(|relay| relay.taken >> slot & 1 == 1);
        match self.neighbours.iter_mut().find(|neighbour| neighbour.address == source) {
            Some(known) => {
                (known.slot, known.cost, known.is_busy) = (slot, cost, is_busy);
                (known.heard, known.hears) = (known.heard | 1, known.hears | hears);
            }
            None => {
                let (heard, took) = (1, u16::MAX);
                let neighbour = Neighbour { address: source, slot, cost, is_busy, heard, hears, took };
                // There are no more sync slots.
                let _ = self.neighbours.push(neighbour);
            }
        }
        if let Some(relay) = told.filter(|relay| relay.cost == 0) {
            self.drop_heard(relay.heard, sync_frame.superframe.wrapping_sub(1));
        }
        let Some((relay, own)) = told.zip(own) else { return };
        let is_late = !comes_before(own, slot);
        let sending = |superframes: u16, is_in_relay_frame| Sending {
            next: source,
            superframe: sync_frame.superframe.wrapping_sub(superframes),
            is_in_relay_frame,
        };
        self.settle(sending(is_late.into(), false), relay.taken >> own & 1 == 1, is_busy);
        self.settle(sending(1, true), relay.taken_frames >> own & 1 == 1, is_busy);
        if relay.next == own && relay.cost > 0 && self.take(&relay.entries) {
            self.taken[0] |= 1 << slot;
        }
    }

    /// A gateway has received the polls in these round slots of a superframe itself.
    fn drop_heard(&mut self, slots: u64, superframe: u16) {
        let is_heard = |(number, slot): (u16, u8)| number == superframe && slots >> slot.min(63) & 1 == 1;
        self.queue.retain(|waiting| !waiting.polled.is_some_and(is_heard));
    }

    /// A relay frame for this anchor came.
    pub fn receive_relay_frame(&mut self, source: u16, frame: &RelayFrame) {
        let known = self.neighbours.iter().find(|neighbour| neighbour.address == source);
        if let Some(slot) = known.map(|neighbour| neighbour.slot)
            && self.take(&frame.entries)
        {
            self.taken_frames[0] |= 1 << slot;
        }
    }

    /// Takes all entries that came, or none.
    fn take(&mut self, entries: &[Relayed]) -> bool {
        let are_for_hosts = |entry: &&Relayed| entry.downlink().is_none();
        let coming = entries.iter().filter(are_for_hosts).count();
        let fits = !self.is_busy() && self.queue.len() + coming <= MAX_WAITING;
        if coming == 0 || self.cost.is_none() || !fits {
            return false;
        }
        for entry in entries.iter().filter(are_for_hosts) {
            let is_there = self.queue.iter().any(|known| Reported::of(&known.entry) == Reported::of(entry));
            if !is_there && (!self.has_host || self.is_news(entry)) {
                // There is a place.
                let _ = self.queue.push(Waiting { entry: *entry, polled: None, sent: None });
            }
        }
        true
    }

    /// An anchor has taken the entries that were sent to it, or it has not: then they are sent again.
    fn settle(&mut self, sending: Sending, were_taken: bool, is_busy: bool) {
        let is_of = |waiting: &Waiting| waiting.sent == Some(sending);
        if !self.queue.iter().any(is_of) {
            return;
        }
        if were_taken {
            self.queue.retain(|waiting| !is_of(waiting));
        } else {
            self.queue.iter_mut().filter(|waiting| is_of(waiting)).for_each(|waiting| waiting.sent = None);
        }
        let Some(neighbour) = self.neighbours.iter_mut().find(|neighbour| neighbour.address == sending.next) else {
            return;
        };
        if were_taken || !is_busy {
            neighbour.took = neighbour.took << 1 | u16::from(were_taken);
        }
    }

    /// A tag's poll came in this superframe and round slot, in 1/256 of a superframe `at`. `is_first`: it names this anchor
    /// first.
    pub fn on_poll(&mut self, polled: &Polled, in_slot: Option<(u16, u8)>, at: u16, is_first: bool) {
        if let Some((number, slot)) = in_slot.filter(|_| self.has_host)
            && let Some(heard) = self.heard.get_mut(usize::from(SerialNumber(self.number).steps_from(number)))
        {
            *heard |= 1_u64.checked_shl(slot.into()).unwrap_or(0);
        }
        let Polled { tag, round, asked, position, data, .. } = *polled;
        let entry = |content| Relayed { tag, round, at, asked, content };
        let data = data.map(|data| entry(Carried::Data(data)));
        for entry in position.map(|position| entry(Carried::Position(position))).into_iter().chain(data) {
            if self.has_host {
                // The anchor reports it itself.
                self.is_news(&entry);
            } else if is_first {
                self.push(entry, in_slot);
            }
        }
    }

    /// An entry of this anchor's own waits. A newer position replaces an older one that was not sent yet.
    fn push(&mut self, entry: Relayed, polled: Option<(u16, u8)>) {
        let waiting = Waiting { entry, polled, sent: None };
        let is_older = |known: &&mut Waiting| {
            known.sent.is_none() && known.entry.tag == entry.tag && !is_data(&known.entry) && !is_data(&entry)
        };
        if let Some(older) = self.queue.iter_mut().find(is_older) {
            *older = waiting;
            return;
        }
        if self.queue.is_full() {
            self.queue.remove(0);
        }
        let _ = self.queue.push(waiting);
    }

    /// Whether a gateway has not reported an entry lately. From now on it has.
    fn is_news(&mut self, entry: &Relayed) -> bool {
        let is = Some(Reported::of(entry));
        let set = usize::from(spread(entry.tag, entry.round, REPORTED_SETS as u16));
        let Some(set) = self.reported.get_mut(set).filter(|set| !set.contains(&is)) else { return false };
        set.rotate_right(1);
        set[0] = is;
        true
    }

    /// Puts the way to a gateway into the sync frame of this anchor's own slot.
    pub fn say_way(&mut self, sync_frame: &mut SyncFrame, coordinates: bool) {
        let own = sync_frame.slot;
        (self.coordinates, self.has_relay_slots) = (coordinates, sync_frame.has_relay_slots);
        self.advance(sync_frame.superframe);
        let Some(cost) = self.cost.map(|cost| self.told_cost(cost)) else { return };
        let next = self.next_now(own, false).map_or(own, |next| next.slot);
        // Frames of these slots were opened in this superframe: those up to the second before the own one.
        let now = 1_u16.wrapping_shl(own.saturating_sub(1).into()) - 1;
        let taken = self.taken[0] & now | self.taken[1] & !now | u16::from(self.is_busy()) << own;
        sync_frame.relay = Some(Relay {
            cost,
            next,
            taken,
            taken_frames: self.taken_frames[1],
            heard: self.heard[1],
            entries: Vec::new(),
        });
    }

    /// Puts an entry into a sync frame that says the way and has none, before its news, unless it is the coordinator's or
    /// there are relay slots.
    pub fn fill_first(&mut self, sync_frame: &mut SyncFrame) {
        self.add_entries(sync_frame, usize::from(!self.coordinates && !self.has_relay_slots));
    }

    /// Puts further entries into a sync frame that says the way, behind its news.
    pub fn fill_rest(&mut self, sync_frame: &mut SyncFrame) {
        self.add_entries(sync_frame, MAX_RELAYED);
    }

    fn add_entries(&mut self, sync_frame: &mut SyncFrame, most: usize) {
        let (superframe, mut room) = (sync_frame.superframe, sync_frame.room());
        let Some(relay) = sync_frame.relay.as_mut().filter(|relay| relay.next != sync_frame.slot) else { return };
        let Some(next) = self.neighbours.iter().find(|neighbour| neighbour.slot == relay.next) else { return };
        let sending = Sending { next: next.address, superframe, is_in_relay_frame: false };
        let has_gateway = self.has_gateway();
        for waiting in self.queue.iter_mut().filter(|waiting| waiting.is_due(superframe, 1, has_gateway)) {
            let bytes = waiting.entry.bytes();
            if relay.entries.len() >= most || bytes > room || relay.entries.push(waiting.entry).is_err() {
                return;
            }
            room -= bytes;
            waiting.sent = Some(sending);
            self.demand.count();
        }
    }

    /// How many entries wait to be sent.
    fn to_send(&self) -> usize {
        let has_gateway = self.has_gateway();
        let waiting = self.queue.iter().filter(|waiting| !(has_gateway && waiting.may_be_heard(self.number)));
        waiting.count()
    }

    /// Whether a neighbour is a gateway.
    fn has_gateway(&self) -> bool {
        self.neighbours.iter().any(|neighbour| neighbour.cost == Some(0))
    }

    /// Whether this anchor, which owns a sync slot, has a relay frame to send in this superframe.
    pub fn has_relay_frame(&self) -> bool {
        let has_gateway = self.has_gateway();
        let waits = || self.queue.iter().any(|waiting| waiting.is_due(self.number, 0, has_gateway));
        self.relayed != Some(self.number) && !self.has_host && self.cost.is_some() && waits()
    }

    /// The relay frame of this superframe, of an anchor with this sync slot, and the anchor for which it is.
    pub fn relay_frame(&mut self, own: u8) -> Option<(u16, RelayFrame)> {
        let superframe = self.number;
        self.relayed = Some(superframe);
        let next = self.next_now(own, true)?.address;
        let sending = Sending { next, superframe, is_in_relay_frame: true };
        let mut frame = RelayFrame { entries: Vec::new() };
        let has_gateway = self.has_gateway();
        for waiting in self.queue.iter_mut().filter(|waiting| waiting.is_due(superframe, 0, has_gateway)) {
            if waiting.entry.bytes() > frame.room() || frame.entries.push(waiting.entry).is_err() {
                break;
            }
            waiting.sent = Some(sending);
            self.demand.count();
        }
        (!frame.entries.is_empty()).then_some((next, frame))
    }

    /// Whether more waits here, or is sent, than fits into sync frames.
    pub const fn wants_relay_slots(&self) -> bool {
        self.demand.wants_relay_slots
    }

    /// Whether so much waits that this anchor takes no more of others.
    pub fn is_busy(&self) -> bool {
        self.to_send() >= if self.has_relay_slots { BUSY_WITH_RELAY_SLOTS } else { BUSY }
    }

    /// Whether a way to a gateway is known, or will be soon.
    pub const fn has_way(&self) -> bool {
        self.cost.is_some() || self.pause > 0
    }

    /// Whether a gateway has entries to report.
    pub fn has_reports(&self) -> bool {
        self.has_host && !self.queue.is_empty()
    }

    /// Takes the next entry that a gateway is to report, at `now` in 1/256 of a superframe of this length.
    pub fn report(&mut self, now: u16, superframe: RadioDuration) -> Option<Polled> {
        if !self.has_reports() {
            return None;
        }
        let Relayed { tag, round, at, asked, content } = self.queue.remove(0).entry;
        let (position, data) = match content {
            Carried::Position(position) => (Some(position), None),
            // A message to a tag does not wait here.
            Carried::Data(data) | Carried::Downlink(data) => (None, Some(data)),
        };
        let age = RadioDuration::from_ticks(superframe.ticks() * i64::from(now.wrapping_sub(at)) / 256);
        Some(Polled { tag, round, asked, age, position, data })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64;
    use std::vec::Vec;
    use wire::uwb::native::{PolledPosition, UserData};

    /// Anchors 1, 2, … in these sync slots, in a row: each receives its neighbours only.
    struct Row {
        slots: Vec<u8>,
        anchors: Vec<Uplink>,
        number: u16,
        rng: Pcg64,
        loss: f64,
        coordinator: Option<usize>,
        has_relay_slots: bool,
        /// It receives nobody.
        deaf: Option<usize>,
        /// Polls come in this round slot, and are told apart by it.
        heard_in: Option<u8>,
        /// Frames to the first anchor are lost with this probability.
        loss_to_first: f64,
        /// What gateways have reported: by which anchor, tag, round, and in 1/256 of a superframe how long ago it was received.
        reported: Vec<(usize, u16, u16, i64)>,
    }

    impl Row {
        /// The anchors at `gateways` have hosts.
        fn new(slots: &[u8], gateways: &[usize]) -> Self {
            let mut anchors: Vec<_> = (1..).take(slots.len()).map(Uplink::new).collect();
            gateways.iter().for_each(|&at| anchors[at].set_host(true));
            let rng = Pcg64::seed_from_u64(7);
            let mut row = Self {
                slots: slots.to_vec(),
                anchors,
                number: 65_500,
                rng,
                loss: 0.0,
                coordinator: None,
                has_relay_slots: false,
                deaf: None,
                heard_in: None,
                loss_to_first: 0.0,
                reported: Vec::new(),
            };
            (0..20).for_each(|_| row.superframe());
            row
        }

        fn superframe(&mut self) {
            self.number = self.number.wrapping_add(1);
            let mut order: Vec<usize> = (0..self.slots.len()).collect();
            order.sort_by_key(|&at| self.slots[at]);
            let mut last: Option<(usize, SyncFrame)> = None;
            for from in order {
                let slot = self.slots[from];
                let mut sync_frame = SyncFrame {
                    superframe: self.number,
                    slot,
                    has_relay_slots: self.has_relay_slots,
                    slot_owners: self.owners(from),
                    ..crate::native::blank_sync_frame()
                };
                self.anchors[from].say_way(&mut sync_frame, self.coordinator == Some(from));
                self.anchors[from].fill_first(&mut sync_frame);
                self.anchors[from].fill_rest(&mut sync_frame);
                // Each opens the frame of the slot before its own after its own.
                if let Some((before, frame)) = last.take() {
                    self.deliver(before, &frame, |slot_of| slot_of == slot);
                }
                self.deliver(from, &sync_frame, |slot_of| slot_of != slot + 1);
                last = Some((from, sync_frame));
            }
            if self.has_relay_slots {
                (0..self.slots.len()).for_each(|from| self.relay(from));
            }
            let length = RadioDuration::from_ticks(256);
            for (at, anchor) in self.anchors.iter_mut().enumerate() {
                while anchor.has_reports() {
                    let Some(polled) = anchor.report(self.number << 8, length) else { break };
                    self.reported.push((at, polled.tag, polled.round, polled.age.ticks()));
                }
            }
        }

        fn is_lost(&mut self, to: usize) -> bool {
            let loss = if to == 0 { self.loss.max(self.loss_to_first) } else { self.loss };
            self.rng.random_bool(loss) || self.deaf == Some(to)
        }

        /// Whom an anchor receives: its neighbours, unless it is deaf.
        fn owners(&self, at: usize) -> [u8; OWNED_SYNC_SLOTS] {
            let mut owners = [0; OWNED_SYNC_SLOTS];
            for other in [at.wrapping_sub(1), at + 1].into_iter().filter(|_| self.deaf != Some(at)) {
                if let Some(slot) = self.slots.get(other) {
                    owners[usize::from(*slot)] = hash(other as u16 + 1);
                }
            }
            owners
        }

        /// The relay slot of an anchor.
        fn relay(&mut self, from: usize) {
            if !self.anchors[from].has_relay_frame() {
                return;
            }
            let Some((next, frame)) = self.anchors[from].relay_frame(self.slots[from]) else { return };
            let to = usize::from(next) - 1;
            assert!(to.abs_diff(from) == 1, "a neighbour");
            if !self.is_lost(to) {
                self.anchors[to].receive_relay_frame(from as u16 + 1, &frame);
            }
        }

        fn deliver(&mut self, from: usize, sync_frame: &SyncFrame, opens: impl Fn(u8) -> bool) {
            for to in [from.wrapping_sub(1), from + 1] {
                let Some(&slot) = self.slots.get(to).filter(|slot| opens(**slot)) else { continue };
                if !self.is_lost(to) {
                    self.anchors[to].receive(from as u16 + 1, sync_frame, Some(slot));
                }
            }
        }

        /// A poll that asks these anchors (their places) and that all of them receive.
        fn poll(&mut self, tag: u16, round: u16, asked: &[usize]) {
            let position = Some(PolledPosition([0; 16]));
            let polled =
                Polled { tag, round, asked: asked.len() as u8, age: RadioDuration::ZERO, position, data: None };
            for (place, &at) in asked.iter().enumerate() {
                self.anchors[at].on_poll(
                    &polled,
                    self.heard_in.map(|slot| (self.number, slot)),
                    self.number << 8,
                    place == 0,
                );
            }
        }

        fn rounds(&self) -> Vec<u16> {
            self.reported.iter().map(|(_, _, round, _)| *round).collect()
        }
    }

    #[test]
    fn a_position_goes_from_anchor_to_anchor_whatever_the_order_of_their_slots() {
        for slots in [[0, 1, 2, 3], [3, 2, 1, 0], [5, 9, 2, 7], [4, 5, 3, 2]] {
            let mut row = Row::new(&slots, &[3]);
            for round in 0..100 {
                row.poll(0x1001, round, &[0]);
                (0..10).for_each(|_| row.superframe());
            }
            assert_eq!(row.rounds(), (0..100).collect::<Vec<_>>(), "{slots:?}");
            // Three hops, each in this superframe or the next, and reported in that of the last: ages in whole superframes.
            assert!(
                row.reported.iter().all(|&(at, tag, _, age)| (at, tag) == (3, 0x1001) && age <= 3 * 256),
                "{slots:?}"
            );
        }
    }

    #[test]
    fn the_anchor_that_a_poll_names_first_relays_alone() {
        let mut row = Row::new(&[0, 4, 8, 12], &[3]);
        row.poll(0x1001, 1, &[2, 0, 1]);
        assert_eq!(row.anchors.iter().map(|anchor| anchor.queue.len()).collect::<Vec<_>>(), [0, 0, 1, 0]);
        // A gateway reports the poll itself, and what another anchor passes on of it is no news.
        row.poll(0x1001, 2, &[3, 2]);
        row.poll(0x1001, 2, &[1]);
        (0..5).for_each(|_| row.superframe());
        assert_eq!(row.rounds(), [1]);
    }

    #[test]
    fn what_a_gateway_has_received_itself_is_not_passed_on() {
        for slots in [[0, 4, 8], [8, 4, 0]] {
            let mut row = Row::new(&slots, &[2]);
            row.heard_in = Some(63);
            // The gateway's neighbour is named first. The gateway receives the first poll, and not the second one.
            row.poll(0x1001, 1, &[1, 2]);
            (0..5).for_each(|_| row.superframe());
            assert!(row.rounds().is_empty() && row.anchors[1].queue.is_empty(), "{slots:?}: it reports this itself");
            row.poll(0x1001, 2, &[1]);
            (0..5).for_each(|_| row.superframe());
            // Whoever is farther away knows nothing of it.
            row.poll(0x1001, 3, &[0, 2]);
            (0..5).for_each(|_| row.superframe());
            assert_eq!(row.rounds(), [2], "{slots:?}");
            // Another poll in the same slot of another superframe.
            row.poll(0x1002, 4, &[1]);
            row.superframe();
            row.poll(0x1003, 5, &[2]);
            (0..5).for_each(|_| row.superframe());
            assert_eq!(row.rounds(), [2, 4], "{slots:?}");
        }
    }

    #[test]
    fn nothing_is_lost_or_doubled_if_a_third_of_the_frames_is() {
        let all = [[0, 1, 2, 3], [3, 2, 1, 0], [4, 5, 3, 2]];
        for (slots, has_relay_slots) in all.into_iter().flat_map(|slots| [(slots, false), (slots, true)]) {
            let mut row = Row::new(&slots, &[3]);
            (row.loss, row.has_relay_slots) = (0.3, has_relay_slots);
            for round in 0..300 {
                row.poll(0x1001 + round, round, &[0]);
                (0..3).for_each(|_| row.superframe());
            }
            let mut rounds = row.rounds();
            rounds.sort_unstable();
            rounds.dedup();
            assert_eq!(rounds.len(), row.reported.len(), "{slots:?}: each once");
            // The last ones are on their way. A way may be lost for a while.
            assert!(rounds.len() > 285, "{slots:?}: {}", rounds.len());
        }
    }

    #[test]
    fn each_anchor_passes_two_entries_on_in_a_superframe_and_four_more_in_a_relay_slot() {
        for (slots, has_relay_slots, most) in [
            ([6, 3], false, 2.0),
            ([1, 8], false, 2.0),
            ([7, 8], false, 2.0),
            ([8, 7], false, 2.0),
            ([6, 3], true, 6.0),
            ([1, 8], true, 6.0),
            ([7, 8], true, 6.0),
        ] {
            let mut row = Row::new(&slots, &[1]);
            assert!(!row.anchors[0].wants_relay_slots());
            row.has_relay_slots = has_relay_slots;
            for _ in 0..100 {
                // Data are not replaced by newer ones.
                for number in 0..8 {
                    let data = UserData::new(number, b"1");
                    let round = row.number << 3 | u16::from(number);
                    let age = RadioDuration::ZERO;
                    let polled = Polled { tag: 0x1001, round, asked: 1, age, position: None, data };
                    row.anchors[0].on_poll(&polled, None, row.number << 8, true);
                }
                row.superframe();
            }
            let rate = row.reported.len() as f64 / 100.0;
            assert!((0.97 * most..=most).contains(&rate), "{slots:?}: {rate}");
            assert!(row.anchors[0].wants_relay_slots());
            (0..30).for_each(|_| row.superframe());
            assert!(!row.anchors[0].wants_relay_slots(), "all is passed on");
        }
    }

    #[test]
    fn a_gateway_that_falls_silent_is_replaced_by_another_within_two_seconds() {
        // Gateways at both ends. The tag is nearer to the first one, whose host reads no more.
        let mut row = Row::new(&[0, 2, 4, 6, 8], &[0, 4]);
        row.poll(0x1001, 1, &[1]);
        (0..3).for_each(|_| row.superframe());
        assert_eq!(row.reported.last(), Some(&(0, 0x1001, 1, 256)));
        row.anchors[0].set_host(false);
        let others = |row: &Row| {
            let others = row.reported.iter().filter(|(at, ..)| *at != 0);
            others.map(|(at, _, round, _)| (*at, *round)).collect::<Vec<_>>()
        };
        for round in 2..=21 {
            row.poll(0x1000 + round, round, &[1]);
            row.superframe();
        }
        assert!(!others(&row).is_empty(), "two seconds");
        (0..20).for_each(|_| row.superframe());
        // What has waited meanwhile is there, too.
        assert_eq!(others(&row), (2..=21).map(|round| (4, round)).collect::<Vec<_>>());
        // Without any gateway nobody knows a way, and nothing older than five seconds waits.
        row.anchors[4].set_host(false);
        (0..40).for_each(|_| row.superframe());
        assert!(row.anchors.iter().all(|anchor| anchor.cost.is_none()));
        row.poll(0x1001, 30, &[1]);
        assert_eq!(row.anchors.iter().map(|anchor| anchor.queue.len()).sum::<usize>(), 1);
        (0..51).for_each(|_| row.superframe());
        assert!(row.anchors.iter().all(|anchor| anchor.queue.is_empty()));
    }

    #[test]
    fn a_way_through_the_coordinator_costs_more() {
        let mut row = Row::new(&[0, 4, 8], &[2]);
        let before = [0, 1].map(|at| row.anchors[at].cost.expect("a way"));
        row.coordinator = Some(1);
        // Half a hop of eight and one more, for the one behind it, without any pause.
        for _ in 0..10 {
            row.superframe();
            assert!(row.anchors[0].cost.is_some());
        }
        assert_eq!([0, 1].map(|at| row.anchors[at].cost), [Some(before[0] + 5), Some(before[1])]);
        row.poll(0x1001, 1, &[0]);
        (0..5).for_each(|_| row.superframe());
        assert_eq!(row.rounds(), [1]);
        // Its own way is nobody's business if a host reads what it reports.
        row.anchors[1].set_host(true);
        (0..10).for_each(|_| row.superframe());
        assert_eq!(row.anchors[0].cost, Some(before[1]));
    }

    #[test]
    fn a_full_queue_drops_its_oldest_entry_and_keeps_one_position_of_each_tag() {
        let mut row = Row::new(&[0, 4], &[1]);
        // No frame arrives any more.
        row.loss = 1.0;
        for (tag, round) in (0..60).map(|tag| (0x1000 + tag, 1)).chain([(0x1020, 2)]) {
            row.poll(tag, round, &[0]);
        }
        let waiting: Vec<(u16, u16)> =
            row.anchors[0].queue.iter().map(|waiting| (waiting.entry.tag, waiting.entry.round)).collect();
        let expected: Vec<_> = (28..60).map(|tag| (0x1000 + tag, if tag == 0x20 { 2 } else { 1 })).collect();
        assert_eq!(waiting, expected);
        (0..6).for_each(|_| row.superframe());
        // The gateway was silent for too long. Then it is there again.
        assert_eq!(row.anchors[0].cost, None);
        row.loss = 0.0;
        (0..30).for_each(|_| row.superframe());
        assert_eq!(row.reported.len(), 32);
        // After five seconds nothing would be left.
        row.poll(0x1001, 3, &[0]);
        row.loss = 1.0;
        (0..51).for_each(|_| row.superframe());
        assert!(row.anchors[0].queue.is_empty());
    }

    #[test]
    fn who_does_not_receive_this_anchor_is_no_way() {
        // The second anchor is between two gateways; the first one receives nobody, or not all.
        let mut row = Row::new(&[0, 4, 8], &[0, 2]);
        let mut ways = |is_deaf: bool, loss: f64, superframes: u16| {
            (row.deaf, row.loss_to_first) = (is_deaf.then_some(0), loss);
            let mut sent = [0_u32; 2];
            for round in 0..superframes {
                row.poll(0x1001 + round, round, &[1]);
                row.superframe();
                sent[0] += u32::from(row.anchors[1].next_now(4, false).is_some_and(|next| next.address == 1));
                sent[1] += 1;
            }
            f64::from(sent[0]) / f64::from(sent[1])
        };
        assert!(ways(false, 0.0, 100) > 0.45, "both in turn");
        ways(true, 0.0, 20);
        assert!(ways(true, 0.0, 100) == 0.0, "it does not report this anchor");
        ways(false, 0.0, 20);
        assert!(ways(false, 0.0, 100) > 0.45);
        ways(false, 0.7, 50);
        assert!(ways(false, 0.7, 200) < 0.25, "of what is sent to it, it takes too little");
        ways(false, 0.0, 70);
        assert!(ways(false, 0.0, 100) > 0.45);
    }
}
