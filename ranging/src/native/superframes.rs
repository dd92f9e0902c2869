//! The position of a node in the course of a network's superframes, and what is in force there: phase, members, layout.

use core::cmp::Ordering;

use super::authentication::Moment;
use super::plan::Membership;
use super::timing::{Network, Phase, Timing};
use crate::{RadioDuration, RadioInstant};
use wire::uwb::layout::Layout;
use wire::uwb::native::{Session, SyncFrame};

/// Superframes after which instants cannot be ordered any more, or soon: 8.6 s of 100 ms.
const LONG_AGO: i32 = 50;

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
        let moment = self.moment()?;
        let is_before = instant.since(self.phase.start) < RadioDuration::ZERO;
        Some(Moment { superframe: moment.superframe.wrapping_sub(is_before.into()), ..moment })
    }

    /// The same for a frame of a round whose first pulse comes at this instant: in a leased slot it counts there only.
    pub fn moment_of_round(&self, pulse: RadioInstant) -> Option<Moment> {
        let moment = self.moment_at(pulse)?;
        let leased = self.membership.in_force().map_or(0, |plan| plan.slots.leased);
        let slot = self.round_slot_at(pulse).map(|(_, slot)| slot).filter(|slot| *slot < leased);
        Some(slot.map_or(moment, |slot| moment.at_place(slot.into())))
    }

    /// The first round slot with places for requests, and how many there are: nobody polls in those that are not leased if
    /// nobody is listed.
    pub fn request_places(&self) -> (u8, u16) {
        let Some(plan) = self.membership.in_force().filter(|plan| plan.members.is_empty()) else { return (0, 0) };
        let slots = self.timing.tag_slots(plan.slots.relays);
        let begin = plan.slots.leased.min(slots);
        (begin, self.timing.requests_in_round_slots(slots - begin))
    }

    /// Whether there are relay slots in this superframe.
    pub fn has_relay_slots(&self) -> bool {
        self.membership.in_force().is_some_and(|plan| plan.slots.relays)
    }

    /// The place of a request that arrived at an instant of this superframe or the one before: first those of the shared
    /// sync slots, then those of round slots.
    pub fn request_place_at(&self, rx_time: RadioInstant) -> Option<u16> {
        let timing = &self.timing;
        let passed = rx_time.since(self.phase.start).ticks();
        let passed = if passed < 0 { passed + timing.superframe.ticks() } else { passed };
        let (shared, (begin, further)) = (u16::from(timing.request_slots), self.request_places());
        let regions = [(0, timing.request(0), shared), (shared, timing.request_from_round_slot(begin, 0), further)];
        // The chip has no 64-bit division.
        let slot = (timing.request_slot.ticks() >> 8) as i32;
        regions.into_iter().find_map(|(before, first, places)| {
            let after = ((passed - first.ticks()) >> 8) as i32 + slot / 2;
            let place = u16::try_from(after.div_euclid(slot.max(1))).ok()?;
            (place < places).then_some(before + place)
        })
    }

    /// What a sync frame of this superframe says of the session. It repeats `answer`.
    pub fn session_now(&self, answer: Option<u32>) -> Option<Session> {
        self.session.map(|number| Session { number, epoch: self.epoch, answer })
    }

    /// How a sync frame of the own session, which nobody can forge, comes by this clock: `Greater` is late by more than half a
    /// superframe, as a recorded one or one of a network that is behind; `Less` is as early.
    #[inline(never)]
    pub fn lateness(&self, sync_frame: &SyncFrame, rx_time: RadioInstant) -> Ordering {
        let told = Moment::of_sync_frame(sync_frame).zip(self.moment());
        let Some((told, own)) = told.filter(|(told, own)| told.session == own.session) else { return Ordering::Equal };
        let begin = Phase::from_sync_frame(&self.timing, sync_frame.superframe, sync_frame.slot, rx_time).start;
        let superframe = self.timing.superframe.ticks();
        let ahead = i64::from(told.superframe) - i64::from(own.superframe);
        let late = begin.since(self.phase.start).ticks().saturating_sub(ahead.saturating_mul(superframe));
        if (-superframe / 2..=superframe / 2).contains(&late) { Ordering::Equal } else { late.cmp(&0) }
    }

    /// An instant in this superframe or the one before, in 1/256 of a superframe, wrapping.
    pub fn of_256th(&self, instant: RadioInstant) -> u16 {
        // The chip has no 64-bit division.
        let into = (instant.since(self.phase.start).ticks() >> 8) as i32;
        let superframe = (self.timing.superframe.ticks() >> 16) as i32;
        (self.phase.number << 8).wrapping_add(into.div_euclid(superframe.max(1)) as u16)
    }

    /// The superframe and the round slot of an instant in this superframe or the one before, if it is in a round slot. By a
    /// clock that is wrong after a sleep, a poll comes up to half a response slot before its slot. No frame of a round
    /// begins so late in its slot.
    #[inline(never)]
    pub fn round_slot_at(&self, instant: RadioInstant) -> Option<(u16, u8)> {
        let Phase { number, start } = self.phase;
        let passed = instant.since(start).ticks();
        // A node prepares for the next superframe before this one ends.
        let (number, passed) = match passed < 0 {
            true => (number.wrapping_sub(1), passed + self.timing.superframe.ticks()),
            false => (number, passed),
        };
        let into = passed + self.timing.response_slot.ticks() / 2 - self.timing.rounds().ticks();
        let slot = u8::try_from(into.div_euclid(self.timing.round_slot.ticks())).ok()?;
        Some((number, slot))
    }

    /// Whether a blink whose first pulse came at this instant is this part of its slot.
    pub fn is_in_part(&self, pulse: RadioInstant, part: u8) -> bool {
        let Some((_, slot)) = self.round_slot_at(pulse) else { return false };
        let passed = pulse.since(self.phase.start).ticks();
        let passed = if passed < 0 { passed + self.timing.superframe.ticks() } else { passed };
        (passed - self.timing.blink(slot, part).ticks()).abs() <= self.timing.response_slot.ticks() / 2
    }

    /// Whether a sync frame of the own session, which nobody can forge, comes later than by this clock, which may be off by
    /// `uncertainty`: it was repeated.
    pub fn is_delayed(&self, uncertainty: RadioDuration, sync_frame: &SyncFrame, rx_time: RadioInstant) -> bool {
        let told = Moment::of_sync_frame(sync_frame).zip(self.moment());
        let Some((told, own)) = told.filter(|(told, own)| told.session == own.session) else { return false };
        let behind = own.superframe.wrapping_sub(told.superframe) as i32;
        // With another layout it came at another time. As long as that is only announced, the one before is in force.
        let is_announced = sync_frame.layout_is_new && sync_frame.countdown > 0;
        let timing = match is_announced || sync_frame.layout == self.timing.layout {
            true => self.timing,
            false => Timing::of(&self.network, sync_frame.layout),
        };
        if behind < 0 || timing.superframe != self.timing.superframe {
            return false;
        }
        let sent = timing.sync_frame(sync_frame.slot.into()).ticks() - i64::from(behind) * timing.superframe.ticks();
        let late = rx_time.since(self.phase.at(RadioDuration::from_ticks(sent))).ticks();
        behind > LONG_AGO || late > self.timing.in_step().ticks().saturating_add(uncertainty.ticks())
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
        let tolerance = self.timing.in_step().ticks().saturating_add(uncertainty.ticks());
        let is_now = sync_frame
            .session
            .is_none_or(|session| Some(session.number) == self.session && session.epoch == self.epoch);
        (is_now && phase.number == self.phase.number && off <= tolerance.unsigned_abs()).then_some(phase)
    }
}

#[cfg(test)]
mod tests {
    use super::super::plan::{Members, Slots};
    use super::*;
    use crate::PhyConfig;
    use wire::uwb::layout::Span;

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
    fn a_request_is_at_the_place_in_which_it_was_sent() {
        let start = RadioInstant::from_ticks(1 << 39);
        let mut course = Superframes::begin(&Network::new(1, PhyConfig::FAST), Layout::LEAST, start, Some(7));
        let slots = Slots { leased: 3, relays: true, ..course.membership.newest().slots };
        course.membership.change(&Members::new(), slots);
        assert_eq!((course.has_relay_slots(), course.request_places().0), (false, 0), "not yet");
        (0..4).for_each(|_| course.next());
        let (timing, (begin, further)) = (course.timing, course.request_places());
        let start = course.phase.start;
        let shared = u16::from(timing.request_slots);
        let all = shared + further;
        assert!(shared > 5 && all > 3 * shared, "{shared} of {all}");
        let last = timing.request_from_round_slot(begin, usize::from(further) - 1).ticks();
        let relays = timing.round_slot_begin(timing.tag_slots(true).into()).ticks();
        assert!(course.has_relay_slots() && begin == 3);
        let room = relays - last;
        assert!((0..2 * timing.request_slot.ticks()).contains(&room), "they come before the relay slots");
        for place in 0..all {
            let rmarker = match place.checked_sub(shared) {
                Some(place) => timing.request_from_round_slot(begin, place.into()),
                None => timing.request(place.into()),
            };
            // A microsecond early, on time and in the superframe before; half a place later it is another one, or none.
            let at = |micros: i64| course.phase.at(rmarker).plus(RadioDuration::from_ticks(micros * 63_898));
            assert_eq!([-1, 0, 3].map(|micros| course.request_place_at(at(micros))), [Some(place); 3]);
            let before = at(0).plus(RadioDuration::from_ticks(-timing.superframe.ticks()));
            assert_eq!(course.request_place_at(before), Some(place));
            assert_ne!(course.request_place_at(at(timing.request_slot.as_micros() * 3 / 5)), Some(place));
        }
        assert_eq!(course.request_place_at(start), None);
    }

    #[test]
    fn a_sync_frame_of_the_own_session_that_comes_late_was_repeated() {
        let start = RadioInstant::from_ticks(1 << 39);
        let mut course = Superframes::begin(&Network::new(1, PhyConfig::FAST), Layout::LEAST, start, Some(7));
        (0..20).for_each(|_| course.next());
        let told = |superframe, number| SyncFrame {
            superframe,
            session: Some(Session { number, epoch: 0, answer: None }),
            layout: Layout::LEAST,
            ..crate::native::blank_sync_frame()
        };
        // Slot 1 of superframe 18, two before.
        let sent = course.timing.sync_frame(1).ticks() - 2 * course.timing.superframe.ticks();
        let is_delayed = |micros: i64, sync_frame: &SyncFrame| {
            let rx_time = course.phase.at(RadioDuration::from_ticks(sent + micros * 63_898));
            course.is_delayed(RadioDuration::from_micros(10), sync_frame, rx_time)
        };
        // The guard is 3 · 100 ms · 40 ppm and 3 µs: 15 µs. Twice that, and 10 µs.
        assert_eq!([-500, 39, 41, 500].map(|micros| is_delayed(micros, &told(18, 7))), [false, false, true, true]);
        assert!(!is_delayed(500, &told(18, 8)) && !is_delayed(500, &told(21, 7)));
        // With another layout, of which superframes last as long or longer, slot 1 begins later. One that is only announced
        // is not in force yet.
        let later = Span::at_least(RadioDuration::from_micros(300));
        for (answer, countdown, expected) in
            [(later, 0, [false, true]), (Span::LONGEST, 0, [false; 2]), (Span::LONGEST, 3, [true; 2])]
        {
            let layout = Layout { answer, ..Layout::LEAST };
            let other = SyncFrame { layout, layout_is_new: true, countdown, ..told(18, 7) };
            assert_eq!([100, 500].map(|micros| is_delayed(micros, &other)), expected, "{countdown}");
        }
        assert!(!is_delayed(500, &SyncFrame { session: None, ..told(18, 7) }));
        // Of 4.1 s ago, whatever the time.
        (0..31).for_each(|_| course.next());
        assert!(course.is_delayed(RadioDuration::ZERO, &told(0, 7), start));
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
