//! How an anchor ranges to the other anchors, in slots of its own as a tag does, for tags that only listen. Such an
//! anchor is also a member of the network.
//!
//! The responses give ranges, and the anchor's polls contain the mean of each. These ranges show how late a frame
//! between two anchors is because of walls or antenna delays. This delay is in every difference that a tag measures
//! between the two, and a tag has no other way to know it.

use heapless::Vec;

use super::MAX_ROUND;
use super::anchor_table::AnchorTable;
use super::authentication::SealedPoll;
use super::coordinator::Coordinator;
use super::leases::Leases;
use super::memory::Table;
use super::plan::{Rate, next_round, share_of};
use super::round::RoundState;
use super::timing::{Phase, Timing};
use crate::{RadioDuration, RadioInstant, RangeBias, RxFrame, StampModel};
use wire::serial_number::SerialNumber;
use wire::uwb::layout::{Layout, Scheme};
use wire::uwb::native::{Distance, Member, Poll, Response, Share};

/// Anchors that are remembered.
const MAX_HEARD: usize = 16;
/// An anchor that was silent for this many superframes is not asked any more.
const FORGOTTEN_AFTER: u16 = 6;
/// A reported distance is the mean of about this many ranges: anchors do not move, but people between them do.
const MEAN_OF: u8 = 100;

/// An anchor's rounds.
#[derive(Debug)]
#[cfg_attr(not(target_os = "none"), derive(Clone))]
pub struct AnchorRounds<'m> {
    rate: Option<Rate>,
    heard: Vec<Other, MAX_HEARD>,
    /// The anchor that the next round names first: if there are more anchors than a round has places, all take turns.
    first: usize,
    round: RoundState,
    /// The anchors that answered.
    anchors: Table<'m, AnchorTable>,
    bias: RangeBias,
    /// The superframe that `owned` is for.
    planned: Option<u16>,
    owned: u64,
    /// Rounds begun in that superframe.
    rounds: u32,
    /// When the responses of the last round are over.
    answered: Option<RadioInstant>,
}

/// Another anchor.
#[derive(Clone, Debug)]
struct Other {
    address: u16,
    /// Superframes since its last frame.
    unheard: u16,
    /// Mean of the ranges to it, metres …
    apart_m: f32,
    /// … and the number of these ranges, at most [`MEAN_OF`].
    ranges: u8,
}

impl<'m> AnchorRounds<'m> {
    /// No anchor received yet.
    pub fn new(rate: Option<Rate>, anchors: Table<'m, AnchorTable>) -> Self {
        Self {
            rate,
            heard: Vec::new(),
            first: 0,
            round: RoundState::new(),
            anchors,
            bias: RangeBias::NONE,
            planned: None,
            owned: 0,
            rounds: 0,
            answered: None,
        }
    }

    /// Takes the radio's stamp model in force.
    pub fn calibrate(&mut self, stamps: &StampModel) {
        self.bias = stamps.range_bias;
    }

    /// The radio was started: everything known of clocks is void.
    pub fn restart(&mut self) {
        self.anchors.forget_clocks();
        self.round.forget();
    }

    /// An anchor's sync frame came.
    pub fn receive(&mut self, anchor: u16) {
        match self.other(anchor) {
            Some(other) => other.unheard = 0,
            // An anchor beyond the remembered number is left to the anchors nearer to it.
            None => {
                let _ = self.heard.push(Other { address: anchor, unheard: 0, apart_m: 0.0, ranges: 0 });
            }
        }
    }

    /// Whether this is an anchor that was received.
    pub fn knows(&self, address: u16) -> bool {
        self.heard.iter().any(|other| other.address == address)
    }

    fn other(&mut self, address: u16) -> Option<&mut Other> {
        self.heard.iter_mut().find(|other| other.address == address)
    }

    /// The poll was written.
    pub fn seal(&mut self, sealed: Option<SealedPoll>) {
        self.round.seal(sealed);
    }

    /// The last poll, in a network with a key.
    pub fn sealed(&self) -> Option<&SealedPoll> {
        self.round.sealed()
    }

    /// The poll has left.
    pub fn sent(&mut self, departure: RadioInstant) {
        self.round.sent(departure);
    }

    /// A response came.
    pub fn answer(&mut self, timing: &Timing, source: u16, response: Response, frame: &RxFrame<'_>) {
        let Self { round, anchors, bias, .. } = self;
        let Some(distance_m) = round.receive(timing, bias, anchors, source, response, frame) else { return };
        if let Some(other) = self.other(source) {
            other.ranges = other.ranges.saturating_add(1).min(MEAN_OF);
            other.apart_m += (distance_m - other.apart_m) / f32::from(other.ranges);
        }
    }

    /// Once a superframe: requests slots if the anchor lacks some, and finds its own slots.
    pub fn plan(&mut self, network: &mut Coordinator, leases: &mut Leases, address: u16) {
        let Some(rate) = self.rate else { return };
        let timing = network.course.timing;
        let number = network.course.phase.number;
        let Some(passed) =
            self.planned.replace(number).map_or(Some(1), |last| match SerialNumber(number).steps_from(last) {
                0 => None,
                superframes => Some(superframes),
            })
        else {
            return;
        };
        // Long past. It must not be mistaken for a future instant once the clock has wrapped.
        (self.answered, self.rounds) = (None, 0);
        self.anchors.advance(passed);
        for other in &mut self.heard {
            other.unheard = other.unheard.saturating_add(passed);
        }
        self.heard.retain(|other| other.unheard <= FORGOTTEN_AFTER);
        // Who listens must know the slots of anchors at once, from the list. An anchor that ranges less often than once a
        // superframe leaves its slot unused.
        let (share, every) = match share_of(rate, &timing) {
            Share::Leased(turns) => (Share::Slots(1), turns.period.superframes()),
            share => (share, 1),
        };
        network.request(leases, Member { tag: address, share }, false);
        let is_turn = number.wrapping_add(address).is_multiple_of(every);
        self.owned = match network.course.membership.in_force() {
            Some(plan) if is_turn => plan.owned_slots(address, number, &timing),
            Some(_) | None => 0,
        };
    }

    /// From the superframe's beginning to the first pulse of the next poll that is still possible `earliest` after that
    /// beginning.
    pub fn next(&self, timing: &Timing, phase: Phase, earliest: RadioDuration) -> Option<RadioDuration> {
        let anchors = self.heard.len().min(MAX_ROUND);
        let answered = self.answered.map_or(earliest, |instant| instant.since(phase.start));
        // Rounds of few anchors are shorter than their slots: there are as many rounds as slots.
        let has_enough = self.rounds >= self.owned.count_ones();
        if anchors == 0 || has_enough {
            None
        } else {
            next_round(self.owned, timing, earliest.max(answered), anchors, RadioDuration::ZERO)
        }
    }

    /// The poll of a round whose first pulse is at `pulse`, by a node that has read a frame `reading` after its end.
    pub fn poll(&mut self, timing: &Timing, pulse: RadioInstant, reading: RadioDuration, wish: Layout) -> Poll {
        let length = timing.round(self.heard.len().min(MAX_ROUND)).ticks() + reading.ticks();
        self.answered = Some(pulse.plus(RadioDuration::from_ticks(length)));
        self.rounds = self.rounds.saturating_add(1);
        let count = self.heard.len();
        let from = self.first;
        self.first = (from + MAX_ROUND).checked_rem(count).unwrap_or(0);
        let turn = self.heard.iter().cycle().skip(from).take(count.min(MAX_ROUND));
        self.round.set_team(turn.map(|other| other.address).collect(), [None; 2]);
        let mut poll = self.round.begin(&mut self.anchors, Scheme::SingleSided, wish, true);
        for asked in &mut poll.anchors {
            let known = self.other(asked.address).filter(|other| other.ranges > 0);
            asked.distance = known.map_or(Distance::Unknown, |other| Distance::from_metres(other.apart_m));
        }
        poll
    }
}
