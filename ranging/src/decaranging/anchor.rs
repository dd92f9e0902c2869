//! The anchor of DecaRanging: takes tags that blink, answers polls, computes the time of flight, reports it.

use heapless::Vec;

use super::{DEVIATION_M, Mean, flight, header, least_reply};
use crate::exchange::{Action, Event, Link, Machine, Range, Report, Round};
use crate::frame::decaranging::{Blink, Final, Frame, Message, Variant, response_time_field};
use crate::frame::{Address, FrameBuffer, Header};
use crate::native::Turnaround;
use crate::{PhyConfig, RadioDuration, RadioInstant, RangeBias, RxFrame, Start};

/// What an anchor is told at its start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AnchorConfig {
    /// Short address; not 0xFFFF (broadcast).
    pub address: u16,
    /// EUI-64, for tags that use long addresses.
    pub eui: u64,
    /// How frames are put on the air.
    pub phy: PhyConfig,
    /// The quickness of the slower of this board and the tag's.
    pub turnaround: Turnaround,
    /// What the radio adds to the snapped start of a transmission, as [`Radio::departure`](crate::Radio::departure) does.
    pub antenna_delay: RadioDuration,
}

/// A tag not heard for this long is lost.
const LOST_AFTER: RadioDuration = RadioDuration::from_micros(3_000_000);
/// Added to the time in which the final should come.
const PATIENCE: RadioDuration = RadioDuration::from_micros(5_000);
/// The receiver is looked after at least this often.
const LISTEN: RadioDuration = RadioDuration::from_micros(1_000_000);

/// An exchange in progress.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Exchange {
    variant: Variant,
    /// The poll's header: whom to answer, and how it addresses us.
    poll: Header,
    poll_rx: RadioInstant,
    /// Departure of the response, once it has left.
    resp_tx: Option<RadioInstant>,
}

/// Tags whose ranges are averaged at a time; others are answered as well.
const MAX_TAGS: usize = 8;

/// A tag that is ranged.
#[derive(Clone, Debug)]
struct Known {
    tag: u16,
    heard: RadioInstant,
    mean: Mean,
}

/// What is to be sent, or was sent last.
#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    /// Listening.
    Listening,
    /// Send this at this instant.
    Answer { frame: Frame, start: RadioInstant },
    /// The response to a poll is leaving.
    Responding,
    /// A ranging init or report is leaving.
    Sending,
}

/// The anchor's side of DecaRanging. Its reports are rounds of one range, and pairings. It answers every tag that polls it.
#[derive(Clone, Debug)]
pub struct Anchor {
    config: AnchorConfig,
    bias: RangeBias,
    /// The same at both ends.
    reply: RadioDuration,
    state: State,
    exchange: Option<Exchange>,
    tags: Vec<Known, MAX_TAGS>,
    link: Option<Link>,
    number: u16,
    range: Option<(RadioInstant, [Range; 1])>,
    reported: Option<[Range; 1]>,
    sequence: u8,
    out: FrameBuffer,
}

impl Anchor {
    /// An anchor that has heard nobody yet.
    pub fn new(config: AnchorConfig) -> Self {
        Self {
            config,
            bias: RangeBias::of(&config.phy),
            reply: least_reply(&config.phy, &config.turnaround),
            state: State::Listening,
            exchange: None,
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

    /// A frame is to leave one reply after another's arrival.
    fn answer(&mut self, rx_time: RadioInstant, frame: Frame) {
        let delay = RadioDuration::from_ticks(-self.config.antenna_delay.ticks());
        self.state = State::Answer { frame, start: rx_time.plus(self.reply).plus(delay) };
    }

    fn hear(&mut self, frame: &RxFrame<'_>) {
        if let Some(blink) = Blink::parse(frame.bytes) {
            // Its short address is the end of its long one, unless that means something else.
            let tag = match blink.tag as u16 {
                address if address == self.config.address || address >= 0xFFFE => self.config.address ^ 1,
                address => address,
            };
            let header =
                header(self.next_sequence(), Address::Extended(blink.tag), Address::Short(self.config.address));
            let message = Message::RangingInit { tag, response_time: response_time_field(self.reply) };
            self.answer(frame.rx_time, Frame { header, message });
            self.exchange = None;
            self.tags.retain(|known| known.tag != tag);
            self.note(tag, frame.rx_time);
            return;
        }
        let Some(heard @ Frame { header, message }) = Frame::parse(frame.bytes) else { return };
        let ours = [Address::Short(self.config.address), Address::Extended(self.config.eui)];
        if !ours.contains(&header.destination) {
            return;
        }
        match message {
            Message::Poll(variant, _) => {
                let sequence = self.next_sequence();
                self.answer(frame.rx_time, heard.answer(sequence, Message::Response(variant, [0; 2])));
                self.exchange = Some(Exchange { variant, poll: header, poll_rx: frame.rx_time, resp_tx: None });
                self.note(short(header.source), frame.rx_time);
            }
            Message::Final(told) => self.hear_final(&heard, told, frame),
            // An anchor's own.
            Message::RangingInit { .. } | Message::Response(..) | Message::Report(..) => {}
        }
    }

    /// A tag was heard; a new one takes the place of the one unheard longest where there is no other.
    fn note(&mut self, tag: u16, now: RadioInstant) {
        if let Some(known) = self.tags.iter_mut().find(|known| known.tag == tag) {
            known.heard = now;
            return;
        }
        self.link = Some(Link::Paired(tag));
        if self.tags.is_full() {
            let unheard = |(_, known): &(usize, &Known)| now.since(known.heard);
            if let Some((longest, _)) = self.tags.iter().enumerate().max_by_key(unheard) {
                self.tags.swap_remove(longest);
            }
        }
        // There is room now.
        let _ = self.tags.push(Known { tag, heard: now, mean: Mean::new() });
    }

    fn hear_final(&mut self, heard: &Frame, told: Final, frame: &RxFrame<'_>) {
        let Some(exchange) = self.exchange.filter(|exchange| exchange.poll.source == heard.header.source) else {
            return;
        };
        let Some(resp_tx) = exchange.resp_tx else { return };
        let (variant, round1, reply2) = match told {
            Final::Instants { poll_tx, resp_rx, final_tx } => {
                (Variant::Standard, resp_rx.since(poll_tx), final_tx.since(resp_rx))
            }
            Final::Intervals { reply2, round1 } => (Variant::Fast, round1, reply2),
        };
        let [reply1, round2] = [resp_tx.since(exchange.poll_rx), frame.rx_time.since(resp_tx)];
        let Some(tof) = flight(round1, reply1, round2, reply2).filter(|_| variant == exchange.variant) else { return };
        self.exchange = None;
        let diagnostics = frame.diagnostics;
        let distance_m = tof.metres() - self.bias.metres(diagnostics.rx_power_dbm);
        let peer = short(heard.header.source);
        if let Some(known) = self.tags.iter_mut().find(|known| known.tag == peer) {
            known.mean.add(distance_m);
        }
        let range = Range { peer, distance_m, deviation_m: DEVIATION_M, position_m: None, diagnostics };
        self.range = Some((exchange.poll_rx, [range]));
        let sequence = self.next_sequence();
        let report = Message::Report(variant, RadioDuration::from_ticks(tof.to_ticks()));
        self.answer(frame.rx_time, heard.answer(sequence, report));
    }
}

/// A tag's short address; of a long one the end.
const fn short(address: Address) -> u16 {
    match address {
        Address::Short(address) => address,
        Address::Extended(address) => address as u16,
    }
}

impl Machine for Anchor {
    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        match event {
            Event::Started => {
                self.state = State::Listening;
                self.exchange = None;
                for known in &mut self.tags {
                    known.heard = now;
                }
            }
            Event::Sent(departure) => {
                if let (State::Responding, Some(exchange)) = (self.state, &mut self.exchange) {
                    exchange.resp_tx = Some(departure);
                }
                self.state = State::Listening;
            }
            Event::Received(frame) => self.hear(&frame),
            Event::Late | Event::NotSent => {
                if self.state == State::Responding {
                    self.exchange = None;
                }
                self.state = State::Listening;
            }
            Event::Corrupt | Event::Timeout | Event::Woken | Event::Reported => {}
        }
        if let State::Answer { frame, start } = self.state {
            self.state = match frame.message {
                Message::Response(..) => State::Responding,
                Message::RangingInit { .. } | Message::Report(..) | Message::Poll(..) | Message::Final(_) => {
                    State::Sending
                }
            };
            frame.emit(&mut self.out);
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
        // No final for the last poll: it is forgotten.
        let patience = RadioDuration::from_ticks(2 * self.reply.ticks() + PATIENCE.ticks());
        if self.exchange.is_some_and(|exchange| now.since(exchange.poll_rx) > patience) {
            self.exchange = None;
        }
        if let Some(lost) = self.tags.iter().position(|known| now.since(known.heard) > LOST_AFTER) {
            return Action::Report(Report::Link(Link::Lost(self.tags.swap_remove(lost).tag)));
        }
        Action::Receive { start: Start::Now, window: LISTEN, keep_listening: true }
    }

    fn calibrate(&mut self, antenna_delay: RadioDuration) {
        self.config.antenna_delay = antenna_delay;
    }
}
