//! How anchors keep one time, one coordinator and one list of members among themselves.
//!
//! Every anchor repeats in its beacon what it knows of the coordinator's word, with the number of superframes since that left
//! the coordinator (`age`) and of hops. Who hears younger word follows it; its clock follows senders nearer to the coordinator
//! only. Word that grows too old means that the coordinator is gone: the first anchor whose beacon slot comes then takes
//! over, with a later term, the same time and the same list; those behind it hear that before their own slot. Of two
//! coordinators the later term is right, then the lower address. A coordinator that comes back hears that first, and follows.
//!
//! A beacon slot is picked where nobody is heard or told of (each beacon tells whom its sender hears in which slot). Who
//! learns that a neighbour hears somebody else in its slot picks another.

use heapless::Vec;

use super::plan::{Members, Membership};
use super::timing::{HOLDOVER_SUPERFRAMES, Phase, SHARED_SLOTS, Timing};
use super::{prevails, spread};
use crate::RadioInstant;
use crate::exchange::Link;
use crate::frame::native::{Beacon, MAX_MEMBERS, Member, OWNED_BEACON_SLOTS, Position, Share};

/// Word of the coordinator older than this many superframes, and two more a hop, means that it is gone.
const COORDINATOR_GONE: u8 = 3;
/// An owner of a beacon slot not heard or told of for this many superframes has left it.
const SLOT_LEFT: u8 = 5;
/// A member of whom no poll was heard for this many of its turns loses its slots.
const LEASE_TURNS: u16 = 10;
/// Requests on their way.
const MAX_REQUESTS: usize = 16;

/// Owners of beacon slots: a byte of the address's hash (0: nobody) and superframes since the last sign of it.
type Owners = [(u8, u8); OWNED_BEACON_SLOTS];

/// An anchor's part in its network.
#[derive(Clone, Debug)]
pub struct Coordination {
    /// Where we are in time.
    pub phase: Phase,
    /// The tags.
    pub membership: Membership,
    address: u16,
    term: u8,
    coordinator: u16,
    hops: u8,
    /// Superframes since what we know left the coordinator.
    age: u8,
    /// Superframes listened to.
    listened: u16,
    slot: Option<u8>,
    heard_owners: Owners,
    told_owners: Owners,
    /// Members of the newest list of whom a poll was heard, here or told by anchors farther from the coordinator.
    heard_members: u32,
    /// As coordinator: superframes since a poll of each member.
    unheard_members: [u16; MAX_MEMBERS],
    requests: Vec<Member, MAX_REQUESTS>,
    /// The last superframe whose beacon is done with.
    told: Option<u16>,
}

/// What a beacon did to us.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heard {
    /// Nothing: of a network that does not prevail, or a repetition.
    Ignored,
    /// We follow as before.
    Followed,
    /// We follow another coordinator now.
    Changed(Link),
}

impl Coordination {
    /// A network of its own, beginning at `start`.
    pub fn found(address: u16, start: RadioInstant) -> Self {
        Self {
            phase: Phase { number: 0, start },
            membership: Membership::default(),
            address,
            term: 0,
            coordinator: address,
            hops: 0,
            age: 0,
            listened: 0,
            slot: Some((usize::from(address) % OWNED_BEACON_SLOTS) as u8),
            heard_owners: [(0, 0); OWNED_BEACON_SLOTS],
            told_owners: [(0, 0); OWNED_BEACON_SLOTS],
            heard_members: 0,
            unheard_members: [0; MAX_MEMBERS],
            requests: Vec::new(),
            told: None,
        }
    }

    /// Into a network that was heard of.
    pub fn join(address: u16, source: u16, beacon: &Beacon, phase: Phase) -> Self {
        let mut joined = Self { slot: None, ..Self::found(address, phase.start) };
        joined.adopt(source, beacon, phase, true);
        joined
    }

    fn coordinates(&self) -> bool {
        self.coordinator == self.address
    }

    fn adopt(&mut self, source: u16, beacon: &Beacon, phase: Phase, anew: bool) {
        self.phase = phase;
        (self.term, self.coordinator) = (beacon.term, beacon.coordinator);
        (self.age, self.hops) = (beacon.age, beacon.hops.saturating_add(1));
        self.membership.hear(beacon.version, beacon.countdown, &beacon.members, anew);
        if anew {
            (self.slot, self.listened, self.told) = (None, 0, None);
            self.heard_owners = [(0, 0); OWNED_BEACON_SLOTS];
            self.told_owners = [(0, 0); OWNED_BEACON_SLOTS];
        }
        self.note_owners(source, beacon);
    }

    /// A beacon of our PAN came at `rx_time`.
    pub fn hear(&mut self, timing: &Timing, source: u16, beacon: &Beacon, rx_time: RadioInstant) -> Heard {
        let phase = Phase::from_beacon(timing, beacon.superframe, beacon.slot, rx_time);
        let mut expected = self.phase;
        expected.advance(timing, rx_time);
        let off = phase.start.since(expected.start).ticks().unsigned_abs();
        let in_step = phase.number == expected.number && off <= timing.guard.ticks().unsigned_abs();
        let (told, followed) = ((beacon.term, beacon.coordinator), (self.term, self.coordinator));
        if told == followed {
            let deaf = u16::from(self.age) > HOLDOVER_SUPERFRAMES && !self.coordinates();
            if !in_step && deaf {
                self.adopt(source, beacon, phase, true);
                return Heard::Followed;
            }
            if !in_step {
                return Heard::Ignored;
            }
            let hops = beacon.hops.saturating_add(1);
            if (beacon.age, hops) <= (self.age, self.hops) && !self.coordinates() {
                (self.age, self.hops) = (beacon.age, hops);
            }
            if beacon.hops < self.hops {
                self.phase = phase;
                self.membership.hear(beacon.version, beacon.countdown, &beacon.members, false);
            }
            self.note_owners(source, beacon);
            self.note_members(beacon);
            return Heard::Followed;
        }
        if !prevails(told, followed) {
            return Heard::Ignored;
        }
        let link = if self.coordinates() { Link::Following(told.1) } else { Link::Synchronised(told.1) };
        self.adopt(source, beacon, phase, !in_step);
        Heard::Changed(link)
    }

    fn note_owners(&mut self, source: u16, beacon: &Beacon) {
        if let Some(owner) = self.heard_owners.get_mut(usize::from(beacon.slot)) {
            *owner = (hash(source), 0);
        }
        for (told, &owner) in self.told_owners.iter_mut().zip(&beacon.slot_owners) {
            if owner != 0 {
                *told = (owner, 0);
            }
        }
        let Some(slot) = self.slot else { return };
        let contested =
            beacon.slot_owners.get(usize::from(slot)).is_some_and(|&owner| owner != 0 && owner != hash(self.address));
        if contested || beacon.slot == slot && source < self.address {
            self.slot = None;
        }
    }

    /// What an anchor farther from the coordinator tells of tags.
    fn note_members(&mut self, beacon: &Beacon) {
        if beacon.hops <= self.hops {
            return;
        }
        if beacon.version == self.membership.version() {
            self.heard_members |= beacon.heard;
        }
        if let Some(request) = beacon.request {
            self.request(request);
        }
    }

    /// A tag asks for slots.
    pub fn request(&mut self, request: Member) {
        let listed = self.membership.members().iter().find(|member| member.tag == request.tag);
        if listed.map_or(Share::Release, |member| member.share) == request.share {
            return;
        }
        match self.requests.iter_mut().find(|known| known.tag == request.tag) {
            Some(known) => *known = request,
            // With too many on their way, the tag asks again.
            None => {
                let _ = self.requests.push(request);
            }
        }
    }

    /// A tag's poll was heard.
    pub fn hear_tag(&mut self, tag: u16) {
        if let Some(place) = self.membership.members().iter().position(|member| member.tag == tag) {
            self.heard_members |= 1 << place;
        }
    }

    /// Goes on to the superframe that `now` is in.
    pub fn advance(&mut self, timing: &Timing, now: RadioInstant) {
        let begun = self.phase.advance(timing, now);
        if begun == 0 {
            return;
        }
        let superframes = begun.min(u8::MAX.into()) as u8;
        self.membership.advance(begun);
        self.listened = self.listened.saturating_add(begun);
        for (owner, unheard) in self.heard_owners.iter_mut().chain(&mut self.told_owners) {
            *unheard = unheard.saturating_add(superframes);
            if *unheard > SLOT_LEFT {
                *owner = 0;
            }
        }
        if self.coordinates() {
            self.coordinate(begun);
        } else {
            self.age = self.age.saturating_add(superframes);
        }
        if self.slot.is_none() && self.listened > 1 {
            self.slot = self.pick_slot();
        }
    }

    /// The coordinator's work of a superframe: leases end, requests are granted.
    fn coordinate(&mut self, begun: u16) {
        let members = self.membership.members();
        for (place, unheard) in self.unheard_members.iter_mut().enumerate() {
            let heard = self.heard_members >> place & 1 == 1;
            *unheard = if heard { 0 } else { unheard.saturating_add(begun) };
        }
        self.heard_members = 0;
        let expired = |place: usize, member: &Member| {
            let turn = match member.share {
                Share::OneIn(superframes) => u16::from(superframes),
                Share::Release | Share::Slots(_) | Share::Greedy => 1,
            };
            self.unheard_members.get(place).is_none_or(|&unheard| unheard > LEASE_TURNS * turn)
        };
        if self.membership.countdown() > 0 {
            return;
        }
        let kept = |&(place, member): &(usize, &Member)| {
            !expired(place, member) && !self.requests.iter().any(|request| request.tag == member.tag)
        };
        let staying = members.iter().enumerate().filter(kept).map(|(_, member)| *member);
        let mut unheard = [0; MAX_MEMBERS];
        let joining = self.requests.iter().filter(|request| request.share != Share::Release).copied();
        // In the order of their addresses; a library's sort takes five kilobytes.
        let mut list = Members::new();
        for member in staying.chain(joining) {
            let place = list.iter().position(|other| other.tag > member.tag).unwrap_or(list.len());
            // A full network takes nobody.
            let _ = list.insert(place, member);
        }
        self.requests.clear();
        if list == *members {
            return;
        }
        for (place, member) in list.iter().enumerate() {
            if let Some(before) = members.iter().position(|known| known.tag == member.tag) {
                unheard[place] = self.unheard_members[before];
            }
        }
        self.unheard_members = unheard;
        self.membership.change(&list);
    }

    fn pick_slot(&self) -> Option<u8> {
        let free = |slot: &u8| {
            let slot = usize::from(*slot);
            self.heard_owners[slot].0 == 0 && self.told_owners[slot].0 == 0
        };
        let wished = (usize::from(self.address) % OWNED_BEACON_SLOTS) as u8;
        let all = 0..OWNED_BEACON_SLOTS as u8;
        // At first the slot that goes with the address: addresses in a row never meet. Whoever was driven out of it draws.
        if free(&wished) && self.listened < 4 {
            return Some(wished);
        }
        let count = all.clone().filter(free).count() as u16;
        all.filter(free).nth(spread(self.address, self.phase.number, count).into())
    }

    /// The beacon slot of this superframe, unless that is done with. Without a slot of its own an anchor speaks in a shared one,
    /// now and then.
    pub fn due(&self) -> Option<u8> {
        if self.told == Some(self.phase.number) {
            return None;
        }
        match self.slot {
            Some(slot) => Some(slot),
            None if self.listened > 1 => {
                let shared = spread(self.address, self.phase.number, 4 * SHARED_SLOTS as u16) as u8;
                (usize::from(shared) < SHARED_SLOTS).then_some(OWNED_BEACON_SLOTS as u8 + shared)
            }
            None => None,
        }
    }

    /// This superframe's beacon is done with.
    pub fn skip(&mut self) {
        self.told = Some(self.phase.number);
    }

    /// The beacon for a slot, to be sent now; and whether we have just become coordinator.
    pub fn tell(&mut self, slot: u8, position: Option<Position>) -> (Beacon, bool) {
        self.skip();
        let gone = COORDINATOR_GONE.saturating_add(self.hops.saturating_mul(2));
        let takes_over = !self.coordinates() && self.age > gone;
        if takes_over {
            self.term = self.term.wrapping_add(1);
            (self.coordinator, self.hops, self.age) = (self.address, 0, 0);
            self.unheard_members = [0; MAX_MEMBERS];
        }
        let mut slot_owners = self.heard_owners.map(|(owner, _)| owner);
        if let Some(own) = self.slot.and_then(|slot| slot_owners.get_mut(usize::from(slot))) {
            *own = hash(self.address);
        }
        let (request, heard) = if self.coordinates() {
            (None, self.heard_members)
        } else {
            (self.requests.pop(), core::mem::take(&mut self.heard_members))
        };
        let beacon = Beacon {
            superframe: self.phase.number,
            term: self.term,
            age: self.age,
            hops: self.hops,
            coordinator: self.coordinator,
            slot,
            slot_owners,
            request,
            heard,
            version: self.membership.version(),
            countdown: self.membership.countdown(),
            position,
            members: self.membership.members().clone(),
        };
        (beacon, takes_over)
    }
}

/// A byte that stands for an address; never 0.
fn hash(address: u16) -> u8 {
    (address % 255) as u8 + 1
}
