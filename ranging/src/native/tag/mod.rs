//! The tag in native mode: receives sync frames, requests slots, ranges in its own slots.
//!
//! Each action leaves the tag in a `State`, which says what the next event means:
//!
//! ```text
//!               sleep                          window for one sync frame
//!  Napping ◄────────────────┐                ┌────────────────► Awaiting ─┐
//!     │     woken           │                │     frame, timeout   ▲     │ window too late:
//!     └───────────────────► │                │ ◄────────────────────┤     │ at once
//!                           │      Idle      │                      └─────┘
//!        wait, listen,  ┌── │                │    request
//!        report         └─► │                │ ───────────────► Requesting
//!                           │                │ ◄────────────────────┘
//!                           └────────────────┘   sent, late
//!                        poll │  ▲   ▲   ▲
//!                             ▼  │   │   │ final has left, or has not: report of the round
//!                          Polling   │   │
//!                             │ late │   └──────────────────────────────┐
//!                        sent │      │ single-sided, or no response:    │
//!                             ▼      │ report of the round              │
//!              response ┌─ Collecting ────────────────────────────► Ending
//!                       └─►            all responses, or end of window:
//!                                      final of a double-sided round
//! ```
//!
//! What the tag does when it is idle depends on the network that it follows, `Tag::network`:
//!
//! ```text
//!              sync frame                     sleeps for turns, or is roused from a nap
//!  searching ─────────────► following (Some) ───────────────────────────────────────► adrift (Some, `sync.adrift`)
//!   (None)                   │            ▲             sync frame                      │
//!      ▲                     │            └─────────────────────────────────────────────┤
//!      │   LOST_AFTER superframes without a sync frame                                  │
//!      └─────────────────────┴──────────────────────────────────────────────────────────┘
//! ```
//!
//! A start of the radio from any state but `Napping` returns the tag to `Idle` and to its search.

mod config;
mod inbox;
mod incoming;
mod schedule;
mod seldom;
mod slot_request;
mod stopwatch;

pub use self::config::TagConfig;
use self::inbox::Inbox;
use self::schedule::Followed;
use self::seldom::{Aim, Awaited, Nap};
use self::stopwatch::Stopwatch;
use super::anchor_table::{AnchorTable, Refused};
use super::authentication::{Moment, SealedPoll};
use super::compensation::Compensation;
use super::pace::Meter;
use super::plan::Rate;
use super::round::RoundState;
use super::search::Search;
use super::sync_schedule::SyncSchedule;
use super::timing::end_of;
use super::wake_ups::{Slept, WakeUps};
use crate::exchange::{Action, Event, Guidance, Link, Protocol, Report, RoundFix};
use crate::{Pace, RadioDuration, RadioInstant, RangeBias, RxFrame, StampModel, Start};
use wire::uwb::native::{Downlink, Message, UserData};
use wire::uwb::{Address, BROADCAST, FrameBuffer, Header};

/// What the tag's last action was, and so the meaning of the next event.
#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    /// Listening, waiting, reporting: nothing depends on its result.
    Idle,
    /// In a wait in which the radio's clock may be lost.
    Napping(Nap),
    /// The receiver is on for the sync frame of one anchor.
    Awaiting(Awaited),
    /// A request for slots is on its way.
    Requesting,
    /// A poll is on its way.
    Polling {
        /// When the tag decided on it, if it leaves at once.
        decided_at: Option<RadioInstant>,
        /// Whether the receiver stays off until the first response.
        is_off_after: bool,
    },
    /// Responses are awaited until the round's deadline.
    Collecting,
    /// A final is on its way.
    Ending,
}

/// The tag's side of native mode. It reports rounds of ranges to anchors, and changes of its link to the network.
#[derive(Clone, Debug)]
pub struct Tag {
    config: TagConfig,
    bias: RangeBias,
    meter: Meter,
    rate: Option<Rate>,
    state: State,
    /// A change of the link that is not reported yet.
    link: Option<Link>,
    network: Option<Followed>,
    anchors: AnchorTable,
    position_m: Option<[f32; 3]>,
    fix: Option<RoundFix>,
    /// Data for the first poll of a superframe.
    data: Option<UserData>,
    inbox: Inbox,
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
    compensation: Compensation,
    /// The end of the current doze.
    aim: Option<Aim>,
    /// The first pulse of the poll that is waited for.
    pulse_at: Option<RadioInstant>,
    /// The sync frames that the tag listens to.
    watch: SyncSchedule,
    /// The timing errors of its wake-ups …
    wakes: WakeUps,
    /// … and its sleeps since the last sync frame.
    slept: Slept,
    search: Search,
    stopwatch: Stopwatch,
    sequence: u8,
    out: FrameBuffer,
}

impl Tag {
    /// A tag that has not received any frame yet.
    pub fn new(config: TagConfig) -> Self {
        Self {
            config,
            bias: RangeBias::NONE,
            meter: Meter::new(config.network.pinned),
            rate: Some(config.rate),
            state: State::Idle,
            link: None,
            network: None,
            anchors: AnchorTable::new(),
            position_m: None,
            fix: None,
            data: None,
            inbox: Inbox::default(),
            busy: RadioDuration::ZERO,
            free_at: None,
            busy_per_round: RadioDuration::ZERO,
            round: RoundState::new(),
            spacing: None,
            next_pulse: None,
            dozes: false,
            compensation: Compensation::default(),
            aim: None,
            pulse_at: None,
            watch: SyncSchedule::default(),
            wakes: WakeUps::new(),
            slept: Slept::default(),
            search: Search::default(),
            stopwatch: Stopwatch::default(),
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

    /// Writes a frame of this moment. Returns what its round refers to, in a network with a key.
    fn write(&mut self, message: Message, moment: Option<Moment>) -> Option<SealedPoll> {
        self.sequence = self.sequence.wrapping_add(1);
        let [destination, source] = [BROADCAST, self.config.address].map(Address::Short);
        let header = Header { sequence: self.sequence, pan: self.config.network.pan, destination, source };
        message.emit(&header, &mut self.out);
        let key = self.config.network.key.as_ref()?;
        Some(key.seal(&mut self.out, moment?))
    }

    /// What makes a frame of this superframe new.
    fn moment(&self) -> Option<Moment> {
        self.network.as_ref()?.sync.course.moment()
    }

    fn listen(window: RadioDuration) -> Action<'static> {
        Action::Receive { start: Start::Now, window, keep_listening: true }
    }

    /// The radio was started. If it has slept, the tag goes on, else the tag knows nothing of the network any more.
    fn on_start(&mut self, now: RadioInstant) -> Action<'_> {
        (self.stopwatch.wake_at, self.next_pulse) = (None, None);
        self.round.forget();
        match self.state {
            State::Napping(nap) => self.woke(nap, now),
            State::Idle
            | State::Awaiting(_)
            | State::Requesting
            | State::Polling { .. }
            | State::Collecting
            | State::Ending => {
                (self.network, self.aim, self.pulse_at, self.search) = (None, None, None, Search::default());
                self.anchors.forget_clocks();
            }
        }
        self.idle(now)
    }

    fn on_sent(&mut self, departure: RadioInstant, now: RadioInstant) -> Action<'_> {
        let to_rmarker = self.config.network.phy.time_to_rmarker();
        let pulse = departure.plus(RadioDuration::from_ticks(-to_rmarker.ticks()));
        self.next_pulse = self.spacing.map(|spacing| pulse.plus(spacing));
        match self.state {
            State::Polling { decided_at, is_off_after } => {
                self.state = State::Collecting;
                self.round.sent(departure);
                if let Some(decided) = decided_at {
                    self.meter.left(pulse.since(decided));
                }
                match is_off_after.then(|| self.await_first_response(now)).flatten() {
                    Some(action) => action,
                    None => self.collect(now, now),
                }
            }
            State::Ending => {
                self.round.ended(departure);
                self.close_round(now)
            }
            State::Collecting => self.collect(now, now),
            State::Idle | State::Napping(_) | State::Awaiting(_) | State::Requesting => self.idle(now),
        }
    }

    fn on_frame(&mut self, frame: &RxFrame<'_>) -> Action<'_> {
        self.receive(frame);
        let ended = end_of(&self.config.network.phy, frame);
        let present = ended.plus(self.meter.reading());
        self.stopwatch.received(ended, self.state == State::Collecting, &mut self.meter);
        match self.state {
            State::Collecting => self.collect(ended, present),
            State::Ending => self.close_round(present),
            State::Idle | State::Napping(_) | State::Awaiting(_) | State::Requesting | State::Polling { .. } => {
                self.idle(present)
            }
        }
    }

    fn on_corrupt(&mut self, now: RadioInstant) -> Action<'_> {
        match self.state {
            State::Awaiting(awaited) => {
                self.missed(awaited);
                self.idle(now)
            }
            State::Collecting => self.collect(now, now),
            State::Ending => self.close_round(now),
            State::Idle | State::Napping(_) | State::Requesting | State::Polling { .. } => self.idle(now),
        }
    }

    /// A window has passed without a frame, or a frame did not leave.
    fn on_timeout(&mut self, now: RadioInstant) -> Action<'_> {
        match self.state {
            State::Awaiting(awaited) => {
                self.missed(awaited);
                self.idle(now)
            }
            State::Collecting => {
                self.round.give_up();
                self.end_round(now)
            }
            State::Ending => self.close_round(now),
            State::Idle | State::Napping(_) | State::Requesting | State::Polling { .. } => self.idle(now),
        }
    }

    /// A transmission or reception began too late. The tag learns from this if the radio did not measure it, and repeats
    /// what was missed.
    fn on_late(&mut self, now: RadioInstant) -> Action<'_> {
        if !self.stopwatch.was_measured {
            self.meter.lead_was_short();
        }
        match self.state {
            State::Awaiting(awaited) => match self.receive_late(awaited, now) {
                Some(action) => action,
                None => self.idle(now),
            },
            State::Requesting => {
                if let Some(network) = &mut self.network {
                    network.request_in = 1;
                }
                self.idle(now)
            }
            // The receiver was not on yet: it is now.
            State::Collecting => self.collect(now, now),
            State::Ending => self.close_round(now),
            State::Idle | State::Napping(_) | State::Polling { .. } => self.idle(now),
        }
    }

    fn on_wake_up(&mut self, now: RadioInstant) -> Action<'_> {
        match self.state {
            State::Napping(nap) => self.woke(nap, now),
            State::Idle
            | State::Awaiting(_)
            | State::Requesting
            | State::Polling { .. }
            | State::Collecting
            | State::Ending => self.resume(now),
        }
        self.idle(now)
    }

    /// Listens for further responses, the last frame having ended at `ended`; none are left: the round ends.
    fn collect(&mut self, ended: RadioInstant, present: RadioInstant) -> Action<'_> {
        let timing = self.network.as_ref().map(|network| network.sync.course.timing);
        match timing.and_then(|timing| self.round.await_more(&timing, ended)) {
            Some(action) => action,
            None => self.end_round(present),
        }
    }

    /// The responses were received or will not come.
    fn end_round(&mut self, present: RadioInstant) -> Action<'_> {
        let Some(round) = self.round.to_end() else { return self.close_round(present) };
        self.state = State::Ending;
        let moment = self.round.sealed().map(|poll| poll.moment);
        self.write(Message::Final { round }, moment);
        let to_rmarker = self.config.network.phy.time_to_rmarker();
        let spaced = self.next_pulse.map(|pulse| pulse.since(present));
        let start = match spaced.filter(|wait| *wait > RadioDuration::ZERO) {
            Some(wait) => Start::At(present.plus(wait.max(self.meter.lead())).plus(to_rmarker)),
            None => Start::Now,
        };
        Action::Transmit { frame: self.out.bytes(), start, listen: false }
    }

    /// The round is over. If it was the first double-sided one, its ranges come with the next round.
    fn close_round(&mut self, present: RadioInstant) -> Action<'_> {
        self.state = State::Idle;
        self.round.close(&mut self.anchors);
        self.note_outcomes();
        if self.round.has_report() { Action::Report(Report::Round(self.round.report())) } else { self.idle(present) }
    }

    /// Nothing is in progress: reports a change of the link or a message, or does what is next in the superframe.
    fn idle(&mut self, present: RadioInstant) -> Action<'_> {
        self.state = State::Idle;
        if let Some(link) = self.link.take() {
            return Action::Report(Report::Link(link));
        }
        if let Some(received) = self.inbox.waiting.take() {
            return Action::Report(Report::Downlink(self.inbox.reported.insert(received)));
        }
        self.schedule(present)
    }
}

impl Protocol for Tag {
    fn calibrate(&mut self, stamps: &StampModel) {
        self.bias = stamps.range_bias;
    }

    fn pace(&mut self, pace: Pace) {
        self.stopwatch.take(&pace, &self.config.network, &mut self.meter);
    }

    fn guide(&mut self, guidance: Guidance) {
        (self.position_m, self.fix) = (guidance.position_m, guidance.fix);
        (self.busy, self.busy_per_round) = (guidance.busy, guidance.busy_per_round);
        self.round.set_turns(guidance.turns);
        if guidance.rate.is_some() {
            self.set_rate(guidance.rate);
        }
    }

    fn send_down(&mut self, message: Downlink) {
        if message.tag == self.config.address {
            self.inbox.put(message, true);
        }
    }

    fn refused_frames(&self) -> u32 {
        self.anchors.refused.total()
    }

    fn carried(&mut self) -> Option<(bool, u8)> {
        self.round.take_sent_data()
    }

    fn carry(&mut self, data: Option<UserData>) {
        self.data = data;
    }

    fn rouse(&mut self, guidance: Guidance) {
        self.guide(guidance);
        self.cut_wait();
    }

    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        self.stopwatch.begin(matches!(event, Event::Timeout | Event::Woken));
        match event {
            Event::Started => self.on_start(now),
            Event::Sent(departure) => self.on_sent(departure, now),
            Event::Received(frame) => self.on_frame(&frame),
            Event::Corrupt => self.on_corrupt(now),
            Event::Timeout | Event::NotSent => self.on_timeout(now),
            Event::Late => self.on_late(now),
            Event::Woken => self.on_wake_up(now),
            Event::Reported => {
                self.free_at = Some(now.plus(core::mem::take(&mut self.busy)));
                self.idle(now)
            }
        }
    }
}
