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

use super::course::Course;
use super::layout::Layout;
use super::plan::Members;
use super::timing::{HOLDOVER_SUPERFRAMES, SHARED_SLOTS};
use super::wishes::Wishes;
use super::{prevails, spread};
use crate::exchange::Link;
use crate::frame::native::{Beacon, MAX_MEMBERS, Member, OWNED_BEACON_SLOTS, Position, Share};
use crate::{PhyConfig, RadioInstant};

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
    /// Where we are in time, and what counts there.
    pub course: Course,
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
    /// What tags, and anchors farther from the coordinator, ask of the layout.
    wishes: Wishes,
    /// The last superframe whose beacon is done with.
    told: Option<u16>,
    /// The last superframe whose beacon came too late in its own slot.
    late: Option<u16>,
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
    /// A network of its own, beginning at `start`, laid out for this anchor itself.
    pub fn found(address: u16, phy: &PhyConfig, layout: Layout, start: RadioInstant) -> Self {
        let slot = Some((usize::from(address) % OWNED_BEACON_SLOTS) as u8);
        Self { slot, ..Self::of_course(address, Course::begin(phy, layout, start)) }
    }

    /// Into a network that was heard of, unless its layout is just changing.
    pub fn join(address: u16, phy: &PhyConfig, source: u16, beacon: &Beacon, rx_time: RadioInstant) -> Option<Self> {
        let mut joined = Self::of_course(address, Course::of_beacon(phy, beacon, rx_time)?);
        joined.follow(source, beacon);
        Some(joined)
    }

    fn of_course(address: u16, course: Course) -> Self {
        Self {
            course,
            address,
            term: 0,
            coordinator: address,
            hops: 0,
            age: 0,
            listened: 0,
            slot: None,
            heard_owners: [(0, 0); OWNED_BEACON_SLOTS],
            told_owners: [(0, 0); OWNED_BEACON_SLOTS],
            heard_members: 0,
            unheard_members: [0; MAX_MEMBERS],
            requests: Vec::new(),
            wishes: Wishes::new(),
            told: None,
            late: None,
        }
    }

    fn coordinates(&self) -> bool {
        self.coordinator == self.address
    }

    /// Takes a beacon's coordinator for its own.
    fn follow(&mut self, source: u16, beacon: &Beacon) {
        (self.term, self.coordinator) = (beacon.term, beacon.coordinator);
        if beacon.coordinator == self.address {
            // Word of our own from before a restart: we go on as the coordinator, by a later term, and all who follow us stay.
            self.term = self.term.wrapping_add(1);
            (self.age, self.hops) = (0, 0);
        } else {
            (self.age, self.hops) = (beacon.age, beacon.hops.saturating_add(1));
        }
        self.note_owners(source, beacon);
    }

    /// Into the network of a beacon, as if nothing had been known; false in the middle of a change of its layout.
    fn begin_anew(&mut self, phy: &PhyConfig, source: u16, beacon: &Beacon, rx_time: RadioInstant) -> bool {
        match Self::join(self.address, phy, source, beacon, rx_time) {
            Some(joined) => {
                *self = joined;
                true
            }
            None => false,
        }
    }

    /// A beacon of our PAN came at `rx_time`.
    pub fn hear(&mut self, phy: &PhyConfig, source: u16, beacon: &Beacon, rx_time: RadioInstant) -> Heard {
        self.advance(rx_time);
        let in_step = self.course.in_step(beacon, rx_time);
        let (told, followed) = ((beacon.term, beacon.coordinator), (self.term, self.coordinator));
        if told == followed {
            let Some(phase) = in_step else {
                let deaf = u16::from(self.age) > HOLDOVER_SUPERFRAMES && !self.coordinates();
                let followed = deaf && self.begin_anew(phy, source, beacon, rx_time);
                return if followed { Heard::Followed } else { Heard::Ignored };
            };
            let hops = beacon.hops.saturating_add(1);
            if (beacon.age, hops) <= (self.age, self.hops) && !self.coordinates() {
                (self.age, self.hops) = (beacon.age, hops);
            }
            if beacon.hops < self.hops {
                self.course.phase = phase;
                self.course.membership.hear(beacon);
            }
            self.note_owners(source, beacon);
            self.note_members(beacon);
            return Heard::Followed;
        }
        if !prevails(told, followed) {
            return Heard::Ignored;
        }
        let link = if self.coordinates() { Link::Following(told.1) } else { Link::Synchronised(told.1) };
        match in_step {
            Some(phase) => {
                self.course.phase = phase;
                self.course.membership.hear(beacon);
                self.follow(source, beacon);
            }
            None if self.begin_anew(phy, source, beacon, rx_time) => {}
            None => return Heard::Ignored,
        }
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
        if beacon.version == self.course.membership.version() {
            self.heard_members |= beacon.heard;
        }
        if let Some(request) = beacon.request {
            self.request(request);
        }
        self.wishes.note(beacon.wish);
    }

    /// A tag asks this of the layout.
    pub fn wish(&mut self, tag: u16, wish: Layout) {
        self.wishes.note_tag(tag, wish, self.course.membership.members());
    }

    /// A tag asks for slots.
    pub fn request(&mut self, request: Member) {
        let listed = self.course.membership.members().iter().find(|member| member.tag == request.tag);
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
        if let Some(place) = self.course.membership.members().iter().position(|member| member.tag == tag) {
            self.heard_members |= 1 << place;
        }
    }

    /// Goes on to the superframe that `now` is in.
    pub fn advance(&mut self, now: RadioInstant) {
        let begun = self.course.advance(now);
        if begun == 0 {
            return;
        }
        let superframes = begun.min(u8::MAX.into()) as u8;
        self.wishes.advance(begun);
        self.wishes.keep(self.course.membership.members());
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

    /// The coordinator's work of a superframe: leases end, requests are granted, slots are laid out.
    fn coordinate(&mut self, begun: u16) {
        let membership = &mut self.course.membership;
        let members = membership.members();
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
        if membership.countdown() > 0 {
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
        let layout = self.wishes.better_than(membership.layout()).unwrap_or(membership.layout());
        if list == *members && layout == membership.layout() {
            return;
        }
        for (place, member) in list.iter().enumerate() {
            if let Some(before) = members.iter().position(|known| known.tag == member.tag) {
                unheard[place] = self.unheard_members[before];
            }
        }
        self.unheard_members = unheard;
        membership.change(&list, layout);
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
        all.filter(free).nth(spread(self.address, self.course.phase.number, count).into())
    }

    /// The beacon slot of this superframe, unless that is done with. An anchor speaks in a shared slot where it came too late for its
    /// own, and, now and then, where it has none of its own.
    pub fn due(&self) -> Option<u8> {
        let number = self.course.phase.number;
        if self.told == Some(number) {
            return None;
        }
        let shared = |choices| {
            let shared = spread(self.address, number, choices) as u8;
            (usize::from(shared) < SHARED_SLOTS).then_some(OWNED_BEACON_SLOTS as u8 + shared)
        };
        match self.slot {
            Some(_) if self.late == Some(number) => shared(SHARED_SLOTS as u16),
            Some(slot) => Some(slot),
            None if self.listened > 1 => shared(4 * SHARED_SLOTS as u16),
            None => None,
        }
    }

    /// This superframe's beacon is done with.
    pub fn skip(&mut self) {
        self.told = Some(self.course.phase.number);
    }

    /// The beacon that was due came too late: there is one more chance in this superframe, in a shared slot.
    pub fn was_late(&mut self) {
        let number = self.course.phase.number;
        self.told = if self.late.replace(number) == Some(number) { Some(number) } else { None };
    }

    /// The beacon for a slot, to be sent now; and whether we have just become coordinator. `wish` is what this anchor itself asks of the
    /// layout.
    pub fn tell(&mut self, slot: u8, position: Option<Position>, wish: Layout) -> (Beacon, bool) {
        self.skip();
        self.wishes.note(wish);
        let gone = COORDINATOR_GONE.saturating_add(self.hops.saturating_mul(2));
        let takes_over = !self.coordinates() && self.age > gone.min(u8::MAX - 1);
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
            // What is asked of the layout has its turn too.
            let passes_request_on = self.course.phase.number.is_multiple_of(2) || self.wishes.all() == Layout::LEAST;
            let request = if passes_request_on { self.requests.pop() } else { None };
            (request, core::mem::take(&mut self.heard_members))
        };
        let membership = &self.course.membership;
        let beacon = Beacon {
            superframe: self.course.phase.number,
            term: self.term,
            age: self.age,
            hops: self.hops,
            coordinator: self.coordinator,
            slot,
            slot_owners,
            request,
            wish: self.wishes.all(),
            heard,
            version: membership.version(),
            countdown: membership.countdown(),
            layout: membership.layout(),
            layout_is_new: membership.changes_layout(),
            position,
            members: membership.members().clone(),
        };
        (beacon, takes_over)
    }
}

/// A byte that stands for an address; never 0.
fn hash(address: u16) -> u8 {
    (address % 255) as u8 + 1
}
