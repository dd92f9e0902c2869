//! The tag in native mode: hears beacons, asks for slots, ranges in its own.

use super::following::{Following, Heard};
use super::neighbours::Neighbours;
use super::plan::{Rate, lists, next_round, owned_slots, share_of};
use super::round::Exchange;
use super::timing::{BEACON_SLOTS, Timing};
use super::{Network, WAKE, spread};
use crate::exchange::{Action, Event, Guidance, Link, Machine, Report};
use crate::frame::native::{Beacon, Frame, MAX_MEMBERS, Message, Position, Share};
use crate::frame::{BROADCAST, FrameBuffer};
use crate::{RadioDuration, RadioInstant, RangeBias, RxFrame, Start};

/// What a tag is told at its start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TagConfig {
    /// Short address, unique in the network; not 0xFFFF (broadcast).
    pub address: u16,
    /// The network.
    pub network: Network,
    /// Anchors a round, at most [`MAX_ROUND`](super::MAX_ROUND).
    pub anchors: u8,
    /// How often it wants to range.
    pub rate: Rate,
    /// Whether polls tell the anchors the last distance to each.
    pub tell_distances: bool,
}

/// Without a beacon for this many superframes the tag searches anew.
const LOST_AFTER: u16 = 5;
/// Superframes from a request until the list can tell of it: to a relay, from there to the coordinator, and back.
const REQUEST_PATIENCE: u16 = 4;
/// A dozing tag waits through superframes only where it is none's turn in the next so many …
const DOZE_FROM: u16 = 3;
/// … and for this long at most, so that instants stay apart from each other.
const LONGEST_DOZE: RadioDuration = RadioDuration::from_micros(6_000_000);
/// It wakes so much before the superframe of its turn: what clocks part by meanwhile, and what waking takes too long.
const DOZE_MARGIN: RadioDuration = RadioDuration::from_micros(2_000);
/// What the tag's last action was for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Doing {
    /// Listening, waiting, asking for slots, reporting: nothing hangs on its outcome.
    Nothing,
    /// A poll is on its way.
    Polling,
    /// Responses are awaited until the round's deadline.
    Collecting,
}

/// The tag's side of native mode. Its reports are rounds of ranges to anchors, and changes of its link to the network.
#[derive(Clone, Debug)]
pub struct Tag {
    config: TagConfig,
    timing: Timing,
    bias: RangeBias,
    share: Share,
    doing: Doing,
    link: Option<Link>,
    network: Option<Followed>,
    neighbours: Neighbours,
    position_m: Option<[f32; 3]>,
    round: Exchange,
    /// Whether superframes without a turn are waited through.
    dozes: bool,
    /// The last action was such a wait.
    dozing: bool,
    sequence: u8,
    out: FrameBuffer,
}

/// The network that the tag follows.
#[derive(Clone, Debug)]
struct Followed {
    following: Following,
    /// From this superframe on slots may be asked for.
    request_from: u16,
    /// Requests without effect.
    requests: u8,
    /// The superframe that `owned` is for.
    planned: Option<u16>,
    /// Round slots of our own in this superframe: bit i for slot i.
    owned: u64,
    joined: bool,
}

impl Tag {
    /// A tag that has heard nobody yet.
    pub fn new(config: TagConfig) -> Self {
        let timing = Timing::of(&config.network);
        Self {
            config,
            timing,
            bias: RangeBias::of(&config.network.phy),
            share: share_of(config.rate, &timing),
            doing: Doing::Nothing,
            link: None,
            network: None,
            neighbours: Neighbours::new(),
            position_m: None,
            round: Exchange::new(),
            dozes: false,
            dozing: false,
            sequence: 0,
            out: FrameBuffer::new(),
        }
    }

    /// Ranges more or less often from now on; `None` gives the slots back and ranges no more.
    pub fn set_rate(&mut self, rate: Option<Rate>) {
        self.share = rate.map_or(Share::Release, |rate| share_of(rate, &self.timing));
    }

    /// A tag that ranges seldom does not listen to superframes without a turn of its own from now on: it waits through them, the
    /// radio may sleep, and it is in step again with the first beacon of the superframe of its turn. What that costs: clocks are
    /// compared anew, by the carrier, so that the ranges of a round deviate twice as much.
    pub fn doze(&mut self) {
        self.dozes = true;
    }

    /// How many anchors are heard.
    pub fn anchors_heard(&self) -> usize {
        self.neighbours.len()
    }

    fn hear(&mut self, frame: &RxFrame<'_>) {
        let Some(told) = Frame::parse(frame.bytes).filter(|told| told.pan == self.config.network.pan) else { return };
        match told.message {
            Message::Beacon(beacon) if told.destination == BROADCAST => self.hear_beacon(told.source, &beacon, frame),
            Message::Response(response)
                if told.destination == self.config.address && self.doing == Doing::Collecting =>
            {
                self.round.hear(&self.timing, &self.bias, &mut self.neighbours, told.source, response, frame);
            }
            // Other tags', and what is not for us.
            Message::Beacon(_) | Message::Response(_) | Message::Poll(_) | Message::Request(_) => {}
        }
    }

    fn hear_beacon(&mut self, source: u16, beacon: &Beacon, frame: &RxFrame<'_>) {
        if usize::from(beacon.slot) >= BEACON_SLOTS {
            return;
        }
        let heard = match &mut self.network {
            None => Heard::Anew,
            Some(network) => network.following.hear(&self.timing, beacon, frame.rx_time),
        };
        match heard {
            Heard::Ignored => return,
            Heard::Followed => {}
            Heard::Changed => self.link = Some(Link::Synchronised(beacon.coordinator)),
            Heard::Anew => {
                self.link = Some(Link::Synchronised(beacon.coordinator));
                let following = Following::new(&self.timing, beacon, frame.rx_time);
                self.network = Some(Followed {
                    request_from: following.phase.number,
                    following,
                    requests: 0,
                    planned: None,
                    owned: 0,
                    joined: false,
                });
            }
        }
        if let Some(anchor) = self.neighbours.hear(source, frame.diagnostics.rx_power_dbm) {
            anchor.position_m = beacon.position.map(Position::metres);
        }
    }

    fn finish_round(&mut self) -> Action<'_> {
        self.doing = Doing::Nothing;
        self.round.close(&mut self.neighbours);
        Action::Report(Report::Round(self.round.report()))
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

    /// What is next in the course of the superframe, no round being in progress.
    fn schedule(&mut self, present: RadioInstant) -> Action<'_> {
        let timing = self.timing;
        let Some(network) = &mut self.network else { return Self::listen(timing.superframe) };
        if let Some(since) = network.following.adrift {
            let patience = RadioDuration::from_ticks(i64::from(LOST_AFTER) * timing.superframe.ticks());
            if present.since(since) <= patience {
                return Self::listen(timing.superframe);
            }
            self.network = None;
            return Action::Report(Report::Link(Link::Unsynchronised));
        }
        let begun = network.following.advance(&timing, present.plus(RadioDuration::from_ticks(2 * WAKE.ticks())));
        self.neighbours.advance(begun);
        if network.following.silent() > LOST_AFTER {
            self.network = None;
            return Action::Report(Report::Link(Link::Unsynchronised));
        }
        let passed = present.since(network.following.phase.start);
        if passed < timing.rounds() {
            return self.among_beacons(passed);
        }
        network.plan(&self.config, &timing);
        let listed = network.following.membership.in_force().is_some_and(|members| lists(members, self.config.address));
        if listed && !network.joined {
            network.joined = true;
            let slots = network.owned.count_ones().max(1) as u8;
            return Action::Report(Report::Link(Link::Joined(slots)));
        }
        network.joined &= listed;
        if network.planned.replace(network.following.phase.number) != Some(network.following.phase.number) {
            self.round.set_team(self.neighbours.choose(self.config.anchors.into(), self.position_m));
        }
        self.among_rounds(passed)
    }

    /// In the beacon slots: listening, and asking for slots where those of the list are not those wanted.
    fn among_beacons(&mut self, passed: RadioDuration) -> Action<'_> {
        let timing = self.timing;
        let rest = RadioDuration::from_ticks(timing.rounds().ticks() - passed.ticks());
        let Some(network) = &mut self.network else { return Self::listen(rest) };
        let (address, number) = (self.config.address, network.following.phase.number);
        let listed = network.following.membership.members().iter().find(|member| member.tag == address);
        let settled = listed.map_or(Share::Release, |member| member.share) == self.share;
        let full = listed.is_none() && network.following.membership.members().len() == MAX_MEMBERS;
        if settled {
            network.requests = 0;
        }
        if settled || full || number.wrapping_sub(network.request_from) >= 0x8000 {
            return Self::listen(rest);
        }
        let rmarker = timing.request(spread(address, number, timing.request_slots.into()).into());
        let ready = passed.ticks() + timing.transmit.ticks() + timing.to_rmarker.ticks();
        let spare = RadioDuration::from_ticks(rmarker.ticks() - ready);
        if spare.ticks() > 2 * WAKE.ticks() {
            return Self::listen(RadioDuration::from_ticks(spare.ticks() - WAKE.ticks()));
        }
        // Whoever collides waits longer each time, one not as long as the other.
        let patience = spread(number, address, 2 << network.requests.min(3));
        network.request_from = number.wrapping_add(REQUEST_PATIENCE + patience);
        network.requests = network.requests.saturating_add(1);
        if spare < RadioDuration::ZERO {
            return Self::listen(rest);
        }
        let start = Start::At(network.following.phase.at(rmarker));
        self.write(Message::Request(self.share));
        Action::Transmit { frame: self.out.bytes(), start, listen: true }
    }

    /// In the round slots: a round where one fits in slots of our own, else off until the next of them or the next superframe.
    fn among_rounds(&mut self, passed: RadioDuration) -> Action<'_> {
        let timing = self.timing;
        let Some(network) = &self.network else { return Self::listen(timing.superframe) };
        let phase = network.following.phase;
        let earliest = RadioDuration::from_ticks(passed.ticks() + timing.transmit.ticks());
        let anchors = self.round.asked();
        let next = next_round(network.owned, &timing, earliest, anchors).filter(|_| anchors > 0);
        if let Some(pulse) = next {
            if pulse.ticks() - earliest.ticks() > 2 * WAKE.ticks() {
                let wake = pulse.ticks() - timing.transmit.ticks() - WAKE.ticks();
                return Action::WaitUntil(phase.at(RadioDuration::from_ticks(wake)));
            }
            let start = if pulse > earliest {
                Start::At(phase.at(RadioDuration::from_ticks(pulse.ticks() + timing.to_rmarker.ticks())))
            } else {
                Start::Now
            };
            self.doing = Doing::Polling;
            let poll = self.round.begin(&mut self.neighbours, self.config.tell_distances);
            self.write(Message::Poll(poll));
            return Action::Transmit { frame: self.out.bytes(), start, listen: true };
        }
        let (turns, early) = match network.next_turn(&self.config, &timing, self.share) {
            Some(turns) if self.dozes && turns >= DOZE_FROM => (turns, DOZE_MARGIN),
            Some(_) | None => (1, WAKE),
        };
        self.dozing = turns > 1;
        let wake = i64::from(turns) * timing.superframe.ticks() - early.ticks();
        Action::WaitUntil(phase.at(RadioDuration::from_ticks(wake)))
    }
}

impl Followed {
    /// In how many superframes the next one with slots of ours begins, as far as that is settled, or how long a doze may be.
    fn next_turn(&self, config: &TagConfig, timing: &Timing, share: Share) -> Option<u16> {
        let membership = &self.following.membership;
        let members = membership.in_force().filter(|_| membership.countdown() == 0)?;
        members.iter().find(|member| member.tag == config.address && member.share == share)?;
        let most = (LONGEST_DOZE.ticks() / timing.superframe.ticks()).max(1) as u16;
        let owns = |turn: &u16| {
            owned_slots(members, config.address, self.following.phase.number.wrapping_add(*turn), timing.round_slots)
                != 0
        };
        Some((1..most).find(owns).unwrap_or(most))
    }

    /// Finds out which slots are ours in this superframe: none where the plan may have changed unheard.
    fn plan(&mut self, config: &TagConfig, timing: &Timing) {
        let number = self.following.phase.number;
        if self.planned == Some(number) {
            return;
        }
        let owned = |members| owned_slots(members, config.address, number, timing.round_slots);
        self.owned = self.following.members().map_or(0, owned);
    }
}

impl Machine for Tag {
    fn may_sleep(&self) -> bool {
        self.dozing
    }

    fn guide(&mut self, guidance: Guidance) {
        self.position_m = guidance.position_m;
        self.round.set_turns(guidance.turns);
        if guidance.rate.is_some() {
            self.set_rate(guidance.rate);
        }
    }

    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        let (mut present, mut ended) = (now, now);
        let dozed = core::mem::take(&mut self.dozing);
        if let Some(network) = self.network.as_mut().filter(|_| dozed) {
            network.following.adrift = Some(now);
        }
        match event {
            Event::Started => {
                self.doing = Doing::Nothing;
                if !dozed {
                    self.network = None;
                }
                self.neighbours.forget_clocks();
            }
            Event::Sent(departure) => {
                if self.doing == Doing::Polling {
                    self.doing = Doing::Collecting;
                    self.round.sent(departure);
                }
            }
            Event::Received(frame) => {
                self.hear(&frame);
                ended = self.timing.end_of(&self.config.network.phy, &frame);
                present = self.timing.read_by(&self.config.network.phy, &frame);
            }
            // The window ended with the round, or the receiver was never on.
            Event::Timeout | Event::Late | Event::NotSent => match self.doing {
                Doing::Collecting => self.round.give_up(),
                Doing::Polling => self.doing = Doing::Nothing,
                Doing::Nothing => {}
            },
            Event::Corrupt | Event::Woken | Event::Reported => {}
        }
        if self.doing == Doing::Collecting {
            return match self.round.await_more(&self.timing, ended) {
                Some(action) => action,
                None => self.finish_round(),
            };
        }
        match self.link.take() {
            Some(link) => Action::Report(Report::Link(link)),
            None => self.schedule(present),
        }
    }
}
