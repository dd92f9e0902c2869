//! The anchor in native mode: answers polls, keeps and relays time, and coordinates if no other anchor does.

mod arrivals;
mod challenge;
mod incoming;
mod reports;
mod round_slots;

use heapless::Vec;

use self::arrivals::Arrivals;
use self::incoming::PostponedFrame;
use super::anchor_rounds::AnchorRounds;
use super::authentication::{Challenger, Moment, Opened, SealedPoll};
use super::compensation::Compensation;
use super::coordinator::Coordinator;
use super::downlinks::Downlinks;
use super::leases::Leases;
use super::memory::AnchorTables;
use super::pace::Meter;
use super::plan::Rate;
use super::timing::{Timing, end_of};
use super::uplink::Uplink;
use super::{Network, SHORTEST_WAIT, STAMP_DEVIATION_TICKS, spread};
use crate::exchange::{Action, Event, Link, Polled, Protocol, Range, Report, Round};
use crate::time::METRES_PER_TICK;
use crate::{Pace, RadioDuration, RadioInstant, StampModel, Start};
use wire::uwb::layout::Scheme;
use wire::uwb::native::{Downlink, FinalReceived, Message, Position, Response};
use wire::uwb::{Address, BROADCAST, FrameBuffer, Header};

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
    /// Answers a blink, behind the other blinks of its slot: this shows nothing of the node's pace.
    AnsweringBlink,
    /// Sends its sync frame.
    Syncing,
    /// Sends a relay frame.
    Relaying,
    /// Polls other anchors.
    Polling,
    /// Asks a session whether it is there.
    Challenging,
}

/// The anchor's side of native mode. It reports changes of its place in the network. Where a tag reports its
/// measurements, it also reports rounds of one range.
#[derive(Debug)]
#[cfg_attr(not(target_os = "none"), derive(Clone))]
pub struct Anchor<'m> {
    config: AnchorConfig,
    stamps: StampModel,
    meter: Meter,
    position: Option<Position>,
    network: Option<Coordinator>,
    leases: Leases<'m>,
    uplink: Uplink,
    downlinks: Downlinks,
    /// Without a network: the instant at which to found one.
    found_at: Option<RadioInstant>,
    /// It was the coordinator before it restarted, and gives others time to take over.
    awaits_successor: bool,
    challenger: Challenger,
    /// The network is known to be there. Until then the anchor only listens to it; it matters with a key.
    is_proven: bool,
    /// The sync frame of the slot before the own one.
    postponed: Option<PostponedFrame>,
    /// The end of a window that leaves enough time for a challenge.
    asks_at: Option<RadioInstant>,
    /// Frames without the code that the network's key gives them, or that were here before.
    refused: u32,
    opened: Opened,
    answer: Option<Answer>,
    /// The last response to each tag, and the final that followed the response.
    answered: Vec<Answered, MAX_ANSWERED>,
    rounds: AnchorRounds<'m>,
    compensation: Compensation,
    link: Option<Link>,
    told: Option<ReportedRange>,
    polled: Polled,
    /// The node has not taken it yet: when it came, and whether it names this anchor first.
    polled_at: Option<(RadioInstant, bool)>,
    /// The one that the node is reading.
    reported: Option<ReportedRange>,
    has_host: bool,
    arrivals: Arrivals,
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
    /// The end of the poll; `None` of a blink.
    polled: Option<RadioInstant>,
    start: RadioInstant,
    response: Response,
    /// The poll, in a network with a key.
    sealed: Option<SealedPoll>,
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

impl<'m> Anchor<'m> {
    /// An anchor that has not received any frame yet.
    #[cold]
    pub fn new(config: AnchorConfig, tables: AnchorTables<'m>) -> Self {
        Self {
            config,
            stamps: StampModel { antenna_delay: config.antenna_delay, ..StampModel::IDEAL },
            meter: Meter::new(config.network.pinned),
            position: config.position_m.and_then(Position::from_metres),
            network: None,
            leases: Leases::new(tables.leases),
            uplink: Uplink::new(config.address),
            downlinks: Downlinks::new(),
            found_at: None,
            awaits_successor: false,
            challenger: Challenger::default(),
            is_proven: false,
            postponed: None,
            asks_at: None,
            refused: 0,
            opened: Opened::default(),
            answer: None,
            answered: Vec::new(),
            rounds: AnchorRounds::new(config.rounds, tables.anchors),
            compensation: Compensation::default(),
            link: None,
            told: None,
            polled: Polled { tag: 0, round: 0, asked: 0, age: RadioDuration::ZERO, position: None, data: None },
            polled_at: None,
            reported: None,
            has_host: false,
            arrivals: Arrivals::default(),
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
        self.uplink.clear();
        self.downlinks.clear();
        self.arrivals.clear();
        self.answered.clear();
        (self.wake_at, self.pulse_at, self.asks_at) = (None, None, None);
        self.rounds.restart();
        self.challenger.restart();
        (self.is_proven, self.postponed) = (false, None);
    }

    fn write(&mut self, destination: u16, message: &Message) {
        self.sequence = self.sequence.wrapping_add(1);
        let [destination, source] = [destination, self.config.address].map(Address::Short);
        let header = Header { sequence: self.sequence, pan: self.config.network.pan, destination, source };
        message.emit(&header, &mut self.out);
    }

    /// Writes a frame to all nodes, of this moment. Returns what its round refers to, in a network with a key.
    fn write_to_all(&mut self, message: &Message, moment: Option<Moment>) -> Option<SealedPoll> {
        self.write(BROADCAST, message);
        let key = self.config.network.key.as_ref()?;
        Some(key.seal(&mut self.out, moment?))
    }

    fn listen(window: RadioDuration) -> Action<'static> {
        Action::Receive { start: Start::Now, window, keep_listening: true }
    }

    /// The next action in the superframe: the sync frame if it is due, else listening.
    #[inline(never)]
    fn schedule(&mut self, present: RadioInstant) -> Action<'_> {
        let (address, lead) = (self.config.address, self.meter.lead());
        let followed = &self.config.network;
        let network = match &mut self.network {
            Some(network) => network,
            None => {
                let first_layout = self.meter.first_layout();
                let timing = Timing::of(followed, first_layout);
                let patience = SEARCH_SUPERFRAMES * timing.superframe.ticks()
                    + i64::from(spread(address, 0, SEARCH_SPREAD)) * timing.sync_slot.ticks();
                let found_at = *self.found_at.get_or_insert(present.plus(RadioDuration::from_ticks(patience)));
                let rest = found_at.since(present);
                if rest > RadioDuration::ZERO {
                    return Self::listen(rest);
                }
                self.is_proven = true;
                let session = followed.key.as_ref().map(|key| self.challenger.draw(key));
                self.network = Some(Coordinator::found(address, followed, first_layout, present, session));
                self.found_at = None;
                return Action::Report(Report::Link(Link::Coordinating));
            }
        };
        // A superframe begins early for this node, because it must decide in time on a sync frame in the first slot.
        let early = RadioDuration::from_ticks(lead.ticks() + SHORTEST_WAIT.ticks());
        network.is_gateway = self.has_host;
        network.advance(followed, &mut self.leases, present.plus(early));
        let (timing, phase) = (network.course.timing, network.course.phase);
        let passed = present.since(phase.start).ticks();
        // A clock that jumped may have any value: a window is never negative.
        let rest = timing.superframe.ticks() - passed - early.ticks();
        let rest = RadioDuration::from_ticks(rest.max(SHORTEST_WAIT.ticks()));
        if !self.is_proven && followed.key.is_some() {
            if !self.challenger.is_waiting(present) {
                (self.network, self.found_at) = (None, Some(present));
            }
            return Self::listen(rest);
        }
        let Some(slot) = network.due() else { return self.among_rounds(RadioDuration::from_ticks(passed), rest) };
        let rmarker = timing.sync_frame(slot.into());
        let until_pulse = rmarker.ticks() - timing.to_rmarker.ticks() - passed;
        let spare = RadioDuration::from_ticks(until_pulse - lead.ticks());
        if spare > SHORTEST_WAIT {
            self.wake_at = Some(present.plus(spare));
            return Self::listen(spare);
        }
        // The anchor may have waited for another slot, which it has left since.
        let pulse_at = phase.at(RadioDuration::from_ticks(passed + until_pulse));
        self.wake_at = self.wake_at.filter(|wake| (0..=2 * lead.ticks()).contains(&pulse_at.since(*wake).ticks()));
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
        let answer = self.challenger.answer();
        let news = (&mut self.leases, &mut self.uplink, &mut self.downlinks);
        let (sync_frame, takes_over) = network.compose(news, slot, self.position, wish, answer);
        let moment = network.course.moment();
        if takes_over {
            self.link = Some(Link::Coordinating);
        }
        self.doing = Doing::Syncing;
        self.arrivals.own = sync_frame.superframe;
        self.write_to_all(&Message::SyncFrame(sync_frame), moment);
        Action::Transmit { frame: self.out.bytes(), start: Start::At(start), listen: true }
    }

    /// How much time there is before the answer to a blink: other blinks of its slot come before.
    fn spare_before_answer(&self, present: RadioInstant) -> Option<RadioDuration> {
        let answer = self.answer.as_ref().filter(|answer| answer.polled.is_none())?;
        let until_pulse = answer.start.since(present).ticks() - self.config.network.phy.time_to_rmarker().ticks();
        Some(RadioDuration::from_ticks(until_pulse - self.meter.lead().ticks()))
    }

    /// Learns from a late start if the radio did not measure it, and repeats what was missed.
    fn was_late(&mut self) {
        match (self.doing, self.was_measured) {
            (Doing::Answering(_), false) => self.meter.answer_was_late(),
            (Doing::Syncing | Doing::Relaying | Doing::Polling | Doing::Challenging, false) => {
                self.meter.lead_was_short();
            }
            (Doing::Nothing | Doing::AnsweringBlink, _) | (_, true) => {}
        }
        if let Some(network) = self.network.as_mut().filter(|_| self.doing == Doing::Syncing) {
            network.was_late();
        }
    }
}

impl Protocol for Anchor<'_> {
    fn set_host(&mut self, has_host: bool) {
        self.has_host = has_host;
        self.uplink.set_host(has_host);
    }

    fn send_down(&mut self, message: Downlink) {
        self.downlinks.send(message, self.config.address);
    }

    fn refused_frames(&self) -> u32 {
        self.refused
    }

    fn pace(&mut self, pace: Pace) {
        self.listening_at = pace.listening;
        self.was_measured = pace.armed.is_some();
        let Some(armed) = pace.armed else { return };
        match (self.doing, self.wake_at.take()) {
            (Doing::Answering(polled), _) => self.meter.answered(armed.since(polled)),
            (Doing::Syncing | Doing::Relaying | Doing::Polling, Some(wake)) => {
                self.meter.led(armed.since(wake), self.was_awaited)
            }
            (Doing::Challenging, _) => {
                if let Some(wake) = self.asks_at.take() {
                    self.meter.led(armed.since(wake), self.was_awaited);
                }
            }
            (Doing::Syncing | Doing::Relaying | Doing::Polling, None) | (Doing::Nothing | Doing::AnsweringBlink, _) => {
            }
        }
    }

    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        let mut present = now;
        self.was_awaited = matches!(event, Event::Timeout | Event::Woken);
        if self.network.as_ref().is_some_and(|network| network.course.is_beyond(now)) {
            self.restart();
        }
        if self.doing == Doing::Syncing {
            self.catch_up();
        }
        if event != Event::Reported {
            self.arrivals.begin();
        }
        match event {
            Event::Started => self.restart(),
            Event::Sent(departure) => match self.doing {
                Doing::Polling => self.rounds.sent(departure),
                Doing::Syncing => self.arrivals.departure(self.config.address, departure),
                Doing::Nothing | Doing::Answering(_) | Doing::AnsweringBlink | Doing::Relaying | Doing::Challenging => {
                }
            },
            Event::Received(frame) => {
                self.take(&frame);
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
        let answer_in = self.spare_before_answer(present);
        if answer_in.is_none_or(|spare| spare <= SHORTEST_WAIT)
            && let Some(Answer { tag, polled, start, response, sealed }) = self.answer.take()
        {
            self.doing = polled.map_or(Doing::AnsweringBlink, Doing::Answering);
            self.write(tag, &Message::Response(response));
            if let Some((key, poll)) = self.config.network.key.as_ref().zip(sealed.as_ref()) {
                key.seal_response(&mut self.out, poll);
            }
            return Action::Transmit { frame: self.out.bytes(), start: Start::At(start), listen: true };
        }
        if let Some(link) = self.link.take() {
            return Action::Report(Report::Link(link));
        }
        if let Some(told) = self.told.take() {
            let ReportedRange { round, poll, range } = self.reported.insert(told);
            return Action::Report(Report::Round(Round { number: *round, poll: *poll, asked: 1, ranges: range }));
        }
        if self.takes_polled() || self.takes_relayed(present) {
            return Action::Report(Report::Polled(&self.polled));
        }
        if !self.is_syncing_soon(present)
            && let Some(arrival) = self.arrivals.next()
        {
            return Action::Report(Report::Arrival(arrival));
        }
        let spare = self.spare_before_challenge(present);
        if spare.is_some_and(|spare| spare <= SHORTEST_WAIT)
            && let Some(at) = self.write_challenge(present)
        {
            let start = Start::At(at.plus(RadioDuration::from_ticks(-self.stamps.antenna_delay.ticks())));
            return Action::Transmit { frame: self.out.bytes(), start, listen: true };
        }
        let spare = [spare.filter(|spare| *spare > SHORTEST_WAIT), answer_in].into_iter().flatten().min();
        match (self.schedule(present), spare) {
            (Action::Receive { start, window, keep_listening }, Some(spare)) => {
                Action::Receive { start, window: window.min(spare), keep_listening }
            }
            (action, _) => action,
        }
    }

    fn calibrate(&mut self, stamps: &StampModel) {
        self.stamps = *stamps;
        self.rounds.calibrate(stamps);
    }
}
