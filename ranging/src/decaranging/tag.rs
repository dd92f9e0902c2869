//! The tag of DecaRanging: blinks, polls, tells its instants, waits for the report.

use super::{DEVIATION_M, Mean, header, least_reply};
use crate::exchange::{Action, Event, Guidance, Link, Machine, Range, Report, Round};
use crate::frame::decaranging::{Blink, Final, Frame, Message, Variant, response_time};
use crate::frame::{Address, FrameBuffer};
use crate::native::{Rate, Turnaround};
use crate::{PhyConfig, RadioDuration, RadioInstant, RangeBias, RxFrame, Start, TimeOfFlight};

/// What a tag is told at its start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TagConfig {
    /// EUI-64.
    pub eui: u64,
    /// Which messages.
    pub variant: Variant,
    /// How frames are put on the air.
    pub phy: PhyConfig,
    /// The quickness of this board.
    pub turnaround: Turnaround,
    /// What the radio adds to the snapped start of a transmission, as [`Radio::departure`](crate::Radio::departure) does.
    pub antenna_delay: RadioDuration,
    /// From one poll to the next.
    pub period: RadioDuration,
}

/// From one blink to the next.
const BLINK_PERIOD: RadioDuration = RadioDuration::from_micros(1_000_000);
/// Without an answer for this long, and for [`UNANSWERED`] polls, the tag blinks again.
const LOST_AFTER: RadioDuration = RadioDuration::from_micros(1_000_000);
const UNANSWERED: u8 = 8;
/// Added to the time in which an answer should come.
const PATIENCE: RadioDuration = RadioDuration::from_micros(5_000);

/// The anchor that took the tag.
#[derive(Clone, Copy, Debug)]
struct Paired {
    anchor: Address,
    /// Our own address.
    tag: Address,
    /// From a frame's arrival to its answer's departure, at both ends.
    reply: RadioDuration,
    /// When the anchor was last heard.
    heard: RadioInstant,
    unanswered: u8,
    /// The anchor's last sequence number.
    sequence: u8,
}

/// What is being waited for.
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
    /// The response, until then.
    AwaitingResponse { until: RadioInstant },
    /// A final is leaving; after it the report is awaited.
    Finishing,
    /// The report, until then.
    AwaitingReport { until: RadioInstant },
}

/// The tag's side of DecaRanging. Its reports are rounds of one range, and pairings.
#[derive(Clone, Debug)]
pub struct Tag {
    config: TagConfig,
    bias: RangeBias,
    state: State,
    paired: Option<Paired>,
    /// When the next blink or poll is due.
    next: Option<RadioInstant>,
    poll_tx: RadioInstant,
    resp_rx: RadioInstant,
    readings: [u8; 2],
    link: Option<Link>,
    number: u16,
    /// The range to be reported.
    range: Option<[Range; 1]>,
    /// The range that the node is reading.
    reported: Option<[Range; 1]>,
    mean: Mean,
    sequence: u8,
    out: FrameBuffer,
}

impl Tag {
    /// A tag that nobody has taken yet.
    pub fn new(config: TagConfig) -> Self {
        Self {
            config,
            bias: RangeBias::of(&config.phy),
            state: State::Between,
            paired: None,
            next: None,
            poll_tx: RadioInstant::default(),
            resp_rx: RadioInstant::default(),
            readings: [0; 2],
            link: None,
            number: 0,
            range: None,
            reported: None,
            mean: Mean::new(),
            sequence: 0,
            out: FrameBuffer::new(),
        }
    }

    /// The chip's raw temperature and voltage, which polls of the standard variant tell.
    pub fn set_readings(&mut self, temperature: u8, voltage: u8) {
        self.readings = [temperature, voltage];
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

    fn hear(&mut self, frame: &RxFrame<'_>) {
        let Some(Frame { header, message }) = Frame::parse(frame.bytes) else { return };
        if let Message::RangingInit { tag, response_time: field } = message {
            // Short addresses of both are used from now on; 0xFFFF and 0xFFFE are nobody's.
            let addressed =
                self.state == State::AwaitingInit && header.destination == Address::Extended(self.config.eui);
            if let (true, Address::Short(anchor), 0..0xFFFE) = (addressed, header.source, tag) {
                let reply = response_time(field).max(least_reply(&self.config.phy, &self.config.turnaround));
                self.paired = Some(Paired {
                    anchor: header.source,
                    tag: Address::Short(tag),
                    reply,
                    heard: frame.rx_time,
                    unanswered: 0,
                    sequence: header.sequence,
                });
                self.link = Some(Link::Paired(anchor));
                self.state = State::Between;
                self.next = None;
                self.mean = Mean::new();
            }
            return;
        }
        let Some(paired) = &mut self.paired else { return };
        if header.source != paired.anchor || header.destination != paired.tag || header.sequence == paired.sequence {
            return;
        }
        match (self.state, message) {
            (State::AwaitingResponse { .. }, Message::Response(variant, _)) if variant == self.config.variant => {
                (paired.heard, paired.sequence, paired.unanswered) = (frame.rx_time, header.sequence, 0);
                self.resp_rx = frame.rx_time;
                self.state = State::Finishing;
            }
            (State::AwaitingReport { .. }, Message::Report(variant, ticks)) if variant == self.config.variant => {
                paired.sequence = header.sequence;
                let Address::Short(peer) = paired.anchor else { return };
                let power = frame.diagnostics.rx_power_dbm;
                let distance_m = TimeOfFlight::from_ticks(ticks.ticks()).metres() - self.bias.metres(power);
                self.mean.add(distance_m);
                let diagnostics = frame.diagnostics;
                self.range =
                    Some([Range { peer, distance_m, deviation_m: DEVIATION_M, position_m: None, diagnostics }]);
                self.state = State::Between;
            }
            _ => {}
        }
    }

    /// A wait is over without what was waited for.
    fn give_up(&mut self, now: RadioInstant) {
        let awaited = matches!(self.state, State::AwaitingResponse { .. });
        self.state = State::Between;
        let Some(paired) = self.paired.as_mut().filter(|_| awaited) else { return };
        paired.unanswered = paired.unanswered.saturating_add(1);
        if paired.unanswered >= UNANSWERED && now.since(paired.heard) > LOST_AFTER {
            if let Address::Short(anchor) = paired.anchor {
                self.link = Some(Link::Lost(anchor));
            }
            self.paired = None;
            self.next = None;
        }
    }

    fn finish(&mut self, paired: &Paired) -> Action<'_> {
        let delay = self.config.antenna_delay;
        let start = self.resp_rx.plus(paired.reply).plus(RadioDuration::from_ticks(-delay.ticks()));
        // The chip starts at the snapped instant: that is what the anchor must be told.
        let final_tx = start.snapped().plus(delay);
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
            return Action::WaitUntil(due);
        }
        match self.paired {
            None => {
                let blink = Blink { sequence: self.next_sequence(), tag: self.config.eui };
                blink.emit(&mut self.out);
                self.next = Some(now.plus(BLINK_PERIOD));
                self.state = State::Blinking;
            }
            Some(paired) => {
                self.write(&paired, Message::Poll(self.config.variant, self.readings));
                // After a pause the rhythm begins anew.
                let next = due.plus(self.config.period);
                let late = now.since(next) > RadioDuration::ZERO;
                self.next = Some(if late { now.plus(self.config.period) } else { next });
                self.state = State::Polling;
            }
        }
        Action::Transmit { frame: self.out.bytes(), start: Start::Now, listen: true }
    }
}

impl Machine for Tag {
    fn may_sleep(&self) -> bool {
        // Between exchanges nothing hangs on the clock: a restart begins with the next poll or blink.
        self.state == State::Between
    }

    fn guide(&mut self, guidance: Guidance) {
        match guidance.rate {
            Some(Rate::Every(period)) => self.config.period = period,
            // There are no slots here to be used up.
            Some(Rate::Greedy) | None => {}
        }
    }

    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        match event {
            Event::Started => {
                self.state = State::Between;
                self.next = None;
                if let Some(paired) = &mut self.paired {
                    paired.heard = now;
                }
            }
            Event::Sent(departure) => {
                let reply = self.paired.map_or(RadioDuration::ZERO, |paired| paired.reply);
                let until = departure.plus(reply).plus(reply).plus(PATIENCE);
                match self.state {
                    State::Blinking => self.state = State::AwaitingInit,
                    State::Polling => {
                        self.poll_tx = departure;
                        self.state = State::AwaitingResponse { until };
                    }
                    State::Finishing => self.state = State::AwaitingReport { until },
                    State::Between
                    | State::AwaitingInit
                    | State::AwaitingResponse { .. }
                    | State::AwaitingReport { .. } => {}
                }
            }
            Event::Received(frame) => self.hear(&frame),
            Event::Timeout | Event::Late | Event::NotSent => self.give_up(now),
            Event::Corrupt | Event::Woken | Event::Reported => {}
        }
        if let Some(link) = self.link.take() {
            return Action::Report(Report::Link(link));
        }
        if let Some(range) = self.range.take() {
            self.number = self.number.wrapping_add(1);
            let ranges = &*self.reported.insert(range);
            return Action::Report(Report::Round(Round { number: self.number, poll: self.poll_tx, asked: 1, ranges }));
        }
        let until = match (self.state, self.paired) {
            (State::Finishing, Some(paired)) => return self.finish(&paired),
            (State::AwaitingInit, _) => self.next.unwrap_or(now),
            (State::AwaitingResponse { until } | State::AwaitingReport { until }, Some(_)) => until,
            (_, _) => now,
        };
        let window = until.since(now);
        if window > RadioDuration::ZERO {
            return Action::Receive { start: Start::Now, window, keep_listening: true };
        }
        if self.state != State::Between {
            self.give_up(now);
            // A link that has just been given up is reported at the next step.
        }
        self.begin(now)
    }

    fn calibrate(&mut self, antenna_delay: RadioDuration) {
        self.config.antenna_delay = antenna_delay;
    }
}
