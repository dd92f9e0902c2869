//! What an anchor knows of a tag: how the tag reads the delays of its ranging init, when to answer the tag, and with
//! what.
//!
//! A blink does not show which software the tag has. An EVK1000's tag may keep the first ranging init that it receives
//! until it is reset. So the inits are sent such that each is received only by tags that read it correctly:
//!
//! 1. at once, with one delay in microseconds: for tags whose receiver is on after the blink, which are this project's
//!    own;
//! 2. after the stock delay, alternating from blink to blink, as long as the tag goes on blinking:
//!    - milliseconds, [`LATE`] after the instant: newer software listens for the init's length and 70 µs, older
//!      software for 3 ms more;
//!    - two delays, at the instant;
//!    - milliseconds, at the instant;
//! 3. after five times the stock delay, milliseconds: for older software with switch S1-8 on.
//!
//! Polls show the rest: polls without readings are those of newer software. A tag of older software that took the two
//! delays has read the first one as milliseconds. It is answered after that number of milliseconds if that is a second
//! at most.

use heapless::Vec;

use super::{INIT_DELAY, Mean, Software};
use crate::{RadioDuration, RadioInstant};
use wire::uwb::Header;
use wire::uwb::decaranging::{Frame, Variant, delay_field};

/// The init for older software is sent this much later than the time for which newer software listens.
const LATE: RadioDuration = RadioDuration::from_micros(1_500);
/// With switch S1-8 on, the delay is this multiple of the stock delay …
const LONG: i64 = 5;
/// … where that is less than the time between two blinks.
const LONGEST_DELAY: RadioDuration = RadioDuration::from_micros(900_000);
/// An EVK1000 with older software switches its receiver on after at most this.
const LONGEST_MILLIS: u16 = 1_000;
/// The delay that is sent in milliseconds: the stock delay.
pub(super) const STOCK_MILLIS: u16 = (INIT_DELAY.as_micros() / 1000) as u16;
/// After this number of exchanges without a final, the tag is assumed to read its delay in another way. This holds
/// before the first final and later.
const MISSES: u8 = 2;
const MISSES_OF_PROVEN: u8 = 8;

/// How a tag whose polls have readings understood its ranging init.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reading {
    /// The delay that was meant.
    AsMeant,
    /// [`STOCK_MILLIS`].
    Millis,
    /// The first of two delays: microseconds, read as milliseconds.
    MicrosAsMillis,
}

/// An exchange in progress.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Exchange {
    pub variant: Variant,
    pub software: Software,
    /// The poll's header: it gives the address to answer, and how the tag addresses this anchor.
    pub poll: Header,
    pub poll_rx: RadioInstant,
    /// Departure of the response, once it has left.
    pub resp_tx: Option<RadioInstant>,
}

/// What a frame is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// A ranging init for this software.
    Init(Software),
    Response,
    Report,
}

/// A frame that is to leave at a future instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pending {
    pub frame: Frame,
    pub start: RadioInstant,
    pub purpose: Purpose,
}

/// A ranging init that follows the first one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Later {
    /// The blink's arrival.
    pub blink_rx: RadioInstant,
    /// From there to the init's departure.
    pub delay: RadioDuration,
    pub software: Software,
}

/// A tag.
#[derive(Clone, Debug)]
pub(super) struct Known {
    /// Its short address.
    pub tag: u16,
    pub heard: RadioInstant,
    /// The tag has polled since its last blink, and was not lost since.
    pub paired: bool,
    pub mean: Mean,
    pub exchange: Option<Exchange>,
    pub pending: Option<Pending>,
    /// The inits that follow a first ranging init without a poll, the next one last.
    later: Vec<Later, 2>,
    /// Time of flight, whole ticks, for the next response to newer software.
    pub tof: Option<RadioDuration>,
    /// An EVK1000's software, once it is known.
    stock: Option<Software>,
    /// Blinks since the last exchange.
    blinks: u8,
    reading: Reading,
    /// Exchanges in a row without a final.
    misses: u8,
    proven: bool,
}

impl Known {
    pub fn new(tag: u16, heard: RadioInstant) -> Self {
        Self {
            tag,
            heard,
            paired: false,
            mean: Mean::new(),
            exchange: None,
            pending: None,
            later: Vec::new(),
            tof: None,
            stock: None,
            blinks: 0,
            reading: Reading::AsMeant,
            misses: 0,
            proven: false,
        }
    }

    /// The clock was restarted: everything that depends on it is dropped.
    pub fn restarted(&mut self, now: RadioInstant) {
        self.heard = now;
        (self.exchange, self.pending) = (None, None);
        self.later.clear();
    }

    /// The tag blinks: any exchange in progress with it is over. `stock_delay` is the time from the blink to the second
    /// init.
    pub fn blinked(&mut self, blink_rx: RadioInstant, stock_delay: RadioDuration) {
        let fresh = Self::new(self.tag, blink_rx);
        *self = Self { stock: self.stock, blinks: self.blinks.wrapping_add(1) % 3, ..fresh };
        let late = RadioDuration::from_ticks(stock_delay.ticks() + LATE.ticks());
        let (software, delay) = match (self.stock, self.blinks) {
            (Some(software), _) => (software, stock_delay),
            (None, 1) => (Software::Millis, late),
            (None, 2) => (Software::Delays, stock_delay),
            (None, _) => (Software::Millis, stock_delay),
        };
        let long = RadioDuration::from_ticks(LONG * stock_delay.ticks());
        let inits = [
            (long < LONGEST_DELAY).then_some(Later { blink_rx, delay: long, software: Software::Millis }),
            Some(Later { blink_rx, delay, software }),
        ];
        self.later = inits.into_iter().flatten().collect();
    }

    /// A ranging init for this software leaves. Returns the next init.
    pub fn offered(&mut self, software: Software) -> Option<Later> {
        self.reading = match software {
            Software::Units => Reading::AsMeant,
            Software::Millis => Reading::Millis,
            Software::Delays => Reading::MicrosAsMillis,
        };
        (self.misses, self.proven) = (0, false);
        self.later.pop()
    }

    /// The tag polls. Returns its software, and the time after the poll at which it expects the response. `meant` is
    /// the delay that was meant.
    pub fn polled(&mut self, variant: Variant, readings: bool, meant: RadioDuration) -> (Software, RadioDuration) {
        self.pending = None;
        self.later.clear();
        match (variant, readings) {
            (Variant::Fast, _) => return (Software::Units, meant),
            (Variant::Standard, false) => {
                self.stock = Some(Software::Delays);
                return (Software::Delays, meant);
            }
            (Variant::Standard, true) => {}
        }
        let micros = delay_field(meant);
        self.misses = if self.exchange.is_some() { self.misses.saturating_add(1) } else { 0 };
        if self.misses >= if self.proven { MISSES_OF_PROVEN } else { MISSES } {
            (self.misses, self.proven) = (0, false);
            self.reading = match self.reading {
                Reading::AsMeant => Reading::Millis,
                Reading::Millis if micros <= LONGEST_MILLIS => Reading::MicrosAsMillis,
                Reading::Millis | Reading::MicrosAsMillis => Reading::AsMeant,
            };
        }
        let millis = |millis: u16| (Software::Millis, RadioDuration::from_micros(u32::from(millis) * 1000));
        match self.reading {
            Reading::AsMeant => (Software::Units, meant),
            Reading::Millis => millis(STOCK_MILLIS),
            Reading::MicrosAsMillis => {
                self.stock = Some(Software::Millis);
                millis(micros.min(LONGEST_MILLIS))
            }
        }
    }

    /// An exchange had its final: the tag has the software that was assumed.
    pub fn ranged(&mut self, exchange: &Exchange) {
        self.exchange = None;
        (self.misses, self.proven, self.blinks) = (0, true, 0);
        self.stock = match exchange.software {
            Software::Units => None,
            stock @ (Software::Millis | Software::Delays) => Some(stock),
        };
    }
}
