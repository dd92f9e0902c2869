//! A stock tag. Its receiver is on only in the windows that its timers open. Once it has taken an anchor it never
//! blinks again, as in some builds: only a reset helps.

use std::cell::RefCell;
use std::rc::Rc;

use ranging::exchange::Event;
use ranging::{RadioDuration, RadioInstant, Start};

use super::kit::{Kit, METRES, START_UP_SYMBOLS, SYMBOL_US, Software, leaves, little, micros, signed40, span};
use crate::air::{Boxed, Owned};

const BLINK_US: u32 = 1_000_000;
const POLL_US: u32 = 400_000;

#[derive(Clone, Copy, PartialEq)]
enum State {
    Blinking,
    /// For a ranging init, a response or a report.
    Hearing,
    Polling,
    Finishing,
    Pausing,
}

pub struct StockTag {
    kit: Kit,
    eui: u64,
    shown: Rc<RefCell<Vec<f64>>>,
    sequence: u8,
    state: State,
    /// The anchor's address and this tag's own, once the anchor has taken it.
    peers: Option<(u64, u64)>,
    /// From poll to response, and from response (older) or poll (newer) to final, µs.
    delays_us: [f64; 2],
    poll_tx: RadioInstant,
    next: RadioInstant,
    report: bool,
}

impl StockTag {
    pub fn boxed(kit: Kit, eui: u64, shown: &Rc<RefCell<Vec<f64>>>) -> Boxed {
        let (poll_tx, next) = (RadioInstant::default(), RadioInstant::default());
        let mut tag = Self {
            kit,
            eui,
            shown: Rc::clone(shown),
            sequence: 0,
            state: State::Pausing,
            peers: None,
            delays_us: [0.0; 2],
            poll_tx,
            next,
            report: false,
        };
        Box::new(move |now, _, event| tag.step(now, event))
    }

    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Owned {
        match event {
            Event::Started | Event::Woken => self.begin(now),
            Event::Sent(departure) => self.sent(departure),
            Event::Received(frame) => self.receive(frame.bytes, frame.rx_time, now),
            Event::Timeout | Event::Corrupt | Event::Late | Event::NotSent | Event::Reported => self.pause(),
        }
    }

    fn pause(&mut self) -> Owned {
        self.state = State::Pausing;
        Owned::WaitUntil(self.next)
    }

    fn send(&mut self, state: State, frame: Vec<u8>, start: Start) -> Owned {
        self.state = state;
        Owned::Transmit { frame, start, listen: false }
    }

    fn begin(&mut self, now: RadioInstant) -> Owned {
        self.sequence = self.sequence.wrapping_add(1);
        let Some((anchor, own)) = self.peers else {
            self.next = now.plus(RadioDuration::from_micros(BLINK_US));
            let mut blink = vec![0xC5, self.sequence];
            blink.extend(self.eui.to_le_bytes());
            return self.send(State::Blinking, blink, Start::Now);
        };
        self.next = now.plus(RadioDuration::from_micros(POLL_US));
        let poll: &[u8] = if self.older() { &[0x21, 0x7F, 0x8E] } else { &[0x21] };
        let frame = self.kit.frame(self.sequence, anchor, own, poll);
        self.send(State::Polling, frame, Start::Now)
    }

    fn older(&self) -> bool {
        matches!(self.kit.software, Software::Older { .. })
    }

    /// The receiver is switched on `wait_us` after the end of the frame that left, and off when a frame of `frame_us`
    /// should have come.
    fn window(&mut self, end: RadioInstant, wait_us: f64, frame_us: f64) -> Owned {
        self.state = State::Hearing;
        // The timer has 20 bits: if the delay is shorter than the frame, it wraps and runs for a long time.
        let symbols = ((wait_us / SYMBOL_US) as i64 - START_UP_SYMBOLS as i64) & 0xF_FFFF;
        let start = Start::At(end.plus(span(symbols as f64 * SYMBOL_US)));
        let window = span(frame_us + (START_UP_SYMBOLS + self.kit.margin_symbols()) * SYMBOL_US);
        Owned::Receive { start, window, keep_listening: false }
    }

    fn sent(&mut self, departure: RadioInstant) -> Owned {
        let kit = self.kit;
        let end = |bytes: u16| departure.plus(kit.phy.time_after_rmarker(bytes));
        match self.state {
            State::Blinking => {
                // Older software subtracts the init's length, newer software the blink's.
                let length = if self.older() { kit.init_us() } else { micros(kit.phy.airtime(12)) };
                self.window(end(12), f64::from(kit.init_ms) * 1000.0 - length, kit.init_us())
            }
            State::Polling => {
                self.poll_tx = departure;
                let poll = if self.older() { 3 } else { 1 };
                // The final is the longest frame: 16 bytes.
                let length = if self.older() { kit.frame_us(16) } else { kit.frame_us(poll) };
                self.window(end(kit.head_bytes() + poll + 2), self.delays_us[0] - length, kit.frame_us(16))
            }
            State::Finishing if self.report => {
                self.state = State::Hearing;
                let window = self.next.since(departure).max(RadioDuration::from_micros(50_000));
                Owned::Receive { start: Start::Now, window, keep_listening: false }
            }
            State::Finishing | State::Hearing | State::Pausing => self.pause(),
        }
    }

    fn receive(&mut self, bytes: &[u8], rx_time: RadioInstant, now: RadioInstant) -> Owned {
        let Some((anchor, own)) = self.peers else {
            self.on_init(bytes);
            return if self.peers.is_some() { self.begin(now) } else { self.pause() };
        };
        let Some((source, payload)) = self.kit.payload(bytes, own) else { return self.pause() };
        if source != anchor {
            return self.pause();
        }
        match payload[..] {
            [0x10, 0x02, report, _, ref tof @ ..] => {
                let since = if self.older() {
                    self.report = report == 1;
                    rx_time.plus(span(self.delays_us[1]))
                } else {
                    self.show(tof);
                    self.poll_tx.plus(span(self.delays_us[1]))
                };
                self.sequence = self.sequence.wrapping_add(1);
                let mut data = vec![0x29];
                for instant in [self.poll_tx.ticks(), rx_time.ticks(), leaves(since)] {
                    data.extend(&instant.to_le_bytes()[..5]);
                }
                let frame = self.kit.frame(self.sequence, anchor, own, &data);
                self.send(State::Finishing, frame, Start::At(since))
            }
            [0x2A, ref sum @ ..] if self.older() => {
                assert_eq!(sum.len(), 5);
                self.shown.borrow_mut().push(signed40(sum) as f64 * 0.25 * METRES);
                self.pause()
            }
            _ => self.pause(),
        }
    }

    /// The time of flight of the exchange before, if there is one.
    fn show(&mut self, tof: &[u8]) {
        assert_eq!(tof.len(), 5, "a response that newer software can read");
        if signed40(tof) != 0 {
            self.shown.borrow_mut().push(signed40(tof) as f64 * METRES);
        }
    }

    /// The length is not checked: missing bytes are read from the check bytes and from the old contents of the buffer.
    fn on_init(&mut self, bytes: &[u8]) {
        let (kind, head) = (bytes.get(..2), if bytes[1] == 0xCC { 21 } else { 15 });
        let ours = matches!(kind, Some([0x41, 0x8C | 0xCC])) && bytes.len() > head + 4;
        if !ours || bytes[5..13] != self.eui.to_le_bytes() || bytes[head] != 0x20 {
            return;
        }
        if self.kit.strict && bytes.len() != head + if self.older() { 5 } else { 7 } {
            return;
        }
        // A short source is the end of a long address.
        let mut source = little(&bytes[13..head]);
        let given = little(&bytes[head + 1..head + 3]);
        if !self.kit.long {
            source &= 0xFFFF;
        }
        self.peers = Some((source, if self.kit.long { self.eui } else { given }));
        let first = little(&bytes[head + 3..head + 5]);
        self.delays_us = if self.older() {
            [first as f64 * 1000.0; 2]
        } else {
            let second = bytes.get(head + 5..head + 7).map_or(0x5A5A, little);
            let us = |field: u64| (field & 0x7FFF) as f64 * if field & 0x8000 == 0 { 1.0 } else { 1000.0 };
            [us(first), us(first) + us(second)]
        };
    }
}
