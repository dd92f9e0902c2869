//! When things happen in native mode: from the frames' time on the air and the quickness of the boards.
//!
//! ```text
//! superframe: | 16 beacon slots, one an anchor | 4 shared slots | round slots, each one poll and eight responses        |
//! round:      | poll | answer time | response 0 | gap | response 1 | gap | … |
//! ```

use crate::frame::native::{BEACON_BYTES, OWNED_BEACON_SLOTS, POLL_BYTES, REQUEST_BYTES, RESPONSE_BYTES};
use crate::native::MAX_ROUND;
use crate::{PhyConfig, RadioDuration, RadioInstant, RxFrame};

/// How quick the slowest board of a network is, beside its frames' time on the air; measured on the board, interrupt latency,
/// bus and computation together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Turnaround {
    /// From the end of a frame heard to the first pulse of the answer.
    pub answer: RadioDuration,
    /// From the end of a frame heard to the first pulse of the next frame that can be heard, the receiver being told to stay on.
    pub listen_again: RadioDuration,
    /// From a decision to transmit to the first pulse.
    pub transmit: RadioDuration,
}

impl Turnaround {
    /// A DWM1001 (nRF52832 at 64 MHz, SPI at 8 MHz) with its Bluetooth off.
    pub const DWM1001: Self = Self {
        answer: RadioDuration::from_micros(250),
        listen_again: RadioDuration::from_micros(40),
        transmit: RadioDuration::from_micros(150),
    };
}

/// What all nodes of a network have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Network {
    /// PAN identifier; frames of other networks are ignored.
    pub pan: u16,
    /// How frames are put on the air.
    pub phy: PhyConfig,
    /// The quickness of the slowest board.
    pub turnaround: Turnaround,
}

/// Beacon slots that nobody owns: for tags' requests, and beacons of anchors that found no slot of their own.
pub const SHARED_SLOTS: usize = 4;
/// All beacon slots.
pub const BEACON_SLOTS: usize = OWNED_BEACON_SLOTS + SHARED_SLOTS;
/// The most round slots of a superframe.
pub const MAX_ROUND_SLOTS: usize = 64;

/// The superframe lasts this long, where the beacon slots leave enough of it.
const SUPERFRAME: RadioDuration = RadioDuration::from_micros(100_000);
/// It lasts at least this many times the beacon slots together.
const BEACON_SHARE: i64 = 4;
/// Two clocks part by at most this many millionths (±20 ppm each) …
const DRIFT_PPM: i64 = 40;
/// … for this many superframes without a beacon heard.
pub const HOLDOVER_SUPERFRAMES: u16 = 2;
/// What a byte takes on a board's bus, read or written (8 MHz): turnarounds are those of short frames.
const BYTE: RadioDuration = RadioDuration::from_micros(1);
/// The longest way to another node and back: 450 m, 3 µs.
const WAY_THERE_AND_BACK: RadioDuration = RadioDuration::from_micros(3);

/// When things happen; the same for all nodes of a [`Network`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Timing {
    /// From the poll's RMARKER, heard, to that of the first response.
    pub reply: RadioDuration,
    /// From one response's RMARKER to the next one's.
    pub response_slot: RadioDuration,
    /// From the RMARKER of a response to its end.
    pub response_tail: RadioDuration,
    /// From a frame's first pulse to its RMARKER.
    pub to_rmarker: RadioDuration,
    /// What two nodes' ideas of a slot's beginning may differ by.
    pub guard: RadioDuration,
    /// A beacon slot.
    pub beacon_slot: RadioDuration,
    /// A tag's request for slots takes this much of the shared slots.
    pub request_slot: RadioDuration,
    /// Requests that the shared slots have room for, one after the other.
    pub request_slots: u8,
    /// A round slot.
    pub round_slot: RadioDuration,
    /// Round slots of a superframe, at most 64.
    pub round_slots: u8,
    /// A superframe.
    pub superframe: RadioDuration,
    /// From a decision to transmit to the first pulse ([`Turnaround::transmit`]).
    pub transmit: RadioDuration,
    /// The same of a beacon, which is longer.
    pub transmit_beacon: RadioDuration,
    /// From the end of a frame until the node has it: the rest of [`Turnaround::answer`].
    pub reading: RadioDuration,
}

const fn sum(a: RadioDuration, b: RadioDuration) -> RadioDuration {
    RadioDuration::from_ticks(a.ticks() + b.ticks())
}

const fn times(a: RadioDuration, n: i64) -> RadioDuration {
    RadioDuration::from_ticks(a.ticks() * n)
}

impl Timing {
    /// That of a network.
    pub const fn of(network: &Network) -> Self {
        let Network { phy, turnaround, .. } = network;
        let to_rmarker = phy.time_to_rmarker();
        let reply = sum(sum(phy.time_after_rmarker(POLL_BYTES), turnaround.answer), to_rmarker);
        let listen_again = sum(turnaround.listen_again, WAY_THERE_AND_BACK);
        let response_slot = sum(phy.airtime(RESPONSE_BYTES), listen_again);
        let response_tail = phy.time_after_rmarker(RESPONSE_BYTES);

        // The guard follows from the superframe's length, which hardly follows from the guard: one step is enough.
        // Who has heard the beacon of one slot must be able to send that of the next, both as long as can be.
        let longer = times(BYTE, (BEACON_BYTES - RESPONSE_BYTES) as i64);
        let answer = sum(turnaround.answer, times(longer, 2));
        let beacon = phy.airtime(BEACON_BYTES).ticks() + answer.ticks() + WAY_THERE_AND_BACK.ticks();
        let nominal = SUPERFRAME.ticks();
        let slow = (beacon + beacon / 16) * (BEACON_SLOTS as i64) * BEACON_SHARE;
        let superframe = if slow > nominal { slow } else { nominal };
        let drift = superframe * (HOLDOVER_SUPERFRAMES as i64 + 1) * DRIFT_PPM / 1_000_000;
        let guard = RadioDuration::from_ticks(drift + WAY_THERE_AND_BACK.ticks());

        let beacon_slot = RadioDuration::from_ticks(beacon + guard.ticks());
        let request_slot = sum(sum(phy.airtime(REQUEST_BYTES), listen_again), guard);
        let request_slots = (beacon_slot.ticks() * SHARED_SLOTS as i64 / request_slot.ticks()) as u8;
        let round = sum(sum(sum(to_rmarker, reply), times(response_slot, MAX_ROUND as i64 - 1)), response_tail);
        let round_slot = sum(sum(round, turnaround.listen_again), guard);
        let fit = (superframe - beacon_slot.ticks() * BEACON_SLOTS as i64) / round_slot.ticks();
        let round_slots = if fit > MAX_ROUND_SLOTS as i64 { MAX_ROUND_SLOTS as u8 } else { fit as u8 };
        Self {
            reply,
            response_slot,
            response_tail,
            to_rmarker,
            guard,
            beacon_slot,
            request_slot,
            request_slots,
            round_slot,
            round_slots,
            superframe: RadioDuration::from_ticks(superframe),
            transmit: turnaround.transmit,
            transmit_beacon: sum(turnaround.transmit, longer),
            reading: RadioDuration::from_ticks(turnaround.answer.ticks() - turnaround.transmit.ticks()),
        }
    }

    /// When a frame that came was over. A window until an instant begins here, and not where the slowest board has read the
    /// frame: a quicker one would close it before the instant.
    pub(super) fn end_of(&self, phy: &PhyConfig, frame: &RxFrame<'_>) -> RadioInstant {
        // The two check bytes are not handed on.
        frame.rx_time.plus(phy.time_after_rmarker(frame.bytes.len() as u16 + 2))
    }

    /// When the slowest node has a frame that it received, and decides what to do next.
    pub(super) fn read_by(&self, phy: &PhyConfig, frame: &RxFrame<'_>) -> RadioInstant {
        self.end_of(phy, frame).plus(self.reading)
    }

    /// From the poll's RMARKER to that of the response in this slot of the round.
    pub const fn reply_in(&self, slot: usize) -> RadioDuration {
        sum(self.reply, times(self.response_slot, slot as i64))
    }

    /// From the first pulse of a poll that names this many anchors to the end of the last response.
    pub const fn round(&self, anchors: usize) -> RadioDuration {
        sum(sum(self.to_rmarker, self.reply_in(anchors.saturating_sub(1))), self.response_tail)
    }

    /// From the beginning of the superframe to the RMARKER of a frame in this beacon slot.
    pub const fn beacon(&self, slot: usize) -> RadioDuration {
        let half_guard = RadioDuration::from_ticks(self.guard.ticks() / 2);
        sum(sum(times(self.beacon_slot, slot as i64), half_guard), self.to_rmarker)
    }

    /// From the beginning of the superframe to the RMARKER of a request in this of the [`request_slots`](Self::request_slots).
    pub const fn request(&self, slot: usize) -> RadioDuration {
        sum(self.beacon(OWNED_BEACON_SLOTS), times(self.request_slot, slot as i64))
    }

    /// From the beginning of the superframe to the end of its beacon slots, where the round slots begin.
    pub const fn rounds(&self) -> RadioDuration {
        times(self.beacon_slot, BEACON_SLOTS as i64)
    }

    /// From the beginning of the superframe to that of this round slot (to its end: to the beginning of the next).
    pub const fn round_slot_begin(&self, slot: usize) -> RadioDuration {
        sum(self.rounds(), times(self.round_slot, slot as i64))
    }
}

/// Where a node is in the course of superframes, in its own clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Phase {
    /// Number of the superframe, wrapping.
    pub number: u16,
    /// When it began.
    pub start: RadioInstant,
}

impl Phase {
    /// From a beacon: sent in `slot` of superframe `number`, heard at `rx_time`.
    pub fn from_beacon(timing: &Timing, number: u16, slot: u8, rx_time: RadioInstant) -> Self {
        let offset = timing.beacon(slot.into()).ticks();
        Self { number, start: rx_time.plus(RadioDuration::from_ticks(-offset)) }
    }

    /// Goes on to the superframe that `now` is in; answers how many have begun since.
    pub fn advance(&mut self, timing: &Timing, now: RadioInstant) -> u16 {
        let length = timing.superframe.ticks();
        let begun = (now.since(self.start).ticks().div_euclid(length)).clamp(0, i64::from(u16::MAX));
        self.number = self.number.wrapping_add(begun as u16);
        self.start = self.start.plus(RadioDuration::from_ticks(begun * length));
        begun as u16
    }

    /// The instant this long after the superframe's beginning.
    pub fn at(&self, offset: RadioDuration) -> RadioInstant {
        self.start.plus(offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phy::{Channel, DataRate, PreambleLength, Prf};

    fn micros(duration: RadioDuration) -> f64 {
        duration.ticks() as f64 / 63_897.6
    }

    #[test]
    fn times_of_a_dwm1001_at_6_81_mbit_s() {
        let network = Network { pan: 1, phy: PhyConfig::FAST, turnaround: Turnaround::DWM1001 };
        let timing = Timing::of(&network);
        // To the RMARKER 136 × 1.01763 = 138.4 µs. Poll of 47 bytes: header 21 × 1.02564 = 21.54, payload (376 + 2 × 48) ×
        // 0.12821 = 60.51 µs. Reply = 82.05 + 250 + 138.4.
        assert!((micros(timing.reply) - 470.4).abs() < 0.1, "{}", micros(timing.reply));
        // Response of 23 bytes: 138.4 + 21.54 + (184 + 48) × 0.12821 = 189.68; + 40 + 3 µs.
        assert!((micros(timing.response_slot) - 232.7).abs() < 0.1, "{}", micros(timing.response_slot));
        // Four responses: 138.4 + 470.4 + 3 × 232.7 + 51.3 = 1358.
        assert!((micros(timing.round(4)) - 1358.2).abs() < 0.5, "{}", micros(timing.round(4)));
        // Drift of 40 ppm over three superframes, 12 µs, and 3 µs of way.
        assert!((micros(timing.guard) - 15.0).abs() < 0.1, "{}", micros(timing.guard));
        assert_eq!(timing.superframe, RadioDuration::from_micros(100_000));
    }

    #[test]
    fn slots_hold_what_happens_in_them() {
        for rate in [DataRate::Kbps110, DataRate::Kbps850, DataRate::Kbps6810] {
            for preamble in [PreambleLength::Symbols128, PreambleLength::Symbols1024, PreambleLength::Symbols4096] {
                let Ok(phy) = PhyConfig::new(Channel::Ch5, Prf::Mhz64, rate, preamble) else { continue };
                let network = Network { pan: 1, phy, turnaround: Turnaround::DWM1001 };
                let timing = Timing::of(&network);
                let name = std::format!("{rate:?}, {preamble:?}");
                assert!(timing.round_slots >= 4, "{name}: {} round slots", timing.round_slots);
                assert!(timing.round(MAX_ROUND) < timing.round_slot, "{name}");
                assert!(timing.round_slot_begin(timing.round_slots.into()) <= timing.superframe, "{name}");
                let beacon = phy.airtime(BEACON_BYTES).ticks() + timing.guard.ticks();
                assert!(beacon + timing.transmit.ticks() < timing.beacon_slot.ticks(), "{name}");
                assert!(timing.request_slots >= SHARED_SLOTS as u8, "{name}");
                let last = timing.request(usize::from(timing.request_slots) - 1).ticks()
                    + phy.time_after_rmarker(REQUEST_BYTES).ticks();
                assert!(last < timing.rounds().ticks(), "{name}");
                // A superframe is well within what instants tell apart.
                assert!(timing.superframe < RadioDuration::from_micros(3_000_000), "{name}: {:?}", timing.superframe);
            }
        }
    }

    #[test]
    fn phases_go_on_across_the_wrap() {
        let network = Network { pan: 1, phy: PhyConfig::FAST, turnaround: Turnaround::DWM1001 };
        let timing = Timing::of(&network);
        let superframe = 6_389_760_000;
        let start = RadioInstant::from_ticks((1 << 40) - superframe);
        let mut phase = Phase { number: u16::MAX, start };
        assert_eq!(phase.advance(&timing, start.plus(RadioDuration::from_ticks(-5))), 0);
        assert_eq!(phase.advance(&timing, start.plus(RadioDuration::from_ticks(2 * superframe as i64 + 7))), 2);
        assert_eq!(phase, Phase { number: 1, start: RadioInstant::from_ticks(superframe) });
    }
}
