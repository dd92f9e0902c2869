//! What an anchor does with received frames: it checks their codes, and takes what is new.

use heapless::Vec;

use super::{Anchor, Answer, Answered, DEVIATION_M, ReportedRange};
use crate::exchange::{Link, Polled, Range};
use crate::native::authentication::{Forged, Moment, SealedPoll};
use crate::native::coordinator::{Coordinator, FollowUpdate};
use crate::native::plan::NOTICE_SUPERFRAMES;
use crate::native::spread;
use crate::native::timing::{Phase, SUPERFRAME, SYNC_SLOTS, Timing, end_of};
use crate::radio::MAX_FRAME;
use crate::{Diagnostics, RadioDuration, RadioInstant, RxFrame};
use wire::uwb::BROADCAST;
use wire::uwb::layout::Scheme;
use wire::uwb::native::{FinalReceived, Frame, Member, Message, Poll, Response, SyncFrame, slot_of};

/// A sync frame that is opened after the anchor's own was sent: the codes of both take longer than an answer.
#[derive(Clone, Debug)]
pub(super) struct PostponedFrame {
    bytes: Vec<u8, MAX_FRAME>,
    rx_time: RadioInstant,
    diagnostics: Diagnostics,
}

/// An anchor that was restarted as the coordinator founds a network of its own if no other one has taken over within
/// this many superframes.
const SUCCESSOR_SUPERFRAMES: i64 = 20;

impl Anchor<'_> {
    /// Whether the anchor takes part in the network that it follows.
    fn takes_part(&self) -> bool {
        self.is_proven || self.config.network.key.is_none()
    }

    /// Takes a frame, or keeps it until the own sync frame has left.
    #[inline(never)]
    pub(super) fn take(&mut self, frame: &RxFrame<'_>) {
        self.catch_up();
        let own = self.network.as_ref().filter(|_| self.is_proven).and_then(Coordinator::due);
        let is_before_own = slot_of(frame.bytes).is_some_and(|slot| own == Some(slot + 1));
        match Vec::from_slice(frame.bytes).ok().filter(|_| is_before_own) {
            Some(bytes) => {
                let RxFrame { rx_time, diagnostics, .. } = *frame;
                self.postponed = Some(PostponedFrame { bytes, rx_time, diagnostics });
            }
            None => self.receive(frame),
        }
    }

    /// Takes the frame that was kept.
    #[inline(never)]
    pub(super) fn catch_up(&mut self) {
        if let Some(PostponedFrame { bytes, rx_time, diagnostics }) = self.postponed.take() {
            self.receive(&RxFrame { bytes: &bytes, rx_time, diagnostics });
        }
    }

    #[inline(never)]
    fn receive(&mut self, frame: &RxFrame<'_>) {
        // By reference: a message takes hundreds of bytes, and each copy as many instructions.
        let parsed = Frame::parse(frame.bytes);
        let Some(told) = parsed.as_ref().ok().filter(|told| told.pan == self.config.network.pan) else { return };
        let is_own = match &told.message {
            Message::Response(_) | Message::RelayFrame(_) => told.destination == self.config.address,
            _ => told.destination == BROADCAST,
        };
        if !is_own {
            return;
        }
        let opened = self.open(&told.message, frame);
        let Some(sealed) = opened.ok().filter(|sealed| sealed.is_none() || self.is_first(told, frame.rx_time)) else {
            self.refused = self.refused.wrapping_add(1);
            return;
        };
        match &told.message {
            Message::Poll(poll) => self.on_poll(told.source, poll, sealed, frame),
            Message::Request(request) => {
                if let Some(network) = &mut self.network {
                    network.request(&mut self.leases, Member { tag: told.source, share: request.share }, false);
                    network.wish(told.source, request.wish);
                }
            }
            Message::SyncFrame(sync_frame) => self.on_sync_frame(told.source, sync_frame, frame),
            Message::Response(response) => {
                if let Some(network) = &self.network {
                    self.rounds.answer(&network.course.timing, told.source, *response, frame);
                }
            }
            Message::RelayFrame(relayed) => self.uplink.receive_relay_frame(told.source, relayed),
            Message::Final { round } => self.on_final(told.source, *round, frame.rx_time),
            Message::Challenge(challenge) => {
                let session = self.network.as_ref().and_then(|network| network.course.session);
                if session == Some(challenge.session) {
                    self.challenger.receive(challenge);
                }
            }
        }
    }

    /// Checks a frame's code. Returns what a round refers to, in a network with a key.
    fn open(&self, message: &Message, frame: &RxFrame<'_>) -> Result<Option<SealedPoll>, Forged> {
        let network = &self.config.network;
        let moment = match message {
            Message::Response(_) => return network.open_response(frame.bytes, self.rounds.sealed()).map(|()| None),
            Message::SyncFrame(sync_frame) => return network.open_sync_frame(frame.bytes, sync_frame),
            Message::Challenge(challenge) => {
                self.moment_at(frame.rx_time).map(|at| Moment::of_challenge(challenge, at.superframe))
            }
            Message::Request(_) => {
                let place = self.network.as_ref().and_then(|network| network.course.request_place_at(frame.rx_time));
                self.moment_at(frame.rx_time).zip(place).map(|(moment, place)| moment.at_place(place))
            }
            Message::RelayFrame(_) => self.moment_at(frame.rx_time),
            // The final of a round in a leased slot comes in that slot, too.
            Message::Poll(_) | Message::Final { .. } => self.network.as_ref().and_then(|network| {
                let course = &network.course;
                course.moment_of_round(frame.rx_time.plus(RadioDuration::from_ticks(-course.timing.to_rmarker.ticks())))
            }),
        };
        network.open(frame.bytes, moment)
    }

    fn moment_at(&self, instant: RadioInstant) -> Option<Moment> {
        self.network.as_ref().and_then(|network| network.course.moment_at(instant))
    }

    /// Whether a frame with a right code has not come before in its superframe. A sync frame says its superframe itself, and a
    /// blink counts in its part of its slot only.
    fn is_first(&mut self, told: &Frame, rx_time: RadioInstant) -> bool {
        if matches!(told.message, Message::SyncFrame(_) | Message::Poll(Poll { part: Some(_), .. })) {
            return true;
        }
        self.moment_at(rx_time).is_some_and(|moment| !self.opened.is_repeated(moment, told.source, told.sequence))
    }

    /// Whether a sync frame is to be followed: it is no older one of the own session, and another session is there.
    #[inline(never)]
    fn is_present(&mut self, sync_frame: &SyncFrame, rx_time: RadioInstant) -> bool {
        let Some((key, session)) = self.config.network.key.as_ref().zip(sync_frame.session.as_ref()) else {
            return true;
        };
        let moment = self.network.as_ref().and_then(|network| network.course.moment_at(rx_time));
        let own = moment.filter(|moment| moment.session == session.number);
        if own.is_none() || !self.is_proven {
            // A challenge comes in the place of a request.
            let timing = Timing::of(&self.config.network, sync_frame.layout);
            let phase = Phase::from_sync_frame(&timing, sync_frame.superframe, sync_frame.slot, rx_time);
            let place = spread(self.config.address, sync_frame.superframe, timing.request_slots.into());
            let mut at = phase.at(timing.request(place.into()));
            let Moment { mut superframe, .. } = Moment::new(session.number, session.epoch, sync_frame.superframe);
            if at.since(rx_time) < timing.request_slot {
                at = at.plus(timing.superframe);
                superframe = superframe.wrapping_add(1);
            }
            let is_live = self.challenger.is_live(key, session, rx_time, (at, superframe));
            if moment.is_some() && own.is_none() {
                return is_live;
            }
            if is_live {
                self.is_proven = true;
                self.link = Some(Link::Synchronised(sync_frame.coordinator));
            }
        }
        // One before the present superframe, as nodes need not agree on it to the tick.
        let told = Moment::of_sync_frame(sync_frame).zip(own);
        told.is_none_or(|(told, own)| told.superframe.saturating_add(1) >= own.superframe)
    }

    fn on_sync_frame(&mut self, source: u16, sync_frame: &SyncFrame, frame: &RxFrame<'_>) {
        if usize::from(sync_frame.slot) >= SYNC_SLOTS || source == self.config.address {
            return;
        }
        if let Some(network) = &mut self.network {
            network.make_way(sync_frame, frame.rx_time);
        }
        if !self.is_present(sync_frame, frame.rx_time) {
            return;
        }
        self.rounds.receive(source);
        let followed = &self.config.network;
        match &mut self.network {
            Some(network) => {
                // A frame in another's slot costs a stranger nothing.
                let is_known = network.is_known(source, sync_frame);
                match network.receive(followed, &mut self.leases, source, sync_frame, frame.rx_time) {
                    FollowUpdate::Ignored => return,
                    FollowUpdate::Followed => {}
                    FollowUpdate::Changed(link) => self.link = Some(link),
                }
                if self.has_host {
                    let (told, bias) = ((source, sync_frame.superframe), &self.stamps.range_bias);
                    self.arrivals.sync_frame(told, frame.rx_time, &frame.diagnostics, bias);
                }
                if is_known {
                    self.uplink.receive(source, sync_frame, network.own_slot());
                    self.downlinks.receive(sync_frame);
                }
            }
            // It was the coordinator, and has forgotten all leases. Another anchor knows them, and takes over.
            None if sync_frame.coordinator == self.config.address => {
                if !self.awaits_successor {
                    let patience = SUCCESSOR_SUPERFRAMES * SUPERFRAME.ticks();
                    self.found_at = Some(frame.rx_time.plus(RadioDuration::from_ticks(patience)));
                    self.awaits_successor = true;
                }
            }
            None => {
                self.network = Coordinator::join(self.config.address, followed, source, sync_frame, frame.rx_time);
                if followed.key.is_none() {
                    self.link = self.network.as_ref().map(|_| Link::Synchronised(sync_frame.coordinator));
                } else if self.network.is_none() {
                    // Its layout changes just now.
                    let superframe = Timing::of(followed, sync_frame.layout).superframe.ticks();
                    let notice = RadioDuration::from_ticks((i64::from(NOTICE_SUPERFRAMES) + 1) * superframe);
                    self.found_at = Some(frame.rx_time.plus(notice));
                }
            }
        }
    }

    fn on_final(&mut self, tag: u16, round: u16, rx_time: RadioInstant) {
        let answered = self.answered.iter_mut().find(|answered| answered.tag == tag && answered.round == round);
        if let Some(answered) = answered {
            let after_response = rx_time.since(answered.departure);
            answered.final_heard = Some(FinalReceived { round: round as u8, after_response });
        }
    }

    /// A response to a tag in a round leaves at `departure`. Returns the final of the round before, if it was received.
    fn note_response(&mut self, tag: u16, round: u16, departure: RadioInstant) -> Option<FinalReceived> {
        let last = self.answered.iter().position(|answered| answered.tag == tag);
        let final_heard = last.and_then(|place| self.answered.remove(place).final_heard);
        if self.answered.is_full() {
            // The one that has been silent longest.
            self.answered.remove(0);
        }
        // There is a place now.
        let _ = self.answered.push(Answered { tag, round, departure, final_heard: None });
        final_heard
    }

    fn on_poll(&mut self, tag: u16, poll: &Poll, sealed: Option<SealedPoll>, frame: &RxFrame<'_>) {
        // An anchor without a network knows no layout, and so does not know when to answer.
        let takes_part = self.takes_part();
        let Some(network) = self.network.as_mut().filter(|_| takes_part) else { return };
        let timing = network.course.timing;
        let pulse = frame.rx_time.plus(RadioDuration::from_ticks(-timing.to_rmarker.ticks()));
        let asked = poll.anchors.len() as u8;
        let Poll { round, position, data, .. } = *poll;
        let place = poll.anchors.iter().position(|asked| asked.address == self.config.address);
        if let Some(part) = poll.part {
            if !network.course.is_in_part(pulse, part) {
                self.refused = self.refused.wrapping_add(1);
                return;
            }
            if self.has_host {
                let superframe = network.course.phase.number;
                let (diagnostics, bias) = (&frame.diagnostics, &self.stamps.range_bias);
                self.arrivals.blink((tag, round), superframe, frame.rx_time, diagnostics, bias);
            }
        }
        if position.is_some() || data.is_some() {
            self.polled = Polled { tag, round, asked, age: RadioDuration::ZERO, position, data };
            self.polled_at = Some((frame.rx_time, place == Some(0)));
        }
        let lease = network.on_poll(&mut self.leases, tag, poll, pulse);
        // One of the anchors asked is enough, another one in each round: perhaps some have not received the message.
        let turn = usize::from(round).checked_rem(poll.anchors.len());
        let is_in_turn = place.is_some() && turn == place;
        let has_message = self.downlinks.on_poll(tag, poll.data.as_ref(), is_in_turn);
        let Some(place) = place else { return };
        let is_for_others = place == 0 && (position.is_some() || data.is_some());
        let passes_on = network.own_slot().is_some() && self.uplink.has_way() && !self.uplink.is_busy();
        let passes_nothing_on = is_for_others && !passes_on;
        let slot = poll.first_slot() + place;
        let poll_rx = frame.rx_time;
        let antenna_delay = self.stamps.antenna_delay;
        let start = poll_rx.plus(timing.reply_in(slot)).plus(RadioDuration::from_ticks(-antenna_delay.ticks()));
        // The chip starts at the snapped instant: the response must contain that instant.
        let departure = self.stamps.departure(start);
        let last_final = self.note_response(tag, poll.round, departure);
        // A long response is only for rounds that have room for it.
        let last_final = last_final.filter(|_| timing.layout.scheme == Scheme::DoubleSided);
        let reply = departure.since(poll_rx);
        let round = poll.round as u8;
        let response = Response { round, lease, has_message, passes_nothing_on, poll_rx, reply, last_final };
        let polled = poll.part.is_none().then(|| end_of(&self.config.network.phy, frame));
        self.answer = Some(Answer { tag, polled, start, response, sealed });
        // The distances in another anchor's poll are for tags that only listen.
        let asked = poll.anchors.get(place).filter(|_| !self.rounds.knows(tag));
        let distance = asked.and_then(|asked| asked.distance.metres());
        self.told = distance.map(|distance_m| ReportedRange {
            // The distance is that of the round before.
            round: poll.round.wrapping_sub(1),
            poll: poll_rx,
            range: [Range {
                peer: tag,
                distance_m,
                deviation_m: DEVIATION_M,
                position_m: None,
                diagnostics: frame.diagnostics,
            }],
        });
    }
}
