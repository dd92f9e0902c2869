//! The anchor in native mode: answers polls, keeps and relays time, and coordinates when nobody else does.

use super::asking::Asking;
use super::coordination::{Coordination, Heard};
use super::plan::Rate;
use super::timing::{BEACON_SLOTS, Phase, Timing};
use super::{Network, STAMP_DEVIATION_TICKS, WAKE, spread};
use crate::exchange::{Action, Event, Link, Machine, Range, Report, Round};
use crate::frame::native::{Beacon, Frame, Member, Message, Poll, Position, Response};
use crate::frame::{BROADCAST, FrameBuffer};
use crate::time::METRES_PER_TICK;
use crate::{RadioDuration, RadioInstant, RangeBias, RxFrame, Start};

/// What an anchor is told at its start.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AnchorConfig {
    /// Short address, unique in the network; not 0xFFFF (broadcast).
    pub address: u16,
    /// The network.
    pub network: Network,
    /// What the radio adds to the snapped start of a transmission: its transmitting antenna's delay, as
    /// [`Radio::departure`](crate::Radio::departure) does.
    pub antenna_delay: RadioDuration,
    /// Where it stands, metres, once surveyed.
    pub position_m: Option<[f32; 3]>,
    /// How often it asks the other anchors, for tags that only listen; `None`: never.
    pub rounds: Option<Rate>,
}

/// Superframes to listen for a network before founding one …
const SEARCH_SUPERFRAMES: i64 = 2;
/// … and as many beacon slots as the address says, of this many: of anchors switched on together, one is first.
const SEARCH_SPREAD: u16 = 128;
/// What a distance told by a tag is worth: two stamps, halved (see [`tof`](crate::tof)).
const DEVIATION_M: f32 = 0.5 * core::f32::consts::SQRT_2 * STAMP_DEVIATION_TICKS * METRES_PER_TICK as f32;

/// The anchor's side of native mode. Its reports are changes of its place in the network, and rounds of one range where a tag
/// tells what it measured.
#[derive(Clone, Debug)]
pub struct Anchor {
    config: AnchorConfig,
    timing: Timing,
    position: Option<Position>,
    network: Option<Coordination>,
    /// Without a network: when to found one.
    found_at: Option<RadioInstant>,
    answer: Option<Answer>,
    asking: Asking,
    link: Option<Link>,
    told: Option<Told>,
    /// The one that the node is reading.
    reported: Option<Told>,
    sequence: u8,
    out: FrameBuffer,
}

/// A response to be sent at an instant.
#[derive(Clone, Copy, Debug)]
struct Answer {
    tag: u16,
    start: RadioInstant,
    response: Response,
}

/// A distance that a tag has told.
#[derive(Clone, Copy, Debug)]
struct Told {
    round: u16,
    poll: RadioInstant,
    range: [Range; 1],
}

impl Anchor {
    /// An anchor that has heard nobody yet.
    pub fn new(config: AnchorConfig) -> Self {
        let timing = Timing::of(&config.network);
        Self {
            config,
            timing,
            position: config.position_m.and_then(Position::from_metres),
            network: None,
            found_at: None,
            answer: None,
            asking: Asking::new(config.rounds, &timing, RangeBias::of(&config.network.phy)),
            link: None,
            told: None,
            reported: None,
            sequence: 0,
            out: FrameBuffer::new(),
        }
    }

    fn hear(&mut self, frame: &RxFrame<'_>) {
        let Some(told) = Frame::parse(frame.bytes).filter(|told| told.pan == self.config.network.pan) else { return };
        let everyone = told.destination == BROADCAST;
        match told.message {
            Message::Poll(poll) if everyone => self.hear_poll(told.source, &poll, frame),
            Message::Request(share) if everyone => {
                if let Some(network) = &mut self.network {
                    network.request(Member { tag: told.source, share });
                }
            }
            Message::Beacon(beacon) if everyone => self.hear_beacon(told.source, &beacon, frame),
            Message::Response(response) if told.destination == self.config.address => {
                self.asking.answer(&self.timing, told.source, response, frame);
            }
            // Other anchors', and what is not for us.
            Message::Poll(_) | Message::Request(_) | Message::Beacon(_) | Message::Response(_) => {}
        }
    }

    fn hear_beacon(&mut self, source: u16, beacon: &Beacon, frame: &RxFrame<'_>) {
        if usize::from(beacon.slot) >= BEACON_SLOTS || source == self.config.address {
            return;
        }
        self.asking.hear(source);
        match &mut self.network {
            Some(network) => match network.hear(&self.timing, source, beacon, frame.rx_time) {
                Heard::Ignored | Heard::Followed => {}
                Heard::Changed(link) => self.link = Some(link),
            },
            None => {
                let phase = Phase::from_beacon(&self.timing, beacon.superframe, beacon.slot, frame.rx_time);
                self.network = Some(Coordination::join(self.config.address, source, beacon, phase));
                self.link = Some(Link::Synchronised(beacon.coordinator));
            }
        }
    }

    fn hear_poll(&mut self, tag: u16, poll: &Poll, frame: &RxFrame<'_>) {
        if let Some(network) = &mut self.network {
            network.hear_tag(tag);
        }
        let named = |place: &usize| poll.anchors.get(*place).is_some_and(|asked| asked.address == self.config.address);
        let Some(slot) = (0..poll.anchors.len()).find(named) else { return };
        let poll_rx = frame.rx_time;
        let antenna_delay = self.config.antenna_delay;
        let start = poll_rx.plus(self.timing.reply_in(slot)).plus(RadioDuration::from_ticks(-antenna_delay.ticks()));
        // The chip starts at the snapped instant: that is what the tag must be told.
        let departure = start.snapped().plus(antenna_delay);
        let response = Response { round: poll.round, poll_rx, reply: departure.since(poll_rx) };
        self.answer = Some(Answer { tag, start, response });
        // What anchors tell is for tags that listen.
        let asked = poll.anchors.get(slot).filter(|_| !self.asking.knows(tag));
        let distance = asked.and_then(|asked| asked.distance.metres());
        self.told = distance.map(|distance_m| Told {
            // The distance is that of the round before.
            round: poll.round.wrapping_sub(1),
            poll: poll_rx,
            range: [Range {
                peer: tag,
                distance_m,
                deviation_m: DEVIATION_M,
                position_m: None,
                diagnostics: frame.diagnostics,
            }],
        });
    }

    fn write(&mut self, destination: u16, message: Message) {
        self.sequence = self.sequence.wrapping_add(1);
        let Network { pan, .. } = self.config.network;
        Frame { sequence: self.sequence, pan, destination, source: self.config.address, message }.emit(&mut self.out);
    }

    fn listen(window: RadioDuration) -> Action<'static> {
        Action::Receive { start: Start::Now, window, keep_listening: true }
    }

    /// What is next in the course of the superframe: the beacon when it is due, else listening.
    fn schedule(&mut self, present: RadioInstant) -> Action<'_> {
        let timing = self.timing;
        let address = self.config.address;
        let network = match &mut self.network {
            Some(network) => network,
            None => {
                let patience = SEARCH_SUPERFRAMES * timing.superframe.ticks()
                    + i64::from(spread(address, 0, SEARCH_SPREAD)) * timing.beacon_slot.ticks();
                let found_at = *self.found_at.get_or_insert(present.plus(RadioDuration::from_ticks(patience)));
                let rest = found_at.since(present);
                if rest > RadioDuration::ZERO {
                    return Self::listen(rest);
                }
                self.network = Some(Coordination::found(address, present));
                self.found_at = None;
                return Action::Report(Report::Link(Link::Coordinating));
            }
        };
        // Early enough for a beacon in the first slot.
        let early = RadioDuration::from_ticks(timing.transmit_beacon.ticks() + 2 * WAKE.ticks());
        network.advance(&timing, present.plus(early));
        let passed = present.since(network.phase.start).ticks();
        let rest = RadioDuration::from_ticks(timing.superframe.ticks() - passed - early.ticks());
        let Some(slot) = network.due() else { return self.among_rounds(RadioDuration::from_ticks(passed), rest) };
        let rmarker = timing.beacon(slot.into());
        let ready = passed + timing.transmit_beacon.ticks() + timing.to_rmarker.ticks();
        let spare = RadioDuration::from_ticks(rmarker.ticks() - ready);
        if spare.ticks() > 2 * WAKE.ticks() {
            return Self::listen(RadioDuration::from_ticks(spare.ticks() - WAKE.ticks()));
        }
        if spare < RadioDuration::ZERO {
            network.skip();
            return Self::listen(rest);
        }
        let start = network.phase.at(rmarker).plus(RadioDuration::from_ticks(-self.config.antenna_delay.ticks()));
        let (beacon, takes_over) = network.tell(slot, self.position);
        if takes_over {
            self.link = Some(Link::Coordinating);
        }
        self.write(BROADCAST, Message::Beacon(beacon));
        Action::Transmit { frame: self.out.bytes(), start: Start::At(start), listen: true }
    }

    /// In the round slots: asks the other anchors in slots of its own, else listens.
    fn among_rounds(&mut self, passed: RadioDuration, rest: RadioDuration) -> Action<'_> {
        let timing = self.timing;
        let Some(network) = &mut self.network else { return Self::listen(rest) };
        self.asking.plan(network, self.config.address, &timing);
        let earliest = RadioDuration::from_ticks(passed.ticks() + timing.transmit.ticks());
        let Some(pulse) = self.asking.next(&timing, network.phase, earliest) else { return Self::listen(rest) };
        let spare = pulse.ticks() - earliest.ticks();
        if spare > 2 * WAKE.ticks() {
            return Self::listen(RadioDuration::from_ticks(spare - WAKE.ticks()));
        }
        let rmarker = network.phase.at(RadioDuration::from_ticks(pulse.ticks() + timing.to_rmarker.ticks()));
        // Its own lease.
        network.hear_tag(self.config.address);
        let poll = self.asking.poll(&timing, network.phase.at(pulse));
        self.write(BROADCAST, Message::Poll(poll));
        // At once would be before the slot, where the board is quicker than it must be: who listens goes by the slot.
        Action::Transmit { frame: self.out.bytes(), start: Start::At(rmarker), listen: true }
    }
}

impl Machine for Anchor {
    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        let mut present = now;
        match event {
            Event::Started => {
                self.network = None;
                self.found_at = None;
                self.answer = None;
                self.asking.restart();
            }
            Event::Sent(departure) => self.asking.sent(departure),
            Event::Received(frame) => {
                self.hear(&frame);
                present = self.timing.read_by(&self.config.network.phy, &frame);
            }
            Event::NotSent | Event::Corrupt | Event::Timeout | Event::Late | Event::Woken | Event::Reported => {}
        }
        if let Some(Answer { tag, start, response }) = self.answer.take() {
            self.write(tag, Message::Response(response));
            return Action::Transmit { frame: self.out.bytes(), start: Start::At(start), listen: true };
        }
        if let Some(link) = self.link.take() {
            return Action::Report(Report::Link(link));
        }
        if let Some(told) = self.told.take() {
            let Told { round, poll, range } = self.reported.insert(told);
            return Action::Report(Report::Round(Round { number: *round, poll: *poll, asked: 1, ranges: range }));
        }
        self.schedule(present)
    }

    fn calibrate(&mut self, antenna_delay: RadioDuration) {
        self.config.antenna_delay = antenna_delay;
    }
}
