//! The tag in native mode: receives sync frames, requests slots, ranges in its own slots.

mod seldom;

use self::seldom::{Aim, Awaited, Nap};
use super::anchor_table::{AnchorTable, Refused};
use super::compensation::Compensation;
use super::pace::Meter;
use super::plan::{Rate, lists, next_round, owned_slots, share_of};
use super::round::RoundState;
use super::search::Search;
use super::sync::{Sync, SyncUpdate};
use super::sync_schedule::SyncSchedule;
use super::timing::{SUPERFRAME, SYNC_SLOTS, Timing, end_of};
use super::wake_ups::{Slept, WakeUps};
use super::{Network, SHORTEST_WAIT, spread};
use crate::exchange::{Action, Event, Guidance, Link, Protocol, Report};
use crate::{Pace, RadioDuration, RadioInstant, RangeBias, RxFrame, StampModel, Start};
use wire::uwb::layout::Scheme;
use wire::uwb::native::{Frame, MAX_MEMBERS, Message, RESPONSE_BYTES, Request, Share, SyncFrame};
use wire::uwb::{BROADCAST, FrameBuffer};

/// The configuration of a tag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TagConfig {
    /// Short address, unique in the network; not 0xFFFF (broadcast).
    pub address: u16,
    /// The network.
    pub network: Network,
    /// Anchors in a round, at most [`MAX_ROUND`](super::MAX_ROUND).
    pub anchors: u8,
    /// How often it wants to range.
    pub rate: Rate,
    /// The scheme of its rounds, as soon as the network has room for it.
    pub scheme: Scheme,
    /// Whether polls report to the anchors the last distance to each.
    pub tell_distances: bool,
}

/// Without a sync frame for this many superframes the tag searches again.
const LOST_AFTER: u16 = 5;
/// Superframes from a request until the list can contain it: to a relay, from there to the coordinator, and back.
const REQUEST_PATIENCE: u16 = 4;
/// The purpose of the tag's last action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Doing {
    /// Listening, waiting, reporting: nothing depends on its result.
    Nothing,
    /// A request for slots is on its way.
    Requesting,
    /// A poll is on its way.
    Polling,
    /// Responses are awaited until the round's deadline.
    Collecting,
    /// A final is on its way.
    Ending,
}

/// How a round ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ended {
    /// A final is to be sent.
    Final,
    /// There are ranges to report.
    Report,
    /// It was the first of its kind. Its ranges come with the next round.
    Nothing,
}

/// The tag's side of native mode. It reports rounds of ranges to anchors, and changes of its link to the network.
#[derive(Clone, Debug)]
pub struct Tag {
    config: TagConfig,
    bias: RangeBias,
    meter: Meter,
    rate: Option<Rate>,
    doing: Doing,
    link: Option<Link>,
    network: Option<Followed>,
    anchors: AnchorTable,
    position_m: Option<[f32; 3]>,
    /// How long the node computes with the last round and earlier ones, …
    busy: RadioDuration,
    /// … and the end of this computation.
    free_at: Option<RadioInstant>,
    /// How long the node computes with a round, in the mean.
    busy_per_round: RadioDuration,
    round: RoundState,
    /// The least time from the first pulse of a frame of this tag to that of its next frame, if limited, …
    spacing: Option<RadioDuration>,
    /// … and the earliest first pulse of the next frame.
    next_pulse: Option<RadioInstant>,
    /// Whether the radio's clock may be lost between turns.
    dozes: bool,
    /// The last action was a wait in which the clock may be lost.
    nap: Option<Nap>,
    compensation: Compensation,
    /// The end of the current doze.
    aim: Option<Aim>,
    /// The anchor whose sync frame the last action awaits.
    awaited: Option<Awaited>,
    /// The sync frames that the tag listens to.
    watch: SyncSchedule,
    /// The timing errors of its wake-ups …
    wakes: WakeUps,
    /// … and its sleeps since the last sync frame.
    slept: Slept,
    search: Search,
    /// The receiver was off after the poll.
    is_off_after_poll: bool,
    /// The end of a wait or a window that leaves enough time for a transmission.
    wake_at: Option<RadioInstant>,
    /// The first pulse of the poll that was waited for.
    pulse_at: Option<RadioInstant>,
    /// When the tag decided on a poll that leaves at once.
    decided_at: Option<RadioInstant>,
    /// The last decision was made at the end of a wait or a window, and not after a frame.
    was_awaited: bool,
    /// The radio reported when the command of the last transmission had reached it.
    was_measured: bool,
    /// When the receiver was on again after the last frame, if the radio reported it.
    listening_at: Option<RadioInstant>,
    /// The end of the last received frame, until something else happens.
    ended_at: Option<RadioInstant>,
    /// It was received in a round.
    is_response: bool,
    sequence: u8,
    out: FrameBuffer,
}

/// The network that the tag follows.
#[derive(Clone, Debug)]
struct Followed {
    sync: Sync,
    /// From this superframe on the tag may request slots.
    request_from: u16,
    /// Requests without effect.
    requests: u8,
    /// The superframe that `owned` is for.
    planned: Option<u16>,
    /// This tag's round slots in this superframe: bit i for slot i.
    owned: u64,
    /// Rounds begun in this superframe.
    rounds: u32,
    joined: bool,
    /// The tag has reported that the network is full.
    is_full: bool,
    /// Superframes followed, counted only as far as needed.
    followed: u16,
}

impl Tag {
    /// A tag that has not received any frame yet.
    pub fn new(config: TagConfig) -> Self {
        Self {
            config,
            bias: RangeBias::NONE,
            meter: Meter::new(config.network.pinned),
            rate: Some(config.rate),
            doing: Doing::Nothing,
            link: None,
            network: None,
            anchors: AnchorTable::new(),
            position_m: None,
            busy: RadioDuration::ZERO,
            free_at: None,
            busy_per_round: RadioDuration::ZERO,
            round: RoundState::new(),
            spacing: None,
            next_pulse: None,
            dozes: false,
            nap: None,
            compensation: Compensation::default(),
            aim: None,
            awaited: None,
            watch: SyncSchedule::default(),
            wakes: WakeUps::new(),
            slept: Slept::default(),
            search: Search::default(),
            is_off_after_poll: false,
            wake_at: None,
            pulse_at: None,
            decided_at: None,
            was_awaited: false,
            was_measured: false,
            listening_at: None,
            ended_at: None,
            is_response: false,
            sequence: 0,
            out: FrameBuffer::new(),
        }
    }

    /// Ranges more or less often from now on; `None` returns the slots and stops ranging.
    pub fn set_rate(&mut self, rate: Option<Rate>) {
        self.rate = rate;
    }

    /// From now on, a tag with a fixed rate lets its radio sleep between its rounds and while it searches for a
    /// network. This has two costs. Clocks are compared by the carrier alone, so that the ranges of a round deviate up
    /// to twice as much. And a network is found up to a minute after it has come.
    pub fn doze(&mut self) {
        self.dozes = true;
    }

    /// From now on, the first pulses of two frames of the tag are at least this far apart. Limits of mean power require
    /// this.
    pub fn space_frames(&mut self, spacing: RadioDuration) {
        self.spacing = Some(spacing);
    }

    /// What the tag received and refused since it was created.
    pub fn refused(&self) -> Refused {
        self.anchors.refused
    }

    /// How many anchors are received.
    pub fn anchors_heard(&self) -> usize {
        self.anchors.len()
    }

    fn receive(&mut self, frame: &RxFrame<'_>) {
        let Some(told) = Frame::parse(frame.bytes).ok().filter(|told| told.pan == self.config.network.pan) else {
            return;
        };
        match told.message {
            Message::SyncFrame(sync_frame) if told.destination == BROADCAST => {
                self.on_sync_frame(told.source, &sync_frame, frame)
            }
            Message::Response(response)
                if told.destination == self.config.address && self.doing == Doing::Collecting =>
            {
                let Some(network) = &self.network else { return };
                let timing = &network.sync.course.timing;
                self.round.receive(timing, &self.bias, &mut self.anchors, told.source, response, frame);
            }
            // Messages for other tags, or not addressed to this tag.
            Message::SyncFrame(_)
            | Message::Response(_)
            | Message::Poll(_)
            | Message::Request(_)
            | Message::Final { .. } => {}
        }
    }

    fn on_sync_frame(&mut self, source: u16, sync_frame: &SyncFrame, frame: &RxFrame<'_>) {
        if usize::from(sync_frame.slot) >= SYNC_SLOTS {
            return;
        }
        let phy = &self.config.network.phy;
        let slept = core::mem::take(&mut self.slept);
        let assumed = self.network.as_mut().filter(|_| !slept.is_none()).map(|network| {
            network.sync.advance(frame.rx_time);
            network.sync.course.phase
        });
        let heard = match &mut self.network {
            None => match Sync::new(phy, sync_frame, frame.rx_time) {
                Some(sync) => {
                    self.network = Some(Followed::begin(sync));
                    self.search = Search::default();
                    SyncUpdate::Anew
                }
                None => SyncUpdate::Ignored,
            },
            Some(network) => match network.sync.receive(phy, sync_frame, frame.rx_time) {
                SyncUpdate::Anew => {
                    *network = Followed::begin(network.sync.clone());
                    SyncUpdate::Anew
                }
                heard @ (SyncUpdate::Ignored | SyncUpdate::Refused | SyncUpdate::Followed | SyncUpdate::Changed) => {
                    heard
                }
            },
        };
        match heard {
            SyncUpdate::Ignored | SyncUpdate::Refused => {
                self.slept = slept;
                if heard == SyncUpdate::Refused {
                    self.anchors.refuse_coordinator();
                }
                return;
            }
            SyncUpdate::Followed => {}
            SyncUpdate::Changed | SyncUpdate::Anew => self.link = Some(Link::Synchronised(sync_frame.coordinator)),
        }
        self.aim = None;
        let phase = self.network.as_ref().map(|network| network.sync.course.phase);
        if let (Some(assumed), Some(phase)) = (assumed, phase)
            && assumed.number == phase.number
        {
            self.wakes.learn(slept, assumed.start.since(phase.start));
        }
        self.watch.receive(source, sync_frame.slot);
        self.anchors.on_sync_frame(source, sync_frame, frame.diagnostics.rx_power_dbm);
    }

    /// The responses were received or will not come, or the final has left. Returns what is to be done then.
    fn end_round(&mut self) -> Ended {
        if self.doing == Doing::Collecting
            && let Some(round) = self.round.to_end()
        {
            self.doing = Doing::Ending;
            self.write(Message::Final { round });
            return Ended::Final;
        }
        self.doing = Doing::Nothing;
        self.round.close(&mut self.anchors);
        self.note_outcomes();
        if self.round.has_report() { Ended::Report } else { Ended::Nothing }
    }

    fn write(&mut self, message: Message) {
        self.sequence = self.sequence.wrapping_add(1);
        let Network { pan, .. } = self.config.network;
        Frame { sequence: self.sequence, pan, destination: BROADCAST, source: self.config.address, message }
            .emit(&mut self.out);
    }

    fn listen(window: RadioDuration) -> Action<'static> {
        Action::Receive { start: Start::Now, window, keep_listening: true }
    }

    /// The next action in the superframe, when no round is in progress.
    fn schedule(&mut self, present: RadioInstant) -> Action<'_> {
        let lead = self.meter.lead();
        let is_seldom = self.is_seldom();
        let is_greedy = self.rate == Some(Rate::Greedy);
        self.free_at = self.free_at.filter(|free_at| is_greedy && free_at.since(present) > RadioDuration::ZERO);
        let Some(network) = &mut self.network else { return self.search(present) };
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
        network.plan(&self.config, &timing);
        let course = &network.sync.course;
        let listed = course.membership.in_force().is_some_and(|members| lists(members, self.config.address));
        if self.rate.is_some() && !network.is_full && network.is_full_without(self.config.address) {
            network.is_full = true;
            return Action::Report(Report::Link(Link::NetworkFull));
        }
        if listed && !network.joined {
            (network.joined, network.is_full) = (true, false);
            let slots = network.owned.count_ones().max(1) as u8;
            return Action::Report(Report::Link(Link::Joined(slots)));
        }
        network.joined &= listed;
        if network.planned.replace(course.phase.number) != Some(course.phase.number) {
            network.rounds = 0;
            self.round.set_team(self.anchors.choose(self.config.anchors.into(), self.position_m));
        }
        self.among_rounds(passed)
    }

    /// No anchor was received for too long.
    fn lose_network(&mut self) -> Action<'static> {
        self.network = None;
        self.anchors.end_session();
        Action::Report(Report::Link(Link::Unsynchronised))
    }

    /// In the sync slots: listens, and requests slots if the listed share differs from the wanted one.
    fn among_sync_frames(&mut self, passed: RadioDuration, end: RadioDuration) -> Action<'_> {
        let (lead, rate) = (self.meter.lead(), self.rate);
        let Some(network) = &mut self.network else { return Self::listen(SUPERFRAME) };
        let course = &network.sync.course;
        let (timing, phase) = (course.timing, course.phase);
        let rest = RadioDuration::from_ticks(end.ticks() - passed.ticks());
        let (address, number) = (self.config.address, phase.number);
        let share = rate.map_or(Share::Release, |rate| share_of(rate, &timing));
        let listed = course.membership.members().iter().find(|member| member.tag == address);
        let settled = listed.map_or(Share::Release, |member| member.share) == share;
        let full = network.is_full_without(address);
        if settled {
            network.requests = 0;
        }
        if settled || full || number.wrapping_sub(network.request_from) >= 0x8000 {
            return Self::listen(rest);
        }
        let in_reach = |slot: &u8| timing.request(usize::from(*slot)) < end;
        let slots = (0..timing.request_slots).take_while(in_reach).count() as u16;
        let rmarker = timing.request(spread(address, number, slots).into());
        let until_pulse = rmarker.ticks() - timing.to_rmarker.ticks() - passed.ticks();
        let spare = RadioDuration::from_ticks(until_pulse - lead.ticks());
        if spare > SHORTEST_WAIT {
            self.wake_at = Some(phase.at(RadioDuration::from_ticks(passed.ticks() + spare.ticks())));
            return Self::listen(spare);
        }
        if until_pulse <= 0 {
            // The request's instant in this superframe has passed.
            network.request_from = number.wrapping_add(1);
            if let Some(wake) = self.wake_at.take() {
                self.meter.overslept(phase.at(passed).since(wake));
            }
            return Self::listen(rest);
        }
        // After each collision a tag waits longer, and each tag a different time.
        let patience = spread(number, address, 2 << network.requests.min(3));
        network.request_from = number.wrapping_add(REQUEST_PATIENCE + patience);
        network.requests = network.requests.saturating_add(1);
        self.doing = Doing::Requesting;
        let wish = self.meter.wish(self.config.scheme);
        self.write(Message::Request(Request { share, wish }));
        Action::Transmit { frame: self.out.bytes(), start: Start::At(phase.at(rmarker)), listen: true }
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
        let anchors = if has_enough { 0 } else { self.round.asked() };
        let after = |earliest: RadioDuration| {
            next_round(network.owned, &timing, earliest, anchors, uncertainty).filter(|_| anchors > 0)
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
        let backlog = Backlog { computed, per_round: self.busy_per_round, until: next_rounds };
        let last = RadioDuration::from_ticks(timing.superframe.ticks() - timing.round(anchors).ticks());
        let every = RadioDuration::from_ticks(takes + self.meter.immediate().ticks());
        let is_for_sync_frames = in_time > soonest
            && computed < next_rounds
            && (backlog.has_room_until(last, soonest, every) || after(in_time).is_none());
        let in_time = if is_for_sync_frames { soonest } else { in_time };
        // The tag was woken for a round. It makes the round if the round's instant is still in the future.
        let spare = |pulse: RadioDuration| RadioDuration::from_ticks(pulse.ticks() - passed.ticks() - lead.ticks());
        let planned = self.pulse_at.take().map(|pulse| pulse.since(phase.start));
        let is_in_time = |pulse: &RadioDuration| *pulse > passed && 2 * spare(*pulse).ticks() > -lead.ticks();
        if let Some(wake) = self.wake_at.filter(|_| planned.is_some_and(|pulse| !is_in_time(&pulse))) {
            self.meter.overslept(phase.at(passed).since(wake));
        }
        let planned = planned.filter(|pulse| anchors > 0 && network.owned != 0 && is_in_time(pulse));
        if let Some(pulse) = planned.or_else(|| after(in_time)) {
            let pulse_at = phase.at(pulse);
            let at_once = planned.is_none() && spaced.is_none() && pulse == soonest;
            if !at_once && spare(pulse) > SHORTEST_WAIT {
                if let Some(action) = self.nap_before(pulse, passed) {
                    return action;
                }
                let wake = pulse_at.plus(RadioDuration::from_ticks(-lead.ticks()));
                (self.wake_at, self.pulse_at) = (Some(wake), Some(pulse_at));
                return Action::WaitUntil(wake);
            }
            self.decided_at = at_once.then(|| phase.at(passed));
            self.wake_at = self.wake_at.filter(|_| planned.is_some());
            let start = if at_once { Start::Now } else { Start::At(pulse_at.plus(timing.to_rmarker)) };
            self.doing = Doing::Polling;
            network.rounds = network.rounds.saturating_add(1);
            let scheme = self.config.scheme.min(timing.layout.scheme);
            let wish = self.meter.wish(self.config.scheme);
            let poll = self.round.begin(&mut self.anchors, scheme, wish, self.config.tell_distances);
            self.write(Message::Poll(poll));
            self.is_off_after_poll = self.is_off_after_poll(scheme);
            let listen = !self.is_off_after_poll;
            return Action::Transmit { frame: self.out.bytes(), start, listen };
        }
        self.rest(passed)
    }

    /// Learns from a late start if the radio did not measure it, and repeats what was missed.
    fn was_late(&mut self) {
        if !self.was_measured {
            self.meter.lead_was_short();
        }
        if let Some(network) = self.network.as_mut().filter(|_| self.doing == Doing::Requesting) {
            network.request_from = network.sync.course.phase.number.wrapping_add(1);
        }
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
    /// Whether the rounds that begin from `soonest` to `last`, one after each interval `every`, can wait until they are
    /// computed. While rounds are made, the node may have no time to compute.
    fn has_room_until(self, last: RadioDuration, soonest: RadioDuration, every: RadioDuration) -> bool {
        let per_round = self.per_round.ticks();
        // An eighth of a round is for what is not the mean.
        let limit = soonest.ticks() + every.ticks() + (WAITING_ROUNDS + 1) * per_round - per_round / 8;
        let limit = self.until.ticks().min(limit);
        let (mut pulse, mut computed) = (soonest.ticks(), self.computed.ticks());
        while pulse <= last.ticks() && computed <= limit {
            computed += per_round;
            pulse += every.ticks().max(1);
        }
        computed <= limit
    }
}

impl Followed {
    /// Nothing requested, nothing owned.
    fn begin(sync: Sync) -> Self {
        let request_from = sync.course.phase.number;
        Self {
            sync,
            request_from,
            requests: 0,
            planned: None,
            owned: 0,
            rounds: 0,
            joined: false,
            is_full: false,
            followed: 0,
        }
    }

    /// Whether all places are taken, none by this tag.
    fn is_full_without(&self, tag: u16) -> bool {
        let members = self.sync.course.membership.members();
        members.len() == MAX_MEMBERS && !lists(members, tag)
    }

    /// Determines this tag's slots in this superframe: none if the plan may have changed without the tag receiving the
    /// change.
    fn plan(&mut self, config: &TagConfig, timing: &Timing) {
        let number = self.sync.course.phase.number;
        if self.planned == Some(number) {
            return;
        }
        let owned = |members| owned_slots(members, config.address, number, timing.round_slots);
        self.owned = self.sync.members().map_or(0, owned);
    }
}

impl Protocol for Tag {
    fn calibrate(&mut self, stamps: &StampModel) {
        self.bias = stamps.range_bias;
    }

    fn pace(&mut self, pace: Pace) {
        self.listening_at = pace.listening;
        self.was_measured = pace.armed.is_some();
        if let Some(armed) = pace.armed
            && let Some(wake) = self.wake_at.take()
        {
            self.meter.led(armed.since(wake), self.was_awaited);
        }
        if let (Some(ready), Some(ended)) = (pace.ready, self.ended_at) {
            let next = self.config.network.phy.airtime(RESPONSE_BYTES);
            let after = ready.since(ended);
            if self.is_response { self.meter.dealt_with(after, next) } else { self.meter.dealt_with_other(after, next) }
        }
    }

    fn guide(&mut self, guidance: Guidance) {
        self.position_m = guidance.position_m;
        (self.busy, self.busy_per_round) = (guidance.busy, guidance.busy_per_round);
        self.round.set_turns(guidance.turns);
        if guidance.rate.is_some() {
            self.set_rate(guidance.rate);
        }
    }

    fn rouse(&mut self, guidance: Guidance) {
        self.guide(guidance);
        self.cut_wait();
    }

    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        let (mut present, mut ended) = (now, now);
        let mut off = false;
        let (nap, awaited) = (self.nap.take(), self.awaited.take());
        self.ended_at = None;
        self.was_awaited = matches!(event, Event::Timeout | Event::Woken);
        match event {
            Event::Started => {
                self.doing = Doing::Nothing;
                (self.wake_at, self.next_pulse) = (None, None);
                self.round.forget();
                match nap {
                    Some(nap) => self.woke(nap, now),
                    None => {
                        (self.network, self.aim, self.pulse_at, self.search) = (None, None, None, Search::default());
                        self.anchors.forget_clocks();
                    }
                }
            }
            Event::Sent(departure) => {
                let to_rmarker = self.config.network.phy.time_to_rmarker();
                let pulse = departure.plus(RadioDuration::from_ticks(-to_rmarker.ticks()));
                self.next_pulse = self.spacing.map(|spacing| pulse.plus(spacing));
                match self.doing {
                    Doing::Polling => {
                        self.doing = Doing::Collecting;
                        self.round.sent(departure);
                        off = core::mem::take(&mut self.is_off_after_poll);
                        if let Some(decided) = self.decided_at.take() {
                            self.meter.left(pulse.since(decided));
                        }
                    }
                    Doing::Ending => self.round.ended(departure),
                    Doing::Requesting | Doing::Collecting | Doing::Nothing => {}
                }
            }
            Event::Received(frame) => {
                self.receive(&frame);
                ended = end_of(&self.config.network.phy, &frame);
                present = ended.plus(self.meter.reading());
                self.ended_at = Some(ended);
                self.is_response = self.doing == Doing::Collecting;
                if let Some(listening) = self.listening_at.take() {
                    self.meter.listened(listening.since(ended));
                }
            }
            // The window ended with the round, or the receiver was never on.
            Event::Timeout | Event::Late | Event::NotSent => {
                if event == Event::Late {
                    self.was_late();
                }
                match self.doing {
                    // The receiver was not on yet: it is now.
                    Doing::Collecting if event == Event::Late => {}
                    Doing::Collecting => self.round.give_up(),
                    Doing::Polling | Doing::Requesting => self.doing = Doing::Nothing,
                    Doing::Nothing | Doing::Ending => {}
                }
            }
            Event::Woken => match nap {
                Some(nap) => self.woke(nap, now),
                None => self.resume(now),
            },
            Event::Reported => self.free_at = Some(now.plus(core::mem::take(&mut self.busy))),
            Event::Corrupt => {}
        }
        if let Some(awaited) = awaited {
            match event {
                Event::Late => {
                    if let Some(action) = self.receive_late(awaited, present) {
                        return action;
                    }
                }
                Event::Timeout | Event::Corrupt => self.missed(awaited),
                Event::Started
                | Event::Sent(_)
                | Event::NotSent
                | Event::Received(_)
                | Event::Woken
                | Event::Reported => {}
            }
        }
        let mut is_over = self.doing == Doing::Ending;
        if self.doing == Doing::Requesting {
            self.doing = Doing::Nothing;
        }
        if let Some(action) = off.then(|| self.await_first_response(now)).flatten() {
            return action;
        }
        if self.doing == Doing::Collecting {
            let timing = self.network.as_ref().map(|network| network.sync.course.timing);
            match timing.and_then(|timing| self.round.await_more(&timing, ended)) {
                Some(action) => return action,
                None => is_over = true,
            }
        }
        if is_over {
            match self.end_round() {
                Ended::Final => {
                    let to_rmarker = self.config.network.phy.time_to_rmarker();
                    let spaced = self.next_pulse.map(|pulse| pulse.since(present));
                    let start = match spaced.filter(|wait| *wait > RadioDuration::ZERO) {
                        Some(wait) => Start::At(present.plus(wait.max(self.meter.lead())).plus(to_rmarker)),
                        None => Start::Now,
                    };
                    return Action::Transmit { frame: self.out.bytes(), start, listen: false };
                }
                Ended::Report => return Action::Report(Report::Round(self.round.report())),
                Ended::Nothing => {}
            }
        }
        match self.link.take() {
            Some(link) => Action::Report(Report::Link(link)),
            None => self.schedule(present),
        }
    }
}
