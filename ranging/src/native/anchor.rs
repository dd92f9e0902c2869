//! The anchor in native mode: answers polls, keeps and relays time, and coordinates if no other anchor does.

use heapless::Vec;

use super::anchor_rounds::AnchorRounds;
use super::compensation::Compensation;
use super::coordinator::{Coordinator, FollowUpdate};
use super::leases::Leases;
use super::pace::Meter;
use super::plan::Rate;
use super::timing::{SYNC_SLOTS, Timing, end_of};
use super::{Network, SHORTEST_WAIT, STAMP_DEVIATION_TICKS, spread};
use crate::exchange::{Action, COMPENSATION, Event, Link, Polled, Protocol, Range, Report, Round};
use crate::time::METRES_PER_TICK;
use crate::{Pace, RadioDuration, RadioInstant, RxFrame, StampModel, Start};
use wire::uwb::layout::Scheme;
use wire::uwb::native::{FinalReceived, Frame, Member, Message, Poll, Position, Response, SyncFrame};
use wire::uwb::{BROADCAST, FrameBuffer};

/// The configuration of an anchor.
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
    /// Position, metres, once surveyed.
    pub position_m: Option<[f32; 3]>,
    /// How often the anchor ranges to the other anchors, for tags that only listen; `None`: never.
    pub rounds: Option<Rate>,
}

/// The anchor listens for a network for this number of superframes before it founds one …
const SEARCH_SUPERFRAMES: i64 = 2;
/// … and for a number of sync slots that follows from the address, less than this number. So one of several anchors
/// switched on together is the first.
const SEARCH_SPREAD: u16 = 128;
/// Tags whose finals are awaited. Of more tags, those that are silent longest get single-sided ranges.
const MAX_ANSWERED: usize = 32;
/// Standard deviation of a distance reported by a tag: two timestamps, halved (see [`tof`](crate::tof)).
const DEVIATION_M: f32 = 0.5 * core::f32::consts::SQRT_2 * STAMP_DEVIATION_TICKS * METRES_PER_TICK as f32;

/// The purpose of the anchor's last action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Doing {
    /// Listening, reporting.
    Nothing,
    /// Answers a poll that ended at this instant.
    Answering(RadioInstant),
    /// Sends its sync frame.
    Syncing,
    /// Polls other anchors.
    Polling,
}

/// The anchor's side of native mode. It reports changes of its place in the network. Where a tag reports its
/// measurements, it also reports rounds of one range.
#[derive(Clone, Debug)]
pub struct Anchor {
    config: AnchorConfig,
    stamps: StampModel,
    meter: Meter,
    position: Option<Position>,
    network: Option<Coordinator>,
    leases: Leases,
    /// Without a network: the instant at which to found one.
    found_at: Option<RadioInstant>,
    answer: Option<Answer>,
    /// The last response to each tag, and the final that followed the response.
    answered: Vec<Answered, MAX_ANSWERED>,
    rounds: AnchorRounds,
    compensation: Compensation,
    link: Option<Link>,
    told: Option<ReportedRange>,
    polled: Polled,
    /// The node has not taken it yet.
    is_polled: bool,
    /// The one that the node is reading.
    reported: Option<ReportedRange>,
    doing: Doing,
    /// The end of a window that leaves enough time for a transmission.
    wake_at: Option<RadioInstant>,
    /// The first pulse of the poll that was waited for.
    pulse_at: Option<RadioInstant>,
    /// The last decision was made at the end of a wait or a window, and not after a frame.
    was_awaited: bool,
    /// The radio reported when the command of the last transmission had reached it.
    was_measured: bool,
    /// When the receiver was on again after the last frame, if the radio reported it.
    listening_at: Option<RadioInstant>,
    sequence: u8,
    out: FrameBuffer,
}

/// A response that is due at an instant.
#[derive(Clone, Copy, Debug)]
struct Answer {
    tag: u16,
    /// The end of the poll.
    polled: RadioInstant,
    start: RadioInstant,
    response: Response,
}

/// The last response to a tag.
#[derive(Clone, Copy, Debug)]
struct Answered {
    tag: u16,
    round: u16,
    departure: RadioInstant,
    final_heard: Option<FinalReceived>,
}

/// A distance that a tag has reported.
#[derive(Clone, Copy, Debug)]
struct ReportedRange {
    round: u16,
    poll: RadioInstant,
    range: [Range; 1],
}

impl Anchor {
    /// An anchor that has not received any frame yet.
    #[cold]
    pub fn new(config: AnchorConfig) -> Self {
        Self {
            config,
            stamps: StampModel { antenna_delay: config.antenna_delay, ..StampModel::IDEAL },
            meter: Meter::new(config.network.pinned),
            position: config.position_m.and_then(Position::from_metres),
            network: None,
            leases: Leases::new(),
            found_at: None,
            answer: None,
            answered: Vec::new(),
            rounds: AnchorRounds::new(config.rounds),
            compensation: Compensation::default(),
            link: None,
            told: None,
            polled: Polled { tag: 0, round: 0, asked: 0, position: None, data: None },
            is_polled: false,
            reported: None,
            doing: Doing::Nothing,
            wake_at: None,
            pulse_at: None,
            was_awaited: false,
            was_measured: false,
            listening_at: None,
            sequence: 0,
            out: FrameBuffer::new(),
        }
    }

    /// Nothing is known of the network and of the time any more.
    #[cold]
    fn restart(&mut self) {
        (self.network, self.found_at, self.answer) = (None, None, None);
        self.leases.clear();
        self.answered.clear();
        (self.wake_at, self.pulse_at) = (None, None);
        self.rounds.restart();
    }

    fn receive(&mut self, frame: &RxFrame<'_>) {
        // By reference: a message takes hundreds of bytes, and each copy as many instructions.
        let parsed = Frame::parse(frame.bytes);
        let Some(told) = parsed.as_ref().ok().filter(|told| told.pan == self.config.network.pan) else { return };
        let everyone = told.destination == BROADCAST;
        match &told.message {
            Message::Poll(poll) if everyone => self.on_poll(told.source, poll, frame),
            Message::Request(request) if everyone => {
                if let Some(network) = &mut self.network {
                    network.request(&mut self.leases, Member { tag: told.source, share: request.share }, false);
                    network.wish(told.source, request.wish);
                }
            }
            Message::SyncFrame(sync_frame) if everyone => self.on_sync_frame(told.source, sync_frame, frame),
            Message::Response(response) if told.destination == self.config.address => {
                if let Some(network) = &self.network {
                    self.rounds.answer(&network.course.timing, told.source, *response, frame);
                }
            }
            Message::Final { round } if everyone => self.on_final(told.source, *round, frame.rx_time),
            // Messages for other anchors, or not addressed to this anchor.
            Message::Poll(_)
            | Message::Request(_)
            | Message::SyncFrame(_)
            | Message::Response(_)
            | Message::Final { .. } => {}
        }
    }

    fn on_sync_frame(&mut self, source: u16, sync_frame: &SyncFrame, frame: &RxFrame<'_>) {
        if usize::from(sync_frame.slot) >= SYNC_SLOTS || source == self.config.address {
            return;
        }
        self.rounds.receive(source);
        let phy = &self.config.network.phy;
        match &mut self.network {
            Some(network) => match network.receive(phy, &mut self.leases, source, sync_frame, frame.rx_time) {
                FollowUpdate::Ignored | FollowUpdate::Followed => {}
                FollowUpdate::Changed(link) => self.link = Some(link),
            },
            None => {
                self.network = Coordinator::join(self.config.address, phy, source, sync_frame, frame.rx_time);
                self.link = self.network.as_ref().map(|_| Link::Synchronised(sync_frame.coordinator));
            }
        }
    }

    fn on_final(&mut self, tag: u16, round: u16, rx_time: RadioInstant) {
        let answered = self.answered.iter_mut().find(|answered| answered.tag == tag && answered.round == round);
        if let Some(answered) = answered {
            let after_response = rx_time.since(answered.departure);
            answered.final_heard = Some(FinalReceived { round: round as u8, after_response });
        }
    }

    /// A response to a tag in a round leaves at `departure`. Returns the final of the round before, if it was received.
    fn note_response(&mut self, tag: u16, round: u16, departure: RadioInstant) -> Option<FinalReceived> {
        let last = self.answered.iter().position(|answered| answered.tag == tag);
        let final_heard = last.and_then(|place| self.answered.remove(place).final_heard);
        if self.answered.is_full() {
            // The one that has been silent longest.
            self.answered.remove(0);
        }
        // There is a place now.
        let _ = self.answered.push(Answered { tag, round, departure, final_heard: None });
        final_heard
    }

    fn on_poll(&mut self, tag: u16, poll: &Poll, frame: &RxFrame<'_>) {
        // An anchor without a network knows no layout, and so does not know when to answer.
        let Some(network) = &mut self.network else { return };
        let timing = network.course.timing;
        let pulse = frame.rx_time.plus(RadioDuration::from_ticks(-timing.to_rmarker.ticks()));
        let lease = network.on_poll(&mut self.leases, tag, poll.wish, pulse);
        let asked = poll.anchors.len() as u8;
        let Poll { round, position, data, .. } = *poll;
        self.is_polled = position.is_some() || data.is_some();
        if self.is_polled {
            self.polled = Polled { tag, round, asked, position, data };
        }
        let named = |place: &usize| poll.anchors.get(*place).is_some_and(|asked| asked.address == self.config.address);
        let Some(place) = (0..poll.anchors.len()).find(named) else { return };
        let slot = poll.first_slot() + place;
        let poll_rx = frame.rx_time;
        let antenna_delay = self.stamps.antenna_delay;
        let start = poll_rx.plus(timing.reply_in(slot)).plus(RadioDuration::from_ticks(-antenna_delay.ticks()));
        // The chip starts at the snapped instant: the response must contain that instant.
        let departure = self.stamps.departure(start);
        let last_final = self.note_response(tag, poll.round, departure);
        // A long response is only for rounds that have room for it.
        let last_final = last_final.filter(|_| timing.layout.scheme == Scheme::DoubleSided);
        let reply = departure.since(poll_rx);
        let response = Response { round: poll.round as u8, lease, poll_rx, reply, last_final };
        let polled = end_of(&self.config.network.phy, frame);
        self.answer = Some(Answer { tag, polled, start, response });
        // The distances in another anchor's poll are for tags that only listen.
        let asked = poll.anchors.get(place).filter(|_| !self.rounds.knows(tag));
        let distance = asked.and_then(|asked| asked.distance.metres());
        self.told = distance.map(|distance_m| ReportedRange {
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

    /// The next action in the superframe: the sync frame if it is due, else listening.
    fn schedule(&mut self, present: RadioInstant) -> Action<'_> {
        let (address, lead) = (self.config.address, self.meter.lead());
        let phy = &self.config.network.phy;
        let network = match &mut self.network {
            Some(network) => network,
            None => {
                let first_layout = self.meter.first_layout();
                let timing = Timing::of(phy, first_layout);
                let patience = SEARCH_SUPERFRAMES * timing.superframe.ticks()
                    + i64::from(spread(address, 0, SEARCH_SPREAD)) * timing.sync_slot.ticks();
                let found_at = *self.found_at.get_or_insert(present.plus(RadioDuration::from_ticks(patience)));
                let rest = found_at.since(present);
                if rest > RadioDuration::ZERO {
                    return Self::listen(rest);
                }
                self.network = Some(Coordinator::found(address, phy, first_layout, present));
                self.found_at = None;
                return Action::Report(Report::Link(Link::Coordinating));
            }
        };
        // A superframe begins early for this node, because it must decide in time on a sync frame in the first slot.
        let early = RadioDuration::from_ticks(lead.ticks() + SHORTEST_WAIT.ticks());
        network.advance(phy, &mut self.leases, present.plus(early));
        let (timing, phase) = (network.course.timing, network.course.phase);
        let passed = present.since(phase.start).ticks();
        // A clock that jumped may have any value: a window is never negative.
        let rest = timing.superframe.ticks() - passed - early.ticks();
        let rest = RadioDuration::from_ticks(rest.max(SHORTEST_WAIT.ticks()));
        let Some(slot) = network.due() else { return self.among_rounds(RadioDuration::from_ticks(passed), rest) };
        let rmarker = timing.sync_frame(slot.into());
        let until_pulse = rmarker.ticks() - timing.to_rmarker.ticks() - passed;
        let spare = RadioDuration::from_ticks(until_pulse - lead.ticks());
        if spare > SHORTEST_WAIT {
            self.wake_at = Some(present.plus(spare));
            return Self::listen(spare);
        }
        if until_pulse <= 0 {
            // The slot was awaited and missed: there is another chance in this superframe. Otherwise the slot was
            // chosen after it had passed.
            if let Some(wake) = self.wake_at.take() {
                self.meter.overslept(present.since(wake));
                network.was_late();
            } else {
                network.skip();
            }
            return Self::listen(SHORTEST_WAIT);
        }
        let start = phase.at(rmarker).plus(RadioDuration::from_ticks(-self.stamps.antenna_delay.ticks()));
        // Tags ask for the room for finals.
        let wish = self.meter.wish(Scheme::SingleSided);
        let (sync_frame, takes_over) = network.compose(&mut self.leases, slot, self.position, wish);
        if takes_over {
            self.link = Some(Link::Coordinating);
        }
        self.doing = Doing::Syncing;
        self.write(BROADCAST, Message::SyncFrame(sync_frame));
        Action::Transmit { frame: self.out.bytes(), start: Start::At(start), listen: true }
    }

    /// In the round slots: ranges to the other anchors in slots of its own, else listens.
    fn among_rounds(&mut self, passed: RadioDuration, rest: RadioDuration) -> Action<'_> {
        let lead = self.meter.lead();
        let Some(network) = &mut self.network else { return Self::listen(rest) };
        let timing = network.course.timing;
        self.rounds.plan(network, &mut self.leases, self.config.address);
        let phase = network.course.phase;
        let in_time = RadioDuration::from_ticks(passed.ticks() + lead.ticks());
        // The anchor was woken for a round. It makes the round if the round's instant is still in the future.
        let spare = |pulse: RadioDuration| RadioDuration::from_ticks(pulse.ticks() - passed.ticks() - lead.ticks());
        let planned = self.pulse_at.take().map(|pulse| pulse.since(phase.start));
        if let Some(wake) = self.wake_at.filter(|_| planned.is_some_and(|pulse| pulse <= passed)) {
            self.meter.overslept(phase.at(passed).since(wake));
        }
        let planned = planned.filter(|pulse| *pulse > passed && spare(*pulse) <= SHORTEST_WAIT);
        let Some(pulse) = planned.or_else(|| self.rounds.next(&timing, phase, in_time)) else {
            let is_due = rest > COMPENSATION && self.compensation.take(phase.number, self.config.address);
            return if is_due { Action::Compensate } else { Self::listen(rest) };
        };
        let pulse_at = phase.at(pulse);
        if spare(pulse) > SHORTEST_WAIT {
            let wake = pulse_at.plus(RadioDuration::from_ticks(-lead.ticks()));
            (self.wake_at, self.pulse_at) = (Some(wake), Some(pulse_at));
            return Self::listen(spare(pulse));
        }
        self.wake_at = self.wake_at.filter(|_| planned.is_some());
        let rmarker = pulse_at.plus(timing.to_rmarker);
        // This anchor renews its own lease.
        network.on_tag(self.config.address);
        let poll = self.rounds.poll(&timing, pulse_at, self.meter.reading(), self.meter.wish(Scheme::SingleSided));
        self.doing = Doing::Polling;
        self.write(BROADCAST, Message::Poll(poll));
        // A start at once would be before the slot if the board is quicker than required. Listening tags rely on the
        // slot.
        Action::Transmit { frame: self.out.bytes(), start: Start::At(rmarker), listen: true }
    }

    /// Learns from a late start if the radio did not measure it, and repeats what was missed.
    fn was_late(&mut self) {
        match (self.doing, self.was_measured) {
            (Doing::Answering(_), false) => self.meter.answer_was_late(),
            (Doing::Syncing | Doing::Polling, false) => self.meter.lead_was_short(),
            (Doing::Nothing, _) | (_, true) => {}
        }
        if let Some(network) = self.network.as_mut().filter(|_| self.doing == Doing::Syncing) {
            network.was_late();
        }
    }
}

impl Protocol for Anchor {
    fn pace(&mut self, pace: Pace) {
        self.listening_at = pace.listening;
        self.was_measured = pace.armed.is_some();
        let Some(armed) = pace.armed else { return };
        match (self.doing, self.wake_at.take()) {
            (Doing::Answering(polled), _) => self.meter.answered(armed.since(polled)),
            (Doing::Syncing | Doing::Polling, Some(wake)) => self.meter.led(armed.since(wake), self.was_awaited),
            (Doing::Syncing | Doing::Polling, None) | (Doing::Nothing, _) => {}
        }
    }

    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        let mut present = now;
        self.was_awaited = matches!(event, Event::Timeout | Event::Woken);
        if self.network.as_ref().is_some_and(|network| network.course.is_beyond(now)) {
            self.restart();
        }
        match event {
            Event::Started => self.restart(),
            Event::Sent(departure) => {
                if self.doing == Doing::Polling {
                    self.rounds.sent(departure);
                }
            }
            Event::Received(frame) => {
                self.receive(&frame);
                let ended = end_of(&self.config.network.phy, &frame);
                present = ended.plus(self.meter.reading());
                if let Some(listening) = self.listening_at.take() {
                    let after = listening.since(ended);
                    match self.config.rounds {
                        Some(_) => self.meter.listened_for_listeners(after),
                        None => self.meter.listened(after),
                    }
                }
            }
            Event::Late => self.was_late(),
            Event::NotSent | Event::Corrupt | Event::Timeout | Event::Woken | Event::Reported => {}
        }
        self.doing = Doing::Nothing;
        if let Some(Answer { tag, polled, start, response }) = self.answer.take() {
            self.doing = Doing::Answering(polled);
            self.write(tag, Message::Response(response));
            return Action::Transmit { frame: self.out.bytes(), start: Start::At(start), listen: true };
        }
        if let Some(link) = self.link.take() {
            return Action::Report(Report::Link(link));
        }
        if let Some(told) = self.told.take() {
            let ReportedRange { round, poll, range } = self.reported.insert(told);
            return Action::Report(Report::Round(Round {
                number: *round,
                poll: *poll,
                asked: 1,
                refused: 0,
                ranges: range,
            }));
        }
        if core::mem::take(&mut self.is_polled) {
            return Action::Report(Report::Polled(&self.polled));
        }
        self.schedule(present)
    }

    fn calibrate(&mut self, stamps: &StampModel) {
        self.stamps = *stamps;
        self.rounds.calibrate(stamps);
    }
}
