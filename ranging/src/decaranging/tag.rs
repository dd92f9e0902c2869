//! The tag of DecaRanging: blinks, polls, sends its instants in the final, and waits for the report or for the next
//! response, which has the time of flight.

use super::paired::Paired;
use super::{Compensation, DEVIATION_M, FLIGHTS_IN_SUM, Mean, Software, bytes_on_air, header, least_reply, short};
use crate::exchange::{Action, COMPENSATION, Event, Guidance, Link, Protocol, Range, Report, Round};
use crate::native::{Rate, ReplyDelay};
use crate::radio::Sensors;
use crate::{PhyConfig, RadioDuration, RadioInstant, RxFrame, StampModel, Start, TimeOfFlight};
use wire::uwb::decaranging::{Answer, Blink, Final, Frame, LONGEST_BYTES, Message, REPORT_FOLLOWS, Variant};
use wire::uwb::{Address, FrameBuffer, Header};

/// The configuration of a tag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TagConfig {
    /// EUI-64.
    pub eui: u64,
    /// The variant of the messages.
    pub variant: Variant,
    /// The radio configuration of the frames.
    pub phy: PhyConfig,
    /// The reply delay of this board.
    pub turnaround: ReplyDelay,
    /// What the radio adds to the snapped start of a transmission, as [`Radio::departure`](crate::Radio::departure)
    /// does.
    pub antenna_delay: RadioDuration,
    /// From one poll to the next, 8 s at most.
    pub period: RadioDuration,
}

/// From one blink to the next.
const BLINK_PERIOD: RadioDuration = RadioDuration::from_micros(1_000_000);
/// A tag without an answer for this long, and for [`UNANSWERED`] polls, blinks again.
const LOST_AFTER: RadioDuration = RadioDuration::from_micros(1_000_000);
const UNANSWERED: u8 = 8;

/// The receiver is switched off if a response is further away than this. It is switched on again this long before the
/// response.
const LEAD: RadioDuration = RadioDuration::from_micros(3_000);

/// What the tag is waiting for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    /// The next blink or poll.
    Between,
    /// A blink is leaving.
    Blinking,
    /// A ranging init, until the next blink.
    AwaitingInit,
    /// A poll is leaving.
    Polling,
    /// The response, until then; it cannot come before `from`.
    AwaitingResponse { from: RadioInstant, until: RadioInstant },
    /// A final is leaving. The tag waits for the report after it.
    Finishing,
    /// The report, until then.
    AwaitingReport { until: RadioInstant },
}

/// The tag's side of DecaRanging. It reports rounds of one range, and pairings.
#[derive(Clone, Debug)]
pub struct Tag {
    config: TagConfig,
    stamps: StampModel,
    state: State,
    paired: Option<Paired>,
    /// When the next blink or poll is due.
    next: Option<RadioInstant>,
    poll_tx: RadioInstant,
    resp_rx: RadioInstant,
    /// The radio's raw temperature and voltage, which polls of the standard variant contain.
    readings: [u8; 2],
    compensation: Compensation,
    link: Option<Link>,
    number: u16,
    /// The poll of the last finished exchange whose distance is not known yet.
    finished: Option<RadioInstant>,
    /// The range to be reported, and its poll.
    range: Option<(RadioInstant, [Range; 1])>,
    /// The range that the node is reading.
    reported: Option<[Range; 1]>,
    mean: Mean,
    sequence: u8,
    out: FrameBuffer,
}

impl Tag {
    /// A tag that no anchor has taken yet.
    pub fn new(config: TagConfig) -> Self {
        Self {
            config,
            stamps: StampModel { antenna_delay: config.antenna_delay, ..StampModel::IDEAL },
            state: State::Between,
            paired: None,
            next: None,
            poll_tx: RadioInstant::default(),
            resp_rx: RadioInstant::default(),
            readings: [0; 2],
            compensation: Compensation::new(),
            link: None,
            number: 0,
            finished: None,
            range: None,
            reported: None,
            mean: Mean::new(),
            sequence: 0,
            out: FrameBuffer::new(),
        }
    }

    /// The mean of the last eight ranges, metres.
    pub fn mean_m(&self) -> Option<f32> {
        self.mean.metres()
    }

    fn next_sequence(&mut self) -> u8 {
        self.sequence = self.sequence.wrapping_add(1);
        self.sequence
    }

    /// Writes a frame to the anchor.
    fn write(&mut self, paired: &Paired, message: Message) {
        let header = header(self.next_sequence(), paired.anchor, paired.tag);
        Frame { header, message }.emit(&mut self.out);
    }

    fn receive(&mut self, frame: &RxFrame<'_>) {
        let Ok(Frame { header, message }) = Frame::parse(frame.bytes) else { return };
        if let Message::RangingInit { tag, anchor_delay, tag_delay } = message {
            let addressed = header.destination == Address::Extended(self.config.eui);
            if addressed && self.state == State::AwaitingInit {
                self.pair(&header, tag, anchor_delay, tag_delay, frame.rx_time);
            }
            return;
        }
        let Some(paired) = &mut self.paired else { return };
        if header.source != paired.anchor || header.destination != paired.tag || header.sequence == paired.sequence {
            return;
        }
        match (self.state, message) {
            (State::AwaitingResponse { .. }, Message::Response(variant, Answer { parameter: [told, _], tof }))
                if variant == self.config.variant =>
            {
                (paired.heard, paired.sequence) = (frame.rx_time, header.sequence);
                paired.flights = if told == REPORT_FOLLOWS { FLIGHTS_IN_SUM as f32 } else { 1.0 };
                paired.answered(frame.rx_time.since(self.poll_tx));
                let least = least_reply(&self.config.phy, &self.config.turnaround, bytes_on_air(frame));
                paired.tag_delay = paired.tag_delay.max(least);
                self.resp_rx = frame.rx_time;
                self.state = State::Finishing;
                // The time of flight belongs to the exchange before, whose final may have been lost: 0 means none.
                let tof = tof.filter(|tof| *tof != RadioDuration::ZERO);
                if let (Some(tof), Some(poll)) = (tof, self.finished.take()) {
                    self.ranged(poll, tof, frame);
                }
            }
            (State::AwaitingReport { .. }, Message::Report(variant, ticks)) if variant == self.config.variant => {
                paired.sequence = header.sequence;
                self.ranged(self.poll_tx, ticks, frame);
                self.state = State::Between;
            }
            _ => {}
        }
    }

    /// An anchor takes the tag.
    fn pair(&mut self, header: &Header, tag: u16, anchor_delay: u16, tag_delay: Option<u16>, heard: RadioInstant) {
        let anchor = header.source;
        // Long addresses are kept if the anchor uses its own long address. Short addresses are those of the init.
        // 0xFFFF and 0xFFFE belong to no node.
        let tag = match (anchor, tag) {
            (Address::Extended(_), _) => Address::Extended(self.config.eui),
            (Address::Short(_), 0..0xFFFE) => Address::Short(tag),
            (Address::Short(_), 0xFFFE..) => return,
        };
        let least = least_reply(&self.config.phy, &self.config.turnaround, LONGEST_BYTES);
        let mut paired = Paired::new((anchor, tag), (anchor_delay, tag_delay), least, self.config.variant);
        (paired.heard, paired.sequence) = (heard, header.sequence);
        self.paired = Some(paired);
        self.link = Some(Link::Paired(short(anchor)));
        self.state = State::Between;
        (self.next, self.finished) = (None, None);
        self.mean = Mean::new();
    }

    /// The distance of an exchange is known, from the anchor's report.
    fn ranged(&mut self, poll: RadioInstant, told: RadioDuration, frame: &RxFrame<'_>) {
        let Some(paired) = &self.paired else { return };
        let diagnostics = frame.diagnostics;
        let flight_m = TimeOfFlight::from_ticks(told.ticks()).metres() / paired.flights;
        let distance_m = flight_m - self.stamps.range_bias.metres(diagnostics.rx_power_dbm);
        self.mean.add(distance_m);
        let (peer, deviation_m) = (short(paired.anchor), DEVIATION_M);
        self.range = Some((poll, [Range { peer, distance_m, deviation_m, position_m: None, diagnostics }]));
    }

    /// A wait has ended without the expected frame.
    fn give_up(&mut self, now: RadioInstant) {
        let awaited = matches!(self.state, State::AwaitingResponse { .. });
        self.state = State::Between;
        let Some(paired) = self.paired.as_mut().filter(|_| awaited) else { return };
        paired.unanswered = paired.unanswered.saturating_add(1);
        // If the response was lost, a stock anchor does not listen until the final is due.
        let deaf_until = now.plus(paired.delay(paired.tag_delay));
        if self.next.is_some_and(|next| deaf_until.since(next) > RadioDuration::ZERO) {
            self.next = Some(deaf_until);
        }
        if paired.unanswered >= UNANSWERED && now.since(paired.heard) > LOST_AFTER {
            self.link = Some(Link::Lost(short(paired.anchor)));
            self.paired = None;
            self.next = None;
        }
    }

    fn finish(&mut self, paired: &Paired) -> Action<'_> {
        let delay = self.stamps.antenna_delay;
        let start = self.resp_rx.plus(paired.delay(paired.tag_delay)).plus(RadioDuration::from_ticks(-delay.ticks()));
        // The chip starts at the snapped instant: the final must contain that instant.
        let final_tx = self.stamps.departure(start);
        let (poll_tx, resp_rx) = (self.poll_tx, self.resp_rx);
        let told = match self.config.variant {
            Variant::Standard => Final::Instants { poll_tx, resp_rx, final_tx },
            Variant::Fast => Final::Intervals { reply2: final_tx.since(resp_rx), round1: resp_rx.since(poll_tx) },
        };
        self.write(paired, Message::Final(told));
        Action::Transmit { frame: self.out.bytes(), start: Start::At(start), listen: true }
    }

    /// Between exchanges: the next blink or poll when it is due.
    fn begin(&mut self, now: RadioInstant) -> Action<'_> {
        let due = *self.next.get_or_insert(now);
        if due.since(now) > RadioDuration::ZERO {
            // Between exchanges nothing depends on the clock, except a distance that comes later. A restart begins with
            // the next poll or blink.
            return match self.finished {
                None if due.since(now) > COMPENSATION && self.compensation.take() => Action::Compensate,
                None => Action::Sleep { from: now, duration: due.since(now) },
                Some(_) => Action::WaitUntil(due),
            };
        }
        match self.paired {
            None => {
                let blink = Blink { sequence: self.next_sequence(), tag: self.config.eui };
                blink.emit(&mut self.out);
                self.next = Some(now.plus(BLINK_PERIOD));
                self.state = State::Blinking;
            }
            Some(paired) => {
                let readings = match (self.config.variant, paired.software) {
                    (Variant::Standard, Software::Units | Software::Millis) => Some(self.readings),
                    // An anchor of newer software counts its delay from the end of a poll without readings.
                    (Variant::Standard, Software::Delays) | (Variant::Fast, _) => None,
                };
                self.write(&paired, Message::Poll(self.config.variant, readings));
                // After a pause a new rhythm begins.
                let next = due.plus(self.config.period);
                let late = now.since(next) > RadioDuration::ZERO;
                self.next = Some(if late { now.plus(self.config.period) } else { next });
                self.compensation.count();
                self.state = State::Polling;
            }
        }
        Action::Transmit { frame: self.out.bytes(), start: Start::Now, listen: true }
    }
}

impl Protocol for Tag {
    fn sense(&mut self, sensors: Sensors) {
        self.readings = sensors.raw;
    }

    fn guide(&mut self, guidance: Guidance) {
        match guidance.rate {
            Some(Rate::Every(period)) => self.config.period = period,
            // There are no slots here.
            Some(Rate::Greedy) | None => {}
        }
    }

    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        match event {
            Event::Started => {
                self.state = State::Between;
                (self.next, self.finished) = (None, None);
                if let Some(paired) = &mut self.paired {
                    paired.heard = now;
                }
            }
            Event::Sent(departure) => match self.state {
                State::Blinking => self.state = State::AwaitingInit,
                State::Polling => {
                    self.poll_tx = departure;
                    self.state = self.paired.map_or(State::Between, |paired| {
                        let lead = LEAD.ticks() + self.config.phy.time_to_rmarker().ticks();
                        let from = departure.plus(RadioDuration::from_ticks(paired.silence().ticks() - lead));
                        State::AwaitingResponse { from, until: departure.plus(paired.response_patience()) }
                    });
                }
                State::Finishing => match self.paired {
                    Some(Paired { software: Software::Delays, .. }) => {
                        self.finished = Some(self.poll_tx);
                        self.state = State::Between;
                    }
                    Some(paired) => {
                        self.state = State::AwaitingReport { until: departure.plus(paired.report_patience()) };
                    }
                    None => self.state = State::Between,
                },
                State::Between
                | State::AwaitingInit
                | State::AwaitingResponse { .. }
                | State::AwaitingReport { .. } => {}
            },
            Event::Received(frame) => self.receive(&frame),
            Event::Timeout | Event::Late | Event::NotSent => self.give_up(now),
            Event::Corrupt | Event::Woken | Event::Reported => {}
        }
        // Nothing may delay the final.
        if let (State::Finishing, Some(paired)) = (self.state, self.paired) {
            return self.finish(&paired);
        }
        if let Some(link) = self.link.take() {
            return Action::Report(Report::Link(link));
        }
        if let Some((poll, range)) = self.range.take() {
            self.number = self.number.wrapping_add(1);
            let ranges = &*self.reported.insert(range);
            return Action::Report(Report::Round(Round { number: self.number, poll, asked: 1, ranges }));
        }
        if let State::AwaitingResponse { from, .. } = self.state
            && from.since(now) > RadioDuration::ZERO
        {
            return Action::WaitUntil(from);
        }
        let until = match (self.state, self.paired) {
            (State::AwaitingInit, _) => self.next.unwrap_or(now),
            (State::AwaitingResponse { until, .. } | State::AwaitingReport { until }, Some(_)) => until,
            (_, _) => now,
        };
        let window = until.since(now);
        if window > RadioDuration::ZERO {
            return Action::Receive { start: Start::Now, window, keep_listening: true };
        }
        if self.state != State::Between {
            self.give_up(now);
            // A link that has just been lost is reported at the next step.
        }
        self.begin(now)
    }

    fn calibrate(&mut self, stamps: &StampModel) {
        self.stamps = *stamps;
    }
}
