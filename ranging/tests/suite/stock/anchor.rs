//! A stock anchor: takes the first tag that blinks, and no other. Its receiver is off until the ranging init has left,
//! and from a response until the final is due.

use std::cell::RefCell;
use std::rc::Rc;

use ranging::exchange::Event;
use ranging::{RadioDuration, RadioInstant, Start};

use super::kit::{Kit, METRES, START_UP_SYMBOLS, SYMBOL_US, Software, little, span, ticks};
use crate::air::{Boxed, Owned};

/// The reply delay of newer software. An anchor's is 150 µs, or more than 170 if it does not answer from its interrupt;
/// a node of this air needs 220.
const ANCHOR_TURNAROUND_US: f64 = 250.0;
const TAG_TURNAROUND_US: f64 = 500.0;

pub struct StockAnchor {
    kit: Kit,
    own: u64,
    shown: Rc<RefCell<Vec<f64>>>,
    sequence: u8,
    tag: Option<(u64, u64)>,
    poll_rx: u64,
    resp_tx: u64,
    responding: bool,
    /// Time of flight for the next response.
    tof: i64,
}

impl StockAnchor {
    pub fn boxed(kit: Kit, own: u64, shown: &Rc<RefCell<Vec<f64>>>) -> Boxed {
        let mut anchor = Self {
            kit,
            own: if kit.long { own } else { own & 0xFFFF },
            shown: Rc::clone(shown),
            sequence: 0,
            tag: None,
            poll_rx: 0,
            resp_tx: 0,
            responding: false,
            tof: 0,
        };
        Box::new(move |_, _, event| anchor.step(event))
    }

    /// Delay fields of the ranging init, and the same in µs.
    fn delays(&self) -> (Vec<u16>, [f64; 2]) {
        let kit = &self.kit;
        match kit.software {
            Software::Older { reply_ms } => (vec![reply_ms], [f64::from(reply_ms) * 1000.0; 2]),
            Software::NewerMicros => {
                // Turn-around and the length of the poll (1 byte) or the response (9 bytes), rounded up.
                let us = [ANCHOR_TURNAROUND_US + kit.frame_us(1).ceil(), TAG_TURNAROUND_US + kit.frame_us(9).ceil()];
                (us.map(|us| us as u16).to_vec(), us)
            }
            Software::NewerMillis => (vec![0x8000 | 150, 0x8000 | 200], [150_000.0, 200_000.0]),
        }
    }

    fn listen() -> Owned {
        let window = RadioDuration::from_micros(1_000_000);
        Owned::Receive { start: Start::Now, window, keep_listening: false }
    }

    fn step(&mut self, event: Event<'_>) -> Owned {
        match event {
            Event::Sent(departure) if core::mem::take(&mut self.responding) => {
                self.resp_tx = departure.ticks();
                let older = matches!(self.kit.software, Software::Older { .. });
                let (follows, wait_us) = if older {
                    (4, self.delays().1[1] - self.kit.frame_us(16))
                } else {
                    (9, self.delays().1[1] - self.kit.frame_us(9))
                };
                let end = departure.plus(self.kit.phy.time_after_rmarker(self.kit.head_bytes() + follows + 2));
                let start = Start::At(end.plus(span(wait_us - START_UP_SYMBOLS * SYMBOL_US)));
                let window = RadioDuration::from_micros(1_000_000);
                Owned::Receive { start, window, keep_listening: false }
            }
            Event::Received(frame) => self.receive(frame.bytes, frame.rx_time),
            _ => Self::listen(),
        }
    }

    fn send(&mut self, frame: Vec<u8>, start: Start) -> Owned {
        Owned::Transmit { frame, start, listen: !self.responding }
    }

    fn receive(&mut self, bytes: &[u8], rx_time: RadioInstant) -> Owned {
        self.sequence = self.sequence.wrapping_add(1);
        if bytes[0] == 0xC5 && matches!(bytes.len(), 10 | 16) {
            return self.take(little(&bytes[2..10]), rx_time);
        }
        let Some((tag, given)) = self.tag else { return Self::listen() };
        let peer = if self.kit.long { tag } else { given };
        let Some((source, payload)) = self.kit.payload(bytes, self.own) else { return Self::listen() };
        if source != peer {
            return Self::listen();
        }
        let older = matches!(self.kit.software, Software::Older { .. });
        match payload[0] {
            0x21 => {
                self.poll_rx = rx_time.ticks();
                let mut data = vec![0x10, 0x02, u8::from(older), 0];
                if !older {
                    data.extend(&std::mem::take(&mut self.tof).to_le_bytes()[..5]);
                }
                self.responding = true;
                let frame = self.kit.frame(self.sequence, peer, self.own, &data);
                self.send(frame, Start::At(rx_time.plus(span(self.delays().1[0]))))
            }
            0x29 => {
                assert_eq!(payload.len(), 16);
                let [poll_tx, resp_rx, final_tx] = [1, 6, 11].map(|at| little(&payload[at..at + 5]));
                let [ra, db] = [ticks(resp_rx, poll_tx), ticks(self.resp_tx, self.poll_rx)];
                let [rb, da] = [ticks(rx_time.ticks(), self.resp_tx), ticks(final_tx, resp_rx)];
                if older {
                    // P. M. de Rojas Malpartida's thesis (2021), equation 5-2, without its division by 4, which both
                    // ends do when they show the distance.
                    let sum = (ra - db) + (rb - da);
                    self.shown.borrow_mut().push(sum * 0.25 * METRES);
                    let mut data = vec![0x2A];
                    data.extend(&(sum as i64).to_le_bytes()[..5]);
                    let frame = self.kit.frame(self.sequence, peer, self.own, &data);
                    return self.send(frame, Start::Now);
                }
                self.tof = ((ra * rb - da * db) / (ra + rb + da + db)) as i64;
                self.shown.borrow_mut().push(self.tof as f64 * METRES);
                Self::listen()
            }
            _ => Self::listen(),
        }
    }

    fn take(&mut self, tag: u64, blink_rx: RadioInstant) -> Owned {
        if self.tag.is_some_and(|(known, _)| known != tag) {
            return Self::listen();
        }
        // Its short address: a byte of the chip's part number, and the end of its long one.
        let given = 0x5A00 | tag & 0xFF;
        self.tag = Some((tag, given));
        let mut init = vec![0x41, if self.kit.long { 0xCC } else { 0x8C }, self.sequence, 0xCA, 0xDE];
        init.extend(tag.to_le_bytes());
        init.extend(&self.own.to_le_bytes()[..if self.kit.long { 8 } else { 2 }]);
        init.push(0x20);
        init.extend(&given.to_le_bytes()[..2]);
        for field in self.delays().0 {
            init.extend(field.to_le_bytes());
        }
        self.send(init, Start::At(blink_rx.plus(span(f64::from(self.kit.init_ms) * 1000.0))))
    }
}
