//! Frames of native mode. All are data frames with 16-bit addresses; the first byte of the payload is the message's code.
//!
//! | message | code | payload after the code |
//! |---|---|---|
//! | poll, tag → all | 30 | round (2), number of anchors (high nibble) and options (1), anchors in slot order (2 each); with option 1, the last distance to each (2 each) |
//! | response, anchor → tag | 31 | round (2), poll RX (5), response TX − poll RX (4) |
//! | beacon, anchor → all | 32 | superframe (2), term (1), age (1), hops (1), coordinator (2), slot (1), slot owners (16), request (3), heard (3), version (1), countdown (1), position (9), number of members (1), members (3 each) |
//! | request, tag → all | 33 | share (1) |
//!
//! Times are in ticks. A distance is in units of 4 mm, signed; 0x8000 is unknown. A position is three times 24 bits,
//! millimetres, signed; (−2²³, 0, 0) is unknown.

mod values;

use heapless::Vec;

use super::{Address, BROADCAST, FrameBuffer, Header, Reader};
use crate::native::MAX_ROUND;
use crate::{RadioDuration, RadioInstant};

pub use values::{Distance, Position, Share};

/// Beacon slots of a superframe that an anchor can own.
pub const OWNED_BEACON_SLOTS: usize = 16;
/// The most tags of a network: as many as a beacon can list.
pub const MAX_MEMBERS: usize = 24;

// Codes that no protocol above 802.15.4 begins its payload with: an analyser takes them for data and for nothing else.
const POLL: u8 = 0x30;
const RESPONSE: u8 = 0x31;
const BEACON: u8 = 0x32;
const REQUEST: u8 = 0x33;

/// Option of a poll.
const WITH_DISTANCES: u8 = 1;

/// A native frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Sequence number.
    pub sequence: u8,
    /// The network.
    pub pan: u16,
    /// To whom: 0xFFFF is everyone.
    pub destination: u16,
    /// From whom.
    pub source: u16,
    /// What is said.
    pub message: Message,
}

/// What is said.
#[derive(Clone, Debug, PartialEq)]
#[allow(
    clippy::large_enum_variant,
    reason = "a message lives on the stack for one step; there is no heap to put it on"
)]
pub enum Message {
    /// A tag asks anchors to answer.
    Poll(Poll),
    /// An anchor answers.
    Response(Response),
    /// An anchor keeps the network together.
    Beacon(Beacon),
    /// A tag asks for slots.
    Request(Share),
}

/// A tag asks anchors to answer, each in its slot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Poll {
    /// Number of the round: answers repeat it.
    pub round: u16,
    /// Who is to answer, in the order of the slots.
    pub anchors: Vec<Asked, MAX_ROUND>,
}

/// An anchor that a poll names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Asked {
    /// Its short address.
    pub address: u16,
    /// How far it is: a tag's last distance, for anchors that want to know, or an anchor's mean, for tags that listen. A poll carries
    /// all or none.
    pub distance: Distance,
}

/// An anchor's answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Response {
    /// Number of the poll's round.
    pub round: u16,
    /// When the poll came, in the anchor's clock.
    pub poll_rx: RadioInstant,
    /// From the poll's arrival to this frame's departure, in the anchor's clock: below 67 ms.
    pub reply: RadioDuration,
}

/// An anchor's view of the network.
#[derive(Clone, Debug, PartialEq)]
pub struct Beacon {
    /// Number of the superframe.
    pub superframe: u16,
    /// Counts changes of coordinator: the higher term (across a wrap) is right.
    pub term: u8,
    /// Superframes since what is told here left the coordinator.
    pub age: u8,
    /// Hops to the coordinator; 0 is the coordinator itself.
    pub hops: u8,
    /// Who coordinates.
    pub coordinator: u16,
    /// The beacon slot in which this frame is sent.
    pub slot: u8,
    /// Who owns the beacon slots, as far as the sender hears: a byte of the address's hash each, 0 is nobody.
    pub slot_owners: [u8; OWNED_BEACON_SLOTS],
    /// A tag's request on its way to the coordinator.
    pub request: Option<Member>,
    /// Members (bit i: the list's i-th) of whom a poll was heard here or farther from the coordinator.
    pub heard: u32,
    /// Number of the list of members.
    pub version: u8,
    /// Superframes, from this one, until the list counts; until then the list before does.
    pub countdown: u8,
    /// Where the sender stands.
    pub position: Option<Position>,
    /// The tags of the network, by address.
    pub members: Vec<Member, MAX_MEMBERS>,
}

/// A tag in the network's list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Member {
    /// Short address of the tag.
    pub tag: u16,
    /// How many slots it has asked for.
    pub share: Share,
}

impl Frame {
    /// The frame of bytes from the air.
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let (header, payload) = Header::parse(bytes)?;
        let (Address::Short(destination), Address::Short(source)) = (header.destination, header.source) else {
            return None;
        };
        let mut reader = Reader(payload);
        let message = match reader.u8()? {
            POLL => Message::Poll(Poll::parse(reader)?),
            RESPONSE => Message::Response(Response::parse(reader)?),
            BEACON => Message::Beacon(Beacon::parse(reader)?),
            REQUEST => {
                let share = Share::parse(reader.u8()?)?;
                reader.end()?;
                Message::Request(share)
            }
            _ => return None,
        };
        (source != BROADCAST).then_some(Self {
            sequence: header.sequence,
            pan: header.pan,
            destination,
            source,
            message,
        })
    }

    /// The bytes of the frame, in place of what `out` held.
    pub fn emit(&self, out: &mut FrameBuffer) {
        out.clear();
        let [destination, source] = [self.destination, self.source].map(Address::Short);
        Header { sequence: self.sequence, pan: self.pan, destination, source }.emit(out);
        match &self.message {
            Message::Poll(poll) => poll.emit(out),
            Message::Response(response) => response.emit(out),
            Message::Beacon(beacon) => beacon.emit(out),
            Message::Request(share) => out.put(&[REQUEST, share.byte()]),
        }
    }
}

/// Bytes of header and code.
const HEAD: u16 = 10;
/// Bytes of the longest poll on the air, its check bytes counted: eight anchors with distances.
pub const POLL_BYTES: u16 = HEAD + 3 + 4 * MAX_ROUND as u16 + 2;
/// Bytes of a response on the air, its check bytes counted.
pub const RESPONSE_BYTES: u16 = HEAD + 11 + 2;
/// Bytes of a request on the air, its check bytes counted.
pub const REQUEST_BYTES: u16 = HEAD + 1 + 2;
/// Bytes of the longest beacon on the air, its check bytes counted.
pub const BEACON_BYTES: u16 = HEAD + 42 + 3 * MAX_MEMBERS as u16 + 2;

impl Poll {
    /// After the code.
    fn parse(mut reader: Reader<'_>) -> Option<Self> {
        let round = reader.u16()?;
        let [count, options] = reader.u8().map(|byte| [byte >> 4, byte & 0x0F])?;
        let with_distances = match options {
            0 => false,
            WITH_DISTANCES => true,
            _ => return None,
        };
        let mut anchors = Vec::new();
        for _ in 0..count {
            anchors.push(Asked { address: reader.u16()?, distance: Distance::Unsent }).ok()?;
        }
        if with_distances {
            for asked in &mut anchors {
                asked.distance = match reader.u16()? as i16 {
                    i16::MIN => Distance::Unknown,
                    units => Distance::Quarters(units),
                };
            }
        }
        reader.end()?;
        (!anchors.is_empty()).then_some(Self { round, anchors })
    }

    fn emit(&self, out: &mut FrameBuffer) {
        let with_distances = self.anchors.iter().any(|asked| asked.distance != Distance::Unsent);
        let options = if with_distances { WITH_DISTANCES } else { 0 };
        out.put(&[POLL]);
        out.put(&self.round.to_le_bytes());
        out.put(&[(self.anchors.len() as u8) << 4 | options]);
        for asked in &self.anchors {
            out.put(&asked.address.to_le_bytes());
        }
        for asked in self.anchors.iter().filter(|_| with_distances) {
            let units = match asked.distance {
                Distance::Unsent | Distance::Unknown => i16::MIN,
                Distance::Quarters(units) => units,
            };
            out.put(&units.to_le_bytes());
        }
    }
}

impl Response {
    fn parse(mut reader: Reader<'_>) -> Option<Self> {
        let round = reader.u16()?;
        let poll_rx = RadioInstant::from_le_bytes(reader.take()?);
        let reply = RadioDuration::from_ticks(reader.u32()?.into());
        reader.end()?;
        Some(Self { round, poll_rx, reply })
    }

    fn emit(&self, out: &mut FrameBuffer) {
        out.put(&[RESPONSE]);
        out.put(&self.round.to_le_bytes());
        out.put(&self.poll_rx.to_le_bytes());
        out.put(&(self.reply.ticks() as u32).to_le_bytes());
    }
}

impl Beacon {
    fn parse(mut reader: Reader<'_>) -> Option<Self> {
        let superframe = reader.u16()?;
        let [term, age, hops] = reader.take()?;
        let coordinator = reader.u16()?;
        let slot = reader.u8()?;
        let slot_owners = reader.take()?;
        let request = match Member::parse(&mut reader)? {
            Member { tag: BROADCAST, share: Share::Release } => None,
            Member { tag: BROADCAST, .. } => return None,
            member => Some(member),
        };
        let [a, b, c, version, countdown] = reader.take()?;
        let heard = u32::from_le_bytes([a, b, c, 0]);
        let position = Position::parse(reader.take()?)?;
        let mut members = Vec::new();
        for _ in 0..reader.u8()? {
            members.push(Member::parse(&mut reader)?).ok()?;
        }
        reader.end()?;
        // In the order of addresses, each once: all nodes make the same plan of it.
        members.is_sorted_by(|a: &Member, b| a.tag < b.tag).then_some(Self {
            superframe,
            term,
            age,
            hops,
            coordinator,
            slot,
            slot_owners,
            request,
            heard,
            version,
            countdown,
            position,
            members,
        })
    }

    fn emit(&self, out: &mut FrameBuffer) {
        out.put(&[BEACON]);
        out.put(&self.superframe.to_le_bytes());
        out.put(&[self.term, self.age, self.hops]);
        out.put(&self.coordinator.to_le_bytes());
        out.put(&[self.slot]);
        out.put(&self.slot_owners);
        self.request.unwrap_or(Member { tag: BROADCAST, share: Share::Release }).emit(out);
        let [a, b, c, _] = self.heard.to_le_bytes();
        out.put(&[a, b, c, self.version, self.countdown]);
        out.put(&Position::bytes(self.position));
        out.put(&[self.members.len() as u8]);
        for member in &self.members {
            member.emit(out);
        }
    }
}

impl Member {
    fn parse(reader: &mut Reader<'_>) -> Option<Self> {
        Some(Self { tag: reader.u16()?, share: Share::parse(reader.u8()?)? })
    }

    fn emit(&self, out: &mut FrameBuffer) {
        out.put(&self.tag.to_le_bytes());
        out.put(&[self.share.byte()]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::MAX_FRAME;

    fn round_trip(message: Message, golden: &[u8]) {
        let frame = Frame { sequence: 0x2A, pan: 0xBA1A, destination: BROADCAST, source: 0x0107, message };
        let mut out = FrameBuffer::new();
        frame.emit(&mut out);
        let mut bytes = std::vec![0x41, 0x88, 0x2A, 0x1A, 0xBA, 0xFF, 0xFF, 0x07, 0x01];
        bytes.extend_from_slice(golden);
        assert_eq!(out.bytes(), bytes);
        assert_eq!(Frame::parse(&bytes), Some(frame));
        bytes.push(0);
        assert_eq!(Frame::parse(&bytes), None, "a byte too many");
        for cut in 0..bytes.len() - 1 {
            assert_eq!(Frame::parse(&bytes[..cut]), None, "cut to {cut}");
        }
    }

    #[test]
    fn golden_poll() {
        let asked = |address| Asked { address, distance: Distance::Unsent };
        let poll = Poll { round: 0x1234, anchors: [asked(1), asked(0x0203)].into_iter().collect() };
        round_trip(Message::Poll(poll), &[0x30, 0x34, 0x12, 0x20, 1, 0, 3, 2]);
    }

    #[test]
    fn golden_poll_with_distances() {
        // 3.2 m are 800 units of 4 mm, 0x0320; −0.1 m are −25, 0xFFE7.
        let anchors = [(1, Distance::from_metres(3.2)), (2, Distance::Unknown), (3, Distance::from_metres(-0.1))];
        let anchors = anchors.into_iter().map(|(address, distance)| Asked { address, distance }).collect();
        let poll = Poll { round: 1, anchors };
        round_trip(Message::Poll(poll), &[0x30, 1, 0, 0x31, 1, 0, 2, 0, 3, 0, 0x20, 0x03, 0x00, 0x80, 0xE7, 0xFF]);
    }

    #[test]
    fn golden_response() {
        let response = Response {
            round: 0xFFFE,
            poll_rx: RadioInstant::from_ticks(0xFF_0102_0304),
            reply: RadioDuration::from_ticks(0x0123_4567),
        };
        let golden = [0x31, 0xFE, 0xFF, 4, 3, 2, 1, 0xFF, 0x67, 0x45, 0x23, 0x01];
        round_trip(Message::Response(response), &golden);
        assert_eq!(usize::from(RESPONSE_BYTES), 9 + golden.len() + 2);
    }

    #[test]
    fn golden_requests() {
        round_trip(Message::Request(Share::Release), &[0x33, 0]);
        round_trip(Message::Request(Share::Slots(2)), &[0x33, 2]);
        round_trip(Message::Request(Share::Greedy), &[0x33, 127]);
        round_trip(Message::Request(Share::OneIn(10)), &[0x33, 0x8A]);
    }

    fn beacon(members: usize) -> Beacon {
        Beacon {
            superframe: 0x0102,
            term: 3,
            age: 4,
            hops: 5,
            coordinator: 0x0607,
            slot: 8,
            slot_owners: core::array::from_fn(|i| i as u8 + 0x10),
            request: None,
            heard: 0x0A0B0C,
            version: 9,
            countdown: 7,
            position: Position::from_metres([1.0, -0.001, 8.388]),
            members: (0..members as u16).map(|tag| Member { tag: 0x0400 + tag, share: Share::Greedy }).collect(),
        }
    }

    #[test]
    fn golden_beacon() {
        // 1000 = 0x0003E8, −1 = 0xFFFFFF, 8388 = 0x0020C4.
        let mut golden = std::vec![0x32, 2, 1, 3, 4, 5, 7, 6, 8];
        golden.extend(0x10..0x20);
        golden.extend([0xFF, 0xFF, 0, 0x0C, 0x0B, 0x0A, 9, 7, 0xE8, 3, 0, 0xFF, 0xFF, 0xFF, 0xC4, 0x20, 0]);
        golden.extend([2, 0x00, 0x04, 127, 0x01, 0x04, 127]);
        round_trip(Message::Beacon(beacon(2)), &golden);
    }

    #[test]
    fn the_longest_frames_fit() {
        let mut out = FrameBuffer::new();
        let mut length = |message| {
            Frame { sequence: 0, pan: 0, destination: BROADCAST, source: 0, message }.emit(&mut out);
            out.bytes().len()
        };
        let longest = length(Message::Beacon(beacon(MAX_MEMBERS)));
        assert_eq!((longest, longest + 2), (MAX_FRAME - 1, usize::from(BEACON_BYTES)));
        let asked = Asked { address: 1, distance: Distance::Unknown };
        let poll = Poll { round: 0, anchors: core::iter::repeat_n(asked, MAX_ROUND).collect() };
        assert_eq!(length(Message::Poll(poll)) + 2, usize::from(POLL_BYTES));
    }

    #[test]
    fn members_out_of_order_or_twice_are_refused() {
        let mut out = FrameBuffer::new();
        let mut jumbled = beacon(2);
        jumbled.members[1].tag = jumbled.members[0].tag;
        let message = Message::Beacon(jumbled);
        Frame { sequence: 0, pan: 0, destination: BROADCAST, source: 0, message }.emit(&mut out);
        assert_eq!(Frame::parse(out.bytes()), None);
    }
}
