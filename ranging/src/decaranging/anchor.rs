//! The anchor of DecaRanging: takes tags that blink, answers polls, computes the time of flight and reports it.

use heapless::Vec;

use super::known::{Exchange, Known, Later, Pending, Purpose, STOCK_MILLIS};
use super::{Compensation, DEVIATION_M, FLIGHTS_IN_SUM, Software, bytes_on_air, flight, header, least_reply, short};
use crate::exchange::{Action, Event, Link, Protocol, Range, Report, Round};
use crate::native::ReplyDelay;
use crate::{PhyConfig, RadioDuration, RadioInstant, RangeBias, RxFrame, StampModel, Start};
use wire::uwb::decaranging::{
    Answer, Blink, Final, Frame, LONGEST_BYTES, Message, REPORT_FOLLOWS, Variant, delay_field,
};
use wire::uwb::{Address, FrameBuffer, Header};

/// The configuration of an anchor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AnchorConfig {
    /// Short address; not 0xFFFF (broadcast).
    pub address: u16,
    /// EUI-64, for tags that use long addresses.
    pub eui: u64,
    /// The radio configuration of the frames.
    pub phy: PhyConfig,
    /// The reply delay of the slower board, this one or the tag's.
    pub turnaround: ReplyDelay,
    /// What the radio adds to the snapped start of a transmission, as [`Radio::departure`](crate::Radio::departure)
    /// does.
    pub antenna_delay: RadioDuration,
    /// From a blink's arrival to the ranging init's departure, for EVK1000 tags: [`INIT_DELAY`](super::INIT_DELAY).
    /// Another init follows after five times this delay, for tags whose switch S1-8 is on.
    pub init_delay: RadioDuration,
}

/// A tag that was not received for this long is lost.
const LOST_AFTER: RadioDuration = RadioDuration::from_micros(3_000_000);
/// The anchor checks its receiver at least this often.
const LISTEN: RadioDuration = RadioDuration::from_micros(1_000_000);
/// The receiver is switched off this long before the first pulse of a frame to be sent: more than any board needs.
const LEAD: RadioDuration = RadioDuration::from_micros(3_000);
/// A frame that is due later than this, or was due longer ago than this, belongs to another time: the clock has jumped.
const LONGEST_PENDING: RadioDuration = RadioDuration::from_micros(2_000_000);
/// The time that a tag of newer software gets from the end of a response to the first pulse of its final. An EVK1000
/// gives itself 500 µs.
const TAG_ANSWER: RadioDuration = RadioDuration::from_micros(1_000);

/// Tags known at a time. A further tag replaces the one that was silent for the longest time.
const MAX_TAGS: usize = 8;

/// The anchor's side of DecaRanging. It answers every tag that polls it. It reports rounds of one range, and pairings.
#[derive(Clone, Debug)]
pub struct Anchor {
    config: AnchorConfig,
    bias: RangeBias,
    /// From a poll to its response, in whole microseconds, as reported to tags.
    reply: RadioDuration,
    /// The tag whose response is leaving.
    responding: Option<u16>,
    compensation: Compensation,
    tags: Vec<Known, MAX_TAGS>,
    link: Option<Link>,
    number: u16,
    range: Option<(RadioInstant, [Range; 1])>,
    reported: Option<[Range; 1]>,
    sequence: u8,
    out: FrameBuffer,
}

impl Anchor {
    /// An anchor that has not received any frame yet.
    pub fn new(config: AnchorConfig) -> Self {
        let reply = least_reply(&config.phy, &config.turnaround, LONGEST_BYTES);
        Self {
            config,
            bias: RangeBias::NONE,
            reply: RadioDuration::from_micros(reply.as_micros() as u32 + 1),
            responding: None,
            compensation: Compensation::new(),
            tags: Vec::new(),
            link: None,
            number: 0,
            range: None,
            reported: None,
            sequence: 0,
            out: FrameBuffer::new(),
        }
    }

    /// The mean of the last eight ranges to a tag, metres.
    pub fn mean_m(&self, tag: u16) -> Option<f32> {
        self.tags.iter().find(|known| known.tag == tag)?.mean.metres()
    }

    fn next_sequence(&mut self) -> u8 {
        self.sequence = self.sequence.wrapping_add(1);
        self.sequence
    }

    /// The start of a frame that is to leave `delay` after another frame's arrival.
    fn after(&self, rx_time: RadioInstant, delay: RadioDuration) -> RadioInstant {
        rx_time.plus(delay).plus(RadioDuration::from_ticks(-self.config.antenna_delay.ticks()))
    }

    /// A ranging init for a tag with this software.
    fn init(&self, tag: u16, software: Software) -> Message {
        let named = delay_field(self.reply);
        let (anchor_delay, tag_delay) = match software {
            Software::Units => (named, None),
            Software::Millis => (STOCK_MILLIS, None),
            Software::Delays => {
                let response = self.config.phy.airtime(LONGEST_BYTES).ticks();
                let reply = RadioDuration::from_ticks(response + TAG_ANSWER.ticks()).max(self.reply);
                (named, Some(delay_field(reply)))
            }
        };
        Message::RangingInit { tag, anchor_delay, tag_delay }
    }

    /// What is known of a tag that is received now. A new tag replaces the one that was silent for the longest time if
    /// there is no other room.
    fn known(&mut self, tag: u16, now: RadioInstant) -> Option<&mut Known> {
        if let Some(index) = self.tags.iter().position(|known| known.tag == tag) {
            return self.tags.get_mut(index);
        }
        if self.tags.is_full() {
            let unheard = |(_, known): &(usize, &Known)| now.since(known.heard);
            if let Some((longest, _)) = self.tags.iter().enumerate().max_by_key(unheard) {
                self.tags.swap_remove(longest);
            }
        }
        // There is room now.
        let _ = self.tags.push(Known::new(tag, now));
        self.tags.last_mut()
    }

    fn receive(&mut self, frame: &RxFrame<'_>) {
        if let Ok(blink) = Blink::parse(frame.bytes) {
            self.on_blink(&blink, frame.rx_time);
            return;
        }
        let Ok(heard @ Frame { header, message }) = Frame::parse(frame.bytes) else { return };
        let address = self.config.address;
        // A tag that uses long addresses takes the short address of the ranging init for the end of a long one.
        let ours = [Address::Short(address), Address::Extended(self.config.eui), Address::Extended(address.into())];
        if !ours.contains(&header.destination) {
            return;
        }
        match message {
            Message::Poll(variant, readings) => self.on_poll(&heard, variant, readings.is_some(), frame.rx_time),
            Message::Final(told) => self.on_final(&heard, told, frame),
            // These messages are sent by anchors.
            Message::RangingInit { .. } | Message::Response(..) | Message::Report(..) => {}
        }
    }

    fn on_blink(&mut self, blink: &Blink, rx_time: RadioInstant) {
        // The short address is the end of the long address, unless that value has another meaning.
        let tag = match blink.tag as u16 {
            address if address == self.config.address || address >= 0xFFFE => self.config.address ^ 1,
            address => address,
        };
        let header = header(self.next_sequence(), Address::Extended(blink.tag), Address::Short(self.config.address));
        let frame = Frame { header, message: self.init(tag, Software::Units) };
        let (start, delay) = (self.after(rx_time, self.reply), self.config.init_delay);
        let Some(known) = self.known(tag, rx_time) else { return };
        known.blinked(rx_time, delay);
        known.pending = Some(Pending { frame, start, purpose: Purpose::Init(Software::Units) });
    }

    fn on_poll(&mut self, heard: &Frame, variant: Variant, readings: bool, poll_rx: RadioInstant) {
        let poll = heard.header;
        let (sequence, reply) = (self.next_sequence(), self.reply);
        let tag = short(poll.source);
        let Some(known) = self.known(tag, poll_rx) else { return };
        let (software, delay) = known.polled(variant, readings, reply);
        let answer = match software {
            Software::Units => Answer::default(),
            Software::Millis => Answer { parameter: [REPORT_FOLLOWS, 0], tof: None },
            Software::Delays => {
                Answer { parameter: [0; 2], tof: Some(known.tof.take().unwrap_or(RadioDuration::ZERO)) }
            }
        };
        known.heard = poll_rx;
        known.exchange = Some(Exchange { variant, software, poll, poll_rx, resp_tx: None });
        let newly = !core::mem::replace(&mut known.paired, true);
        let frame = heard.answer(sequence, Message::Response(variant, answer));
        let start = self.after(poll_rx, delay);
        if let Some(known) = self.known(tag, poll_rx) {
            known.pending = Some(Pending { frame, start, purpose: Purpose::Response });
        }
        if newly {
            self.link = Some(Link::Paired(tag));
        }
    }

    fn on_final(&mut self, heard: &Frame, told: Final, frame: &RxFrame<'_>) {
        let source = heard.header.source;
        let peer = short(source);
        let (variant, round1, reply2) = match told {
            Final::Instants { poll_tx, resp_rx, final_tx } => {
                (Variant::Standard, resp_rx.since(poll_tx), final_tx.since(resp_rx))
            }
            Final::Intervals { reply2, round1 } => (Variant::Fast, round1, reply2),
        };
        let sequence = self.next_sequence();
        let least = least_reply(&self.config.phy, &self.config.turnaround, bytes_on_air(frame));
        let start = self.after(frame.rx_time, self.reply.max(least));
        let Some(known) = self.tags.iter_mut().find(|known| known.tag == peer) else { return };
        let of_tag = |exchange: &Exchange| exchange.poll.source == source && exchange.variant == variant;
        let Some(exchange) = known.exchange.filter(of_tag) else { return };
        let Some(resp_tx) = exchange.resp_tx else { return };
        let [reply1, round2] = [resp_tx.since(exchange.poll_rx), frame.rx_time.since(resp_tx)];
        let Some(tof) = flight(round1, reply1, round2, reply2) else { return };
        let diagnostics = frame.diagnostics;
        let distance_m = tof.metres() - self.bias.metres(diagnostics.rx_power_dbm);
        known.mean.add(distance_m);
        self.compensation.count();
        known.ranged(&exchange);
        let report = match exchange.software {
            Software::Units => Some(tof.to_ticks()),
            Software::Millis => Some(tof.to_ticks() * FLIGHTS_IN_SUM),
            Software::Delays => {
                known.tof = Some(RadioDuration::from_ticks(tof.to_ticks()));
                None
            }
        };
        known.pending = report.map(|ticks| {
            let message = Message::Report(variant, RadioDuration::from_ticks(ticks));
            Pending { frame: heard.answer(sequence, message), start, purpose: Purpose::Report }
        });
        let range = Range { peer, distance_m, deviation_m: DEVIATION_M, position_m: None, diagnostics };
        self.range = Some((exchange.poll_rx, [range]));
    }

    /// The tag whose frame is to be sent first, and the time from now until the receiver must be off for that frame.
    fn earliest(&mut self, now: RadioInstant) -> Option<(usize, RadioDuration)> {
        let off = LEAD.ticks() + self.config.phy.time_to_rmarker().ticks();
        for known in &mut self.tags {
            let of_now = |pending: &Pending| pending.start.since(now).ticks().abs() < LONGEST_PENDING.ticks();
            known.pending = known.pending.filter(of_now);
        }
        let spare = |known: &Known| {
            known.pending.map(|pending| RadioDuration::from_ticks(pending.start.since(now).ticks() - off))
        };
        let pending = self.tags.iter().enumerate().filter_map(|(index, known)| Some((index, spare(known)?)));
        pending.min_by_key(|(_, spare)| *spare)
    }

    /// Takes and writes a tag's frame. Returns its start.
    fn take(&mut self, index: usize) -> Option<RadioInstant> {
        let known = self.tags.get_mut(index)?;
        let Pending { frame, start, purpose } = known.pending.take()?;
        self.responding = match purpose {
            Purpose::Response => Some(known.tag),
            Purpose::Init(_) | Purpose::Report => None,
        };
        if let Purpose::Init(software) = purpose {
            let tag = known.tag;
            if let Some(Later { blink_rx, delay, software }) = known.offered(software) {
                let header = Header { sequence: self.next_sequence(), ..frame.header };
                let frame = Frame { header, message: self.init(tag, software) };
                let (start, purpose) = (self.after(blink_rx, delay), Purpose::Init(software));
                self.tags.get_mut(index)?.pending = Some(Pending { frame, start, purpose });
            }
        }
        frame.emit(&mut self.out);
        Some(start)
    }

    /// The exchange whose response is leaving.
    fn responding(&mut self) -> Option<&mut Option<Exchange>> {
        let tag = self.responding.take()?;
        self.tags.iter_mut().find(|known| known.tag == tag).map(|known| &mut known.exchange)
    }
}

impl Protocol for Anchor {
    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        match event {
            Event::Started => {
                self.responding = None;
                for known in &mut self.tags {
                    known.restarted(now);
                }
            }
            Event::Sent(departure) => {
                if let Some(Some(exchange)) = self.responding() {
                    exchange.resp_tx = Some(departure);
                }
            }
            Event::Received(frame) => self.receive(&frame),
            Event::Late | Event::NotSent => {
                if let Some(exchange) = self.responding() {
                    *exchange = None;
                }
            }
            Event::Corrupt | Event::Timeout | Event::Woken | Event::Reported => {}
        }
        let earliest = self.earliest(now);
        if let Some((index, spare)) = earliest
            && spare <= RadioDuration::ZERO
            && let Some(start) = self.take(index)
        {
            return Action::Transmit { frame: self.out.bytes(), start: Start::At(start), listen: true };
        }
        if let Some(link) = self.link.take() {
            return Action::Report(Report::Link(link));
        }
        if let Some((poll, range)) = self.range.take() {
            self.number = self.number.wrapping_add(1);
            let ranges = &*self.reported.insert(range);
            return Action::Report(Report::Round(Round { number: self.number, poll, asked: 1, ranges }));
        }
        let lost = |known: &&mut Known| known.paired && now.since(known.heard) > LOST_AFTER;
        if let Some(known) = self.tags.iter_mut().find(lost) {
            known.paired = false;
            return Action::Report(Report::Link(Link::Lost(known.tag)));
        }
        if earliest.is_none() && self.compensation.take() {
            return Action::Compensate;
        }
        let window = earliest.map_or(LISTEN, |(_, spare)| spare.min(LISTEN));
        Action::Receive { start: Start::Now, window, keep_listening: true }
    }

    fn calibrate(&mut self, stamps: &StampModel) {
        self.config.antenna_delay = stamps.antenna_delay;
        self.bias = stamps.range_bias;
    }
}
