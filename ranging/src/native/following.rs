//! How a tag follows the network that it hears: where it is in time, whose word counts, who may range when.

use super::plan::{Members, Membership};
use super::prevails;
use super::timing::{HOLDOVER_SUPERFRAMES, Phase, Timing};
use crate::RadioInstant;
use crate::frame::native::Beacon;

/// The network that is followed.
#[derive(Clone, Debug)]
pub struct Following {
    /// Where it is in time.
    pub phase: Phase,
    /// Who may range.
    pub membership: Membership,
    /// Who coordinates.
    pub coordinator: u16,
    term: u8,
    /// Since when the phase is not known any more, after a doze: the next beacon tells it.
    pub adrift: Option<RadioInstant>,
    /// The superframe of the last beacon heard.
    heard: u16,
}

/// What a beacon did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heard {
    /// Nothing: of a network that does not prevail, or a repetition.
    Ignored,
    /// The network is followed as before.
    Followed,
    /// It has another coordinator now.
    Changed,
    /// Another network is followed, or the same in another time: everything is new.
    Anew,
}

impl Following {
    /// The network that this beacon tells of.
    pub fn new(timing: &Timing, beacon: &Beacon, rx_time: RadioInstant) -> Self {
        let phase = Phase::from_beacon(timing, beacon.superframe, beacon.slot, rx_time);
        let mut membership = Membership::default();
        membership.hear(beacon.version, beacon.countdown, &beacon.members, true);
        Self {
            phase,
            membership,
            coordinator: beacon.coordinator,
            term: beacon.term,
            adrift: None,
            heard: phase.number,
        }
    }

    /// A beacon came.
    pub fn hear(&mut self, timing: &Timing, beacon: &Beacon, rx_time: RadioInstant) -> Heard {
        let phase = Phase::from_beacon(timing, beacon.superframe, beacon.slot, rx_time);
        let told = (beacon.term, beacon.coordinator);
        let followed = (self.term, self.coordinator);
        let mut expected = self.phase;
        expected.advance(timing, rx_time);
        let silent = expected.number.wrapping_sub(self.heard);
        // In step: the same superframe, begun at the same time. A beacon repeated later is neither.
        let off = phase.start.since(expected.start).ticks().unsigned_abs();
        let in_step = phase.number == expected.number && off <= timing.guard.ticks().unsigned_abs();
        if self.adrift.is_some() && told == followed {
            (self.phase, self.heard, self.adrift) = (phase, phase.number, None);
            self.membership.hear(beacon.version, beacon.countdown, &beacon.members, true);
            Heard::Followed
        } else if in_step && prevails(told, followed) {
            self.phase = phase;
            self.heard = phase.number;
            (self.term, self.coordinator) = told;
            self.membership.hear(beacon.version, beacon.countdown, &beacon.members, false);
            if told.1 == followed.1 { Heard::Followed } else { Heard::Changed }
        } else if self.adrift.is_some()
            || silent > HOLDOVER_SUPERFRAMES
            || (told != followed && prevails(told, followed))
        {
            *self = Self::new(timing, beacon, rx_time);
            Heard::Anew
        } else {
            Heard::Ignored
        }
    }

    /// Goes on to the superframe that `now` is in; answers how many have begun since.
    pub fn advance(&mut self, timing: &Timing, now: RadioInstant) -> u16 {
        let begun = self.phase.advance(timing, now);
        self.membership.advance(begun);
        begun
    }

    /// Superframes since a beacon was heard.
    pub fn silent(&self) -> u16 {
        self.phase.number.wrapping_sub(self.heard)
    }

    /// The list that counts in this superframe, unless it may have changed unheard.
    pub fn members(&self) -> Option<&Members> {
        self.membership.in_force().filter(|_| self.silent() <= HOLDOVER_SUPERFRAMES)
    }
}
