//! How a tag follows the network that it hears: where it is in time, whose word counts, who may range when.

use super::course::Course;
use super::plan::Members;
use super::prevails;
use super::timing::HOLDOVER_SUPERFRAMES;
use crate::frame::native::Beacon;
use crate::{PhyConfig, RadioDuration, RadioInstant};

/// The network that is followed.
#[derive(Clone, Debug)]
pub struct Following {
    /// Where it is, and what counts there.
    pub course: Course,
    /// Who coordinates.
    pub coordinator: u16,
    term: u8,
    /// Since when the phase is not known any more, after a doze: the next beacon tells it.
    pub adrift: Option<RadioInstant>,
    /// How far off the phase may be, after naps: until the next beacon.
    pub doubt: RadioDuration,
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
    /// The network that this beacon tells of; `None` in the middle of a change of its layout.
    pub fn new(phy: &PhyConfig, beacon: &Beacon, rx_time: RadioInstant) -> Option<Self> {
        let course = Course::of_beacon(phy, beacon, rx_time)?;
        let (coordinator, term, heard) = (beacon.coordinator, beacon.term, course.phase.number);
        Some(Self { course, coordinator, term, adrift: None, doubt: RadioDuration::ZERO, heard })
    }

    /// A beacon came.
    pub fn hear(&mut self, phy: &PhyConfig, beacon: &Beacon, rx_time: RadioInstant) -> Heard {
        let told = (beacon.term, beacon.coordinator);
        let followed = (self.term, self.coordinator);
        if self.adrift.is_none() {
            self.advance(rx_time);
            let in_step = self.course.in_step_within(self.doubt, beacon, rx_time);
            if let Some(phase) = in_step.filter(|_| prevails(told, followed)) {
                self.course.phase = phase;
                (self.heard, self.doubt) = (phase.number, RadioDuration::ZERO);
                (self.term, self.coordinator) = told;
                self.course.membership.hear(beacon);
                return if told.1 == followed.1 { Heard::Followed } else { Heard::Changed };
            }
            let is_lost = self.silent() > HOLDOVER_SUPERFRAMES;
            let is_replaced = told != followed && prevails(told, followed);
            if !is_lost && !is_replaced {
                return Heard::Ignored;
            }
        }
        let Some(anew) = Self::new(phy, beacon, rx_time) else { return Heard::Ignored };
        let is_the_same = self.adrift.is_some() && told == followed;
        *self = anew;
        if is_the_same { Heard::Followed } else { Heard::Anew }
    }

    /// Goes on to the superframe that `now` is in; answers how many have begun since.
    pub fn advance(&mut self, now: RadioInstant) -> u16 {
        self.course.advance(now)
    }

    /// Superframes since a beacon was heard.
    pub fn silent(&self) -> u16 {
        self.course.phase.number.wrapping_sub(self.heard)
    }

    /// The radio's clock has begun anew: what was the instant `before` is `now`.
    pub fn rebase(&mut self, before: RadioInstant, now: RadioInstant) {
        let passed = self.course.phase.start.since(before);
        self.course.phase.start = now.plus(passed);
    }

    /// The list that counts in this superframe, unless it may have changed unheard.
    pub fn members(&self) -> Option<&Members> {
        self.course.membership.in_force().filter(|_| self.silent() <= HOLDOVER_SUPERFRAMES)
    }
}
