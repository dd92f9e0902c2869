//! How anchors share one time, one coordinator, one plan and one table of leases.
//!
//! Each sync frame repeats the coordinator's last message, with its age in superframes (`age`) and the number of hops.
//! An anchor follows the freshest message. Its clock follows senders that are nearer to the coordinator, or fresher. If the
//! age exceeds the limit, the coordinator is gone. Then the first anchor whose sync slot comes takes over, with a later
//! term, the same time and the same list. The anchors after it receive this before their own slot.
//! [`election`](super::election) decides which of two coordinators is followed, and when. A coordinator that comes back
//! receives the new coordinator's message first, and follows it.
//!
//! Polls that other anchors received count if these anchors report them in sync slots of their own, which they had
//! before.
//!
//! Who sends in which sync slot is decided by each anchor for itself ([`sync_slot`](super::sync_slot)).
//!
//! Every state of an anchor has a way out:
//!
//! | state | way out |
//! |---|---|
//! | no network | a sync frame, or it founds one |
//! | founded, alone | any network that prevails, at once |
//! | follows | a coordinator that prevails, after patience; takes over from a silent one |
//! | out of step | the age grows, and the next sync frame begins anew |
//! | a network that does not prevail is received | that network follows this one, see [`election`](super::election) |
//! | layout changes at the start | the notice ends after four superframes |
//! | slot contested, or unconfirmed | shared slots, then another slot |

use super::downlinks::Downlinks;
use super::election::{Choice, Election};
use super::enrolment::Enrolment;
use super::introductions::Introductions;
use super::layout_requests::LayoutRequests;
use super::leases::Leases;
use super::plan::Slots;
use super::superframes::Superframes;
use super::sync_slot::SyncSlot;
use super::timing::{HOLDOVER_SUPERFRAMES, Network, Timing};
use super::uplink::Uplink;
use crate::exchange::Link;
use crate::{RadioDuration, RadioInstant};
use wire::uwb::layout::Layout;
use wire::uwb::native::{Confirmation, Member, OWNED_SYNC_SLOTS, Poll, Position, Share, SyncFrame};

/// If the coordinator's last message is older than this many superframes, and two more for each hop, the coordinator is
/// gone.
const COORDINATOR_GONE: u8 = 3;
/// A sync frame that comes late was recorded, unless the coordinator was silent for more than this many superframes.
const LONG_SILENT: u8 = 20;

/// An anchor's state in its network, but for the leases: their table is large and stays where it is, and methods take
/// it.
#[derive(Clone, Debug)]
pub struct Coordinator {
    /// The time of the network, and the list and layout in force.
    pub course: Superframes,
    address: u16,
    /// The coordinator of the network.
    election: Election,
    /// Superframes spent listening.
    listened: u16,
    slot: SyncSlot,
    introductions: Introductions,
    /// A host reads what this anchor reports.
    pub is_gateway: bool,
    /// Members of the newest list whose poll was received, here or according to anchors farther from the coordinator.
    heard_members: u16,
    enrolment: Enrolment,
    /// What tags, and anchors farther from the coordinator, request of the layout.
    wishes: LayoutRequests,
    /// The last superframe whose sync frame is finished.
    told: Option<u16>,
    /// The last superframe whose sync frame was too late for its own slot.
    late: Option<u16>,
}

/// The effect of a sync frame on this anchor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FollowUpdate {
    /// None: its network does not prevail, or it is a repetition.
    Ignored,
    /// This anchor follows as before.
    Followed,
    /// This anchor follows another coordinator now.
    Changed(Link),
}

impl Coordinator {
    /// Founds a network that begins at `start`, with a layout for this anchor itself.
    pub fn found(address: u16, network: &Network, layout: Layout, start: RadioInstant, session: Option<u32>) -> Self {
        let mut founded = Self::of_course(address, Superframes::begin(network, layout, start, session));
        founded.slot.take_first();
        founded
    }

    /// Joins a network whose sync frame was received, unless its layout is just changing.
    pub fn join(
        address: u16,
        network: &Network,
        source: u16,
        sync_frame: &SyncFrame,
        rx_time: RadioInstant,
    ) -> Option<Self> {
        let mut joined = Self::of_course(address, Superframes::of_sync_frame(network, sync_frame, rx_time)?);
        joined.election = Election::joined(sync_frame);
        joined.follow(source, sync_frame);
        Some(joined)
    }

    fn of_course(address: u16, course: Superframes) -> Self {
        Self {
            course,
            address,
            election: Election::founded(address),
            listened: 0,
            slot: SyncSlot::new(address),
            introductions: Introductions::new(),
            is_gateway: false,
            heard_members: 0,
            enrolment: Enrolment::new(),
            wishes: LayoutRequests::new(),
            told: None,
            late: None,
        }
    }

    fn coordinates(&self) -> bool {
        self.election.coordinator == self.address
    }

    /// Accepts a sync frame's coordinator.
    fn follow(&mut self, source: u16, sync_frame: &SyncFrame) {
        self.election.follow(sync_frame);
        if sync_frame.coordinator == self.address {
            // A message of this anchor from before its restart: it goes on as the coordinator with a later term, and
            // all followers stay.
            self.election.take_over(self.address);
        }
        self.note_anchor(source, sync_frame);
    }

    /// Another anchor of the network was received.
    fn note_anchor(&mut self, source: u16, sync_frame: &SyncFrame) {
        self.slot.receive(source, sync_frame);
        self.introductions.receive(source, sync_frame);
    }

    /// Joins the network of a sync frame without any earlier knowledge. Returns false in the middle of a change of its
    /// layout.
    fn begin_anew(
        &mut self,
        network: &Network,
        leases: &mut Leases,
        source: u16,
        sync_frame: &SyncFrame,
        rx_time: RadioInstant,
    ) -> bool {
        match Self::join(self.address, network, source, sync_frame, rx_time) {
            Some(joined) => {
                leases.clear();
                *self = joined;
                true
            }
            None => false,
        }
    }

    /// A sync frame of this PAN arrived at `rx_time`.
    pub fn receive(
        &mut self,
        network: &Network,
        leases: &mut Leases,
        source: u16,
        sync_frame: &SyncFrame,
        rx_time: RadioInstant,
    ) -> FollowUpdate {
        self.advance(network, leases, rx_time);
        let in_step = self.course.in_step(sync_frame, rx_time);
        let is_deaf = u16::from(self.election.age) > HOLDOVER_SUPERFRAMES && !self.coordinates();
        // A recorded one would give a wrong time. One that comes late for seconds is another's.
        let may_be_recorded = is_deaf && self.election.age <= LONG_SILENT;
        if may_be_recorded && self.course.is_delayed(RadioDuration::ZERO, sync_frame, rx_time) {
            return FollowUpdate::Ignored;
        }
        let is_the_same = (sync_frame.term, sync_frame.coordinator) == (self.election.term, self.election.coordinator);
        if is_the_same && in_step.is_none() {
            let followed = is_deaf && self.begin_anew(network, leases, source, sync_frame, rx_time);
            return if followed { FollowUpdate::Followed } else { FollowUpdate::Ignored };
        }
        let is_alone = self.coordinates() && self.course.membership.members().is_empty() && !self.slot.has_neighbours();
        let is_fresher = sync_frame.age < self.election.age;
        let lateness = self.course.lateness(sync_frame, rx_time);
        match (self.election.receive(sync_frame, is_alone, lateness), in_step) {
            (Choice::Same, Some(phase)) => {
                if sync_frame.hops < self.election.hops || is_fresher {
                    self.course.phase = phase;
                    let agrees = self.course.membership.receive(sync_frame);
                    if agrees && self.is_known(source, sync_frame) {
                        leases.learn(sync_frame);
                        self.enrolment.answered(&sync_frame.leases);
                    }
                }
                self.note_members(leases, source, sync_frame);
                self.note_anchor(source, sync_frame);
                FollowUpdate::Followed
            }
            (Choice::Change, phase) => {
                let link = match self.coordinates() {
                    true => Link::Following(sync_frame.coordinator),
                    false => Link::Synchronised(sync_frame.coordinator),
                };
                match phase {
                    Some(phase) => {
                        self.course.phase = phase;
                        self.course.membership.adopt(sync_frame);
                        self.follow(source, sync_frame);
                    }
                    None if self.begin_anew(network, leases, source, sync_frame, rx_time) => {}
                    None => return FollowUpdate::Ignored,
                }
                FollowUpdate::Changed(link)
            }
            (Choice::Same, None) | (Choice::Older | Choice::Refused, _) => FollowUpdate::Ignored,
        }
    }

    /// Takes the report of tags and the request of a layout by an anchor farther from the coordinator. They count if
    /// they are sent in the anchor's own slot, and the anchor had that slot before. A sync frame in a shared slot can
    /// be forged without any cost.
    fn note_members(&mut self, leases: &mut Leases, source: u16, sync_frame: &SyncFrame) {
        if sync_frame.hops <= self.election.hops {
            return;
        }
        let is_known_relay = self.is_known(source, sync_frame);
        if is_known_relay && sync_frame.version == self.course.membership.version() {
            self.heard_members |= sync_frame.heard;
        }
        if let Some(request) = sync_frame.request {
            self.request(leases, request, true);
        }
        if is_known_relay {
            leases.on_passed_polls(sync_frame, self.coordinates());
            self.wishes.note(sync_frame.wish);
            if sync_frame.wishes_relay_slots {
                self.wishes.note_relay_slots();
            }
        }
    }

    /// Whether a sync frame came in a slot of its sender's own, which the sender had before.
    pub fn is_known(&self, source: u16, sync_frame: &SyncFrame) -> bool {
        self.slot.is_known(source, sync_frame)
    }

    /// A tag requests this layout. Its request counts once it is a member.
    pub fn wish(&mut self, tag: u16, wish: Layout) {
        self.wishes.note_tag(tag, wish, self.course.membership.members());
    }

    /// A tag requests slots. `is_passed_on`: another anchor has received the request.
    pub fn request(&mut self, leases: &mut Leases, request: Member, is_passed_on: bool) {
        let (members, number) = (self.course.membership.members(), self.course.phase.number);
        let Member { tag, share } = request;
        match share {
            Share::Leased(turns) if self.coordinates() => {
                leases.request(tag, turns, number, is_passed_on);
                self.enrolment.withdraw(tag, members, number);
            }
            _ => {
                if self.coordinates() {
                    leases.release(tag, number);
                }
                self.enrolment.request(request, members, leases.has(tag), number);
            }
        }
    }

    /// A tag's poll was received.
    pub fn on_tag(&mut self, tag: u16) {
        if let Some(place) = self.course.membership.members().iter().position(|member| member.tag == tag) {
            self.heard_members |= 1 << place;
        }
    }

    /// A tag's poll was received, whose first pulse came at `pulse`. Returns what this anchor knows of its lease.
    pub fn on_poll(&mut self, leases: &mut Leases, tag: u16, poll: &Poll, pulse: RadioInstant) -> Confirmation {
        let wish = poll.wish;
        self.wish(tag, wish);
        let Some((number, slot)) = self.course.round_slot_at(pulse) else { return Confirmation::None };
        // Members poll in slots that are not leased. A forged request may have listed a tag that has a lease.
        if self.course.membership.in_force().is_none_or(|plan| slot >= plan.slots.leased) {
            self.on_tag(tag);
        }
        leases.on_poll(tag, (slot, poll.part.unwrap_or(0)), wish.tag_byte(), number, self.coordinates())
    }

    /// Advances to the superframe that contains `now`.
    pub fn advance(&mut self, network: &Network, leases: &mut Leases, now: RadioInstant) {
        let begun = self.course.advance(now);
        if begun == 0 {
            return;
        }
        self.wishes.advance(begun);
        self.wishes.keep(self.course.membership.members());
        self.wishes.note(leases.wish());
        leases.look_over(self.course.phase.number, self.course.membership.newest().slots.leased);
        self.listened = self.listened.saturating_add(begun);
        self.election.advance(begun);
        if self.coordinates() {
            self.election.age = 0;
            self.coordinate(network, leases, begun);
        }
        self.slot.is_needed = self.is_gateway || self.coordinates();
        self.slot.advance(begun, self.course.phase.number, self.listened);
    }

    /// The coordinator's work of a superframe: it grants requests and sets the layout of the slots.
    fn coordinate(&mut self, network: &Network, leases: &mut Leases, begun: u16) {
        let Superframes { membership, phase, timing, .. } = &mut self.course;
        let before = membership.layout();
        let layout = self.wishes.better_than(before).unwrap_or(before);
        let heard = core::mem::take(&mut self.heard_members);
        let relays = self.wishes.needs_relay_slots();
        let next = if layout == timing.layout { *timing } else { Timing::of(network, layout) };
        let round_slots = next.tag_slots(relays);
        self.enrolment.take_leases(|tag, turns| leases.request(tag, turns, phase.number, true));
        let others_use_them = !membership.members().is_empty() || self.enrolment.is_awaited();
        let most = leases.most_slots(round_slots, others_use_them);
        leases.grant(phase.number, membership.leased().unwrap_or(0), most);
        let leased = leases.wanted_slots(membership.newest().slots.leased, most, others_use_them);
        self.enrolment.renew(membership, Slots { layout, leased, relays }, heard, begun, phase.number);
        if membership.layout() != before {
            self.wishes.adopted();
        }
    }

    /// The sync slot of this anchor's own.
    pub const fn own_slot(&self) -> Option<u8> {
        self.slot.own()
    }

    /// The sync slot of this superframe, unless its sync frame is finished. An anchor transmits in a shared slot if it
    /// was too late for its own, and nothing if it listens in its own. An anchor without one transmits in a shared slot now and
    /// then.
    pub fn due(&self) -> Option<u8> {
        let number = self.course.phase.number;
        if self.told == Some(number) {
            return None;
        }
        match self.slot.own() {
            Some(_) if self.slot.is_listened_to(number) => None,
            Some(_) if self.late == Some(number) => Some(self.slot.shared(number)),
            Some(slot) => Some(slot),
            None if self.listened > 1 => self.slot.shared_at_random(number),
            None => None,
        }
    }

    /// This superframe's sync frame is finished.
    pub fn skip(&mut self) {
        self.told = Some(self.course.phase.number);
    }

    /// A sync frame came. If it is another network's, and came while this anchor listened in its own slot, both send at the
    /// same time, and this anchor hears no more of that network: it takes another slot.
    #[inline(never)]
    pub fn make_way(&mut self, sync_frame: &SyncFrame, rx_time: RadioInstant) {
        let Superframes { timing, phase, session, .. } = &self.course;
        let is_own = (sync_frame.term, sync_frame.coordinator) == (self.election.term, self.election.coordinator)
            && sync_frame.session.map(|told| told.number) == *session;
        let Some(slot) = self.slot.own().filter(|_| !is_own && self.slot.is_listened_to(phase.number)) else { return };
        let off = rx_time.since(phase.at(timing.sync_frame(slot.into()))).ticks();
        if off.abs() < timing.sync_slot.ticks() {
            self.slot.leave();
        }
    }

    /// The sync frame was too late for its slot: there is one more chance in this superframe, in a shared slot.
    pub fn was_late(&mut self) {
        let number = self.course.phase.number;
        self.told = if self.late.replace(number) == Some(number) { Some(number) } else { None };
    }

    /// From the superframe's beginning to the first pulse of this anchor's relay frame, if there are relay slots.
    pub fn relay_pulse(&self) -> Option<RadioDuration> {
        let Superframes { timing, phase, .. } = &self.course;
        let slot = self.slot.own().filter(|_| self.course.has_relay_slots())?;
        timing.relay_pulse(phase.number, slot)
    }

    /// The sync frame for a slot, to be sent now; and whether this anchor has just become coordinator. `wish` is what
    /// this anchor itself requests of the layout, `answer` the number of a challenge.
    pub fn compose(
        &mut self,
        (leases, uplink, downlinks): (&mut Leases, &mut Uplink, &mut Downlinks),
        slot: u8,
        position: Option<Position>,
        wish: Layout,
        answer: Option<u32>,
    ) -> (SyncFrame, bool) {
        self.skip();
        self.wishes.note(wish);
        if uplink.wants_relay_slots() {
            self.wishes.note_relay_slots();
        }
        let gone = COORDINATOR_GONE.saturating_add(self.election.hops.saturating_mul(2));
        let takes_over = !self.coordinates() && self.election.age > gone.min(u8::MAX - 1);
        if takes_over {
            self.election.take_over(self.address);
            self.enrolment.take_over();
        }
        let (request, heard) = if self.coordinates() {
            (None, self.heard_members)
        } else {
            // Requests of slots and requests of the layout take turns.
            let passes_request_on = self.course.phase.number.is_multiple_of(2) || !self.wishes.has_any();
            let request =
                if passes_request_on { self.enrolment.pass_on(self.address, self.course.phase.number) } else { None };
            let heard = self.heard_members;
            // A transmission in a shared slot does not count: it is repeated.
            if usize::from(slot) < OWNED_SYNC_SLOTS {
                self.heard_members = 0;
            }
            (request, heard)
        };
        let Election { term, age, hops, coordinator, .. } = self.election;
        let membership = &self.course.membership;
        let mut sync_frame = SyncFrame {
            session: self.course.session_now(answer),
            superframe: self.course.phase.number,
            term,
            age,
            hops,
            coordinator,
            slot,
            slot_owners: self.slot.owners(),
            request,
            wish: self.wishes.all(),
            wishes_relay_slots: request.is_none() && self.wishes.wants_relay_slots(),
            heard,
            version: membership.version(),
            countdown: membership.countdown(),
            layout: membership.layout(),
            layout_is_new: membership.changes_layout(),
            position,
            leased: membership.newest().slots.leased,
            has_relay_slots: membership.newest().slots.relays,
            relay: None,
            neighbour: None,
            members: membership.members().clone(),
            leases: Default::default(),
            polls: Default::default(),
        };
        if usize::from(slot) < OWNED_SYNC_SLOTS {
            uplink.say_way(&mut sync_frame, self.coordinates());
            downlinks.fill(&mut sync_frame);
            uplink.fill_first(&mut sync_frame);
            self.introductions.fill(self.address, &mut sync_frame);
        }
        leases.news.fill(&mut sync_frame);
        uplink.fill_rest(&mut sync_frame);
        (sync_frame, takes_over)
    }
}
