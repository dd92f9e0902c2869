//! How an anchor asks the others, in slots of its own as a tag does, for tags that only listen. It is a member of the network
//! beside being an anchor; what it is answered it needs not.

use heapless::Vec;

use super::MAX_ROUND;
use super::coordination::Coordination;
use super::plan::{Rate, next_round, owned_slots, share_of};
use super::timing::{Phase, Timing};
use crate::frame::native::{Asked, Distance, Member, Poll, Share};
use crate::{RadioDuration, RadioInstant};

/// Anchors kept in mind.
const MAX_HEARD: usize = 16;
/// An anchor not heard for this many superframes is asked no more.
const FORGOTTEN_AFTER: u16 = 6;

/// An anchor's rounds.
#[derive(Clone, Debug)]
pub struct Asking {
    share: Option<Share>,
    /// Anchors heard, each with superframes since.
    heard: Vec<(u16, u16), MAX_HEARD>,
    /// Whom the next round names first: with more anchors than a round has places, all have their turn.
    first: usize,
    round: u16,
    /// The superframe that `owned` is for.
    planned: Option<u16>,
    owned: u64,
    /// When the answers of the last round are over.
    answered: Option<RadioInstant>,
}

impl Asking {
    /// Nobody heard yet.
    pub fn new(rate: Option<Rate>, timing: &Timing) -> Self {
        let share = rate.map(|rate| share_of(rate, timing));
        Self { share, heard: Vec::new(), first: 0, round: 0, planned: None, owned: 0, answered: None }
    }

    /// An anchor's beacon came.
    pub fn hear(&mut self, anchor: u16) {
        match self.heard.iter_mut().find(|(address, _)| *address == anchor) {
            Some((_, unheard)) => *unheard = 0,
            // One more than is kept in mind is left to those nearer to it.
            None => {
                let _ = self.heard.push((anchor, 0));
            }
        }
    }

    /// Once a superframe: asks for slots where it has not those it wants, and finds which are its own.
    pub fn plan(&mut self, network: &mut Coordination, address: u16, timing: &Timing) {
        let Some(share) = self.share else { return };
        let number = network.phase.number;
        let Some(passed) = self.planned.replace(number).map_or(Some(1), |last| match number.wrapping_sub(last) {
            0 => None,
            superframes => Some(superframes),
        }) else {
            return;
        };
        // Long past, and not to be mistaken for an instant to come once the clock has wrapped.
        self.answered = None;
        for (_, unheard) in &mut self.heard {
            *unheard = unheard.saturating_add(passed);
        }
        self.heard.retain(|(_, unheard)| *unheard <= FORGOTTEN_AFTER);
        network.request(Member { tag: address, share });
        self.owned = match network.membership.in_force() {
            Some(members) => owned_slots(members, address, number, timing.round_slots),
            None => 0,
        };
    }

    /// From the superframe's beginning to the first pulse of the next poll that can still be made `earliest` after it.
    pub fn next(&self, timing: &Timing, phase: Phase, earliest: RadioDuration) -> Option<RadioDuration> {
        let anchors = self.heard.len().min(MAX_ROUND);
        let answered = self.answered.map_or(earliest, |instant| instant.since(phase.start));
        if anchors == 0 { None } else { next_round(self.owned, timing, earliest.max(answered), anchors) }
    }

    /// The poll of a round whose first pulse is at `pulse`.
    pub fn poll(&mut self, timing: &Timing, pulse: RadioInstant) -> Poll {
        let length = timing.round(self.heard.len().min(MAX_ROUND)).ticks() + timing.reading.ticks();
        self.answered = Some(pulse.plus(RadioDuration::from_ticks(length)));
        self.round = self.round.wrapping_add(1);
        let count = self.heard.len();
        let from = self.first;
        self.first = (from + MAX_ROUND).checked_rem(count).unwrap_or(0);
        let turn = self.heard.iter().cycle().skip(from).take(count.min(MAX_ROUND));
        let anchors = turn.map(|&(address, _)| Asked { address, distance: Distance::Unsent }).collect();
        Poll { round: self.round, anchors }
    }
}
