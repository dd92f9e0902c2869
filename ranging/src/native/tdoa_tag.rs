//! The listening tag: receives the rounds that anchors make among themselves. From each round it computes how much
//! farther every answering anchor is than the asking one. It never transmits, so any number of tags share the rounds.
//!
//! An anchor P at a known position polls. Anchor i answers, and reports how long after the poll's arrival, in its own
//! clock (`reply`). The tag receives the poll and the answer at t_P and t_i of the tag's clock:
//!
//! d_i − d_P = c · (t_i − t_P − reply · (1 + r_i)) − D,
//!
//! D is the distance that the anchor P measured to i, and reports in its poll. Walls between the two and their antenna
//! delays add to this distance, and they delay the answer by the same time. Until P has measured it, D is |P − i|.
//!
//! r_i is the rate of the tag's clock relative to anchor i's. It follows from successive answers: their departures in
//! the anchor's clock are compared with their arrivals in the tag's ([`ClockModel`](super::ClockModel)). No wires
//! synchronise the anchors, and no long intervals are compared: a reply lasts 3 ms at most. The timestamp t_P is common
//! to all differences of a round, so their errors are correlated (E. Garcia et al., "A Robust UWB Indoor Positioning
//! System for Highly Complex Environments", 2015, equation 6).

use heapless::Vec;
use positioning_core::Real;

use super::anchor_table::{AnchorTable, Refused};
use super::authentication::SealedPoll;
use super::pace::Meter;
use super::plan::Rate;
use super::sync::{Sync, SyncUpdate};
use super::timing::{SUPERFRAME, SYNC_SLOTS, end_of};
use super::{MAX_ROUND, Network, SHORTEST_WAIT, STAMP_DEVIATION_TICKS};
use crate::exchange::{Action, Difference, Differences, Event, Guidance, Link, Protocol, Report};
use crate::time::METRES_PER_TICK;
use crate::{Diagnostics, RadioDuration, RadioInstant, RangeBias, RxFrame, StampModel, Start};
use wire::uwb::BROADCAST;
use wire::uwb::native::{Asked, Frame, Message, Poll, Response, SyncFrame};

/// Without a sync frame for this many superframes there is no network here.
const LOST_AFTER: u16 = 5;
/// Standard deviation of one timestamp, metres.
const STAMP_DEVIATION_M: f32 = STAMP_DEVIATION_TICKS * METRES_PER_TICK as f32;

/// The configuration of a listening tag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TdoaTagConfig {
    /// The network.
    pub network: Network,
    /// The least time from one received round to the next, at most 8 s; in between the radio is off. `None`: every
    /// round is received.
    pub period: Option<RadioDuration>,
}

/// A tag that only listens. It reports the differences of distances of each received round, and changes of its link.
#[derive(Clone, Debug)]
pub struct TdoaTag {
    config: TdoaTagConfig,
    meter: Meter,
    bias: RangeBias,
    anchors: AnchorTable,
    link: Option<Link>,
    network: Option<Sync>,
    round: Option<Round>,
    /// Counts the received rounds.
    number: u16,
    differences: Vec<Difference, MAX_ROUND>,
    /// The radio is off until this instant.
    rest_until: Option<RadioInstant>,
}

/// A round that is being received.
#[derive(Clone, Debug)]
struct Round {
    /// The number that the anchors give it.
    number: u16,
    reference: u16,
    reference_m: [f32; 3],
    poll: RadioInstant,
    diagnostics: Diagnostics,
    asked: Vec<Asked, MAX_ROUND>,
    /// The poll, in a network with a key.
    sealed: Option<SealedPoll>,
    /// Slots whose response may still come.
    pending: u8,
}

impl TdoaTag {
    /// A tag that has not received any frame yet.
    pub fn new(config: TdoaTagConfig) -> Self {
        Self {
            config,
            meter: Meter::new(config.network.pinned),
            bias: RangeBias::NONE,
            anchors: AnchorTable::new(),
            link: None,
            network: None,
            round: None,
            number: 0,
            differences: Vec::new(),
            rest_until: None,
        }
    }

    /// What the tag received and refused since the start.
    pub fn refused(&self) -> Refused {
        self.anchors.refused
    }

    fn receive(&mut self, frame: &RxFrame<'_>) {
        // By reference: a message takes hundreds of bytes, and each copy as many instructions.
        let parsed = Frame::parse(frame.bytes);
        let Some(told) = parsed.as_ref().ok().filter(|told| told.pan == self.config.network.pan) else { return };
        match &told.message {
            Message::SyncFrame(sync_frame) if told.destination == BROADCAST => {
                if self.anchors.believe(self.config.network.open_sync_frame(frame.bytes, sync_frame)).is_some() {
                    self.on_sync_frame(told.source, sync_frame, frame);
                }
            }
            Message::Poll(poll) if told.destination == BROADCAST => self.on_poll(told.source, poll, frame),
            Message::Response(response) => self.on_response(told.source, told.destination, *response, frame),
            Message::SyncFrame(_)
            | Message::Poll(_)
            | Message::Request(_)
            | Message::Final { .. }
            | Message::Challenge(_)
            | Message::RelayFrame(_) => {}
        }
    }

    fn on_sync_frame(&mut self, source: u16, sync_frame: &SyncFrame, frame: &RxFrame<'_>) {
        if usize::from(sync_frame.slot) >= SYNC_SLOTS {
            return;
        }
        self.advance(frame.rx_time);
        let followed = &self.config.network;
        let heard = match &mut self.network {
            None => {
                self.network = Sync::new(followed, sync_frame, frame.rx_time);
                if self.network.is_some() { SyncUpdate::Anew } else { SyncUpdate::Ignored }
            }
            Some(network) => network.receive(followed, sync_frame, frame.rx_time),
        };
        if !self.anchors.follows(heard) {
            return;
        }
        if heard.is_another() {
            self.link = Some(Link::Synchronised(sync_frame.coordinator));
        }
        self.anchors.on_sync_frame(source, sync_frame, frame.diagnostics.rx_power_dbm);
    }

    /// A round that this tag can use begins, if an anchor with a known position asks in a slot of its own.
    fn on_poll(&mut self, source: u16, poll: &Poll, frame: &RxFrame<'_>) {
        let Some(reference_m) = self.anchors.get_mut(source).and_then(|anchor| anchor.position.metres()) else {
            return;
        };
        if !self.may_poll(source, frame.rx_time) {
            return;
        }
        let moment = self.network.as_ref().and_then(|network| network.course.moment_at(frame.rx_time));
        let Some(sealed) = self.anchors.believe(self.config.network.open(frame.bytes, moment)) else { return };
        self.differences.clear();
        self.round = Some(Round {
            number: poll.round,
            reference: source,
            reference_m,
            poll: frame.rx_time,
            diagnostics: frame.diagnostics,
            pending: u8::MAX >> MAX_ROUND.saturating_sub(poll.anchors.len()).min(7),
            asked: poll.anchors.clone(),
            sealed,
        });
    }

    /// An answer within the round gives a difference. Any answer gives the rate of its sender's clock.
    fn on_response(&mut self, source: u16, destination: u16, response: Response, frame: &RxFrame<'_>) {
        let (Some(round), Some(network)) = (&mut self.round, &self.network) else { return };
        let timing = &network.course.timing;
        let Some(slot) = round.asked.iter().position(|asked| asked.address == source) else { return };
        let told = round.asked.get(slot).and_then(|asked| asked.distance.metres());
        let awaited =
            destination == round.reference && response.round == round.number as u8 && round.pending >> slot & 1 == 1;
        let between = frame.rx_time.since(round.poll);
        if !awaited {
            return;
        }
        if !timing.is_in_slot(slot, between) || !timing.is_reply(slot, response.reply) {
            self.anchors.refused.off_slot = self.anchors.refused.off_slot.saturating_add(1);
            return;
        }
        if self.anchors.believe(self.config.network.open_response(frame.bytes, round.sealed.as_ref())).is_none() {
            return;
        }
        // Responses come in the order of their slots: the earlier ones have been lost.
        round.pending &= !(u8::MAX >> (MAX_ROUND - 1 - slot));
        let diagnostics = frame.diagnostics;
        let Some(anchor) = self.anchors.receive(source, diagnostics.rx_power_dbm) else { return };
        // In the model the sender is the anchor and the receiver is this tag: the rate is the tag's relative to the
        // anchor's.
        if !anchor.clock.expects(-diagnostics.clock_offset_ppm) {
            self.anchors.refused.carriers = self.anchors.refused.carriers.saturating_add(1);
            return;
        }
        anchor.clock.poll(response.poll_rx.plus(response.reply), frame.rx_time);
        anchor.clock.carrier(-diagnostics.clock_offset_ppm);
        let Some(position_m) = anchor.position.metres() else { return };
        let reply = response.reply.ticks() as f32;
        let excess = (between.ticks() - response.reply.ticks()) as f32 - reply * anchor.clock.rate();
        let apart_m = told.unwrap_or_else(|| distance(round.reference_m, position_m));
        // The received power of each frame biases its timestamp. The bias of the poll's timestamp at the anchor follows
        // from the distance of the two anchors.
        let bias_m = self.bias.metres(diagnostics.rx_power_dbm) - self.bias.metres(round.diagnostics.rx_power_dbm)
            + self.bias.expected(apart_m);
        let difference_m = excess * METRES_PER_TICK as f32 - apart_m - bias_m;
        // The timestamps of this frame and of the poll at the anchor, and the rate over the reply. The timestamp of the
        // poll at the tag is common to all.
        let rate_m = reply * METRES_PER_TICK as f32;
        let variance = 2.0 * STAMP_DEVIATION_M * STAMP_DEVIATION_M + rate_m * rate_m * anchor.clock.rate_variance();
        let deviation_m = Real::sqrt(variance);
        // At most one for each slot: it fits.
        let _ = self.differences.push(Difference { peer: source, difference_m, deviation_m, position_m, diagnostics });
    }

    /// Whether a poll whose RMARKER arrived at `rx_time` is in a slot of its sender. A poll that was repeated later
    /// usually is not.
    fn may_poll(&mut self, anchor: u16, rx_time: RadioInstant) -> bool {
        let Some(network) = &mut self.network else { return false };
        let pulse = rx_time.plus(RadioDuration::from_ticks(-network.course.timing.to_rmarker.ticks()));
        let begun = network.advance(pulse);
        self.anchors.advance(begun);
        let Some((number, slot)) = network.course.round_slot_at(pulse) else { return false };
        let timing = &network.course.timing;
        let owned = network.plan().map_or(0, |plan| plan.owned_slots(anchor, number, timing));
        owned.checked_shr(slot.into()).is_some_and(|slots| slots & 1 == 1)
    }

    /// Superframes pass, whether a sync frame is received or not.
    fn advance(&mut self, present: RadioInstant) {
        let Some(network) = &mut self.network else { return };
        let begun = network.advance(present);
        self.anchors.advance(begun);
        if network.silent() > LOST_AFTER || network.has_lost_time(present) {
            self.network = None;
            self.anchors.end_session();
            self.link = Some(Link::Unsynchronised);
        }
    }

    /// The rest of the current round since the end of the last frame: a window until the round's end, or `None` if
    /// there is no round.
    fn rest_of_round(&self, ended: RadioInstant) -> Option<RadioDuration> {
        let round = self.round.as_ref()?;
        let last = round.asked.len().checked_sub(1)?;
        let timing = &self.network.as_ref()?.course.timing;
        let end = timing.reply_in(last).ticks() + timing.response_tail.ticks() + timing.guard.ticks();
        let rest = round.poll.plus(RadioDuration::from_ticks(end)).since(ended);
        (round.pending != 0 && rest > RadioDuration::ZERO).then_some(rest)
    }
}

impl Protocol for TdoaTag {
    fn refused_frames(&self) -> u32 {
        self.anchors.refused.total()
    }

    fn calibrate(&mut self, stamps: &StampModel) {
        self.bias = stamps.range_bias;
    }

    fn guide(&mut self, guidance: Guidance) {
        match guidance.rate {
            Some(Rate::Every(period)) => self.config.period = Some(period),
            Some(Rate::Greedy) => self.config.period = None,
            None => {}
        }
    }

    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        let (mut present, mut ended) = (now, now);
        match event {
            Event::Started => {
                (self.network, self.round, self.rest_until) = (None, None, None);
                self.anchors.forget_clocks();
            }
            Event::Received(frame) => {
                self.receive(&frame);
                ended = end_of(&self.config.network.phy, &frame);
                present = ended.plus(self.meter.reading());
            }
            Event::Sent(_)
            | Event::NotSent
            | Event::Corrupt
            | Event::Timeout
            | Event::Late
            | Event::Woken
            | Event::Reported => {}
        }
        self.advance(present);
        if let Some(link) = self.link.take() {
            return Action::Report(Report::Link(link));
        }
        if let Some(window) = self.rest_of_round(ended) {
            return Action::Receive { start: Start::Now, window, keep_listening: true };
        }
        if let Some(round) = self.round.take() {
            // A listening tag asks nothing, so nothing proves more than this.
            if let Some(network) = self.network.as_mut().filter(|_| !self.differences.is_empty()) {
                network.prove();
            }
            self.number = self.number.wrapping_add(1);
            self.rest_until = self.config.period.map(|period| round.poll.plus(period));
            return Action::Report(Report::Differences(Differences {
                number: self.number,
                poll: round.poll,
                asked: round.asked.len() as u8,
                reference: round.reference,
                reference_m: round.reference_m,
                reference_deviation_m: STAMP_DEVIATION_M,
                reference_diagnostics: round.diagnostics,
                differences: &self.differences,
            }));
        }
        if let Some(instant) = self.rest_until.take().filter(|instant| instant.since(present) > SHORTEST_WAIT) {
            return Action::WaitUntil(instant);
        }
        Action::Receive { start: Start::Now, window: SUPERFRAME, keep_listening: true }
    }
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    Real::sqrt(a.into_iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum())
}
