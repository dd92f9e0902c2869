//! DecaRanging mode: ranging with unmodified EVK1000 boards.
//!
//! A tag sends a blink every second until an anchor takes it with a ranging init. Then both range by poll, response and
//! final. After the final the anchor has all six instants and reports the time of flight, so that both know the
//! distance. Both show the mean of the last eight distances.
//!
//! The time of flight is computed with the asymmetric product form ([`double_sided_asymmetric`]). For equal replies
//! this form is as good as the sum of equation 5-2 of P. M. de Rojas Malpartida's thesis (Universidad de Sevilla,
//! 2021), and it stays as good for unequal replies. A board at the other end that uses the sum gets equal replies from
//! our tag: our tag answers after the time that the ranging init names.
//!
//! EVK1000 boards run different software, older and newer. This module recognises the software of the other end by its
//! frames and by the time of its answers. No setting is needed.
//!
//! Nothing needs a reset. A tag without answers blinks again. A restarted anchor answers the polls that it receives. A
//! blink of a restarted tag pairs the tag again.

mod anchor;
mod known;
mod paired;
mod tag;

pub use anchor::{Anchor, AnchorConfig};
pub use tag::{Tag, TagConfig};

use heapless::HistoryBuf;

use crate::native::{ReplyDelay, STAMP_DEVIATION_TICKS};
use crate::time::METRES_PER_TICK;
use crate::tof::{TimeOfFlight, double_sided_asymmetric};
use crate::{PhyConfig, RadioDuration, RxFrame};
use wire::uwb::decaranging::PAN;
use wire::uwb::{Address, Header};

/// From a blink's arrival to the ranging init's departure, RMARKER to RMARKER. The tag of an EVK1000 switches its
/// receiver on only then.
pub const INIT_DELAY: RadioDuration = RadioDuration::from_micros(150_000);

/// At first, a board corrects its antenna delays for temperature and supply after this number of exchanges.
const COMPENSATE_AFTER: u16 = 16;
/// Later, a board corrects its antenna delays once in this number of exchanges.
const COMPENSATE_EVERY: u16 = 256;

/// The software of a board that uses the messages of DecaRanging.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Software {
    /// This project's own software: one delay, with its unit in bit 15; a report of the time of flight after each
    /// final.
    Units,
    /// An EVK1000's older software: one delay in plain milliseconds; responses that announce a report. The report holds
    /// the sum of both rounds' excess over the replies, which is four times the time of flight.
    Millis,
    /// An EVK1000's newer software: two delays with units; polls without readings; no report. The next response holds
    /// the time of flight.
    Delays,
}

/// Times of flight in a report that was announced ([`REPORT_FOLLOWS`](wire::uwb::decaranging::REPORT_FOLLOWS)).
const FLIGHTS_IN_SUM: i64 = 4;

/// Standard deviation of a distance, metres. Of the three receptions, that of the response counts twice (in its round
/// and in its reply): √(2² + 1 + 1) / 4 of the deviation of one timestamp.
const DEVIATION_M: f32 = 0.612_372_4 * STAMP_DEVIATION_TICKS * METRES_PER_TICK as f32;
/// Ranges whose mean is shown.
const MEAN_OF: usize = 8;

/// Exchanges until a board corrects its antenna delays again.
#[derive(Clone, Debug)]
struct Compensation {
    due_in: u16,
}

impl Compensation {
    const fn new() -> Self {
        Self { due_in: COMPENSATE_AFTER }
    }

    /// One more exchange.
    fn count(&mut self) {
        self.due_in = self.due_in.saturating_sub(1);
    }

    /// Whether a correction is due. Returns true once for each due correction.
    fn take(&mut self) -> bool {
        let is_due = self.due_in == 0;
        if is_due {
            self.due_in = COMPENSATE_EVERY;
        }
        is_due
    }
}

/// The mean of the last eight ranges, metres.
#[derive(Clone, Debug, Default)]
struct Mean(HistoryBuf<f32, MEAN_OF>);

impl Mean {
    const fn new() -> Self {
        Self(HistoryBuf::new())
    }

    fn add(&mut self, distance_m: f32) {
        self.0.write(distance_m);
    }

    fn metres(&self) -> Option<f32> {
        let ranges = self.0.as_slice();
        (!ranges.is_empty()).then(|| ranges.iter().sum::<f32>() / ranges.len() as f32)
    }
}

/// From the RMARKER of a received frame of `heard_bytes` bytes on the air to the RMARKER of the earliest answer.
const fn least_reply(phy: &PhyConfig, turnaround: &ReplyDelay, heard_bytes: u16) -> RadioDuration {
    let tail = phy.time_after_rmarker(heard_bytes).ticks();
    RadioDuration::from_ticks(tail + turnaround.answer.ticks() + phy.time_to_rmarker().ticks())
}

/// Bytes on the air of a received frame, including its two check bytes.
fn bytes_on_air(frame: &RxFrame<'_>) -> u16 {
    frame.bytes.len() as u16 + 2
}

/// The flight in both directions and the clocks' drift may make a round longer than its reply by at most this, ticks:
/// 100 µs.
const LONGEST_EXCESS_TICKS: u64 = 6_389_760;

/// The time of flight of an exchange, if its intervals belong together. Intervals that were repeated from another
/// exchange do not.
fn flight(
    round1: RadioDuration,
    reply1: RadioDuration,
    round2: RadioDuration,
    reply2: RadioDuration,
) -> Option<TimeOfFlight> {
    let belong =
        |round: RadioDuration, reply: RadioDuration| round.ticks().abs_diff(reply.ticks()) < LONGEST_EXCESS_TICKS;
    if belong(round1, reply1) && belong(round2, reply2) {
        double_sided_asymmetric(round1, reply1, round2, reply2)
    } else {
        None
    }
}

/// A board's short address. For a long address: its low 16 bits.
const fn short(address: Address) -> u16 {
    match address {
        Address::Short(address) => address,
        Address::Extended(address) => address as u16,
    }
}

/// A header between short addresses.
const fn header(sequence: u8, destination: Address, source: Address) -> Header {
    Header { sequence, pan: PAN, destination, source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_of_the_last_eight() {
        let mut mean = Mean::new();
        assert_eq!(mean.metres(), None);
        mean.add(100.0);
        assert_eq!(mean.metres(), Some(100.0));
        for metres in 1..=8 {
            mean.add(metres as f32);
        }
        // (1 + 2 + … + 8) / 8.
        assert_eq!(mean.metres(), Some(4.5));
    }

    #[test]
    fn intervals_of_different_exchanges_give_nothing() {
        let [short, long] = [400, 600].map(RadioDuration::from_micros);
        assert_eq!(flight(short, short, short, short).map(TimeOfFlight::ticks), Some(0.0));
        assert_eq!(flight(long, short, short, short), None);
        assert_eq!(flight(short, short, short, long), None);
    }
}
