//! What an idle tag does next in the superframe: it listens to sync frames and requests slots, then ranges in its own
//! slots.

use super::slot_request::{DueRequest, Now};
use super::{State, Tag, TagConfig};
use crate::exchange::{Action, Link, Report};
use crate::native::SHORTEST_WAIT;
use crate::native::own_lease::OwnLease;
use crate::native::plan::{Rate, last_round, lists, next_round};
use crate::native::sync::Sync;
use crate::native::timing::{SUPERFRAME, Timing};
use crate::{RadioDuration, RadioInstant, Start};
use wire::config::PollContent;
use wire::uwb::layout::Scheme;
use wire::uwb::native::{MAX_MEMBERS, Message, Poll, PolledPosition, Share, SyncFrame};

/// Without a sync frame for this many superframes the tag searches again.
pub(super) const LOST_AFTER: u16 = 5;

/// A lease in a slot that is not leased for more than this many superframes was given by another coordinator, or for another
/// layout: its tag asks again.
const NOT_LEASED: u16 = 50;

/// The network that the tag follows.
#[derive(Clone, Debug)]
pub(super) struct Followed {
    pub(super) sync: Sync,
    /// Superframes until the tag may request slots again.
    pub(super) request_in: u16,
    /// Requests without effect.
    pub(super) requests: u8,
    /// The superframe that `owned` is for.
    planned: Option<u16>,
    /// This tag's round slots in this superframe: bit i for slot i.
    pub(super) owned: u64,
    /// Its lease.
    pub(super) lease: OwnLease,
    /// The superframe since which the lease's slot is not leased.
    not_leased_since: Option<u16>,
    /// Rounds begun in this superframe.
    rounds: u32,
    pub(super) joined: bool,
    /// The tag has reported that the network is full.
    is_full: bool,
    /// Superframes followed, counted only as far as needed.
    pub(super) followed: u16,
}

impl Tag {
    /// The next action in the superframe, when no round is in progress.
    pub(super) fn schedule(&mut self, present: RadioInstant) -> Action<'_> {
        let lead = self.meter.lead();
        let is_seldom = self.is_seldom();
        let is_greedy = self.rate == Some(Rate::Greedy);
        self.free_at = self.free_at.filter(|free_at| is_greedy && free_at.since(present) > RadioDuration::ZERO);
        let Some(network) = &mut self.network else { return self.search(present) };
        if network.sync.has_lost_time(present) {
            return self.lose_network();
        }
        let superframe = network.sync.course.timing.superframe;
        // A superframe begins early for this node, because it must decide in time what to send first.
        let early = RadioDuration::from_ticks(lead.ticks() + SHORTEST_WAIT.ticks());
        if let Some(since) = network.sync.adrift {
            network.sync.advance(present.plus(early));
            if let Some(action) = self.end_doze(present) {
                return action;
            }
            let patience = RadioDuration::from_ticks(i64::from(LOST_AFTER) * superframe.ticks());
            if present.since(since) <= patience {
                return Self::listen(superframe);
            }
            return self.lose_network();
        }
        let begun = network.sync.advance(present.plus(early));
        network.followed = network.followed.saturating_add(begun);
        network.request_in = if is_seldom { 0 } else { network.request_in.saturating_sub(begun) };
        self.age_anchors(begun, is_seldom);
        let Some(network) = &mut self.network else { return Self::listen(SUPERFRAME) };
        if network.sync.silent() > LOST_AFTER {
            return self.lose_network();
        }
        let Sync { course, .. } = &network.sync;
        let timing = course.timing;
        let passed = present.since(course.phase.start);
        // The sync slots end early, because the tag must decide in time on a round in the first round slot.
        let sync_end = RadioDuration::from_ticks(timing.rounds().ticks() - early.ticks());
        if passed < sync_end {
            if !is_seldom {
                return self.among_sync_frames(passed, sync_end);
            }
            if let Some(action) = self.among_few_sync_frames(passed, sync_end) {
                return action;
            }
        }
        let Some(network) = &mut self.network else { return Self::listen(SUPERFRAME) };
        let share = self.config.share_of(self.rate, &timing);
        network.plan(&self.config, share, &timing);
        let course = &network.sync.course;
        let is_listed = course.membership.in_force().is_some_and(|plan| lists(&plan.members, self.config.address));
        let has_slots = is_listed || network.lease.turn().is_some();
        let is_refused = !has_slots && network.is_full_for(self.config.address, share);
        if self.rate.is_some() && !network.is_full && is_refused {
            (network.is_full, network.joined) = (true, false);
            return Action::Report(Report::Link(Link::NetworkFull));
        }
        if has_slots && !network.joined {
            (network.joined, network.is_full) = (true, false);
            let slots = network.owned.count_ones().max(1) as u8;
            return Action::Report(Report::Link(Link::Joined(slots)));
        }
        if network.joined && !has_slots {
            network.joined = false;
            if self.rate.is_some() {
                return Action::Report(Report::Link(Link::Unlisted));
            }
        }
        if network.planned.replace(course.phase.number) != Some(course.phase.number) {
            network.rounds = 0;
            let team = self.anchors.choose(self.config.anchors.into(), self.position_m);
            let relays = self.anchors.relays_of(&team, network.sync.course.phase.number);
            self.round.set_team(team, relays);
            self.round.set_data(self.data);
        }
        // Who has slots asks for others among the sync frames only.
        let due = if !is_seldom && !network.joined { self.due_request(sync_end) } else { None };
        match due.filter(|due| due.rmarker >= sync_end) {
            Some(due) => self.request_among_rounds(due, passed),
            None => self.among_rounds(passed),
        }
    }

    /// No anchor was received for too long.
    fn lose_network(&mut self) -> Action<'static> {
        self.network = None;
        self.anchors.end_session();
        Action::Report(Report::Link(Link::Unsynchronised))
    }

    /// In the sync slots: listens, and requests slots if the listed share differs from the wanted one.
    fn among_sync_frames(&mut self, passed: RadioDuration, end: RadioDuration) -> Action<'_> {
        let rest = RadioDuration::from_ticks(end.ticks() - passed.ticks());
        let Some(network) = &self.network else { return Self::listen(rest) };
        let rounds = network.sync.course.timing.rounds();
        let Some(due) = self.due_request(end).filter(|due| due.rmarker < rounds) else { return Self::listen(rest) };
        match self.time_to_request(due, passed) {
            Now::Nothing => Self::listen(rest),
            Now::Wait(spare) => Self::listen(spare),
            Now::Send => self.request(due),
        }
    }

    /// A request in round slots that belong to nobody.
    fn request_among_rounds(&mut self, due: DueRequest, passed: RadioDuration) -> Action<'_> {
        match self.time_to_request(due, passed) {
            Now::Nothing => self.rest(passed),
            Now::Wait(spare) => {
                let Some(network) = &self.network else { return Self::listen(SUPERFRAME) };
                Action::WaitUntil(network.sync.course.phase.at(passed).plus(spare))
            }
            Now::Send => self.request(due),
        }
    }

    /// In the round slots: a round if one fits in this tag's slots, else off until the next of them or the next
    /// superframe.
    fn among_rounds(&mut self, passed: RadioDuration) -> Action<'_> {
        let lead = self.meter.lead();
        let is_greedy = self.rate == Some(Rate::Greedy);
        let Some(network) = &mut self.network else { return Self::listen(SUPERFRAME) };
        let course = &network.sync.course;
        let (timing, phase, uncertainty) = (course.timing, course.phase, network.sync.uncertainty);
        if is_greedy && self.compensation.take(phase.number, self.config.address) {
            return Action::Compensate;
        }
        // Rounds of few anchors are shorter than slots. A tag with a fixed rate makes as many rounds as it has slots.
        let has_enough = !is_greedy && network.rounds >= network.owned.count_ones();
        let anchors = match self.config.blinks {
            _ if has_enough => 0,
            true => 1,
            false => self.round.slots(),
        };
        let after = |earliest: RadioDuration| {
            network.next_pulse(network.owned, earliest, anchors, uncertainty).filter(|_| anchors > 0)
        };
        let immediate = RadioDuration::from_ticks(passed.ticks() + self.meter.immediate().ticks());
        // A tag that must wait with its next frame sends it at an instant.
        let spaced = self.next_pulse.map(|pulse| pulse.since(phase.start)).filter(|pulse| *pulse > passed);
        let in_lead = RadioDuration::from_ticks(passed.ticks() + lead.ticks());
        let soonest = spaced.map_or(immediate, |pulse| pulse.max(in_lead));
        // A measurement before the end of the computation would be wasted. The time from the round's end to its report
        // is about that of two frames.
        let computed = self.free_at.map_or(RadioDuration::ZERO, |free_at| free_at.since(phase.start));
        let takes = timing.round(anchors).ticks() + 2 * self.meter.reading().ticks();
        let in_time = soonest.max(RadioDuration::from_ticks(computed.ticks() - takes));
        // But during the sync frames there is time to compute what is measured at the superframe's end.
        let next_rounds = RadioDuration::from_ticks(timing.superframe.ticks() + timing.rounds().ticks());
        let in_time = if in_time > soonest && computed < next_rounds {
            let backlog = Backlog { computed, per_round: self.busy_per_round, until: next_rounds };
            let last = last_round(network.owned, &timing, anchors, uncertainty);
            let every = RadioDuration::from_ticks(takes + self.meter.immediate().ticks());
            let otherwise = after(in_time).map_or(soonest, |_| in_time);
            backlog.begin(last, soonest, every).map_or(otherwise, |begin| begin.min(otherwise))
        } else {
            in_time
        };
        // The tag was woken for a round. It makes the round if the round's instant is still in the future.
        let spare = |pulse: RadioDuration| RadioDuration::from_ticks(pulse.ticks() - passed.ticks() - lead.ticks());
        let planned = self.pulse_at.take().map(|pulse| pulse.since(phase.start));
        let is_in_time = |pulse: &RadioDuration| *pulse > passed && 2 * spare(*pulse).ticks() > -lead.ticks();
        if let Some(wake) = self.stopwatch.wake_at.filter(|_| planned.is_some_and(|pulse| !is_in_time(&pulse))) {
            self.meter.overslept(phase.at(passed).since(wake));
        }
        let planned = planned.filter(|pulse| anchors > 0 && network.owned != 0 && is_in_time(pulse));
        if let Some(pulse) = planned.or_else(|| after(in_time)) {
            let pulse_at = phase.at(pulse);
            let at_once = planned.is_none() && spaced.is_none() && pulse == soonest && !self.config.blinks;
            if !at_once && spare(pulse) > SHORTEST_WAIT {
                if let Some(action) = self.nap_before(pulse, passed) {
                    return action;
                }
                let wake = pulse_at.plus(RadioDuration::from_ticks(-lead.ticks()));
                (self.stopwatch.wake_at, self.pulse_at) = (Some(wake), Some(pulse_at));
                return Action::WaitUntil(wake);
            }
            self.stopwatch.wake_at = self.stopwatch.wake_at.filter(|_| planned.is_some());
            let start = if at_once { Start::Now } else { Start::At(pulse_at.plus(timing.to_rmarker)) };
            network.rounds = network.rounds.saturating_add(1);
            if self.config.blinks {
                return self.blink(start, pulse_at);
            }
            let scheme = self.config.scheme.min(timing.layout.scheme);
            return self.poll(scheme, (start, pulse_at), at_once.then(|| phase.at(passed)));
        }
        self.rest(passed)
    }

    /// A sync frame of the followed network may have news of this tag's lease.
    pub(super) fn learn_leases(&mut self, sync_frame: &SyncFrame) {
        let Some(network) = &mut self.network else { return };
        let Some(turns) = self.config.share_of(self.rate, &network.sync.course.timing).leased() else { return };
        for lease in sync_frame.leases.iter().filter(|lease| lease.tag == self.config.address) {
            network.lease.receive(lease, turns, sync_frame.superframe);
        }
    }

    /// Begins a round, whose first pulse leaves at about the instant `pulse`.
    fn poll(
        &mut self,
        scheme: Scheme,
        (start, pulse): (Start, RadioInstant),
        decided_at: Option<RadioInstant>,
    ) -> Action<'_> {
        let wish = self.meter.wish(self.config.scheme);
        let mut poll = self.round.begin(&mut self.anchors, scheme, wish, self.config.tells == PollContent::Distances);
        poll.position = self.fix.filter(|_| self.config.tells.has_position()).and_then(|fix| {
            let rounds_ago = u8::try_from(poll.round.wrapping_sub(fix.round)).ok()?;
            (rounds_ago <= PolledPosition::OLDEST).then_some(fix.position.of_rounds_ago(rounds_ago))
        });
        self.send_poll(poll, pulse);
        let is_off_after = self.is_off_after_poll(scheme);
        self.state = State::Polling { decided_at, is_off_after };
        Action::Transmit { frame: self.out.bytes(), start, listen: !is_off_after }
    }

    /// A blink, whose first pulse leaves at the instant `pulse`. It asks an anchor only for a confirmation of its lease.
    fn blink(&mut self, start: Start, pulse: RadioInstant) -> Action<'_> {
        let Some(network) = &self.network else { return Self::listen(SUPERFRAME) };
        let asks = network.lease.asks(network.sync.course.phase.number);
        let part = network.lease.turn().map_or(1, |turn| turn.part());
        let asked = if asks { self.anchors.surest() } else { None };
        let wish = self.meter.wish(Scheme::SingleSided);
        let blink = self.round.begin_blink(part, asked, wish);
        self.send_poll(blink, pulse);
        let is_off_after = asked.is_some() && self.is_off_after_poll(Scheme::SingleSided);
        self.state = State::Polling { decided_at: None, is_off_after };
        Action::Transmit { frame: self.out.bytes(), start, listen: asked.is_some() && !is_off_after }
    }

    fn send_poll(&mut self, poll: Poll, pulse: RadioInstant) {
        let moment = self.network.as_ref().and_then(|network| network.sync.course.moment_of_round(pulse));
        let sealed = self.write(Message::Poll(poll), moment);
        self.round.seal(sealed);
    }
}

/// The rounds that the node has not computed yet.
#[derive(Clone, Copy, Debug)]
struct Backlog {
    /// From the superframe's beginning to the end of the computation.
    computed: RadioDuration,
    /// How long a round takes, in the mean.
    per_round: RadioDuration,
    /// From the superframe's beginning to the instant by which all must be computed.
    until: RadioDuration,
}

/// A node computes one round while this many others wait.
const WAITING_ROUNDS: i64 = 2;

impl Backlog {
    /// When rounds may begin, one after each interval `every` until `last`, so that they can wait until they are
    /// computed: as soon as possible, from `soonest` on. While rounds are made, the node may have no time to compute.
    fn begin(self, last: RadioDuration, soonest: RadioDuration, every: RadioDuration) -> Option<RadioDuration> {
        let [last, soonest, every] = [last, soonest, every].map(RadioDuration::ticks);
        (0..=WAITING_ROUNDS).rev().find_map(|before_last| {
            let begin = last - before_last * every;
            // An eighth of a round is for what is not the mean.
            let limit = begin + every + (WAITING_ROUNDS + 1) * self.per_round.ticks() - self.per_round.ticks() / 8;
            let computed = self.computed.ticks() + (before_last + 1) * self.per_round.ticks();
            let fits = begin >= soonest && computed <= limit.min(self.until.ticks());
            // All that there is time for need not wait.
            fits.then_some(if begin - every < soonest { soonest } else { begin }).map(RadioDuration::from_ticks)
        })
    }
}

impl Followed {
    /// Nothing requested, nothing owned.
    pub(super) fn begin(sync: Sync) -> Self {
        Self {
            sync,
            request_in: 0,
            requests: 0,
            planned: None,
            owned: 0,
            lease: OwnLease::default(),
            not_leased_since: None,
            rounds: 0,
            joined: false,
            is_full: false,
            followed: 0,
        }
    }

    /// Whether the tag has the share that it wants.
    pub(super) fn has(&self, tag: u16, share: Share) -> bool {
        let listed = self.sync.course.membership.members().iter().find(|member| member.tag == tag);
        match share {
            Share::Leased(turns) => self.lease.has(turns),
            Share::Release => listed.is_none() && self.lease.turn().is_none(),
            Share::Slots(_) | Share::Greedy => listed.is_some_and(|member| member.share == share),
        }
    }

    /// Whether the network has no place of the wanted kind for this tag.
    pub(super) fn is_full_for(&self, tag: u16, share: Share) -> bool {
        let members = self.sync.course.membership.members();
        match share {
            Share::Leased(_) => self.lease.is_refused,
            Share::Release | Share::Slots(_) | Share::Greedy => members.len() == MAX_MEMBERS && !lists(members, tag),
        }
    }

    /// From the superframe's beginning to the first pulse of the next round of `anchors` anchors, or of the blink, in
    /// these slots of the tag, as [`next_round`].
    #[inline(never)]
    pub(super) fn next_pulse(
        &self,
        owned: u64,
        earliest: RadioDuration,
        anchors: usize,
        uncertainty: RadioDuration,
    ) -> Option<RadioDuration> {
        let timing = &self.sync.course.timing;
        match self.lease.turn().filter(|turn| turn.part() > 0) {
            Some(turn) => {
                let pulse = timing.blink(turn.slot, turn.part());
                let fits = owned == turn.bit() && pulse >= earliest && uncertainty <= timing.most_uncertain_blink();
                fits.then_some(pulse)
            }
            None => next_round(owned, timing, earliest, anchors, uncertainty),
        }
    }

    /// Determines this tag's slots in this superframe: none if the plan may have changed without the tag receiving the
    /// change. A tag that wants a lease uses its slots of the list until it has one, and the other way round.
    fn plan(&mut self, config: &TagConfig, share: Share, timing: &Timing) {
        let number = self.sync.course.phase.number;
        if self.planned == Some(number) {
            return;
        }
        self.lease.expire(number);
        let Some(plan) = self.sync.plan() else {
            self.owned = 0;
            return;
        };
        let wants_lease = share.leased().is_some();
        if !wants_lease && lists(&plan.members, config.address) {
            self.lease.release();
        }
        let leased = plan.slots.leased.min(timing.round_slots);
        let is_leased = self.lease.turn().is_none_or(|turn| turn.slot < leased);
        let since = *self.not_leased_since.get_or_insert(number);
        if is_leased {
            self.not_leased_since = None;
        } else if number.wrapping_sub(since) > NOT_LEASED {
            self.lease.release();
        }
        self.owned = match self.lease.turn() {
            Some(turn) if turn.is_in(number) && is_leased => turn.bit(),
            Some(_) => 0,
            None => plan.owned_slots(config.address, number, timing),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_rounds_as_the_sync_frames_leave_time_for_come_at_the_end() {
        let us = RadioDuration::from_micros;
        let begin = |computed, soonest| {
            let backlog = Backlog { computed: us(computed), per_round: us(8_480), until: us(119_488) };
            backlog.begin(us(97_585), us(soonest), us(3_510)).map(|begin| begin.as_micros())
        };
        // Of three rounds the last would be computed at 99.187 + 3 · 8.48 = 124.6 ms, of two at 116.1: the first of them
        // begins 3.51 ms before the last.
        assert_eq!(begin(99_187, 85_000), Some(94_075));
        // There is time for two and no more.
        assert_eq!(begin(99_187, 92_000), Some(92_000));
        assert_eq!(begin(99_187, 95_000), Some(95_000));
        assert_eq!(begin(99_187, 98_000), None);
        // 115 + 8.48 = 123.5.
        assert_eq!(begin(115_000, 95_000), None);
    }
}
