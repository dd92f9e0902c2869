//! The listening tag: hears the rounds that anchors make among themselves, and finds from each how much farther every anchor
//! is than the one that asked. It never sends, so that any number of tags share the rounds.
//!
//! An anchor P at a known place polls; anchor i answers, and tells how long after the poll's arrival in its own clock (`reply`).
//! SyncUpdate by the tag at t_P and t_i of the tag's clock,
//!
//! d_i − d_P = c · (t_i − t_P − reply · (1 + r_i)) − D,
//!
//! D the distance that the anchor P measured to i, and tells in its poll: by what walls between the two and their antenna delays add, the
//! answer was late as well. Until it has measured it, D is |P − i|.
//!
//! r_i the rate of the tag's clock against anchor i's, which successive answers give: their departures in the anchor's clock
//! against their arrivals in the tag's ([`ClockModel`](super::ClockModel)). No wires keep the anchors' time, and no long intervals are compared:
//! a reply lasts 3 ms at most. The stamp t_P is common to all differences of a round: their errors are correlated (seed 003,
//! equation 6).

use heapless::Vec;
use positioning_core::Real;

use super::anchor_table::{AnchorTable, Refused};
use super::pace::Meter;
use super::plan::{Rate, owned_slots};
use super::sync::{Sync, SyncUpdate};
use super::timing::{SUPERFRAME, SYNC_SLOTS, end_of};
use super::{MAX_ROUND, Network, SHORTEST_WAIT, STAMP_DEVIATION_TICKS};
use crate::exchange::{Action, Difference, Differences, Event, Guidance, Link, Protocol, Report};
use crate::time::METRES_PER_TICK;
use crate::{Diagnostics, RadioDuration, RadioInstant, RangeBias, RxFrame, Start};
use wire::uwb::BROADCAST;
use wire::uwb::native::{Asked, Frame, Message, Poll, Response, SyncFrame};

/// Without a sync frame for this many superframes there is no network here.
const LOST_AFTER: u16 = 5;
/// One stamp, metres.
const STAMP_DEVIATION_M: f32 = STAMP_DEVIATION_TICKS * METRES_PER_TICK as f32;

/// What a listening tag is told at its start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TdoaTagConfig {
    /// The network.
    pub network: Network,
    /// From one round heard to the next, at least, 8 s at most; in between the radio is off. `None`: every round is heard.
    pub period: Option<RadioDuration>,
}

/// A tag that only listens. Its reports are the differences of distances of each round heard, and changes of its link.
#[derive(Clone, Debug)]
pub struct TdoaTag {
    config: TdoaTagConfig,
    meter: Meter,
    bias: RangeBias,
    anchors: AnchorTable,
    link: Option<Link>,
    network: Option<Sync>,
    round: Option<Round>,
    /// Counts the rounds heard.
    number: u16,
    differences: Vec<Difference, MAX_ROUND>,
    /// The radio is off until then.
    rest_until: Option<RadioInstant>,
}

/// A round being heard.
#[derive(Clone, Debug)]
struct Round {
    /// As the anchors count it.
    number: u16,
    reference: u16,
    reference_m: [f32; 3],
    poll: RadioInstant,
    diagnostics: Diagnostics,
    asked: Vec<Asked, MAX_ROUND>,
    /// Slots whose response may still come.
    pending: u8,
}

impl TdoaTag {
    /// A tag that has heard nobody yet.
    pub fn new(config: TdoaTagConfig) -> Self {
        Self {
            config,
            meter: Meter::new(config.network.pinned),
            bias: RangeBias::of(&config.network.phy),
            anchors: AnchorTable::new(),
            link: None,
            network: None,
            round: None,
            number: 0,
            differences: Vec::new(),
            rest_until: None,
        }
    }

    /// What was heard and not believed since the start.
    pub fn refused(&self) -> Refused {
        self.anchors.refused
    }

    fn receive(&mut self, frame: &RxFrame<'_>) {
        let Some(told) = Frame::parse(frame.bytes).ok().filter(|told| told.pan == self.config.network.pan) else {
            return;
        };
        match told.message {
            Message::SyncFrame(sync_frame) if told.destination == BROADCAST => {
                self.on_sync_frame(told.source, &sync_frame, frame)
            }
            Message::Poll(poll) if told.destination == BROADCAST => self.on_poll(told.source, &poll, frame),
            Message::Response(response) => self.on_response(told.source, told.destination, response, frame),
            Message::SyncFrame(_) | Message::Poll(_) | Message::Request(_) | Message::Final { .. } => {}
        }
    }

    fn on_sync_frame(&mut self, source: u16, sync_frame: &SyncFrame, frame: &RxFrame<'_>) {
        if usize::from(sync_frame.slot) >= SYNC_SLOTS {
            return;
        }
        self.advance(frame.rx_time);
        let phy = &self.config.network.phy;
        let heard = match &mut self.network {
            None => {
                self.network = Sync::new(phy, sync_frame, frame.rx_time);
                if self.network.is_some() { SyncUpdate::Anew } else { SyncUpdate::Ignored }
            }
            Some(network) => network.receive(phy, sync_frame, frame.rx_time),
        };
        match heard {
            SyncUpdate::Ignored => return,
            SyncUpdate::Refused => return self.anchors.refuse_coordinator(),
            SyncUpdate::Followed => {}
            SyncUpdate::Changed | SyncUpdate::Anew => self.link = Some(Link::Synchronised(sync_frame.coordinator)),
        }
        self.anchors.on_sync_frame(source, sync_frame, frame.diagnostics.rx_power_dbm);
    }

    /// A round begins that serves us, where an anchor asks in a slot of its own and its place is known.
    fn on_poll(&mut self, source: u16, poll: &Poll, frame: &RxFrame<'_>) {
        let Some(reference_m) = self.anchors.get_mut(source).and_then(|anchor| anchor.position.metres()) else {
            return;
        };
        if !self.may_poll(source, frame.rx_time) {
            return;
        }
        self.differences.clear();
        self.round = Some(Round {
            number: poll.round,
            reference: source,
            reference_m,
            poll: frame.rx_time,
            diagnostics: frame.diagnostics,
            pending: u8::MAX >> MAX_ROUND.saturating_sub(poll.anchors.len()).min(7),
            asked: poll.anchors.clone(),
        });
    }

    /// An answer within the round makes a difference; any answer tells of its sender's clock.
    fn on_response(&mut self, source: u16, destination: u16, response: Response, frame: &RxFrame<'_>) {
        let (Some(round), Some(network)) = (&mut self.round, &self.network) else { return };
        let timing = &network.course.timing;
        let Some(slot) = round.asked.iter().position(|asked| asked.address == source) else { return };
        let told = round.asked.get(slot).and_then(|asked| asked.distance.metres());
        let awaited =
            destination == round.reference && response.round == round.number && round.pending >> slot & 1 == 1;
        let between = frame.rx_time.since(round.poll);
        if !awaited {
            return;
        }
        if !timing.is_in_slot(slot, between) || !timing.is_reply(slot, response.reply) {
            self.anchors.refused.off_slot = self.anchors.refused.off_slot.saturating_add(1);
            return;
        }
        // Responses come in the order of their slots: those before have been lost.
        round.pending &= !(u8::MAX >> (MAX_ROUND - 1 - slot));
        let diagnostics = frame.diagnostics;
        let Some(anchor) = self.anchors.receive(source, diagnostics.rx_power_dbm) else { return };
        // The model's sender is the anchor, its receiver this tag: the rate is the tag's against the anchor's.
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
        // Each stamp is late by what its frame's power makes of it; that of the poll at the anchor is known by their distance.
        let bias_m = self.bias.metres(diagnostics.rx_power_dbm) - self.bias.metres(round.diagnostics.rx_power_dbm)
            + self.bias.expected(apart_m);
        let difference_m = excess * METRES_PER_TICK as f32 - apart_m - bias_m;
        // The stamps of this frame and of the poll at the anchor, and the rate over the reply; that of the poll is common.
        let rate_m = reply * METRES_PER_TICK as f32;
        let variance = 2.0 * STAMP_DEVIATION_M * STAMP_DEVIATION_M + rate_m * rate_m * anchor.clock.rate_variance();
        let deviation_m = Real::sqrt(variance);
        // One a slot at most: it fits.
        let _ = self.differences.push(Difference { peer: source, difference_m, deviation_m, position_m, diagnostics });
    }

    /// Whether a poll whose RMARKER came then is in a slot of its sender: one that was repeated later is not, as a rule.
    fn may_poll(&mut self, anchor: u16, rx_time: RadioInstant) -> bool {
        let Some(network) = &mut self.network else { return false };
        let pulse = rx_time.plus(RadioDuration::from_ticks(-network.course.timing.to_rmarker.ticks()));
        let begun = network.advance(pulse);
        self.anchors.advance(begun);
        let (timing, phase) = (network.course.timing, network.course.phase);
        let into = pulse.since(phase.start).ticks() - timing.rounds().ticks();
        let Some(slot) = u32::try_from(into.div_euclid(timing.round_slot.ticks())).ok() else { return false };
        let owned = |members| owned_slots(members, anchor, phase.number, timing.round_slots);
        network.members().map_or(0, owned).checked_shr(slot).is_some_and(|slots| slots & 1 == 1)
    }

    /// Superframes pass, whether a sync frame is heard or not.
    fn advance(&mut self, present: RadioInstant) {
        let Some(network) = &mut self.network else { return };
        let begun = network.advance(present);
        self.anchors.advance(begun);
        if network.silent() > LOST_AFTER {
            self.network = None;
            self.anchors.end_session();
            self.link = Some(Link::Unsynchronised);
        }
    }

    /// What is left of the round being heard since the last frame was over: a window to its end, nothing where there is none.
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
