//! How an anchor asks the others, in slots of its own as a tag does, for tags that only listen. It is a member of the network
//! beside being an anchor.
//!
//! What it is answered makes ranges, and its polls tell the mean of each: by how much a frame between two anchors is late, behind
//! walls, by antenna delays, is in every difference that a tag hears of the two, and in no other way known to it.

use heapless::Vec;

use super::MAX_ROUND;
use super::anchor_table::AnchorTable;
use super::coordinator::Coordinator;
use super::plan::{Rate, next_round, owned_slots, share_of};
use super::round::RoundState;
use super::timing::{Phase, Timing};
use crate::{RadioDuration, RadioInstant, RangeBias, RxFrame};
use wire::uwb::layout::{Layout, Scheme};
use wire::uwb::native::{Distance, Member, Poll, Response};

/// Anchors kept in mind.
const MAX_HEARD: usize = 16;
/// An anchor not heard for this many superframes is asked no more.
const FORGOTTEN_AFTER: u16 = 6;
/// A distance that is told is the mean of about so many ranges: anchors stand, people between them do not.
const MEAN_OF: u8 = 100;

/// An anchor's rounds.
#[derive(Clone, Debug)]
pub struct AnchorRounds {
    rate: Option<Rate>,
    heard: Vec<Other, MAX_HEARD>,
    /// Whom the next round names first: with more anchors than a round has places, all have their turn.
    first: usize,
    round: RoundState,
    /// Those who answered.
    anchors: AnchorTable,
    bias: RangeBias,
    /// The superframe that `owned` is for.
    planned: Option<u16>,
    owned: u64,
    /// Rounds begun in that superframe.
    rounds: u32,
    /// When the answers of the last round are over.
    answered: Option<RadioInstant>,
}

/// Another anchor.
#[derive(Clone, Debug)]
struct Other {
    address: u16,
    /// Superframes since it was heard.
    unheard: u16,
    /// Mean of the ranges to it, metres …
    apart_m: f32,
    /// … and how many there are, at most [`MEAN_OF`].
    ranges: u8,
}

impl AnchorRounds {
    /// Nobody heard yet.
    pub fn new(rate: Option<Rate>, bias: RangeBias) -> Self {
        Self {
            rate,
            heard: Vec::new(),
            first: 0,
            round: RoundState::new(),
            anchors: AnchorTable::new(),
            bias,
            planned: None,
            owned: 0,
            rounds: 0,
            answered: None,
        }
    }

    /// The radio was started: what was known of clocks is void.
    pub fn restart(&mut self) {
        self.anchors.forget_clocks();
        self.round.forget();
    }

    /// An anchor's sync frame came.
    pub fn receive(&mut self, anchor: u16) {
        match self.other(anchor) {
            Some(other) => other.unheard = 0,
            // One more than is kept in mind is left to those nearer to it.
            None => {
                let _ = self.heard.push(Other { address: anchor, unheard: 0, apart_m: 0.0, ranges: 0 });
            }
        }
    }

    /// Whether this is an anchor that was heard.
    pub fn knows(&self, address: u16) -> bool {
        self.heard.iter().any(|other| other.address == address)
    }

    fn other(&mut self, address: u16) -> Option<&mut Other> {
        self.heard.iter_mut().find(|other| other.address == address)
    }

    /// The poll has left.
    pub fn sent(&mut self, departure: RadioInstant) {
        self.round.sent(departure);
    }

    /// An answer came.
    pub fn answer(&mut self, timing: &Timing, source: u16, response: Response, frame: &RxFrame<'_>) {
        let Self { round, anchors, bias, .. } = self;
        let Some(distance_m) = round.receive(timing, bias, anchors, source, response, frame) else { return };
        if let Some(other) = self.other(source) {
            other.ranges = other.ranges.saturating_add(1).min(MEAN_OF);
            other.apart_m += (distance_m - other.apart_m) / f32::from(other.ranges);
        }
    }

    /// Once a superframe: asks for slots where it has not those it wants, and finds which are its own.
    pub fn plan(&mut self, network: &mut Coordinator, address: u16) {
        let Some(rate) = self.rate else { return };
        let timing = network.course.timing;
        let number = network.course.phase.number;
        let Some(passed) = self.planned.replace(number).map_or(Some(1), |last| match number.wrapping_sub(last) {
            0 => None,
            superframes => Some(superframes),
        }) else {
            return;
        };
        // Long past, and not to be mistaken for an instant to come once the clock has wrapped.
        (self.answered, self.rounds) = (None, 0);
        self.anchors.advance(passed);
        for other in &mut self.heard {
            other.unheard = other.unheard.saturating_add(passed);
        }
        self.heard.retain(|other| other.unheard <= FORGOTTEN_AFTER);
        network.request(Member { tag: address, share: share_of(rate, &timing) });
        self.owned = match network.course.membership.in_force() {
            Some(members) => owned_slots(members, address, number, timing.round_slots),
            None => 0,
        };
    }

    /// From the superframe's beginning to the first pulse of the next poll that can still be made `earliest` after it.
    pub fn next(&self, timing: &Timing, phase: Phase, earliest: RadioDuration) -> Option<RadioDuration> {
        let anchors = self.heard.len().min(MAX_ROUND);
        let answered = self.answered.map_or(earliest, |instant| instant.since(phase.start));
        // Rounds of few anchors are shorter than slots: there are as many as slots.
        let has_enough = self.rounds >= self.owned.count_ones();
        if anchors == 0 || has_enough {
            None
        } else {
            next_round(self.owned, timing, earliest.max(answered), anchors, RadioDuration::ZERO)
        }
    }

    /// The poll of a round whose first pulse is at `pulse`, by a node that has read a frame this long after its end.
    pub fn poll(&mut self, timing: &Timing, pulse: RadioInstant, reading: RadioDuration, wish: Layout) -> Poll {
        let length = timing.round(self.heard.len().min(MAX_ROUND)).ticks() + reading.ticks();
        self.answered = Some(pulse.plus(RadioDuration::from_ticks(length)));
        self.rounds = self.rounds.saturating_add(1);
        let count = self.heard.len();
        let from = self.first;
        self.first = (from + MAX_ROUND).checked_rem(count).unwrap_or(0);
        let turn = self.heard.iter().cycle().skip(from).take(count.min(MAX_ROUND));
        self.round.set_team(turn.map(|other| other.address).collect());
        let mut poll = self.round.begin(&mut self.anchors, Scheme::SingleSided, wish, true);
        for asked in &mut poll.anchors {
            let known = self.other(asked.address).filter(|other| other.ranges > 0);
            asked.distance = known.map_or(Distance::Unknown, |other| Distance::from_metres(other.apart_m));
        }
        poll
    }
}
