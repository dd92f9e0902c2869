//! Sync frames: the time of a network, its coordinator, plan and news of leases.

use heapless::Vec;

use super::integrity::AUTHENTICATED;
use super::{
    Lease, LeasedPoll, MAX_LEASES, MAX_MEMBERS, MAX_POLLS, OWNED_SYNC_SLOTS, Position, Relay,
    SHORTEST_SYNC_FRAME_BYTES, SYNC, SYNC_FRAME_BYTES, Share,
};
use crate::uwb::layout::Layout;
use crate::uwb::{FrameBuffer, FrameError, Reader};

/// What the sync frames of a network with a key say of its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Session {
    /// A random number of the anchor that founded the network.
    pub number: u32,
    /// The high half of the superframe's number.
    pub epoch: u16,
    /// The number of a challenge that the sender has received.
    pub answer: Option<u32>,
}

/// An anchor's view of the network.
#[derive(Clone, Debug, PartialEq)]
pub struct SyncFrame {
    /// Of a network with a key.
    pub session: Option<Session>,
    /// Number of the superframe; of a network with a key its low half.
    pub superframe: u16,
    /// Counts changes of coordinator: the higher term (across a wrap) prevails.
    pub term: u8,
    /// Superframes since this information left the coordinator.
    pub age: u8,
    /// Hops to the coordinator; 0 is the coordinator itself.
    pub hops: u8,
    /// The coordinator's address.
    pub coordinator: u16,
    /// The sync slot in which this frame is sent.
    pub slot: u8,
    /// Owners of the sync slots, as far as the sender receives them: a byte of the address's hash each; 0 is no owner.
    pub slot_owners: [u8; OWNED_SYNC_SLOTS],
    /// A tag's request on its way to the coordinator.
    pub request: Option<Member>,
    /// What the sender, and anchors farther from the coordinator, request of the layout; not sent together with a
    /// request for slots.
    pub wish: Layout,
    /// An anchor here, or farther from the coordinator, has more entries to pass on than fit into its sync frames; not sent
    /// together with a request for slots.
    pub wishes_relay_slots: bool,
    /// Members (bit i: the list's i-th) whose poll was received here or farther from the coordinator.
    pub heard: u16,
    /// Number of the list of members.
    pub version: u8,
    /// Superframes, from this one, until the list is in force, at most 7; until then the former list is in force.
    pub countdown: u8,
    /// The layout of the slots …
    pub layout: Layout,
    /// … which is in force only with the list of members; another layout is in force until then.
    pub layout_is_new: bool,
    /// The position of the sender.
    pub position: Option<Position>,
    /// The first round slots of a superframe are leased, this many of them; the others are dealt to the members.
    pub leased: u8,
    /// The last round slots of a superframe are for relay frames.
    pub has_relay_slots: bool,
    /// The way to a gateway, if the sender knows one.
    pub relay: Option<Relay>,
    /// Another anchor, which has no sync slot of its own.
    pub neighbour: Option<AnchorAt>,
    /// The tags that range more than once a superframe, by address.
    pub members: Vec<Member, MAX_MEMBERS>,
    /// News of leases.
    pub leases: Vec<Lease, MAX_LEASES>,
    /// Polls of tags whose leases are to be renewed.
    pub polls: Vec<LeasedPoll, MAX_POLLS>,
}

/// Where an anchor is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AnchorAt {
    /// Short address of the anchor.
    pub address: u16,
    /// Its position, as it says itself.
    pub position: Position,
}

/// A tag in the network's list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Member {
    /// Short address of the tag.
    pub tag: u16,
    /// The share that it requested.
    pub share: Share,
}

/// Bytes of session and epoch, and of the answer to a challenge.
const SESSION_BYTES: usize = 6;
const ANSWER_BYTES: usize = 4;

/// In the byte with the number of members: the frame passes on a request for slots, and not one for the layout.
const PASSES_REQUEST_ON: u8 = 0x80;
/// In the same byte: one more than the number of relayed entries, or 0 if there is no way to a gateway.
const RELAYS: u8 = 0x60;
const RELAYS_SHIFT: u8 = 5;
const MEMBERS: u8 = 0x1F;
/// In the byte with the number of leased slots: the frame says where another anchor is.
const HAS_NEIGHBOUR: u8 = 0x80;
/// In the same byte: there are relay slots.
const HAS_RELAY_SLOTS: u8 = 0x40;
const LEASED: u8 = 0x3F;
/// After the request of a layout: relay slots are requested, too.
const WISHES_RELAY_SLOTS: u8 = 1;
/// In the first byte of the layout: another layout is in force until the list of members is.
const LAYOUT_IS_NEW: u8 = 0x80;
/// Mask of the slot in the byte with slot and countdown.
const SLOT: u8 = 0x1F;
const COUNTDOWN_SHIFT: u8 = 5;
/// In the byte with the numbers of leases and polls: the answer to a challenge follows the session.
const ANSWERS: u8 = 0x08;

/// The slot of a sync frame with an integrity code. No other byte is looked at.
pub fn slot_of(bytes: &[u8]) -> Option<u8> {
    // After the header, the code: superframe, term, age, hops, coordinator.
    let [code, .., slot] = bytes.get(9..18)? else { return None };
    (*code == SYNC | AUTHENTICATED).then_some(*slot & SLOT)
}

impl SyncFrame {
    #[inline]
    pub(super) fn parse(mut reader: Reader<'_>, is_authenticated: bool) -> Result<Self, FrameError> {
        let superframe = reader.u16()?;
        let [term, age, hops] = reader.take()?;
        let coordinator = reader.u16()?;
        let slot_and_countdown = reader.u8()?;
        let slot_owners = reader.take()?;
        let passed_on: [u8; 3] = reader.take()?;
        let heard = reader.u16()?;
        let version = reader.u8()?;
        let layout: [u8; 2] = reader.take()?;
        let position = Position::parse(reader.take()?)?;
        let [count, leased, entries] = reader.take()?;
        let (session, polls_passed_on) = if is_authenticated {
            (Some(Session::parse(&mut reader, entries & ANSWERS != 0)?), entries & 0x0F & !ANSWERS)
        } else {
            (None, entries & 0x0F)
        };
        let has_relay_slots = leased & HAS_RELAY_SLOTS != 0;
        let relay = match (count & RELAYS) >> RELAYS_SHIFT {
            0 => None,
            entries => Some(Relay::parse(&mut reader, entries - 1, has_relay_slots)?),
        };
        let neighbour = if leased & HAS_NEIGHBOUR == 0 { None } else { Some(AnchorAt::parse(&mut reader)?) };
        let (request, wish, wishes_relay_slots) = if count & PASSES_REQUEST_ON == 0 {
            let [answer, tag, relay_slots @ (0 | WISHES_RELAY_SLOTS)] = passed_on else {
                return Err(FrameError::Field);
            };
            (None, Layout::from_bytes([answer, tag]), relay_slots != 0)
        } else {
            (Some(Member::parse(&mut Reader(&passed_on))?), Layout::LEAST, false)
        };
        let mut members = Vec::new();
        for _ in 0..count & MEMBERS {
            let member = Member::parse(&mut reader)?;
            if member.share.leased().is_some() {
                return Err(FrameError::Field);
            }
            members.push(member).map_err(|_| FrameError::Field)?;
        }
        let (mut leases, mut polls) = (Vec::new(), Vec::new());
        for _ in 0..entries >> 4 {
            leases.push(Lease::parse(&mut reader)?).map_err(|_| FrameError::Field)?;
        }
        for _ in 0..polls_passed_on {
            polls.push(LeasedPoll::parse(&mut reader)?).map_err(|_| FrameError::Field)?;
        }
        reader.end()?;
        // In the order of addresses, each once: all nodes make the same plan from it.
        if !members.is_sorted_by(|a: &Member, b| a.tag < b.tag) {
            return Err(FrameError::Field);
        }
        Ok(Self {
            session,
            superframe,
            term,
            age,
            hops,
            coordinator,
            slot: slot_and_countdown & SLOT,
            slot_owners,
            request,
            wish,
            wishes_relay_slots,
            heard,
            version,
            countdown: slot_and_countdown >> COUNTDOWN_SHIFT,
            layout: Layout::from_bytes(layout),
            layout_is_new: layout[0] & LAYOUT_IS_NEW != 0,
            position,
            leased: leased & LEASED,
            has_relay_slots,
            relay,
            neighbour,
            members,
            leases,
            polls,
        })
    }

    /// Bytes that are left.
    pub fn room(&self) -> usize {
        let session = self.session.map_or(0, |session| session.bytes());
        let relay = self.relay.as_ref().map_or(0, |relay| relay.bytes(self.has_relay_slots));
        let news = Lease::BYTES * self.leases.len() + LeasedPoll::BYTES * self.polls.len();
        let neighbour = if self.neighbour.is_some() { AnchorAt::BYTES } else { 0 };
        let used = session + relay + neighbour + Member::BYTES * self.members.len() + news;
        usize::from(SYNC_FRAME_BYTES - SHORTEST_SYNC_FRAME_BYTES).saturating_sub(used)
    }

    /// How many further leases fit, and how many polls if no lease is added.
    pub fn room_for_news(&self) -> (usize, usize) {
        let room = self.room();
        let leases = (room / Lease::BYTES).min(MAX_LEASES - self.leases.len());
        (leases, (room / LeasedPoll::BYTES).min(MAX_POLLS - self.polls.len()))
    }

    #[inline]
    pub(super) fn emit(&self, out: &mut FrameBuffer) {
        out.put(&[SYNC]);
        out.put(&self.superframe.to_le_bytes());
        out.put(&[self.term, self.age, self.hops]);
        out.put(&self.coordinator.to_le_bytes());
        out.put(&[self.slot & SLOT | self.countdown << COUNTDOWN_SHIFT]);
        out.put(&self.slot_owners);
        let passes_request_on = match self.request {
            Some(request) => {
                request.emit(out);
                PASSES_REQUEST_ON
            }
            None => {
                let [answer, tag] = self.wish.bytes();
                out.put(&[answer, tag, if self.wishes_relay_slots { WISHES_RELAY_SLOTS } else { 0 }]);
                0
            }
        };
        out.put(&self.heard.to_le_bytes());
        out.put(&[self.version]);
        let [answer, tag] = self.layout.bytes();
        out.put(&[if self.layout_is_new { answer | LAYOUT_IS_NEW } else { answer }, tag]);
        out.put(&Position::bytes(self.position));
        let answers = self.session.is_some_and(|session| session.answer.is_some());
        let entries = (self.leases.len() as u8) << 4 | self.polls.len() as u8 | if answers { ANSWERS } else { 0 };
        let relays = self.relay.as_ref().map_or(0, |relay| relay.entries.len() as u8 + 1);
        let count = self.members.len() as u8 | relays << RELAYS_SHIFT | passes_request_on;
        let has_neighbour = if self.neighbour.is_some() { HAS_NEIGHBOUR } else { 0 };
        let has_relay_slots = if self.has_relay_slots { HAS_RELAY_SLOTS } else { 0 };
        out.put(&[count, self.leased.min(LEASED) | has_neighbour | has_relay_slots, entries]);
        if let Some(Session { number, epoch, answer }) = self.session {
            out.put(&number.to_le_bytes());
            out.put(&epoch.to_le_bytes());
            answer.into_iter().for_each(|answer| out.put(&answer.to_le_bytes()));
        }
        if let Some(relay) = &self.relay {
            relay.emit(out, self.has_relay_slots);
        }
        self.neighbour.iter().for_each(|neighbour| neighbour.emit(out));
        self.members.iter().for_each(|member| member.emit(out));
        self.leases.iter().for_each(|lease| lease.emit(out));
        self.polls.iter().for_each(|poll| poll.emit(out));
    }
}

impl Session {
    #[inline]
    fn parse(reader: &mut Reader<'_>, answers: bool) -> Result<Self, FrameError> {
        let (number, epoch) = (reader.u32()?, reader.u16()?);
        Ok(Self { number, epoch, answer: if answers { Some(reader.u32()?) } else { None } })
    }

    const fn bytes(self) -> usize {
        SESSION_BYTES + if self.answer.is_some() { ANSWER_BYTES } else { 0 }
    }
}

impl AnchorAt {
    /// Its length on the air.
    pub const BYTES: usize = 11;

    #[inline]
    fn parse(reader: &mut Reader<'_>) -> Result<Self, FrameError> {
        let (address, position) = (reader.u16()?, Position::parse(reader.take()?)?);
        Ok(Self { address, position: position.ok_or(FrameError::Field)? })
    }

    #[inline]
    fn emit(&self, out: &mut FrameBuffer) {
        out.put(&self.address.to_le_bytes());
        out.put(&Position::bytes(Some(self.position)));
    }
}

impl Member {
    /// Its length on the air.
    const BYTES: usize = 3;

    #[inline]
    fn parse(reader: &mut Reader<'_>) -> Result<Self, FrameError> {
        Ok(Self { tag: reader.u16()?, share: Share::parse(reader.u8()?)? })
    }

    #[inline]
    fn emit(&self, out: &mut FrameBuffer) {
        out.put(&self.tag.to_le_bytes());
        out.put(&[self.share.byte()]);
    }
}
