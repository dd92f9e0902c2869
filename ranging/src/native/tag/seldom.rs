//! What a tag with a fixed rate does so that its receiver is on as briefly as possible. It listens to one sync frame,
//! and is off until its round and between its rounds. Where possible, its radio sleeps meanwhile and restarts its
//! clock.

use super::super::SHORTEST_WAIT;
use super::super::search::{Next, Search};
use super::super::sync_schedule::{Listening, WatchedAnchor};
use super::super::timing::{HOLDOVER_SUPERFRAMES, Network, SUPERFRAME, Timing};
use super::super::wake_ups::Slept;
use super::{Rate, State, Tag, TagConfig};
use crate::exchange::{Action, COMPENSATION};
use crate::time::TICKS_PER_SECOND;
use crate::{RadioDuration, RadioInstant, Start};
use wire::serial_number::SerialNumber;
use wire::uwb::layout::Scheme;
use wire::uwb::native::{POLL_BYTES, SYNC_FRAME_BYTES, Share};

/// A dozing tag gives up its clock between turns that are at least this many superframes apart. For fewer superframes
/// it naps, and relies on its clock.
const DOZE_FROM: u16 = 2;
/// The tag makes a turn without a sync frame before it if it has slept for no longer than this: the set of ranging
/// nodes may change meanwhile.
const LONGEST_HOLDOVER: RadioDuration = RadioDuration::from_micros(20_000_000);
/// A tag listens to a sync frame after this many blinks.
const HELD_BLINKS: u8 = 8;
/// Waits shorter than this are not worth a sleep, after which the node's time has an uncertainty.
const NAP_FROM: RadioDuration = RadioDuration::from_micros(7_000);
/// The tag listens to all sync frames for this many superframes before it listens to single ones: so it knows all
/// anchors.
const ACQUAINTING: u16 = 10;
/// From a decision until a receiver is ready to start at an instant.
const ARMING: RadioDuration = RadioDuration::from_micros(250);
/// The receiver starts this long before the expected frame: its own start takes 16 µs.
const RECEIVER_START: RadioDuration = RadioDuration::from_micros(20);
/// A tag that doubts its session listens for others in one of this many superframes.
const LOOKS_ABOUT_EVERY: u16 = 8;
/// An anchor confirms a lease of which it knows a poll of the last four turns. A tag that ranges even less often than
/// the longest period uses half of them.
const TURNS_A_POLL: i64 = 2;

/// A wait through which the radio may sleep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Nap {
    from: RadioInstant,
    duration: RadioDuration,
    /// It ended early, at an unknown instant.
    is_cut: bool,
}

/// The purpose at the end of a doze.
#[derive(Clone, Copy, Debug)]
pub(super) struct Aim {
    superframe: u16,
    listening: Listening,
}

/// An anchor whose sync frame is awaited, and the end of the wait.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Awaited {
    address: u16,
    until: RadioInstant,
}

const fn sum(a: RadioDuration, b: RadioDuration) -> RadioDuration {
    RadioDuration::from_ticks(a.ticks() + b.ticks())
}

const fn difference(a: RadioDuration, b: RadioDuration) -> RadioDuration {
    RadioDuration::from_ticks(a.ticks() - b.ticks())
}

impl Tag {
    /// The start and end of the receiver's window for the sync frame of a slot, from the beginning of the superframe.
    /// The node's clock may be off by `uncertainty`.
    fn sync_window(&self, timing: &Timing, slot: u8, uncertainty: RadioDuration) -> [RadioDuration; 2] {
        let rmarker = timing.sync_frame(slot.into());
        let early = sum(timing.to_rmarker, sum(uncertainty, RECEIVER_START));
        let Network { phy, .. } = &self.config.network;
        let bytes = SYNC_FRAME_BYTES + self.config.network.code_bytes();
        let late = sum(phy.time_after_rmarker(bytes), sum(uncertainty, timing.guard));
        [difference(rmarker, early), sum(rmarker, late)]
    }

    /// Waits. The radio sleeps if the tag dozes and the radio allows it. The node must be awake in time, so its wake-up
    /// is set earlier by the expected lateness.
    pub(super) fn pause(&mut self, present: RadioInstant, wait: RadioDuration) -> Action<'static> {
        if !self.dozes || wait < NAP_FROM {
            return Action::WaitUntil(present.plus(wait));
        }
        let duration = difference(wait, self.wakes.late(Slept::once(wait)));
        self.state = State::Napping(Nap { from: present, duration, is_cut: false });
        Action::Sleep { from: present, duration }
    }

    /// The last requested wait ends early. Its purpose is given up: the tag listens to the next sync frame.
    pub(super) fn cut_wait(&mut self) {
        (self.aim, self.stopwatch.wake_at, self.pulse_at) = (None, None, None);
        if let State::Napping(nap) = &mut self.state {
            nap.is_cut = true;
        }
    }

    /// The radio has slept for an unknown time.
    fn lose_time(&mut self, now: RadioInstant) {
        (self.slept, self.search) = (Slept::default(), Search::default());
        if let Some(network) = &mut self.network {
            network.sync.adrift = Some(now);
        }
    }

    /// The radio has slept: its clock was restarted.
    pub(super) fn woke(&mut self, nap: Nap, now: RadioInstant) {
        self.anchors.sleep(nap.duration.ticks() as f32 / TICKS_PER_SECOND as f32);
        if nap.is_cut {
            return self.lose_time(now);
        }
        let once = Slept::once(nap.duration);
        let before = nap.from.plus(sum(nap.duration, self.wakes.late(once)));
        self.slept = self.slept.and(once);
        self.pulse_at = self.pulse_at.map(|pulse| now.plus(pulse.since(before)));
        if let Some(network) = &mut self.network {
            network.sync.rebase(before, now);
            network.sync.uncertainty = self.wakes.uncertainty(self.slept);
        }
        self.resume(now);
    }

    /// A wait is over. A tag that dozed listens from now on.
    pub(super) fn resume(&mut self, now: RadioInstant) {
        if let Some(since) = self.network.as_mut().and_then(|network| network.sync.adrift.as_mut()) {
            *since = now;
        }
    }

    /// The action of a searching tag.
    pub(super) fn search(&mut self, present: RadioInstant) -> Action<'static> {
        if !self.dozes {
            return Self::listen(SUPERFRAME);
        }
        self.slept = Slept::default();
        match self.search.next(present) {
            Next::Listen(window) => Self::listen(window),
            Next::Pause(wait) => self.pause(present, wait),
        }
    }

    /// Whether the tag has a fixed rate and the share that it wants, and knows the anchors.
    pub(super) fn is_seldom(&self) -> bool {
        let (Some(rate @ Rate::Every(_)), Some(network)) = (self.rate, &self.network) else { return false };
        if network.followed < ACQUAINTING {
            return false;
        }
        network.has(self.config.address, self.config.share_of(Some(rate), &network.sync.course.timing))
    }

    /// Listens from `open` to `close`.
    fn listen_between(present: RadioInstant, open: RadioInstant, close: RadioInstant) -> Action<'static> {
        let is_far = sum(open.since(present), open.since(present)) > ARMING;
        let (start, begin) = if is_far { (Start::At(open), open) } else { (Start::Now, present) };
        Action::Receive { start, window: close.since(begin), keep_listening: false }
    }

    /// The window for a sync frame could not be opened in time: opens it at once.
    pub(super) fn receive_late(&mut self, awaited: Awaited, present: RadioInstant) -> Option<Action<'static>> {
        let window = awaited.until.since(present);
        (window > RadioDuration::ZERO).then(|| {
            self.state = State::Awaiting(awaited);
            Action::Receive { start: Start::Now, window, keep_listening: false }
        })
    }

    /// A sync frame did not come in its slot.
    pub(super) fn missed(&mut self, awaited: Awaited) {
        self.watch.missed(awaited.address);
        if !self.slept.is_none() {
            self.wakes.missed();
        }
        if let Some(network) = self.network.as_ref().filter(|network| network.sync.adrift.is_none()) {
            self.watch.is_over(network.sync.course.phase.number);
        }
    }

    /// In a doze: waits further for the sync frame that ends it, and listens for it. `None` if there is no such sync
    /// frame, or not any more.
    pub(super) fn end_doze(&mut self, present: RadioInstant) -> Option<Action<'static>> {
        let Aim { superframe, listening } = self.aim?;
        let course = &self.network.as_ref()?.sync.course;
        let (timing, phase) = (course.timing, course.phase);
        let superframes = i64::from(SerialNumber(superframe).minus(phase.number));
        let begin = RadioDuration::from_ticks(superframes * timing.superframe.ticks());
        self.doze_until(difference(begin, present.since(phase.start)), listening, present)
    }

    /// Waits for a sync frame in the superframe that begins after `begin`, and listens for it.
    fn doze_until(
        &mut self,
        begin: RadioDuration,
        listening: Listening,
        present: RadioInstant,
    ) -> Option<Action<'static>> {
        let timing = self.network.as_ref()?.sync.course.timing;
        let uncertainty = self.wakes.uncertainty(Slept::once(begin));
        let (open, one) = match listening {
            Listening::One(anchor) => {
                let [open, close] = self.sync_window(&timing, anchor.slot, uncertainty);
                (sum(begin, open), Some((anchor, sum(begin, close))))
            }
            Listening::All | Listening::Nothing => (difference(begin, uncertainty), None),
        };
        let wait = difference(open, ARMING);
        if wait > SHORTEST_WAIT {
            return Some(self.pause(present, wait));
        }
        self.aim = None;
        let (WatchedAnchor { address, .. }, close) = one.filter(|(_, close)| *close > RadioDuration::ZERO)?;
        self.state = State::Awaiting(Awaited { address, until: present.plus(close) });
        Some(Self::listen_between(present, present.plus(open), present.plus(close)))
    }

    /// In the sync slots, before `end`: listens to what is planned. `None`: nothing more to listen to.
    pub(super) fn among_few_sync_frames(
        &mut self,
        passed: RadioDuration,
        end: RadioDuration,
    ) -> Option<Action<'static>> {
        let sync = &self.network.as_ref()?.sync;
        let (timing, phase, silent) = (sync.course.timing, sync.course.phase, sync.silent());
        let uncertainty = sync.uncertainty;
        let anchor = match self.watch.plan(phase.number, silent) {
            Listening::All => return Some(Self::listen(difference(end, passed))),
            Listening::One(anchor) if silent > 0 => anchor,
            Listening::One(_) | Listening::Nothing => return None,
        };
        let [open, close] = self.sync_window(&timing, anchor.slot, uncertainty);
        let present = phase.at(passed);
        let wait = difference(difference(open, ARMING), passed);
        if wait > SHORTEST_WAIT {
            return Some(self.pause(present, wait));
        }
        let awaited = Awaited { address: anchor.address, until: phase.at(close) };
        if close <= passed {
            self.missed(awaited);
            return None;
        }
        self.state = State::Awaiting(awaited);
        Some(Self::listen_between(present, phase.at(open), phase.at(close)))
    }

    /// The end of a nap from which a round `pulse` after the superframe's beginning is still possible.
    pub(super) fn nap_before(&mut self, pulse: RadioDuration, passed: RadioDuration) -> Option<Action<'static>> {
        let wait = difference(difference(pulse, passed), self.meter.lead());
        if !self.dozes || wait < NAP_FROM || !self.is_seldom() {
            return None;
        }
        let network = self.network.as_ref()?;
        let phase = network.sync.course.phase;
        let uncertainty = self.wakes.uncertainty(Slept::once(wait));
        let later = network.next_pulse(network.owned, pulse, self.round.most_slots(), uncertainty)?;
        (self.stopwatch.wake_at, self.pulse_at) = (None, Some(phase.at(later)));
        let until = difference(later, sum(self.meter.lead(), uncertainty));
        Some(self.pause(phase.at(passed), difference(until, passed)))
    }

    /// Nothing more is to be done in this superframe: off until the next task.
    pub(super) fn rest(&mut self, passed: RadioDuration) -> Action<'static> {
        let lead = self.meter.lead();
        let is_seldom = self.is_seldom();
        let Some(network) = &mut self.network else { return Self::listen(SUPERFRAME) };
        let (timing, phase) = (network.sync.course.timing, network.sync.course.phase);
        let present = phase.at(passed);
        let next = phase.at(timing.superframe);
        if next.since(present) > COMPENSATION && self.compensation.take(phase.number, self.config.address) {
            return Action::Compensate;
        }
        let begin = next.plus(difference(RadioDuration::ZERO, lead));
        // Another session has its sync frames at other times.
        if network.sync.is_doubtful() && phase.number.is_multiple_of(LOOKS_ABOUT_EVERY) {
            return Self::listen(begin.since(present).max(SHORTEST_WAIT));
        }
        let Some(rate) = self.rate.filter(|_| is_seldom) else { return Action::WaitUntil(begin) };
        let may_doze = self.dozes && !self.watch.expects_message();
        if let Some(turns) = network.next_turn(&self.config, rate).filter(|turns| *turns >= DOZE_FROM && may_doze) {
            if let Some(action) = self.hold_over(present, turns) {
                return action;
            }
            let Some(network) = &mut self.network else { return Self::listen(SUPERFRAME) };
            network.sync.doze(turns, present);
            let superframe = phase.number.wrapping_add(turns);
            let listening = self.watch.after_doze(superframe);
            // The superframes slept through count as one.
            self.age_anchors(1, true);
            self.aim = Some(Aim { superframe, listening });
            let until = RadioDuration::from_ticks(i64::from(turns) * timing.superframe.ticks());
            return self.doze_until(difference(until, passed), listening, present).unwrap_or(Action::WaitUntil(begin));
        }
        // After a nap the clock has an uncertainty: a round needs room for it, or a sync frame before the round.
        let uncertainty =
            if self.dozes { self.wakes.uncertainty(Slept::once(timing.superframe)) } else { network.sync.uncertainty };
        let number = phase.number.wrapping_add(1);
        let pulse = network.round_in(1, self.config.address, self.round.most_slots(), uncertainty);
        let silent = network.sync.silent() + 1;
        let silent = if pulse.is_none() { silent.max(HOLDOVER_SUPERFRAMES) } else { silent };
        // A request that was awaited may have become needless: its instant is no beginning of the next poll's lead.
        (self.stopwatch.wake_at, self.pulse_at) = (None, None);
        let wake = match (self.watch.plan(number, silent), pulse) {
            (Listening::One(anchor), _) => difference(self.sync_window(&timing, anchor.slot, uncertainty)[0], ARMING),
            (Listening::Nothing, Some(pulse)) => {
                self.pulse_at = Some(next.plus(pulse));
                difference(pulse, sum(lead, uncertainty))
            }
            (Listening::Nothing, None) | (Listening::All, _) => difference(RadioDuration::ZERO, sum(lead, uncertainty)),
        };
        self.pause(present, next.plus(wake).since(present))
    }

    /// Nothing more is to be done before the turn in `turns` superframes: the tag sleeps until its round or blink, which it
    /// makes without a sync frame before it. `None` if this turn had no sync frame either, or too many blinks had none; if
    /// the list changes, or if there is no room for the uncertainty.
    fn hold_over(&mut self, present: RadioInstant, turns: u16) -> Option<Action<'static>> {
        let (lead, uncertainty) =
            (self.meter.lead(), self.wakes.uncertainty(self.slept.and(Slept::once(LONGEST_HOLDOVER))));
        let most = if self.config.blinks { HELD_BLINKS } else { 1 };
        let silent = self.config.blinks.into();
        let network = self.network.as_mut().filter(|network| network.sync.silent() <= silent)?;
        let (timing, phase) = (network.sync.course.timing, network.sync.course.phase);
        let pulse = network.round_in(turns, self.config.address, self.round.most_slots(), uncertainty)?;
        let begin = RadioDuration::from_ticks(i64::from(turns) * timing.superframe.ticks());
        let held = network.sync.held + 1;
        if held > most || i64::from(held) * begin.ticks() > LONGEST_HOLDOVER.ticks() {
            return None;
        }
        (self.stopwatch.wake_at, self.pulse_at) = (None, Some(phase.at(sum(begin, pulse))));
        network.sync.hold_over(turns);
        let wait = difference(sum(begin, difference(pulse, sum(lead, uncertainty))), present.since(phase.start));
        // The superframes slept through count as one.
        self.age_anchors(1, true);
        Some(self.pause(present, wait))
    }

    /// The poll has left: the receiver is off until the first response, if this saves enough.
    pub(super) fn await_first_response(&self, departure: RadioInstant) -> Option<Action<'static>> {
        let timing = &self.network.as_ref()?.sync.course.timing;
        let (first, length) = self.round.responses(timing);
        let open = first.plus(difference(RadioDuration::ZERO, sum(RECEIVER_START, timing.guard)));
        let Network { phy, .. } = &self.config.network;
        let poll = phy.time_after_rmarker(POLL_BYTES + self.config.network.code_bytes());
        (open.since(departure) > sum(poll, ARMING)).then(|| Action::Receive {
            start: Start::At(open),
            window: departure.plus(length).since(open),
            keep_listening: self.round.asked() > 1,
        })
    }

    /// Whether the receiver stays off after a poll.
    pub(super) fn is_off_after_poll(&self, scheme: Scheme) -> bool {
        scheme == Scheme::SingleSided && self.is_seldom()
    }

    /// `superframes` have begun. A tag that listens seldom keeps the anchors that it awaits in turn.
    pub(super) fn age_anchors(&mut self, superframes: u16, is_seldom: bool) {
        for address in self.watch.anchors().filter(|_| is_seldom) {
            if let Some(anchor) = self.anchors.get_mut(address) {
                anchor.keep();
            }
        }
        self.anchors.advance(superframes);
    }

    /// A round is over: the anchors that answered are there.
    pub(super) fn note_outcomes(&mut self) {
        for (anchor, answered) in self.round.outcomes() {
            if answered {
                self.watch.answered(anchor);
            } else {
                self.watch.missed(anchor);
            }
        }
    }
}

impl super::schedule::Followed {
    /// From the beginning of a superframe to the first pulse of the tag's round of `anchors` anchors in it, as far as
    /// that is settled. The superframe is `superframes` ahead, and the tag's clock may be off by `uncertainty`.
    fn round_in(
        &self,
        superframes: u16,
        address: u16,
        anchors: usize,
        uncertainty: RadioDuration,
    ) -> Option<RadioDuration> {
        let (course, timing) = (&self.sync.course, &self.sync.course.timing);
        let number = course.phase.number.wrapping_add(superframes);
        let owned = match self.lease.turn() {
            Some(turn) if turn.is_in(number) && turn.slot < course.membership.leased()? => turn.bit(),
            Some(_) => 0,
            None => course.membership.settled()?.owned_slots(address, number, timing),
        };
        self.next_pulse(owned, timing.rounds(), anchors, uncertainty)
    }

    /// The number of superframes until a tag's next turn, as far as that is settled.
    fn next_turn(&self, config: &TagConfig, rate: Rate) -> Option<u16> {
        let course = &self.sync.course;
        let share = config.share_of(Some(rate), &course.timing);
        let (Share::Leased(turns), Rate::Every(period)) = (share, rate) else {
            course.membership.settled()?;
            return self.has(config.address, share).then_some(1);
        };
        course.membership.leased()?;
        let every = turns.period.superframes();
        let next = self.lease.turn().filter(|_| self.has(config.address, share))?.next_after(course.phase.number);
        let turn = i64::from(every) * course.timing.superframe.ticks();
        let skipped = (period.ticks() / turn.max(1)).clamp(1, TURNS_A_POLL) - 1;
        Some(next.saturating_add(skipped as u16 * every))
    }
}
