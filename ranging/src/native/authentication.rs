//! The key of a network: who has it sends frames that the other nodes believe, and believes no others.
//!
//! **Freshness.** A network has a session, a random number of the anchor that founded it, and counts its superframes in
//! 32 bits. Both are in the nonce of each frame, so a frame counts only in its own superframe. A response's code covers
//! the code of its poll: a tag that polls has asked something that nobody has asked before, so what it gets is new even
//! if it was deceived about the session.
//!
//! **Recorded networks.** Whoever replays the frames of a network that was there before shows anchors a session with a
//! correct code. So an anchor joins a session, or changes to it, only after an anchor of that session has repeated a
//! number that it has just drawn ([`Challenger`]). A tag needs no challenge: where its polls are not answered it follows
//! any other session that it receives.

use core::fmt;

use heapless::Vec;

use super::Network;
use crate::{RadioDuration, RadioInstant};
use wire::uwb::FrameBuffer;
use wire::uwb::native::{Challenge, IntegrityCode, MakeCode, Session, SyncFrame, split_code};

/// Senders of a superframe that are remembered: tags that poll in 64 round slots, and those that request some.
const MAX_OPENED: usize = 96;
/// The last byte of a nonce that draws a random number. That of a frame is 0, or more than this.
const DRAWN: u8 = 1;

/// The key of a network, and what a node needs to use it.
#[derive(Clone, Copy)]
pub struct NetworkKey {
    key: [u8; 16],
    seed: u64,
    make_code: MakeCode,
}

/// What makes a frame new: a session and a superframe of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Moment {
    /// The session.
    pub session: u32,
    /// Number of the superframe; of a challenge this and the number that was drawn.
    pub superframe: u32,
    /// Of a request its place in the superframe, of a round its leased slot, 2 and more; else 0.
    pub place: u8,
}

/// A poll with a code, as its round refers to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SealedPoll {
    /// The superframe of the round.
    pub moment: Moment,
    /// The poll's code.
    pub code: IntegrityCode,
}

impl NetworkKey {
    /// The seed must be another one at each start, and nobody may foresee it.
    #[cold]
    pub const fn new(key: [u8; 16], seed: u64, make_code: MakeCode) -> Self {
        Self { key, seed, make_code }
    }

    /// The `count`-th random number since the start.
    #[cold]
    pub fn random(&self, count: u32) -> u32 {
        let mut nonce = [DRAWN; 13];
        nonce[..8].copy_from_slice(&self.seed.to_le_bytes());
        nonce[8..12].copy_from_slice(&count.to_le_bytes());
        let [a, b, c, d, ..] = (self.make_code)(&self.key, &nonce, [b"random", &[]]);
        u32::from_le_bytes([a, b, c, d])
    }

    /// Adds the code to a frame that was written.
    pub fn seal(&self, frame: &mut FrameBuffer, moment: Moment) -> SealedPoll {
        SealedPoll { moment, code: frame.authenticate(|bytes| self.code(bytes, moment, &[])) }
    }

    /// Adds the code to a response that was written.
    pub fn seal_response(&self, frame: &mut FrameBuffer, poll: &SealedPoll) {
        frame.authenticate(|bytes| self.code(bytes, poll.moment, &poll.code));
    }

    /// Whether a received frame has the code that it must have.
    fn accepts(&self, frame: &[u8], moment: Moment, poll: &[u8]) -> Option<IntegrityCode> {
        let (bytes, code) = split_code(frame)?;
        let expected = self.code(bytes, moment, poll);
        // All bytes are compared: the time does not show how many agree.
        let differing = code.iter().zip(expected).fold(0, |differing, (a, b)| differing | a ^ b);
        (differing == 0).then_some(expected)
    }

    fn code(&self, bytes: &[u8], moment: Moment, poll: &[u8]) -> IntegrityCode {
        let mut nonce = [0; 13];
        // Frame control (2), sequence, PAN (2), destination (2), source, message's code.
        if let [_, _, sequence, _, _, _, _, low, high, message, ..] = *bytes {
            nonce[..2].copy_from_slice(&[low, high]);
            nonce[10..12].copy_from_slice(&[sequence, message]);
        }
        nonce[2..6].copy_from_slice(&moment.session.to_le_bytes());
        nonce[6..10].copy_from_slice(&moment.superframe.to_le_bytes());
        nonce[12] = moment.place;
        (self.make_code)(&self.key, &nonce, [poll, bytes])
    }
}

/// A frame without the code that it must have, or with one in a network without a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Forged;

impl Network {
    /// Checks a received frame of this moment. Returns what a round refers to, in a network with a key.
    pub fn open(&self, frame: &[u8], moment: Option<Moment>) -> Result<Option<SealedPoll>, Forged> {
        let Some(key) = &self.key else { return self.open_response(frame, None).map(|()| None) };
        let moment = moment.ok_or(Forged)?;
        let code = key.accepts(frame, moment, &[]).ok_or(Forged)?;
        Ok(Some(SealedPoll { moment, code }))
    }

    /// Checks a sync frame, which says its moment itself.
    pub fn open_sync_frame(&self, frame: &[u8], sync_frame: &SyncFrame) -> Result<Option<SealedPoll>, Forged> {
        self.open(frame, Moment::of_sync_frame(sync_frame))
    }

    /// Checks a response to a poll.
    pub fn open_response(&self, frame: &[u8], poll: Option<&SealedPoll>) -> Result<(), Forged> {
        let is_authentic = match &self.key {
            None => split_code(frame).is_none(),
            Some(key) => poll.is_some_and(|poll| key.accepts(frame, poll.moment, &poll.code).is_some()),
        };
        if is_authentic { Ok(()) } else { Err(Forged) }
    }
}

impl Moment {
    /// A superframe of a session, by the halves of its number.
    pub const fn new(session: u32, epoch: u16, superframe: u16) -> Self {
        Self { session, superframe: (epoch as u32) << 16 | superframe as u32, place: 0 }
    }

    /// The moment of a request at this place of the superframe, or of a round in this slot: it counts there only.
    pub fn at_place(self, place: u16) -> Self {
        // 0 and 1 are for other frames and for random numbers.
        Self { place: u8::try_from(place).unwrap_or(u8::MAX).saturating_add(2), ..self }
    }

    /// The moment of a sync frame; `None` without a session.
    pub fn of_sync_frame(sync_frame: &SyncFrame) -> Option<Self> {
        let Session { number, epoch, .. } = sync_frame.session?;
        Some(Self::new(number, epoch, sync_frame.superframe))
    }

    /// The moment of a challenge that is sent in this superframe of its session.
    pub fn of_challenge(challenge: &Challenge, superframe: u32) -> Self {
        Self { session: challenge.session, superframe: challenge.number ^ superframe, place: 0 }
    }
}

/// Who has sent frames with a right code in a superframe. A sender counts its frames: one that comes again, or after a later
/// one, is recorded.
#[derive(Clone, Debug, Default)]
pub struct Opened {
    moment: Option<Moment>,
    /// Each sender and its last sequence number.
    senders: Vec<(u16, u8), MAX_OPENED>,
}

impl Opened {
    /// Whether a frame of this superframe comes again, or after a later one of its sender.
    pub fn is_repeated(&mut self, moment: Moment, sender: u16, sequence: u8) -> bool {
        if self.moment != Some(moment) {
            self.moment = Some(moment);
            self.senders.clear();
        }
        if let Some((_, last)) = self.senders.iter_mut().find(|(known, _)| *known == sender) {
            let is_later = sequence.wrapping_sub(*last) as i8 > 0;
            *last = if is_later { sequence } else { *last };
            return !is_later;
        }
        if self.senders.is_full() {
            self.senders.remove(0);
        }
        // There is a place now.
        let _ = self.senders.push((sender, sequence));
        false
    }
}

/// Nobody reads a key in a log.
impl fmt::Debug for NetworkKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("NetworkKey")
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for NetworkKey {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "NetworkKey");
    }
}

impl PartialEq for NetworkKey {
    fn eq(&self, other: &Self) -> bool {
        (self.key, self.seed) == (other.key, other.seed)
    }
}

impl Eq for NetworkKey {}

/// A session that has not repeated the number for this long is hardly there. Other sessions may be asked.
const PATIENCE: RadioDuration = RadioDuration::from_micros(2_000_000);
/// The same for a session that has been asked in vain before.
const LITTLE_PATIENCE: RadioDuration = RadioDuration::from_micros(300_000);

/// How an anchor finds out whether a session is there or was recorded.
#[derive(Clone, Debug, Default)]
pub struct Challenger {
    /// Random numbers drawn.
    drawn: u32,
    /// The session that is asked and the number that it must repeat, and since when.
    asked: Option<(Challenge, RadioInstant)>,
    /// The last session that was asked in vain since the start.
    silent: Option<u32>,
    /// Other sessions were received since.
    others_wait: bool,
    /// When the next challenge leaves, and in which superframe of the session.
    due: Option<(RadioInstant, u32)>,
    /// The session that has answered.
    live: Option<u32>,
    /// The number that this anchor is to repeat.
    to_repeat: Option<u32>,
}

impl Challenger {
    /// A random number for a new session.
    #[cold]
    pub fn draw(&mut self, key: &NetworkKey) -> u32 {
        self.drawn = self.drawn.wrapping_add(1);
        key.random(self.drawn)
    }

    /// A sync frame of another session than the own one was received at `now`. Returns whether that session is there; if
    /// this is not known, a challenge is due at the instant `at`, in this superframe of the session.
    #[cold]
    pub fn is_live(&mut self, key: &NetworkKey, session: &Session, now: RadioInstant, at: (RadioInstant, u32)) -> bool {
        if self.live == Some(session.number) {
            return true;
        }
        let is_patient = |(asked, since): &(Challenge, RadioInstant)| {
            let patience = if self.silent == Some(asked.session) { LITTLE_PATIENCE } else { PATIENCE };
            (RadioDuration::ZERO..patience).contains(&now.since(*since))
        };
        match self.asked {
            Some((asked, _)) if asked.session == session.number && session.answer == Some(asked.number) => {
                (self.asked, self.due, self.live) = (None, None, Some(session.number));
                return true;
            }
            // One session after the other, so that a recorded one does not keep the others out.
            Some(before @ (asked, _)) if is_patient(&before) => {
                if asked.session != session.number {
                    self.others_wait = true;
                    return false;
                }
            }
            Some((asked, _)) if asked.session == session.number && self.others_wait => return false,
            before => {
                self.silent = before.map(|(asked, _)| asked.session).or(self.silent);
                self.others_wait = false;
                let number = self.draw(key);
                (self.asked, self.due) = (Some((Challenge { session: session.number, number }, now)), None);
            }
        }
        self.due.get_or_insert(at);
        false
    }

    /// Whether the first session that was asked may still answer.
    pub fn is_waiting(&self, now: RadioInstant) -> bool {
        self.silent.is_none() && self.asked.is_some_and(|(_, since)| now.since(since) < PATIENCE)
    }

    /// When the next challenge leaves.
    pub fn due(&self) -> Option<RadioInstant> {
        self.due.map(|(at, _)| at)
    }

    /// The challenge that is due, when it leaves, and in which superframe of the session. It is due no more.
    pub fn take(&mut self) -> Option<(Challenge, RadioInstant, u32)> {
        let (at, superframe) = self.due.take()?;
        self.asked.map(|(challenge, _)| (challenge, at, superframe))
    }

    /// Another anchor asks for the own session.
    pub fn receive(&mut self, challenge: &Challenge) {
        self.to_repeat.get_or_insert(challenge.number);
    }

    /// What the next sync frame repeats.
    pub fn answer(&mut self) -> Option<u32> {
        self.to_repeat.take()
    }

    /// The radio was started: instants are void.
    pub fn restart(&mut self) {
        *self = Self { drawn: self.drawn, ..Self::default() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PhyConfig;
    use wire::uwb::BROADCAST;
    use wire::uwb::native::{Frame, Message, software_code};

    const MOMENT: Moment = Moment::new(0x0102_0304, 0x0506, 0x0708);

    fn network(key: u8) -> Network {
        let key = Some(NetworkKey::new([key; 16], 1, software_code));
        Network { key, ..Network::new(1, PhyConfig::FAST) }
    }

    fn sealed(network: &Network, poll: Option<&SealedPoll>) -> FrameBuffer {
        let mut out = FrameBuffer::new();
        let message = Message::Final { round: 0x0102 };
        Frame { sequence: 3, pan: 1, destination: BROADCAST, source: 0x0405, message }.emit(&mut out);
        let key = network.key.as_ref().unwrap();
        match poll {
            Some(poll) => key.seal_response(&mut out, poll),
            None => {
                key.seal(&mut out, MOMENT);
            }
        }
        out
    }

    #[test]
    fn a_frame_counts_with_its_key_and_in_its_moment_only() {
        let network_7 = network(7);
        let out = sealed(&network_7, None);
        let opened = network_7.open(out.bytes(), Some(MOMENT)).unwrap().unwrap();
        assert_eq!((opened.moment, &opened.code[..]), (MOMENT, &out.bytes()[12..]));
        for bit in 0..out.bytes().len() * 8 {
            let mut changed = out.bytes().to_vec();
            changed[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(network_7.open(&changed, Some(MOMENT)), Err(Forged), "bit {bit}");
        }
        for moment in [Moment { session: 1, ..MOMENT }, Moment { superframe: 0x0506_0709, ..MOMENT }] {
            assert_eq!(network_7.open(out.bytes(), Some(moment)), Err(Forged));
        }
        assert_eq!(network_7.open(out.bytes(), None), Err(Forged));
        assert_eq!(network(8).open(out.bytes(), Some(MOMENT)), Err(Forged));
        // Without a key a frame with a code is another network's, and the other way round.
        assert_eq!(Network::new(1, PhyConfig::FAST).open(out.bytes(), Some(MOMENT)), Err(Forged));
        assert_eq!(network_7.open(&out.bytes()[..12], Some(MOMENT)), Err(Forged));
    }

    #[test]
    fn a_response_answers_one_poll() {
        let (network, poll) = (network(7), SealedPoll { moment: MOMENT, code: [1; 8] });
        let out = sealed(&network, Some(&poll));
        assert_eq!(network.open_response(out.bytes(), Some(&poll)), Ok(()));
        assert_eq!(network.open_response(out.bytes(), Some(&SealedPoll { code: [2; 8], ..poll })), Err(Forged));
        assert_eq!(network.open_response(out.bytes(), None), Err(Forged));
        assert_eq!(network.open(out.bytes(), Some(MOMENT)), Err(Forged));
    }

    #[test]
    fn random_numbers_differ_by_seed_and_count() {
        let key = |seed| NetworkKey::new([7; 16], seed, software_code);
        let mut drawn: std::vec::Vec<u32> =
            (0..100).flat_map(|seed| (0..100).map(move |count| key(seed).random(count))).collect();
        drawn.sort_unstable();
        drawn.dedup();
        // Of 10,000 numbers of 32 bits, 0.01 pairs agree by chance.
        assert!(drawn.len() >= 9_999, "{}", drawn.len());
    }

    #[test]
    fn a_frame_counts_once_in_its_superframe() {
        let mut opened = Opened::default();
        let next = Moment { superframe: MOMENT.superframe + 1, ..MOMENT };
        let frames = [(1, 5), (2, 255), (1, 7), (2, 0), (2, 0), (2, 255), (1, 6)];
        let repeated = frames.map(|(sender, sequence)| opened.is_repeated(MOMENT, sender, sequence));
        assert_eq!(repeated, [false, false, false, false, true, true, true]);
        assert!(!opened.is_repeated(next, 2, 5));
        // More than fit: the oldest are forgotten.
        (0..MAX_OPENED as u16).for_each(|sender| assert!(!opened.is_repeated(next, 0x1000 + sender, 0)));
        assert!(opened.is_repeated(next, 0x1000, 0) && !opened.is_repeated(next, 2, 5));
        let network = network(7);
        let challenge = Challenge { session: MOMENT.session, number: 0x0102_0304 };
        let of = |superframe| Moment::of_challenge(&challenge, superframe);
        let mut out = FrameBuffer::new();
        let message = Message::Challenge(challenge);
        Frame { sequence: 3, pan: 1, destination: BROADCAST, source: 0x0405, message }.emit(&mut out);
        network.key.as_ref().unwrap().seal(&mut out, of(9));
        assert!(network.open(out.bytes(), Some(of(9))).is_ok() && network.open(out.bytes(), Some(of(10))).is_err());
    }

    #[test]
    fn sessions_are_asked_one_after_the_other() {
        let key = NetworkKey::new([7; 16], 1, software_code);
        let session = |number, answer| Session { number, epoch: 0, answer };
        let at = |ms: u32| RadioInstant::from_ticks(0).plus(RadioDuration::from_micros(ms * 1_000));
        let mut challenger = Challenger::default();
        assert!(!challenger.is_live(&key, &session(1, None), at(0), (at(20), 7)));
        assert_eq!(challenger.due(), Some(at(20)));
        let (first, first_at, superframe) = challenger.take().unwrap();
        assert_eq!((first.session, first_at, superframe, challenger.due()), (1, at(20), 7, None));
        // The other session waits, and a wrong number is no answer.
        assert!(!challenger.is_live(&key, &session(2, None), at(50), (at(70), 7)));
        assert!(!challenger.is_live(&key, &session(1, Some(first.number ^ 1)), at(100), (at(120), 7)));
        assert!(challenger.is_waiting(at(1_900)) && !challenger.is_waiting(at(2_001)));
        // After two seconds it is the other's turn, and the first does not come between.
        assert!(!challenger.is_live(&key, &session(1, None), at(2_100), (at(2_120), 7)));
        assert!(!challenger.is_live(&key, &session(2, None), at(2_150), (at(2_170), 7)));
        let (second, ..) = challenger.take().unwrap();
        assert_eq!(second.session, 2);
        assert_ne!(second.number, first.number);
        assert!(challenger.is_live(&key, &session(2, Some(second.number)), at(2_200), (at(2_220), 7)));
        assert!(challenger.is_live(&key, &session(2, None), at(2_300), (at(2_320), 7)));
        // Who has been asked in vain before has less time.
        assert!(!challenger.is_live(&key, &session(1, None), at(2_400), (at(2_420), 7)));
        assert!(!challenger.is_live(&key, &session(3, None), at(2_500), (at(2_520), 7)));
        assert!(!challenger.is_live(&key, &session(3, None), at(2_701), (at(2_720), 7)));
        challenger.take();
        assert!(!challenger.is_live(&key, &session(3, None), at(2_800), (at(2_820), 7)));
        assert_eq!(challenger.take().map(|(challenge, ..)| challenge.session), Some(3));
    }
}
