//! The position of a node in the course of a network's superframes, and what is in force there: phase, members, layout.

use super::authentication::Moment;
use super::plan::Membership;
use super::timing::{Network, Phase, Timing};
use crate::{RadioDuration, RadioInstant};
use wire::uwb::layout::Layout;
use wire::uwb::native::{Session, SyncFrame};

/// The course of superframes as a node knows it.
#[derive(Clone, Debug)]
pub struct Superframes {
    /// The phase: superframe and its beginning.
    pub phase: Phase,
    /// Who may range, and the layout of the slots.
    pub membership: Membership,
    /// The times that follow from the layout in force.
    pub timing: Timing,
    /// The session of a network with a key.
    pub session: Option<u32>,
    /// The high half of the superframe's number, in a session.
    epoch: u16,
    network: Network,
}

impl Superframes {
    /// A network without members that begins at `start`.
    pub fn begin(network: &Network, layout: Layout, start: RadioInstant, session: Option<u32>) -> Self {
        Self {
            phase: Phase { number: 0, start },
            membership: Membership::new(layout),
            timing: Timing::of(network, layout),
            session,
            epoch: 0,
            network: *network,
        }
    }

    /// The course from a sync frame that arrived at `rx_time`; `None` in the middle of a change of layout, when only
    /// nodes that follow already know what is in force.
    pub fn of_sync_frame(network: &Network, sync_frame: &SyncFrame, rx_time: RadioInstant) -> Option<Self> {
        let membership = Membership::from_sync_frame(sync_frame);
        if sync_frame.layout_is_new && sync_frame.countdown > 0 {
            return None;
        }
        let timing = Timing::of(network, sync_frame.layout);
        let phase = Phase::from_sync_frame(&timing, sync_frame.superframe, sync_frame.slot, rx_time);
        let session = sync_frame.session.map(|session| session.number);
        let epoch = sync_frame.session.map_or(0, |session| session.epoch);
        Some(Self { phase, membership, timing, session, epoch, network: *network })
    }

    /// The course from a sync frame that arrived at `rx_time` in the middle of a change of layout, for a node that
    /// knows what was in force before and lost only the time; `None` if the node may have missed another change.
    pub fn of_notice(&self, sync_frame: &SyncFrame, rx_time: RadioInstant) -> Option<Self> {
        let is_next = sync_frame.version == self.membership.version().wrapping_add(1);
        if !is_next || self.membership.countdown() > 0 || sync_frame.countdown == 0 {
            return None;
        }
        let mut course = self.clone();
        course.phase = Phase::from_sync_frame(&self.timing, sync_frame.superframe, sync_frame.slot, rx_time);
        course.epoch = sync_frame.session.map_or(0, |session| session.epoch);
        course.membership.receive(sync_frame);
        Some(course)
    }

    /// Whether this superframe seems to begin only after the next one. Instants can be ordered within 8.6 s: a node that
    /// was halted for 8.6 to 17 s has lost the time. After a longer halt its superframe is one of 17 s ago, so that no
    /// sync frame is in step.
    pub fn is_beyond(&self, now: RadioInstant) -> bool {
        self.phase.start.since(now) > self.timing.superframe
    }

    /// Advances to the superframe that contains `now`. Returns the number of superframes begun since.
    pub fn advance(&mut self, now: RadioInstant) -> u16 {
        let mut begun = 0;
        while self.phase.ends_by(&self.timing, now) {
            self.next();
            begun += 1;
        }
        begun
    }

    /// Advances to the next superframe.
    pub fn next(&mut self) {
        self.phase.next(&self.timing);
        if self.phase.number == 0 {
            self.epoch = self.epoch.wrapping_add(1);
        }
        self.membership.advance();
        let layout = self.membership.layout_in_force();
        if layout != self.timing.layout {
            self.timing = Timing::of(&self.network, layout);
        }
    }

    /// What makes frames of this superframe new, in a session.
    pub fn moment(&self) -> Option<Moment> {
        Some(Moment::new(self.session?, self.epoch, self.phase.number))
    }

    /// The same for the superframe of an instant in this superframe or the one before.
    pub fn moment_at(&self, instant: RadioInstant) -> Option<Moment> {
        let Moment { session, superframe } = self.moment()?;
        let is_before = instant.since(self.phase.start) < RadioDuration::ZERO;
        Some(Moment { session, superframe: superframe.wrapping_sub(is_before.into()) })
    }

    /// What a sync frame of this superframe says of the session. It repeats `answer`.
    pub fn session_now(&self, answer: Option<u32>) -> Option<Session> {
        self.session.map(|number| Session { number, epoch: self.epoch, answer })
    }

    /// An instant in this superframe or the one before, in 1/256 of a superframe, wrapping.
    pub fn of_256th(&self, instant: RadioInstant) -> u16 {
        let into = instant.since(self.phase.start).ticks() * 256;
        (i64::from(self.phase.number) * 256 + into.div_euclid(self.timing.superframe.ticks())) as u16
    }

    /// The superframe and the round slot of an instant in this superframe or the one before, if it is in a round slot.
    pub fn round_slot_at(&self, instant: RadioInstant) -> Option<(u16, u8)> {
        let Phase { number, start } = self.phase;
        let passed = instant.since(start).ticks();
        // A node prepares for the next superframe before this one ends.
        let (number, passed) = match passed < 0 {
            true => (number.wrapping_sub(1), passed + self.timing.superframe.ticks()),
            false => (number, passed),
        };
        let into = passed - self.timing.rounds().ticks();
        let slot = u8::try_from(into.div_euclid(self.timing.round_slot.ticks())).ok()?;
        Some((number, slot))
    }

    /// The phase of a sync frame that arrived at `rx_time`, if its superframe has the same number and beginning as this
    /// course has then. A sync frame that was repeated later does not.
    pub fn in_step(&self, sync_frame: &SyncFrame, rx_time: RadioInstant) -> Option<Phase> {
        self.in_step_within(RadioDuration::ZERO, sync_frame, rx_time)
    }

    /// The same for a node whose clock may be off by `uncertainty`.
    pub fn in_step_within(
        &self,
        uncertainty: RadioDuration,
        sync_frame: &SyncFrame,
        rx_time: RadioInstant,
    ) -> Option<Phase> {
        let phase = Phase::from_sync_frame(&self.timing, sync_frame.superframe, sync_frame.slot, rx_time);
        let off = phase.start.since(self.phase.start).ticks().unsigned_abs();
        let tolerance = self.timing.guard.ticks().saturating_add(uncertainty.ticks());
        let is_now = sync_frame
            .session
            .is_none_or(|session| Some(session.number) == self.session && session.epoch == self.epoch);
        (is_now && phase.number == self.phase.number && off <= tolerance.unsigned_abs()).then_some(phase)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PhyConfig;

    #[test]
    fn the_number_of_a_superframe_goes_on_after_65535_in_a_session() {
        let start = RadioInstant::from_ticks(1 << 39);
        let network = Network::new(1, PhyConfig::FAST);
        let mut course = Superframes::begin(&network, Layout::LEAST, start, Some(7));
        (0..65_536).for_each(|_| course.next());
        let superframe = |moment: Option<Moment>| moment.map(|moment| moment.superframe);
        assert_eq!((course.phase.number, superframe(course.moment())), (0, Some(65_536)));
        let before = course.phase.start.plus(RadioDuration::from_ticks(-1));
        assert_eq!(superframe(course.moment_at(before)), Some(65_535));
        assert_eq!(superframe(course.moment_at(course.phase.start)), Some(65_536));
        assert_eq!(course.session_now(Some(9)), Some(Session { number: 7, epoch: 1, answer: Some(9) }));
        assert_eq!(Superframes::begin(&network, Layout::LEAST, start, None).moment(), None);
    }

    #[test]
    fn the_time_is_lost_to_who_was_halted_for_longer_than_instants_can_be_ordered() {
        let start = RadioInstant::from_ticks(1 << 39);
        let course = Superframes::begin(&Network::new(1, PhyConfig::FAST), Layout::LEAST, start, None);
        let is_lost = |micros: u32| course.is_beyond(start.plus(RadioDuration::from_micros(micros)));
        // Half of the clock's 2^40 ticks of 1 / 63.8976 GHz are 8.6 s.
        assert!([8_700_000, 12_000_000, 17_000_000].into_iter().all(is_lost));
        assert!(![0, 100_000, 8_500_000].into_iter().any(is_lost));
        // A node prepares for a superframe, and then receives the last frame of the one before.
        assert!(!course.is_beyond(start.plus(RadioDuration::from_ticks(-63_897_600))));
    }
}
