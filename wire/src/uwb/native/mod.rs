//! Frames of native mode. All are data frames with 16-bit addresses. The first byte of the payload is the message's
//! code. `docs/reference/wire-format.md` has the bytes of each message, with the examples that the tests here have.

mod downlink;
mod integrity;
mod lease;
mod poll;
mod relay;
mod sync_frame;
mod table_aes;
mod user_data;
mod values;

use super::MAX_ROUND;
use super::layout::Layout;
use super::{Address, BROADCAST, FrameBuffer, FrameError, Header, Reader};
use integrity::AUTHENTICATED;
use radio::{RadioDuration, RadioInstant};

pub use downlink::{Answer, Downlink, TagCommand};
pub use integrity::{CODE_BYTES, IntegrityCode, MakeCode, Nonce, integrity_code, software_code, split_code};
pub use lease::{Confirmation, Grant, Lease, LeasedPoll, MAX_BLINKS, Period, Turn, Turns};
pub use poll::{Asked, Poll};
pub use relay::{Carried, MAX_IN_RELAY_FRAME, MAX_RELAYED, Relay, RelayFrame, Relayed};
pub use sync_frame::{AnchorAt, Member, Session, SyncFrame, slot_of};
pub use user_data::UserData;
pub use values::{Distance, PolledPosition, Position, Share};

/// Sync slots of a superframe that an anchor can own.
pub const OWNED_SYNC_SLOTS: usize = 16;
/// The most tags that range more than once a superframe: as many as a sync frame lists.
pub const MAX_MEMBERS: usize = 16;
/// The most leases in a sync frame.
pub const MAX_LEASES: usize = 10;
/// The most polls that a sync frame passes on.
pub const MAX_POLLS: usize = 6;

// No protocol above 802.15.4 begins its payload with these codes: an analyser shows them as data and as nothing else.
const POLL: u8 = 0x30;
const RESPONSE: u8 = 0x31;
const SYNC: u8 = 0x32;
const REQUEST: u8 = 0x33;
const FINAL: u8 = 0x34;
const CHALLENGE: u8 = 0x35;
const RELAY: u8 = 0x36;

/// A native frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Sequence number.
    pub sequence: u8,
    /// The PAN identifier of the network.
    pub pan: u16,
    /// The address of the receiver; 0xFFFF means all nodes.
    pub destination: u16,
    /// The address of the sender.
    pub source: u16,
    /// The message.
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
    /// An anchor sends the network's time, coordinator and members.
    SyncFrame(SyncFrame),
    /// A tag requests slots.
    Request(Request),
    /// A tag ends a double-sided round.
    Final {
        /// Number of the round.
        round: u16,
    },
    /// An anchor asks whether a session is a present one.
    Challenge(Challenge),
    /// An anchor passes on what tags told, to one other anchor.
    RelayFrame(RelayFrame),
}

/// An anchor asks an anchor of a session to repeat a number, which a recorded network does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Challenge {
    /// The session.
    pub session: u32,
    /// A number that nobody can foresee.
    pub number: u32,
}

/// A tag requests slots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// The requested share.
    pub share: Share,
    /// The tag's request for the network's layout.
    pub wish: Layout,
}

/// An anchor's answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Response {
    /// Low byte of the number of the poll's round.
    pub round: u8,
    /// What the anchor knows of the lease of the poll's turn.
    pub lease: Confirmation,
    /// A message to the tag waits here: the anchor's next sync frames carry it.
    pub has_message: bool,
    /// The poll names this anchor first, and this anchor cannot pass on what the poll carries.
    pub passes_nothing_on: bool,
    /// Arrival of the poll, in the anchor's clock.
    pub poll_rx: RadioInstant,
    /// From the poll's arrival to this frame's departure, in the anchor's clock: below 67 ms.
    pub reply: RadioDuration,
    /// The last final of this tag that the anchor received.
    pub last_final: Option<FinalReceived>,
}

/// When an anchor received a final.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FinalReceived {
    /// Low byte of the number of the final's round.
    pub round: u8,
    /// From the departure of the anchor's response in that round to the arrival of the final, in the anchor's clock:
    /// below 67 ms.
    pub after_response: RadioDuration,
}

impl Frame {
    /// Parses a frame.
    ///
    /// # Errors
    /// The first error found.
    #[inline]
    pub fn parse(bytes: &[u8]) -> Result<Self, FrameError> {
        let (header, payload) = Header::parse(bytes)?;
        let (Address::Short(destination), Address::Short(source)) = (header.destination, header.source) else {
            return Err(FrameError::Header);
        };
        if source == BROADCAST {
            return Err(FrameError::Header);
        }
        let mut reader = Reader(payload);
        let code = reader.u8()?;
        let is_authenticated = code & AUTHENTICATED != 0;
        if is_authenticated {
            let (message, _) = reader.0.split_last_chunk::<CODE_BYTES>().ok_or(FrameError::Truncated)?;
            reader = Reader(message);
        }
        let message = match code & !AUTHENTICATED {
            POLL => Message::Poll(Poll::parse(reader)?),
            RESPONSE => Message::Response(Response::parse(reader)?),
            SYNC => Message::SyncFrame(SyncFrame::parse(reader, is_authenticated)?),
            REQUEST => {
                let share = Share::parse(reader.u8()?)?;
                let wish = Layout::from_tag_byte(reader.u8()?);
                reader.end()?;
                Message::Request(Request { share, wish })
            }
            FINAL => {
                let round = reader.u16()?;
                reader.end()?;
                Message::Final { round }
            }
            CHALLENGE if is_authenticated => {
                let challenge = Challenge { session: reader.u32()?, number: reader.u32()? };
                reader.end()?;
                Message::Challenge(challenge)
            }
            RELAY => Message::RelayFrame(RelayFrame::parse(reader)?),
            _ => return Err(FrameError::Code(code)),
        };
        Ok(Self { sequence: header.sequence, pan: header.pan, destination, source, message })
    }

    /// Writes the frame, in place of what `out` held, without an integrity code ([`FrameBuffer::authenticate`]).
    #[inline]
    pub fn emit(&self, out: &mut FrameBuffer) {
        let [destination, source] = [self.destination, self.source].map(Address::Short);
        self.message.emit(&Header { sequence: self.sequence, pan: self.pan, destination, source }, out);
    }
}

impl Message {
    /// Writes a frame with this header, as [`Frame::emit`] does. A message takes hundreds of bytes: it is not moved.
    #[inline]
    pub fn emit(&self, header: &Header, out: &mut FrameBuffer) {
        out.clear();
        header.emit(out);
        match self {
            Message::Poll(poll) => poll.emit(out),
            Message::Response(response) => response.emit(out),
            Message::SyncFrame(sync_frame) => sync_frame.emit(out),
            Message::RelayFrame(frame) => frame.emit(out),
            Message::Request(Request { share, wish }) => out.put(&[REQUEST, share.byte(), wish.tag_byte()]),
            Message::Final { round } => {
                let [low, high] = round.to_le_bytes();
                out.put(&[FINAL, low, high]);
            }
            Message::Challenge(Challenge { session, number }) => {
                out.put(&[CHALLENGE]);
                out.put(&session.to_le_bytes());
                out.put(&number.to_le_bytes());
            }
        }
    }
}

/// Bytes of header and code.
const HEAD: u16 = 10;
/// Bytes of the longest poll on the air, including its check bytes: eight anchors with distances.
pub const POLL_BYTES: u16 = HEAD + 4 + 4 * MAX_ROUND as u16 + 2;
// What data adds to a poll is three bytes more than a response. They take less time than the response's preamble: so all
// takes less than the time from one response to the next.
const _: () = assert!(UserData::LONGEST <= RESPONSE_BYTES + 3);
/// Bytes of a response on the air, including its check bytes.
pub const RESPONSE_BYTES: u16 = HEAD + 11 + 2;
/// The same for a response that reports a final.
pub const LONG_RESPONSE_BYTES: u16 = RESPONSE_BYTES + 5;
/// Bytes of a final on the air, including its check bytes.
pub const FINAL_BYTES: u16 = HEAD + 2 + 2;
/// Bytes of a request on the air, including its check bytes.
pub const REQUEST_BYTES: u16 = HEAD + 2 + 2;
/// Bytes of a challenge on the air, including its check bytes and its integrity code.
pub const CHALLENGE_BYTES: u16 = HEAD + 8 + CODE_BYTES as u16 + 2;
/// Bytes of the longest relay frame on the air, including its check bytes.
pub const RELAY_FRAME_BYTES: u16 = HEAD + (MAX_IN_RELAY_FRAME * Relayed::POSITION_BYTES) as u16 + 2;
/// Bytes of a sync frame without session, members, leases and polls on the air, including its check bytes.
const SHORTEST_SYNC_FRAME_BYTES: u16 = HEAD + 44 + 2;
/// Bytes of the longest sync frame on the air, including its check bytes. An integrity code still fits into a frame.
pub const SYNC_FRAME_BYTES: u16 = 119;
/// In the byte of the confirmation.
const HAS_MESSAGE: u8 = 0x80;
const PASSES_NOTHING_ON: u8 = 0x40;

impl Response {
    #[inline]
    fn parse(mut reader: Reader<'_>) -> Result<Self, FrameError> {
        let [round, lease] = reader.take()?;
        let (has_message, passes_nothing_on) = (lease & HAS_MESSAGE != 0, lease & PASSES_NOTHING_ON != 0);
        let lease = Confirmation::from_code(lease & !(HAS_MESSAGE | PASSES_NOTHING_ON))?;
        let poll_rx = RadioInstant::from_le_bytes(reader.take()?);
        let reply = RadioDuration::from_ticks(reader.u32()?.into());
        let last_final = match reader.u8() {
            Err(_) => None,
            Ok(round) => Some(FinalReceived { round, after_response: RadioDuration::from_ticks(reader.u32()?.into()) }),
        };
        reader.end()?;
        Ok(Self { round, lease, has_message, passes_nothing_on, poll_rx, reply, last_final })
    }

    #[inline]
    fn emit(&self, out: &mut FrameBuffer) {
        let marks = (u8::from(self.has_message) * HAS_MESSAGE) | (u8::from(self.passes_nothing_on) * PASSES_NOTHING_ON);
        out.put(&[RESPONSE, self.round, self.lease as u8 | marks]);
        out.put(&self.poll_rx.to_le_bytes());
        out.put(&(self.reply.ticks() as u32).to_le_bytes());
        if let Some(FinalReceived { round, after_response }) = self.last_final {
            out.put(&[round]);
            out.put(&(after_response.ticks() as u32).to_le_bytes());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use heapless::Vec;
    use radio::MAX_FRAME;

    fn round_trip(message: Message, golden: &[u8]) {
        let frame = Frame { sequence: 0x2A, pan: 0xBA1A, destination: BROADCAST, source: 0x0107, message };
        let mut out = FrameBuffer::new();
        frame.emit(&mut out);
        let mut bytes = std::vec![0x41, 0x88, 0x2A, 0x1A, 0xBA, 0xFF, 0xFF, 0x07, 0x01];
        bytes.extend_from_slice(golden);
        assert_eq!(out.bytes(), bytes);
        assert_eq!(Frame::parse(&bytes), Ok(frame));
        bytes.push(0);
        assert_eq!(Frame::parse(&bytes), Err(FrameError::TooLong(1)), "a byte too many");
        for cut in 0..bytes.len() - 1 {
            assert_eq!(Frame::parse(&bytes[..cut]), Err(FrameError::Truncated), "cut to {cut}");
        }
    }

    #[test]
    fn golden_poll() {
        let asked = |address| Asked { address, distance: Distance::Unsent };
        // (16 + 8) · 2² = 96 µs: code 0x28; with a final 0xA8.
        let wish = Layout::from_tag_byte(0xA8);
        assert_eq!(wish.listen_again.duration(), RadioDuration::from_micros(96));
        let poll = Poll {
            round: 0x1234,
            wish,
            anchors: [asked(1), asked(0x0203)].into_iter().collect(),
            position: None,
            data: None,
            part: None,
        };
        round_trip(Message::Poll(poll), &[0x30, 0x34, 0x12, 0x20, 0xA8, 1, 0, 3, 2]);
    }

    #[test]
    fn golden_poll_with_distances() {
        // 3.2 m are 800 units of 4 mm, 0x0320; −0.1 m are −25, 0xFFE7.
        let anchors = [(1, Distance::from_metres(3.2)), (2, Distance::Unknown), (3, Distance::from_metres(-0.1))];
        let anchors = anchors.into_iter().map(|(address, distance)| Asked { address, distance }).collect();
        let poll = Poll { round: 1, wish: Layout::LEAST, anchors, position: None, data: None, part: None };
        round_trip(Message::Poll(poll), &[0x30, 1, 0, 0x31, 0, 1, 0, 2, 0, 3, 0, 0x20, 0x03, 0x00, 0x80, 0xE7, 0xFF]);
    }

    /// At (1, −0.001, 8.388) m of a given height, ± 0.1 m and ± 1 m, correlated by a half, three rounds ago, suspect.
    fn a_position() -> PolledPosition {
        let covariance_m2 = [[0.01, 0.05, 0.0], [0.05, 1.0, 0.0], [0.0; 3]];
        PolledPosition::new([1.0, -0.001, 8.388], covariance_m2, true).unwrap().of_rounds_ago(3)
    }

    #[test]
    fn golden_poll_with_a_position() {
        let anchors = [Asked { address: 1, distance: Distance::Unsent }].into_iter().collect();
        let poll =
            Poll { round: 1, wish: Layout::LEAST, anchors, position: Some(a_position()), data: None, part: None };
        // 100 = (16 + 9) · 2⁶ / 16 mm: 9 + 6 · 16 = 0x69; 1024 = 16 · 2¹⁰ / 16 is the next after 992: 0xA0.
        // The half is 63.5/127, away from zero 64. 0x83 = 3 rounds ago and suspect.
        let golden =
            [0x30, 1, 0, 0x12, 0, 1, 0, 0xE8, 3, 0, 0xFF, 0xFF, 0xFF, 0xC4, 0x20, 0, 0x69, 0xA0, 0, 64, 0, 0, 0x83];
        round_trip(Message::Poll(poll.clone()), &golden);
        let data = UserData::new(0xFE, b"door 3");
        let mut with_data = golden.to_vec();
        with_data[3] = 0x16;
        with_data.extend([0xFE, 6, 0x64, 0x6F, 0x6F, 0x72, 0x20, 0x33]);
        round_trip(Message::Poll(Poll { data, ..poll }), &with_data);
    }

    #[test]
    fn golden_blinks() {
        let wish = Layout::from_tag_byte(0xA8);
        let blink =
            |part| Poll { round: 0x1234, wish, anchors: Vec::new(), position: None, data: None, part: Some(part) };
        // Nobody is asked: 0, blink: 8.
        round_trip(Message::Poll(blink(7)), &[0x30, 0x34, 0x12, 0x08, 0xA8, 7]);
        let anchors: Vec<_, _> = [Asked { address: 0x0203, distance: Distance::Unsent }].into_iter().collect();
        let asking = Poll { anchors: anchors.clone(), ..blink(3) };
        // The third of the blinks is answered five places of responses later than a round's poll would be: in the eighth.
        assert_eq!([1, 3, 7].map(|part| Poll { part: Some(part), ..asking.clone() }.first_slot()), [7, 5, 1]);
        round_trip(Message::Poll(asking.clone()), &[0x30, 0x34, 0x12, 0x18, 0xA8, 3, 3, 2]);
        let data = UserData::new(0xFE, b"door 3");
        let golden = [0x30, 0x34, 0x12, 0x0C, 0xA8, 1, 0xFE, 6, 0x64, 0x6F, 0x6F, 0x72, 0x20, 0x33];
        round_trip(Message::Poll(Poll { data, ..blink(1) }), &golden);
        // A part that there is not, two anchors, or what belongs to rounds.
        let mut out = FrameBuffer::new();
        for (part, asked) in [(0, 0), (8, 0), (1, 2)] {
            let anchors = core::iter::repeat_n(anchors[0], asked).collect();
            let message = Message::Poll(Poll { anchors, ..blink(part) });
            Frame { sequence: 0, pan: 0, destination: BROADCAST, source: 0, message }.emit(&mut out);
            assert_eq!(Frame::parse(out.bytes()), Err(FrameError::Field), "{part} {asked}");
        }
        for options in [0x19, 0x1A] {
            let mut bytes = out.bytes().to_vec();
            bytes[12] = options;
            assert_eq!(Frame::parse(&bytes), Err(FrameError::Field), "{options:#x}");
        }
    }

    #[test]
    fn a_poll_with_data_names_seven_anchors_at_most() {
        let mut out = FrameBuffer::new();
        let mut parse = |anchors, data: &[u8], length| {
            let asked = Asked { address: 1, distance: Distance::Unknown };
            let anchors = core::iter::repeat_n(asked, anchors).collect();
            let data = UserData::new(0, data);
            let message =
                Message::Poll(Poll { round: 0, wish: Layout::LEAST, anchors, position: None, data, part: None });
            Frame { sequence: 0, pan: 0, destination: BROADCAST, source: 0, message }.emit(&mut out);
            let mut bytes = out.bytes().to_vec();
            // From the end: the data, their length.
            let place = bytes.len() - UserData::MOST - 1;
            bytes[place] = length;
            Frame::parse(&bytes).map(|_| bytes.len() + 2)
        };
        // The longest poll with data: 10 + 4 + 7 · 4 + 2 + 24 + 2 bytes.
        assert_eq!(parse(7, &[1; UserData::MOST], 24), Ok(70));
        assert_eq!(parse(8, &[1; UserData::MOST], 24), Err(FrameError::Field));
        assert_eq!(parse(7, &[1; UserData::MOST], 25), Err(FrameError::Truncated));
        assert_eq!(parse(7, &[1; UserData::MOST], 23), Err(FrameError::TooLong(1)));
        assert_eq!(parse(7, &[1; UserData::MOST], 0), Err(FrameError::Field));
    }

    #[test]
    fn golden_response() {
        let response = Response {
            round: 0xFE,
            lease: Confirmation::Renewed,
            has_message: false,
            passes_nothing_on: false,
            poll_rx: RadioInstant::from_ticks(0xFF_0102_0304),
            reply: RadioDuration::from_ticks(0x0123_4567),
            last_final: None,
        };
        let golden = [0x31, 0xFE, 0x01, 4, 3, 2, 1, 0xFF, 0x67, 0x45, 0x23, 0x01];
        let mut out = FrameBuffer::new();
        Frame { sequence: 0, pan: 0, destination: 0, source: 0, message: Message::Response(response) }.emit(&mut out);
        assert_eq!(out.bytes().get(9..), Some(&golden[..]));
        assert_eq!(usize::from(RESPONSE_BYTES), 9 + golden.len() + 2);

        let last_final = Some(FinalReceived { round: 0xFD, after_response: RadioDuration::from_ticks(0x0089_ABCD) });
        let with_final: std::vec::Vec<u8> = golden.into_iter().chain([0xFD, 0xCD, 0xAB, 0x89, 0x00]).collect();
        assert_eq!(usize::from(LONG_RESPONSE_BYTES), 9 + with_final.len() + 2);
        for (cut, bytes) in (0..5).map(|cut| (cut, &with_final[..with_final.len() - cut])) {
            let mut frame = std::vec![0x41, 0x88, 0, 0, 0, 0, 0, 0, 0];
            frame.extend(bytes);
            let parsed = Frame::parse(&frame).map(|frame| frame.message);
            let whole = Message::Response(Response { last_final, ..response });
            assert_eq!(parsed, if cut == 0 { Ok(whole) } else { Err(FrameError::Truncated) }, "cut by {cut}");
        }
    }

    #[test]
    fn golden_final() {
        round_trip(Message::Final { round: 0x0102 }, &[0x34, 0x02, 0x01]);
        assert_eq!(usize::from(FINAL_BYTES), 9 + 3 + 2);
    }

    #[test]
    fn golden_requests() {
        let wish = Layout::from_tag_byte(0x12);
        // 10 = 2 · 5: code 9.
        let period = Period::at_most(10);
        let leased = [(Share::Leased(Turns::rounds(period)), 0x89), (Share::Leased(Turns::blinks(period)), 0xC9)];
        for (share, byte) in [(Share::Release, 0), (Share::Slots(2), 2), (Share::Greedy, 127)].into_iter().chain(leased)
        {
            round_trip(Message::Request(Request { share, wish }), &[0x33, byte, 0x12]);
        }
    }

    fn sync_frame(members: usize) -> SyncFrame {
        SyncFrame {
            session: None,
            superframe: 0x0102,
            term: 3,
            age: 4,
            hops: 5,
            coordinator: 0x0607,
            slot: 8,
            slot_owners: core::array::from_fn(|i| i as u8 + 0x10),
            request: None,
            wish: Layout::from_bytes([0x21, 0x43]),
            wishes_relay_slots: false,
            heard: 0x0B0C,
            version: 9,
            countdown: 7,
            layout: Layout::from_bytes([0x35, 0x90]),
            layout_is_new: true,
            position: Position::from_metres([1.0, -0.001, 8.388]),
            leased: 17,
            has_relay_slots: false,
            relay: None,
            neighbour: None,
            members: (0..members as u16).map(|tag| Member { tag: 0x0400 + tag, share: Share::Greedy }).collect(),
            leases: Vec::new(),
            polls: Vec::new(),
        }
    }

    /// A lease of slot 5, once in 100 superframes, 2² · 5²: code 2 · 8 + 2.
    fn lease(grant: Grant) -> Lease {
        Lease { tag: 0x0809, turn: Turn::new(5, 0, Period::at_most(100), 99), grant }
    }

    #[test]
    fn golden_sync_frame() {
        // 1000 = 0x0003E8, −1 = 0xFFFFFF, 8388 = 0x0020C4.
        // Slot 8 and countdown 7: 8 + 7 · 32 = 0xE8. Layout 35 90, new: B5 90.
        let mut golden = std::vec![0x32, 2, 1, 3, 4, 5, 7, 6, 0xE8];
        golden.extend(0x10..0x20);
        golden.extend([0x21, 0x43, 0, 0x0C, 0x0B, 9, 0xB5, 0x90, 0xE8, 3, 0, 0xFF, 0xFF, 0xFF, 0xC4, 0x20, 0]);
        golden.extend([2, 17, 0, 0x00, 0x04, 127, 0x01, 0x04, 127]);
        round_trip(Message::SyncFrame(sync_frame(2)), &golden);
    }

    #[test]
    fn golden_sync_frame_that_says_where_another_anchor_is() {
        let position = Position::from_metres([-1.0, 0.258, 3.0]).unwrap();
        let neighbour = Some(AnchorAt { address: 0x1234, position });
        let mut golden = std::vec![0x32, 2, 1, 3, 4, 5, 7, 6, 0xE8];
        golden.extend(0x10..0x20);
        golden.extend([0x21, 0x43, 0, 0x0C, 0x0B, 9, 0xB5, 0x90, 0xE8, 3, 0, 0xFF, 0xFF, 0xFF, 0xC4, 0x20, 0]);
        // 17 + 128. −1000 = 0xFFFC18, 258 = 0x000102, 3000 = 0x000BB8.
        golden.extend([0, 0x91, 0, 0x34, 0x12, 0x18, 0xFC, 0xFF, 2, 1, 0, 0xB8, 0x0B, 0]);
        round_trip(Message::SyncFrame(SyncFrame { neighbour, ..sync_frame(0) }), &golden);
        // An anchor without a position says nothing: −8388608 is "not known".
        golden.truncate(golden.len() - 9);
        golden.extend([0, 0, 0x80, 0, 0, 0, 0, 0, 0]);
        let frame = [&[0x41, 0x88, 0, 0, 0, 0xFF, 0xFF, 0, 0], &golden[..]].concat();
        assert_eq!(Frame::parse(&frame), Err(FrameError::Field));
    }

    #[test]
    fn golden_sync_frame_that_passes_a_request_on() {
        let request = Some(Member { tag: 0x0506, share: Share::Slots(3) });
        let mut golden = std::vec![0x32, 2, 1, 3, 4, 5, 7, 6, 0xE8];
        golden.extend(0x10..0x20);
        golden.extend([0x06, 0x05, 3, 0x0C, 0x0B, 9, 0xB5, 0x90, 0xE8, 3, 0, 0xFF, 0xFF, 0xFF, 0xC4, 0x20, 0]);
        golden.extend([0x80, 17, 0]);
        round_trip(Message::SyncFrame(SyncFrame { request, wish: Layout::LEAST, ..sync_frame(0) }), &golden);
    }

    #[test]
    fn golden_sync_frame_with_leases_and_polls() {
        let mut leases: Vec<_, _> =
            [Grant::New, Grant::Kept, Grant::Refused, Grant::Ended].map(lease).into_iter().collect();
        // The fifth blink of the slot: 99 + 5 · 2¹³ = 0xA063.
        leases[1].turn = Turn::new(5, 5, Period::at_most(100), 99);
        let polls = [LeasedPoll { tag: 0x0A0B, wish: 0xA8 }].into_iter().collect();
        let mut golden = std::vec![0x32, 2, 1, 3, 4, 5, 7, 6, 0xE8];
        golden.extend(0x10..0x20);
        golden.extend([0x21, 0x43, 0, 0x0C, 0x0B, 9, 0xB5, 0x90, 0xE8, 3, 0, 0xFF, 0xFF, 0xFF, 0xC4, 0x20, 0]);
        golden.extend([0, 17, 0x41]);
        for (slot, part) in [(0x05, 0), (0x45, 0xA0), (0x85, 0), (0xC5, 0)] {
            golden.extend([0x09, 0x08, slot, 0x12, 99, part]);
        }
        golden.extend([0x0B, 0x0A, 0xA8]);
        round_trip(Message::SyncFrame(SyncFrame { leases, polls, ..sync_frame(0) }), &golden);
    }

    #[test]
    fn golden_sync_frame_that_relays() {
        let data = UserData::new(0xFE, b"door 3").unwrap();
        let entry = |at, content| Relayed { tag: 0x0809, round: 0x1234, at, asked: 5, content };
        let entries = [
            entry(
                0xF080,
                Carried::Position(PolledPosition([
                    0xE8, 3, 0, 0xFF, 0xFF, 0xFF, 0xC4, 0x20, 0, 0x69, 0xA0, 0, 0x40, 0, 0, 0x83,
                ])),
            ),
            entry(0xF102, Carried::Data(data)),
        ];
        let mut golden = std::vec![0x32, 2, 1, 3, 4, 5, 7, 6, 0xE8];
        golden.extend(0x10..0x20);
        golden.extend([0x21, 0x43, 0, 0x0C, 0x0B, 9, 0xB5, 0x90, 0xE8, 3, 0, 0xFF, 0xFF, 0xFF, 0xC4, 0x20, 0]);
        // Two members, and two entries and one: 2 + 3 · 32.
        golden.extend([0x62, 17, 0]);
        // Cost 25, the next anchor in slot 12.
        golden.extend([25, 12, 0x02, 0x81]);
        golden.extend([0x09, 0x08, 0x34, 0x12, 0x80, 0xF0, 5, 0xE8, 3, 0, 0xFF, 0xFF, 0xFF, 0xC4, 0x20, 0]);
        golden.extend([0x69, 0xA0, 0, 0x40, 0, 0, 0x83]);
        golden.extend([0x09, 0x08, 0x34, 0x12, 0x02, 0xF1, 0x85, 0xFE, 6]);
        golden.extend(b"door 3");
        golden.extend([0x00, 0x04, 127, 0x01, 0x04, 127]);
        let relay = Relay {
            cost: 25,
            next: 12,
            taken: 0x8102,
            taken_frames: 0,
            heard: 0,
            entries: entries.into_iter().collect(),
        };
        // Two members (6), the way (4), a position (23), data (7 + 2 + 6).
        let relaying = SyncFrame { relay: Some(relay), ..sync_frame(2) };
        assert_eq!(relaying.room(), 63 - 6 - 4 - 23 - 15);
        round_trip(Message::SyncFrame(relaying), &golden);
        // A gateway with nothing to relay.
        let relay = Relay { cost: 0, next: 8, taken: 1, taken_frames: 0, heard: 0x0102, entries: Vec::new() };
        golden.truncate(42);
        golden.extend([0x20, 17, 0, 0, 8, 1, 0, 2, 1, 0, 0, 0, 0, 0, 0]);
        round_trip(Message::SyncFrame(SyncFrame { relay: Some(relay), ..sync_frame(0) }), &golden);
    }

    #[test]
    fn golden_sync_frame_with_relay_slots_and_a_relay_frame() {
        let relay = Relay { cost: 25, next: 12, taken: 0x8102, taken_frames: 0x0410, heard: 0, entries: Vec::new() };
        let mut golden = std::vec![0x32, 2, 1, 3, 4, 5, 7, 6, 0xE8];
        golden.extend(0x10..0x20);
        golden.extend([0x21, 0x43, 1, 0x0C, 0x0B, 9, 0xB5, 0x90, 0xE8, 3, 0, 0xFF, 0xFF, 0xFF, 0xC4, 0x20, 0]);
        // 17 + 64.
        golden.extend([0x20, 0x51, 0, 25, 12, 0x02, 0x81, 0x10, 0x04]);
        let relaying =
            SyncFrame { has_relay_slots: true, wishes_relay_slots: true, relay: Some(relay), ..sync_frame(0) };
        assert_eq!(relaying.room(), 63 - 6);
        round_trip(Message::SyncFrame(relaying), &golden);
        golden[27] = 2;
        let frame = [&[0x41, 0x88, 0, 0, 0, 0xFF, 0xFF, 0, 0], &golden[..]].concat();
        assert_eq!(Frame::parse(&frame), Err(FrameError::Field), "no such request");

        let entry = |at, content| Relayed { tag: 0x0809, round: 0x1234, at, asked: 5, content };
        let position = Carried::Position(a_position());
        let data = Carried::Data(UserData::new(0xFE, b"door 3").unwrap());
        let mut golden = std::vec![0x36, 9, 8, 0x34, 0x12, 0x80, 0xF0, 5, 0xE8, 3, 0, 0xFF, 0xFF, 0xFF, 0xC4, 0x20, 0];
        golden.extend([0x69, 0xA0, 0, 64, 0, 0, 0x83]);
        let one: Vec<_, _> = [entry(0xF080, position)].into_iter().collect();
        assert_eq!(RelayFrame { entries: one.clone() }.room(), 3 * 23);
        let parse = |golden: &[u8]| {
            let frame = [&[0x41, 0x88, 0, 0, 0, 3, 2, 0, 0], golden].concat();
            Frame::parse(&frame).map(|frame| frame.message)
        };
        assert_eq!(parse(&golden), Ok(Message::RelayFrame(RelayFrame { entries: one })));
        assert_eq!(parse(&golden[..1]), Err(FrameError::Truncated), "it says something");
        golden.extend([9, 8, 0x34, 0x12, 2, 0xF1, 0x85, 0xFE, 6]);
        golden.extend(b"door 3");
        let entries: Vec<_, _> = [entry(0xF080, position), entry(0xF102, data)].into_iter().collect();
        let frame = RelayFrame { entries };
        assert_eq!(frame.room(), 2 * 23 + 8);
        let mut out = FrameBuffer::new();
        let message = Message::RelayFrame(frame);
        Frame { sequence: 0, pan: 0, destination: 0x0203, source: 0, message: message.clone() }.emit(&mut out);
        assert_eq!(out.bytes().get(9..), Some(&golden[..]));
        assert_eq!(parse(&golden), Ok(message));
        for cut in (1..golden.len()).filter(|cut| *cut != 24) {
            assert_eq!(parse(&golden[..cut]), Err(FrameError::Truncated), "cut to {cut}");
        }
        let five = core::iter::once(0x36).chain((0..5).flat_map(|_| golden[1..24].to_vec()));
        assert_eq!(parse(&five.collect::<std::vec::Vec<_>>()), Err(FrameError::Field), "five entries");
        assert_eq!(usize::from(RELAY_FRAME_BYTES), 9 + 1 + 4 * 23 + 2);
    }

    #[test]
    fn golden_message_to_a_tag_and_its_answer() {
        // For 6000 superframes, 0x1770, by gateway 0x0A0B; 30 seconds of light.
        let message =
            Downlink { gateway: 0x0A0B, left: 6000, ..Downlink::new(0x0809, 200, TagCommand::Identify(30)).unwrap() };
        let mut golden = std::vec![0x32, 2, 1, 3, 4, 5, 7, 6, 0xE8];
        golden.extend(0x10..0x20);
        golden.extend([0x21, 0x43, 0, 0x0C, 0x0B, 9, 0xB5, 0x90, 0xE8, 3, 0, 0xFF, 0xFF, 0xFF, 0xC4, 0x20, 0]);
        golden.extend([0x40, 17, 0, 25, 12, 0, 0, 0x09, 0x08, 0x0B, 0x0A, 0x70, 0x17, 0x41, 200, 1, 30]);
        let relay = Relay {
            cost: 25,
            next: 12,
            taken: 0,
            taken_frames: 0,
            heard: 0,
            entries: [message.into()].into_iter().collect(),
        };
        round_trip(Message::SyncFrame(SyncFrame { relay: Some(relay), ..sync_frame(0) }), &golden);
        let asked = Asked { address: 1, distance: Distance::Unsent };
        let data = Some(UserData::answering(200, Answer::NeedsKey));
        let anchors = [asked].into_iter().collect();
        let poll = Poll { round: 1, wish: Layout::LEAST, anchors, position: None, data, part: None };
        round_trip(Message::Poll(poll), &[0x30, 1, 0, 0x14, 0, 1, 0, 200, 0x81, 2]);
        assert_eq!(data.and_then(|data| data.answer()), Some(Answer::NeedsKey));
        assert_eq!(UserData::new(200, &[2]).and_then(|data| data.answer()), None);
        let response = Response {
            round: 1,
            lease: Confirmation::Ended,
            has_message: true,
            passes_nothing_on: true,
            poll_rx: RadioInstant::from_ticks(0),
            reply: RadioDuration::ZERO,
            last_final: None,
        };
        let mut out = FrameBuffer::new();
        let message = Message::Response(response);
        Frame { sequence: 0, pan: 0, destination: 0, source: 0, message: message.clone() }.emit(&mut out);
        assert_eq!(out.bytes().get(9..), Some(&[0x31, 1, 0xC2, 0, 0, 0, 0, 0, 0, 0, 0, 0][..]));
        assert_eq!(Frame::parse(out.bytes()).map(|frame| frame.message), Ok(message));
    }

    #[test]
    fn a_lease_outside_its_period_or_with_no_period_is_refused() {
        let mut out = FrameBuffer::new();
        let leases = [lease(Grant::New)].into_iter().collect();
        let message = Message::SyncFrame(SyncFrame { leases, ..sync_frame(0) });
        Frame { sequence: 0, pan: 0, destination: BROADCAST, source: 0, message }.emit(&mut out);
        let end = out.bytes().len();
        assert!(Frame::parse(out.bytes()).is_ok());
        // From the end: phase (2), period. Period 0x30 is 5⁶, 0x27 128 · 625, 0x2F 128 · 3125.
        for (place, value) in [(2, 100), (3, 0x30), (3, 0x27), (3, 0x2F), (3, 0x40), (3, 0x80)] {
            let mut bytes = out.bytes().to_vec();
            bytes[end - place] = value;
            assert_eq!(Frame::parse(&bytes), Err(FrameError::Field), "{place}: {value}");
        }
    }

    #[test]
    fn the_longest_frames_fit() {
        let mut out = FrameBuffer::new();
        let mut length = |message| {
            Frame { sequence: 0, pan: 0, destination: BROADCAST, source: 0, message }.emit(&mut out);
            out.bytes().len()
        };
        let mut longest = sync_frame(MAX_MEMBERS);
        // 16 members take 48 of the 63 bytes: two leases and a poll take the rest.
        assert_eq!(longest.room_for_news(), (2, 5));
        longest.leases = [lease(Grant::New); 2].into_iter().collect();
        assert_eq!(longest.room_for_news(), (0, 1));
        longest.polls = [LeasedPoll { tag: 0, wish: 0 }].into_iter().collect();
        assert_eq!(longest.room_for_news(), (0, 0));
        assert_eq!(sync_frame(0).room_for_news(), (MAX_LEASES, MAX_POLLS));
        let longest = length(Message::SyncFrame(longest));
        assert_eq!((longest + 2, longest + 8), (usize::from(SYNC_FRAME_BYTES), MAX_FRAME));
        for (distance, position) in [(Distance::Unknown, None), (Distance::Unsent, Some(a_position()))] {
            let asked = Asked { address: 1, distance };
            let anchors = core::iter::repeat_n(asked, MAX_ROUND).collect();
            let poll = Poll { round: 0, wish: Layout::LEAST, anchors, position, data: None, part: None };
            assert_eq!(length(Message::Poll(poll)) + 2, usize::from(POLL_BYTES));
        }
    }

    /// The code of the bytes that an authenticated frame has before it, here their number.
    fn authenticated(message: Message) -> std::vec::Vec<u8> {
        let mut out = FrameBuffer::new();
        let frame = Frame { sequence: 0x2A, pan: 0xBA1A, destination: BROADCAST, source: 0x0107, message };
        frame.emit(&mut out);
        out.authenticate(|bytes| [bytes.len() as u8; CODE_BYTES]);
        assert_eq!(Frame::parse(out.bytes()), Ok(frame));
        for cut in 0..out.bytes().len() - 1 {
            assert!(Frame::parse(&out.bytes()[..cut]).is_err(), "cut to {cut}");
        }
        out.bytes()[9..].to_vec()
    }

    #[test]
    fn frames_with_a_code_are_the_same_with_another_mark() {
        // Nine bytes of the header, and the message.
        assert_eq!(authenticated(Message::Final { round: 0x0102 }), [0x3C, 2, 1, 12, 12, 12, 12, 12, 12, 12, 12]);
        let challenge = Challenge { session: 0x0102_0304, number: 0x0506_0708 };
        let golden = [0x3D, 4, 3, 2, 1, 8, 7, 6, 5, 18, 18, 18, 18, 18, 18, 18, 18];
        assert_eq!(authenticated(Message::Challenge(challenge)), golden);
        assert_eq!(9 + golden.len() + 2, usize::from(CHALLENGE_BYTES));
        // A challenge without a code is no frame.
        let mut out = FrameBuffer::new();
        let message = Message::Challenge(challenge);
        Frame { sequence: 0, pan: 0, destination: BROADCAST, source: 0, message }.emit(&mut out);
        assert_eq!(Frame::parse(out.bytes()), Err(FrameError::Code(0x35)));
    }

    #[test]
    fn sync_frames_with_a_code_have_a_session() {
        let polls = [LeasedPoll { tag: 0x0A0B, wish: 0xA8 }].into_iter().collect();
        let mut sync_frame = SyncFrame { polls, ..sync_frame(0) };
        for (answer, entries, bytes) in [(None, 0x01, &[][..]), (Some(0x0506_0708), 0x09, &[8, 7, 6, 5])] {
            sync_frame.session = Some(Session { number: 0x0102_0304, epoch: 0x0910, answer });
            let written = authenticated(Message::SyncFrame(sync_frame.clone()));
            let golden = [&[0, 17, entries, 4, 3, 2, 1, 0x10, 9], bytes, &[0x0B, 0x0A, 0xA8]].concat();
            assert_eq!(written[0], 0x3A);
            let frame = [&[0; 9][..], &written].concat();
            assert_eq!((slot_of(&frame), slot_of(&frame[..17])), (Some(8), None));
            assert_eq!(written[42..written.len() - CODE_BYTES], golden);
        }
        // 16 members take 48 of the 63 bytes, and session, epoch and answer 10.
        sync_frame.members = (0..16).map(|tag| Member { tag, share: Share::Greedy }).collect();
        sync_frame.polls.clear();
        assert_eq!(sync_frame.room_for_news(), (0, 1));
    }

    #[test]
    fn members_out_of_order_or_twice_are_refused() {
        let mut out = FrameBuffer::new();
        let mut jumbled = sync_frame(2);
        jumbled.members[1].tag = jumbled.members[0].tag;
        let message = Message::SyncFrame(jumbled);
        Frame { sequence: 0, pan: 0, destination: BROADCAST, source: 0, message }.emit(&mut out);
        assert_eq!(Frame::parse(out.bytes()), Err(FrameError::Field));
    }
}
