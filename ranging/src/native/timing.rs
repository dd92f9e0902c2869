//! When things happen in native mode. The times follow from the frames' time on the air and from the layout, which is
//! set by the slowest node.
//!
//! ```text
//! superframe: | 16 sync slots, one an anchor | 4 shared slots | round slots |
//! round slots: | those of tags | relay slots, if anchors need some: a frame of each owner of a sync slot |
//! round slot: | one poll, up to eight responses, perhaps a final |
//! round:      | poll | answer time | response 0 | gap | response 1 | gap | … | answer time | final |
//! ```

use super::authentication::NetworkKey;
use super::pace::Meter;
use crate::native::MAX_ROUND;
use crate::{PhyConfig, RadioDuration, RadioInstant, RxFrame};
use wire::config;
use wire::uwb::layout::{Layout, Scheme};
use wire::uwb::native::{
    CHALLENGE_BYTES, CODE_BYTES, FINAL_BYTES, LONG_RESPONSE_BYTES, OWNED_SYNC_SLOTS, POLL_BYTES, RELAY_FRAME_BYTES,
    REQUEST_BYTES, RESPONSE_BYTES, SYNC_FRAME_BYTES,
};

/// How quick a board is, without its frames' time on the air: interrupt latency, bus and computation together. In
/// native mode each node measures this while it runs, unless its config record pins it. None of the values here was
/// measured on a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ReplyDelay {
    /// From the end of a received frame to the first pulse of the answer.
    pub answer: RadioDuration,
    /// From the end of a received frame to the first pulse of the next frame that can be received, with the receiver
    /// set to stay on.
    pub listen_again: RadioDuration,
    /// From a decision to transmit to the first pulse.
    pub transmit: RadioDuration,
}

impl ReplyDelay {
    /// What a node assumes of itself before it has measured: half as much again as the cost of a DWM1001 in the
    /// simulation.
    pub const START: Self = Self {
        answer: RadioDuration::from_micros(500),
        listen_again: RadioDuration::from_micros(120),
        transmit: RadioDuration::from_micros(500),
    };
}

impl From<config::ReplyDelay> for ReplyDelay {
    fn from(record: config::ReplyDelay) -> Self {
        let micros = |us: u16| RadioDuration::from_micros(us.into());
        Self {
            answer: micros(record.answer_us),
            listen_again: micros(record.listen_again_us),
            transmit: micros(record.transmit_us),
        }
    }
}

/// What all nodes of a network have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Network {
    /// PAN identifier; frames of other networks are ignored.
    pub pan: u16,
    /// The radio configuration of the frames.
    pub phy: PhyConfig,
    /// This node's configured reply delay, which replaces the measurement.
    pub pinned: Option<ReplyDelay>,
    /// The key of its frames; `None`: they are not authenticated.
    pub key: Option<NetworkKey>,
}

impl Network {
    /// A network without a key, whose nodes measure their pace.
    pub const fn new(pan: u16, phy: PhyConfig) -> Self {
        Self { pan, phy, pinned: None, key: None }
    }

    /// Bytes of the code at the end of each frame.
    pub const fn code_bytes(&self) -> u16 {
        if self.key.is_some() { CODE_BYTES as u16 } else { 0 }
    }

    /// The layout of a network that this node founds, before any node has measured anything.
    pub fn first_layout(&self) -> Layout {
        Meter::new(self.pinned).first_layout()
    }
}

impl TryFrom<&config::Record> for Network {
    type Error = config::Invalid;

    /// The network of a config record. Its key is added by the node, which has the AES for it.
    fn try_from(record: &config::Record) -> Result<Self, config::Invalid> {
        record.validate_region()?;
        Ok(Self {
            pan: record.network.pan,
            phy: record.phy()?,
            pinned: record.network.turnaround.map(ReplyDelay::from),
            key: None,
        })
    }
}

/// Sync slots without an owner: for tags' requests, and for sync frames of anchors that found no slot of their own.
pub const SHARED_SLOTS: usize = 4;
/// All sync slots.
pub const SYNC_SLOTS: usize = OWNED_SYNC_SLOTS + SHARED_SLOTS;
/// The most round slots of a superframe.
pub const MAX_ROUND_SLOTS: usize = 64;

/// The superframe lasts this long, if the sync slots leave enough of it.
pub const SUPERFRAME: RadioDuration = RadioDuration::from_micros(100_000);
/// It lasts at least this multiple of all sync slots together.
const BEACON_SHARE: i64 = 4;
/// A response's arrival may be off by the reply times ½ to this power, 61 ppm: the drift of two clocks, ±20 ppm each,
/// and the noise of timestamps. It is a shift, because the chip has no 64-bit division.
const REPLY_DRIFT_SHIFT: u32 = 14;
/// A delayed transmission starts at a multiple of this many ticks (DW1000 user manual, DX_TIME), 8 ns.
const TX_STEP_TICKS: i64 = 512;
/// Two clocks drift apart by at most this many millionths (±20 ppm each) …
const DRIFT_PPM: i64 = 40;
/// … for this many superframes without a received sync frame.
pub const HOLDOVER_SUPERFRAMES: u16 = 2;
/// The time of a byte on a board's bus, read or written (8 MHz): reply delays are those of short frames.
const BYTE: RadioDuration = RadioDuration::from_micros(1);
/// The longest flight to another node and back: 450 m, 3 µs.
const WAY_THERE_AND_BACK: RadioDuration = RadioDuration::from_micros(3);

/// When things happen. All nodes of a network with the same PHY and layout have the same times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Timing {
    /// The layout from which the times follow.
    pub layout: Layout,
    /// From the received poll's RMARKER to that of the first response.
    pub reply: RadioDuration,
    /// From one response's RMARKER to the next one's.
    pub response_slot: RadioDuration,
    /// From the RMARKER of a response to its end.
    pub response_tail: RadioDuration,
    /// From the end of the last response to that of the final, if there is one.
    pub finale: RadioDuration,
    /// From a frame's first pulse to its RMARKER.
    pub to_rmarker: RadioDuration,
    /// The greatest difference between two nodes' estimates of a slot's beginning.
    pub guard: RadioDuration,
    /// A sync slot.
    pub sync_slot: RadioDuration,
    /// A tag's request for slots takes this much of the shared slots.
    pub request_slot: RadioDuration,
    /// Requests that the shared slots have room for, one after the other.
    pub request_slots: u8,
    /// A round slot.
    pub round_slot: RadioDuration,
    /// Round slots of a superframe, at most 64.
    pub round_slots: u8,
    /// From one relay frame to the next.
    pub relay_frame: RadioDuration,
    /// How many of the round slots, the last ones, are for relay frames where anchors need some.
    pub relay_slots: u8,
    /// Relay frames for which there is room in these.
    pub relay_frames: u8,
    /// A superframe.
    pub superframe: RadioDuration,
}

const fn sum(a: RadioDuration, b: RadioDuration) -> RadioDuration {
    RadioDuration::from_ticks(a.ticks() + b.ticks())
}

const fn times(a: RadioDuration, n: i64) -> RadioDuration {
    RadioDuration::from_ticks(a.ticks() * n)
}

impl Timing {
    /// The times of a network with this layout.
    pub const fn of(network: &Network, layout: Layout) -> Self {
        let (phy, code) = (&network.phy, network.code_bytes());
        let to_rmarker = phy.time_to_rmarker();
        let answer = layout.answer.duration();
        let reply = sum(sum(phy.time_after_rmarker(POLL_BYTES + code), answer), to_rmarker);
        let listen_again = sum(layout.listen_again.duration(), WAY_THERE_AND_BACK);
        let (response_bytes, finale) = match layout.scheme {
            Scheme::SingleSided => (RESPONSE_BYTES + code, RadioDuration::ZERO),
            Scheme::DoubleSided => (LONG_RESPONSE_BYTES + code, sum(answer, phy.airtime(FINAL_BYTES + code))),
        };
        let response_slot = sum(phy.airtime(response_bytes), listen_again);
        let response_tail = phy.time_after_rmarker(response_bytes);

        // The guard follows from the superframe's length, which hardly depends on the guard: one step is enough. A node
        // that received the sync frame of one slot must be able to send that of the next, both of the greatest length.
        let longer = times(BYTE, (SYNC_FRAME_BYTES - RESPONSE_BYTES) as i64);
        let sync_frame_answer = sum(answer, times(longer, 2));
        let sync_frame =
            phy.airtime(SYNC_FRAME_BYTES + code).ticks() + sync_frame_answer.ticks() + WAY_THERE_AND_BACK.ticks();
        let nominal = SUPERFRAME.ticks();
        let slow = (sync_frame + sync_frame / 16) * (SYNC_SLOTS as i64) * BEACON_SHARE;
        let superframe = if slow > nominal { slow } else { nominal };
        let drift = superframe * (HOLDOVER_SUPERFRAMES as i64 + 1) * DRIFT_PPM / 1_000_000;
        let guard = RadioDuration::from_ticks(drift + WAY_THERE_AND_BACK.ticks());

        let sync_slot = RadioDuration::from_ticks(sync_frame + guard.ticks());
        // A challenge comes in the place of a request. Its code is counted already.
        let longest_request = if code == 0 { REQUEST_BYTES } else { CHALLENGE_BYTES - code };
        let request_slot = sum(sum(phy.airtime(longest_request + code), listen_again), guard);
        let request_slots = (sync_slot.ticks() * SHARED_SLOTS as i64 / request_slot.ticks()) as u8;
        let responses = sum(sum(sum(to_rmarker, reply), times(response_slot, MAX_ROUND as i64 - 1)), response_tail);
        let shortest = sum(sum(sum(responses, finale), listen_again), guard).ticks();
        let room = superframe - sync_slot.ticks() * SYNC_SLOTS as i64;
        let fit = room / shortest;
        let round_slots = if fit > MAX_ROUND_SLOTS as i64 { MAX_ROUND_SLOTS as u8 } else { fit as u8 };
        // The slots fill the superframe, but for the time in which the first sync slot's owner decides on its frame.
        let even = if round_slots == 0 { 0 } else { (room - answer.ticks()) / round_slots as i64 };
        let round_slot = RadioDuration::from_ticks(if even > shortest { even } else { shortest });
        // One relay frame of each owner of a sync slot, or as many as fit into a quarter of the slots.
        let relay_frame = sum(sum(phy.airtime(RELAY_FRAME_BYTES + code), listen_again), guard);
        let all = relay_frame.ticks() * OWNED_SYNC_SLOTS as i64;
        let (needed, most) = ((all + round_slot.ticks() - 1) / round_slot.ticks(), round_slots as i64 / 4);
        let relay_slots = if needed < most { needed } else { most };
        let fit = relay_slots * round_slot.ticks() / relay_frame.ticks();
        let relay_frames = if fit > OWNED_SYNC_SLOTS as i64 { OWNED_SYNC_SLOTS as u8 } else { fit as u8 };
        Self {
            layout,
            reply,
            response_slot,
            response_tail,
            finale,
            to_rmarker,
            guard,
            sync_slot,
            request_slot,
            request_slots,
            round_slot,
            round_slots,
            relay_frame,
            relay_slots: relay_slots as u8,
            relay_frames,
            superframe: RadioDuration::from_ticks(superframe),
        }
    }

    /// From the poll's RMARKER to that of the response in this slot of the round.
    pub const fn reply_in(&self, slot: usize) -> RadioDuration {
        sum(self.reply, times(self.response_slot, slot as i64))
    }

    /// From the first pulse of a poll that names this many anchors to the end of the last frame of the round.
    pub const fn round(&self, anchors: usize) -> RadioDuration {
        let responses = sum(sum(self.to_rmarker, self.reply_in(anchors.saturating_sub(1))), self.response_tail);
        sum(responses, self.finale)
    }

    /// Whether a response in this slot can have come `after_poll` after the poll. It may come at its instant by the
    /// anchor's clock, up to a step of the transmitter earlier, and later by the longest flight to another node and
    /// back; all this within the drift of both clocks.
    ///
    /// The same limits hold for a node that only listens: the triangle of poll, response and listener is never shorter
    /// than the direct path, and never longer than the path between the anchors there and back.
    pub fn is_in_slot(&self, slot: usize, after_poll: RadioDuration) -> bool {
        let due = self.reply_in(slot).ticks();
        let drift = due >> REPLY_DRIFT_SHIFT;
        let late = after_poll.ticks() - due;
        (-TX_STEP_TICKS - drift..=WAY_THERE_AND_BACK.ticks() + drift).contains(&late)
    }

    /// Whether an anchor that answers in this slot can have sent its response `reply` after it received the poll, by
    /// its own clock. The reply must be exact, except for the step of its transmitter.
    pub fn is_reply(&self, slot: usize, reply: RadioDuration) -> bool {
        (reply.ticks() - self.reply_in(slot).ticks()).abs() <= TX_STEP_TICKS
    }

    /// From the beginning of the superframe to the RMARKER of a frame in this sync slot.
    pub const fn sync_frame(&self, slot: usize) -> RadioDuration {
        let half_guard = RadioDuration::from_ticks(self.guard.ticks() / 2);
        sum(sum(times(self.sync_slot, slot as i64), half_guard), self.to_rmarker)
    }

    /// From the beginning of the superframe to the RMARKER of a request in one of the
    /// [`request_slots`](Self::request_slots).
    pub const fn request(&self, slot: usize) -> RadioDuration {
        sum(self.sync_frame(OWNED_SYNC_SLOTS), times(self.request_slot, slot as i64))
    }

    /// The round slots of tags, in a network with or without relay slots.
    pub const fn tag_slots(&self, has_relay_slots: bool) -> u8 {
        if has_relay_slots { self.round_slots - self.relay_slots } else { self.round_slots }
    }

    /// From the beginning of the superframe `number` to the first pulse of the relay frame of this sync slot's owner, if
    /// there is room for it. It comes after that of another one in each superframe: an anchor does not receive the one
    /// before its own.
    pub const fn relay_pulse(&self, number: u16, sync_slot: u8) -> Option<RadioDuration> {
        let place = (number.wrapping_mul(2) | 1).wrapping_mul(sync_slot as u16).wrapping_add(number) % 16;
        if place >= self.relay_frames as u16 {
            return None;
        }
        let half_guard = RadioDuration::from_ticks(self.guard.ticks() / 2);
        let begin = sum(self.round_slot_begin(self.tag_slots(true) as usize), half_guard);
        Some(sum(begin, times(self.relay_frame, place as i64)))
    }

    /// How many requests there is room for in this many round slots.
    pub const fn requests_in_round_slots(&self, slots: u8) -> u16 {
        (times(self.round_slot, slots as i64).ticks() / self.request_slot.ticks()) as u16
    }

    /// From the beginning of the superframe to the RMARKER of one of them.
    pub const fn request_from_round_slot(&self, slot: u8, place: usize) -> RadioDuration {
        let half_guard = RadioDuration::from_ticks(self.guard.ticks() / 2);
        let begin = sum(self.round_slot_begin(slot as usize), half_guard);
        sum(sum(begin, self.to_rmarker), times(self.request_slot, place as i64))
    }

    /// From the beginning of the superframe to the first pulse of one of a round slot's blinks, counted from 1 on. They come
    /// at the distance of responses.
    pub const fn blink(&self, slot: u8, part: u8) -> RadioDuration {
        let half_guard = RadioDuration::from_ticks(self.guard.ticks() / 2);
        let before = times(self.response_slot, part.saturating_sub(1) as i64);
        sum(sum(self.round_slot_begin(slot as usize), half_guard), before)
    }

    /// How wrong a tag's clock may be when it blinks. Anchors tell blinks apart up to here; a tag is usually wrong by an
    /// eighth of it, and two that come too close to each other cost one blink.
    pub const fn most_uncertain_blink(&self) -> RadioDuration {
        RadioDuration::from_ticks(self.response_slot.ticks() / 2)
    }

    /// How far apart the beginnings of a superframe may be according to two sync frames: the time goes from anchor to
    /// anchor, each of which may have held it over. A sync frame that was recorded and repeated comes much later.
    pub const fn in_step(&self) -> RadioDuration {
        times(self.guard, 2)
    }

    /// From the beginning of the superframe to the end of its sync slots, where the round slots begin.
    pub const fn rounds(&self) -> RadioDuration {
        times(self.sync_slot, SYNC_SLOTS as i64)
    }

    /// From the beginning of the superframe to that of this round slot. For its end: to the beginning of the next.
    pub const fn round_slot_begin(&self, slot: usize) -> RadioDuration {
        sum(self.rounds(), times(self.round_slot, slot as i64))
    }
}

/// The position of a node in the course of superframes, in its own clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Phase {
    /// Number of the superframe, wrapping.
    pub number: u16,
    /// The instant of its beginning.
    pub start: RadioInstant,
}

impl Phase {
    /// From a sync frame that was sent in `slot` of superframe `number` and arrived at `rx_time`.
    pub fn from_sync_frame(timing: &Timing, number: u16, slot: u8, rx_time: RadioInstant) -> Self {
        let offset = timing.sync_frame(slot.into()).ticks();
        Self { number, start: rx_time.plus(RadioDuration::from_ticks(-offset)) }
    }

    /// Whether the superframe is over at `now`.
    pub fn ends_by(&self, timing: &Timing, now: RadioInstant) -> bool {
        now.since(self.start) >= timing.superframe
    }

    /// Advances to the next superframe.
    pub fn next(&mut self, timing: &Timing) {
        self.number = self.number.wrapping_add(1);
        self.start = self.start.plus(timing.superframe);
    }

    /// The instant this long after the superframe's beginning.
    pub fn at(&self, offset: RadioDuration) -> RadioInstant {
        self.start.plus(offset)
    }
}

/// The end of a received frame.
pub fn end_of(phy: &PhyConfig, frame: &RxFrame<'_>) -> RadioInstant {
    // The two check bytes are not in `frame`.
    frame.rx_time.plus(phy.time_after_rmarker(frame.bytes.len() as u16 + 2))
}

#[cfg(test)]
mod tests {
    use super::super::superframes::Superframes;
    use super::*;
    use crate::phy::{Channel, DataRate, PreambleLength, Prf};
    use wire::uwb::layout::Span;

    const FAST: Network = Network::new(1, PhyConfig::FAST);

    fn micros(duration: RadioDuration) -> f64 {
        duration.ticks() as f64 / 63_897.6
    }

    fn layout(answer_us: u32, listen_again_us: u32, scheme: Scheme) -> Layout {
        let span = |micros| Span::at_least(RadioDuration::from_micros(micros));
        Layout { answer: span(answer_us), listen_again: span(listen_again_us), scheme }
    }

    #[test]
    fn times_at_6_81_mbit_s() {
        // 248 = 31 · 8 and 40 = 20 · 2 are spans.
        let timing = Timing::of(&FAST, layout(248, 40, Scheme::SingleSided));
        // To the RMARKER 136 × 1.01763 = 138.4 µs. Poll of 48 bytes: header 21 × 1.02564 = 21.54, payload (384 + 2
        // × 48) × 0.12821 = 61.54 µs. Reply = 83.08 + 248 + 138.4.
        assert!((micros(timing.reply) - 469.5).abs() < 0.1, "{}", micros(timing.reply));
        // Response of 23 bytes: 138.4 + 21.54 + (184 + 48) × 0.12821 = 189.68; + 40 + 3 µs.
        assert!((micros(timing.response_slot) - 232.7).abs() < 0.1, "{}", micros(timing.response_slot));
        // Four responses: 138.4 + 469.5 + 3 × 232.7 + 51.3 = 1357.
        assert!((micros(timing.round(4)) - 1357.3).abs() < 0.5, "{}", micros(timing.round(4)));
        // Drift of 40 ppm over three superframes, 12 µs, and 3 µs of flight.
        assert!((micros(timing.guard) - 15.0).abs() < 0.1, "{}", micros(timing.guard));
        assert_eq!(timing.superframe, RadioDuration::from_micros(100_000));
    }

    #[test]
    fn a_final_makes_rounds_longer_by_an_answer_and_two_frames() {
        let [single, double] =
            [Scheme::SingleSided, Scheme::DoubleSided].map(|scheme| Timing::of(&FAST, layout(248, 40, scheme)));
        // Responses are 5 bytes longer, 40 bits of 0.12821 µs: 5.13 µs each. The final of 14 bytes: 138.4 + 21.54 +
        // (112 + 48) × 0.12821 = 180.45 µs, after 248 µs.
        let longer = micros(double.round(4)) - micros(single.round(4));
        assert!((longer - (4.0 * 5.13 + 248.0 + 180.45)).abs() < 0.2, "{longer}");
    }

    #[test]
    fn slots_hold_what_happens_in_them() {
        for rate in [DataRate::Kbps110, DataRate::Kbps850, DataRate::Kbps6810] {
            for preamble in [PreambleLength::Symbols128, PreambleLength::Symbols1024, PreambleLength::Symbols4096] {
                for (answer_us, scheme) in
                    [(250, Scheme::SingleSided), (600, Scheme::DoubleSided), (3968, Scheme::DoubleSided)]
                {
                    let Ok(phy) = PhyConfig::new(Channel::Ch5, Prf::Mhz64, rate, preamble) else { continue };
                    let timing = Timing::of(&Network::new(1, phy), layout(answer_us, answer_us / 6, scheme));
                    let name = std::format!("{rate:?}, {preamble:?}, {answer_us} µs");
                    assert!(timing.round_slots >= 4, "{name}: {} round slots", timing.round_slots);
                    assert!(timing.round(MAX_ROUND) < timing.round_slot, "{name}");
                    assert!(timing.round_slot_begin(timing.round_slots.into()) <= timing.superframe, "{name}");
                    let sync_frame = phy.airtime(SYNC_FRAME_BYTES).ticks() + timing.guard.ticks();
                    assert!(
                        sync_frame + layout(answer_us, 0, scheme).answer.duration().ticks() <= timing.sync_slot.ticks(),
                        "{name}"
                    );
                    assert!(timing.request_slots >= SHARED_SLOTS as u8, "{name}");
                    let last = timing.request(usize::from(timing.request_slots) - 1).ticks()
                        + phy.time_after_rmarker(REQUEST_BYTES).ticks();
                    assert!(last < timing.rounds().ticks(), "{name}");
                    // A superframe is well within the range in which instants can be ordered.
                    assert!(
                        timing.superframe < RadioDuration::from_micros(3_000_000),
                        "{name}: {:?}",
                        timing.superframe
                    );
                }
            }
        }
    }

    #[test]
    fn a_forged_reply_shifts_a_distance_by_a_metre_at_most() {
        let timing = Timing::of(&FAST, layout(248, 40, Scheme::SingleSided));
        let ticks = RadioDuration::from_ticks;
        let [first, last] = [0, 7].map(|slot| timing.reply_in(slot).ticks());
        assert!(timing.is_reply(0, ticks(first)) && timing.is_reply(0, ticks(first - 511)));
        // A metre more or less is 2 / 299 702 547 s of reply, 426 ticks; two metres are beyond the step of 512.
        assert!(!timing.is_reply(7, ticks(last + 853)) && !timing.is_reply(7, ticks(last - 853)));
        // 450 m away, clocks 40 ppm apart over 469.5 µs: 3 µs and 19 ns late.
        assert!(timing.is_in_slot(0, ticks(first + 191_693 + 1200)));
        assert!(timing.is_in_slot(0, ticks(first - 511 - 1200 - 100)));
        // A microsecond early, or 5 µs late.
        assert!(!timing.is_in_slot(0, ticks(first - 63_898)) && !timing.is_in_slot(7, ticks(last + 319_488)));
    }

    #[test]
    fn each_owner_of_a_sync_slot_has_a_place_for_a_relay_frame_behind_others() {
        let timing = Timing::of(&FAST, layout(248, 40, Scheme::SingleSided));
        // 104 bytes: 138.4 + 21.54 + (832 + 3 × 48) × 0.12821 = 285.1 µs, and 40, 3 and 15.
        assert!((micros(timing.relay_frame) - 343.1).abs() < 0.1, "{}", micros(timing.relay_frame));
        // 16 take 5489 µs: three round slots of eight responses, 2.0 ms and more.
        assert_eq!((timing.relay_slots, timing.relay_frames), (3, 16));
        assert_eq!(timing.tag_slots(true) + 3, timing.tag_slots(false));
        let [first, end] =
            [timing.tag_slots(true), timing.round_slots].map(|slot| timing.round_slot_begin(slot.into()));
        for number in 0..64 {
            let mut pulses: std::vec::Vec<_> =
                (0..16).filter_map(|slot| Some((timing.relay_pulse(number, slot)?.ticks(), slot))).collect();
            pulses.sort_unstable();
            assert_eq!(pulses.len(), 16);
            assert!(pulses[0].0 >= first.ticks() && pulses[15].0 + timing.relay_frame.ticks() <= end.ticks());
            assert!(pulses.windows(2).all(|two| two[1].0 - two[0].0 == timing.relay_frame.ticks()));
        }
        // Which one comes just before slot 5: each odd distance once in eight superframes.
        let before = |number| {
            let own = timing.relay_pulse(number, 5)?.ticks() - timing.relay_frame.ticks();
            (0..16).find(|slot| timing.relay_pulse(number, *slot).is_some_and(|pulse| pulse.ticks() == own))
        };
        let mut others: std::vec::Vec<_> = (0..8).filter_map(before).collect();
        others.sort_unstable();
        others.dedup();
        assert!(others.len() >= 7, "{others:?}");
        // A slow network has few round slots: a quarter of them at most.
        let slow = Timing::of(&FAST, layout(3968, 600, Scheme::DoubleSided));
        assert!(slow.relay_slots <= slow.round_slots / 4 && slow.relay_frames > 0, "{slow:?}");
        let places = (0..16).filter(|slot| slow.relay_pulse(7, *slot).is_some()).count();
        assert_eq!(places, usize::from(slow.relay_frames));
    }

    #[test]
    fn phases_go_on_across_the_wrap() {
        let superframe = 6_389_760_000;
        let start = RadioInstant::from_ticks((1 << 40) - superframe);
        let mut course = Superframes::begin(&FAST, Layout::LEAST, start, None);
        course.phase.number = u16::MAX;
        assert_eq!(course.advance(start.plus(RadioDuration::from_ticks(-5))), 0);
        assert_eq!(course.advance(start.plus(RadioDuration::from_ticks(2 * superframe as i64 + 7))), 2);
        assert_eq!(course.phase, Phase { number: 1, start: RadioInstant::from_ticks(superframe) });
    }
}
