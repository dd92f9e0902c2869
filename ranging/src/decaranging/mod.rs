//! DecaRanging mode: ranging with EVK1000 boards as they are.
//!
//! A tag blinks every second until an anchor takes it with a ranging init. Then they range by poll, response and final; the
//! anchor, which has all six instants then, reports the time of flight, so that both know the distance. Both show the mean of
//! the last eight.
//!
//! The time of flight is the asymmetric product form ([`double_sided_asymmetric`]), which is as good as the sum of seed 000,
//! equation 5-2, for equal replies, and stays so for unequal ones; a board at the other end that uses the sum gets equal
//! replies from our tag, which answers after the time that the ranging init names.
//!
//! Boards are found with different software, older and newer; which one the other end has is told by its frames and by when it
//! answers, and needs no setting.
//!
//! Nothing needs a reset: a tag without answers blinks again; an anchor that was restarted answers the polls it hears, and a
//! blink of a tag that was restarted pairs it anew.

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

/// From a blink's arrival to the ranging init's departure, RMARKER to RMARKER: an EVK1000's tag switches its receiver on only
/// then.
pub const INIT_DELAY: RadioDuration = RadioDuration::from_micros(150_000);

/// A board corrects its antenna delays for temperature and supply after this number of exchanges at first, …
const COMPENSATE_AFTER: u16 = 16;
/// … and once in this number from then on.
const COMPENSATE_EVERY: u16 = 256;

/// What a board says with the messages of DecaRanging.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Software {
    /// One delay, its unit in bit 15; a report of the time of flight after each final. This project's own.
    Units,
    /// An EVK1000's older software: one delay in plain milliseconds; responses that announce a report, which is of the sum of both
    /// rounds' excess over the replies, four times the time of flight.
    Millis,
    /// An EVK1000's newer software: two delays with units; polls without readings; no report, the next response has the time of
    /// flight.
    Delays,
}

/// Times of flight in a report that was announced ([`REPORT_FOLLOWS`](wire::uwb::decaranging::REPORT_FOLLOWS)).
const FLIGHTS_IN_SUM: i64 = 4;

/// Standard deviation of a distance, metres: of three receptions the response's counts twice (in its round and in its reply),
/// √(2² + 1 + 1) / 4 of one stamp's.
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

    /// Whether it is due: true once for each time.
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

/// From the RMARKER of a frame heard, of so many bytes on the air, to that of the earliest answer.
const fn least_reply(phy: &PhyConfig, turnaround: &ReplyDelay, heard_bytes: u16) -> RadioDuration {
    let tail = phy.time_after_rmarker(heard_bytes).ticks();
    RadioDuration::from_ticks(tail + turnaround.answer.ticks() + phy.time_to_rmarker().ticks())
}

/// Bytes on the air of a frame heard, its two check bytes counted.
fn bytes_on_air(frame: &RxFrame<'_>) -> u16 {
    frame.bytes.len() as u16 + 2
}

/// Both ways' flight and the clocks' drift may make a round longer than the reply in it by this, ticks: 100 µs.
const LONGEST_EXCESS_TICKS: u64 = 6_389_760;

/// The flight of an exchange, where its intervals belong together: not those of another exchange, repeated.
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

/// A board's short address; of a long one the end.
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
