//! How a tag follows a network: the time, the coordinator, and who may range when.

use core::cmp::Ordering;

use super::authentication::Moment;
use super::election::{Choice, Election};
use super::plan::Plan;
use super::superframes::Superframes;
use super::timing::{HOLDOVER_SUPERFRAMES, Network};
use crate::{RadioDuration, RadioInstant};
use wire::serial_number::SerialNumber;
use wire::uwb::native::SyncFrame;

/// The followed network.
#[derive(Clone, Debug)]
pub struct Sync {
    /// The time of the network, and the list and layout in force.
    pub course: Superframes,
    /// The coordinator.
    pub election: Election,
    /// The instant since which the phase is unknown, after a doze. The next sync frame gives the phase.
    pub adrift: Option<RadioInstant>,
    /// The possible error of the phase, after naps, until the next sync frame.
    pub uncertainty: RadioDuration,
    /// Sleeps to a next turn since the last received sync frame.
    pub held: u8,
    /// The superframe of the last received sync frame.
    heard: u16,
    /// The same in a session. Sync frames from before are recorded ones.
    newest: u32,
    /// Superframes in a session of which nothing proves that it is there; `None`: something does.
    unproven: Option<u16>,
}

/// A session that has proved nothing for this many superframes is left for another one.
const UNPROVEN: u16 = 20;

/// The effect of a sync frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SyncUpdate {
    /// None: its network does not prevail, or it is a repetition.
    Ignored,
    /// None: its coordinator prevails, but the followed one is still received.
    Refused,
    /// The network is followed as before.
    Followed,
    /// The same, but the list contradicts what was received before.
    Contradicted,
    /// The network has another coordinator now.
    Changed,
    /// Another network is followed, or the same with another time: everything is new.
    Anew,
}

impl SyncUpdate {
    /// Whether another coordinator or network is followed now.
    pub const fn is_another(self) -> bool {
        matches!(self, Self::Changed | Self::Anew)
    }
}

impl Sync {
    /// The network of this sync frame; `None` in the middle of a change of its layout.
    pub fn new(network: &Network, sync_frame: &SyncFrame, rx_time: RadioInstant) -> Option<Self> {
        Superframes::of_sync_frame(network, sync_frame, rx_time).map(|course| Self::in_course(course, sync_frame))
    }

    fn in_course(course: Superframes, sync_frame: &SyncFrame) -> Self {
        let (heard, election) = (course.phase.number, Election::joined(sync_frame));
        let newest = course.moment().map_or(0, |moment| moment.superframe);
        let uncertainty = RadioDuration::ZERO;
        Self { course, election, adrift: None, uncertainty, held: 0, heard, newest, unproven: Some(0) }
    }

    /// This node awaits its turn, which will prove the session or not.
    pub fn wait_for_proof(&mut self) {
        self.unproven = self.unproven.map(|_| 0);
    }

    /// An anchor has answered a poll of this node: the session is no recorded one.
    pub fn prove(&mut self) {
        self.unproven = None;
    }

    /// A sync frame was received.
    pub fn receive(&mut self, network: &Network, sync_frame: &SyncFrame, rx_time: RadioInstant) -> SyncUpdate {
        let told = Moment::of_sync_frame(sync_frame);
        if told.is_some_and(|told| Some(told.session) != self.course.session) {
            return self.leave_session(network, sync_frame, rx_time);
        }
        let newest = told.map_or(0, |told| told.superframe);
        // After a doze the next one is of a later superframe.
        let is_old = newest < self.newest || newest == self.newest && self.adrift.is_some();
        if told.is_some() && is_old {
            return SyncUpdate::Ignored;
        }
        let is_the_same = (sync_frame.term, sync_frame.coordinator) == (self.election.term, self.election.coordinator);
        if self.adrift.is_none() {
            self.advance(rx_time);
            let in_step = self.course.in_step_within(self.uncertainty, sync_frame, rx_time);
            let is_lost = self.silent() > HOLDOVER_SUPERFRAMES;
            // One that comes late for seconds, and alone, is no recorded one.
            if self.silent() <= UNPROVEN && self.course.is_delayed(self.uncertainty, sync_frame, rx_time) {
                return SyncUpdate::Ignored;
            }
            // A sync frame of the network that was repeated later gives no information about its coordinator.
            let choice = match in_step {
                None if is_the_same => Choice::Older,
                None | Some(_) => self.election.receive(sync_frame, false, Ordering::Equal),
            };
            match (choice, in_step) {
                (Choice::Same | Choice::Change, Some(phase)) => {
                    let followed = self.election.coordinator;
                    self.course.phase = phase;
                    (self.heard, self.newest, self.uncertainty, self.held) =
                        (phase.number, newest, RadioDuration::ZERO, 0);
                    if choice == Choice::Change {
                        self.election.follow(sync_frame);
                        self.course.membership.adopt(sync_frame);
                    }
                    let agrees = self.course.membership.receive(sync_frame);
                    return match sync_frame.coordinator == followed {
                        true if agrees => SyncUpdate::Followed,
                        true => SyncUpdate::Contradicted,
                        false => SyncUpdate::Changed,
                    };
                }
                (Choice::Same | Choice::Older, _) if !is_lost => return SyncUpdate::Ignored,
                (Choice::Refused, _) if !is_lost => return SyncUpdate::Refused,
                (Choice::Change, None) | (Choice::Same | Choice::Older | Choice::Refused, _) => {}
            }
        }
        let is_as_before = self.adrift.is_some() && is_the_same;
        let noticed = || self.course.of_notice(sync_frame, rx_time).filter(|_| is_as_before);
        let anew = Self::new(network, sync_frame, rx_time);
        let Some(anew) = anew.or_else(|| noticed().map(|course| Self::in_course(course, sync_frame))) else {
            return SyncUpdate::Ignored;
        };
        *self = Self { unproven: self.unproven, ..anew };
        if is_as_before { SyncUpdate::Followed } else { SyncUpdate::Anew }
    }

    /// Whether the session may be a recorded one: it has proved nothing for long.
    pub fn is_doubtful(&self) -> bool {
        self.course.session.is_some() && self.unproven.is_some_and(|unproven| unproven > UNPROVEN)
    }

    /// A sync frame of another session was received. It is followed if the own one is silent or has never answered.
    fn leave_session(&mut self, network: &Network, sync_frame: &SyncFrame, rx_time: RadioInstant) -> SyncUpdate {
        if self.adrift.is_none() {
            self.advance(rx_time);
        }
        let may_leave = self.silent() > HOLDOVER_SUPERFRAMES || self.is_doubtful();
        match Self::new(network, sync_frame, rx_time).filter(|_| may_leave) {
            Some(anew) => {
                *self = anew;
                SyncUpdate::Anew
            }
            None => SyncUpdate::Ignored,
        }
    }

    /// Advances to the superframe that contains `now`. Returns the number of superframes begun since.
    pub fn advance(&mut self, now: RadioInstant) -> u16 {
        let begun = self.course.advance(now);
        if begun > 0 {
            self.election.advance(begun);
            self.unproven = self.unproven.map(|unproven| unproven.saturating_add(begun));
        }
        begun
    }

    /// Whether the node was halted and has lost the time. In a doze the superframe of the next turn lies ahead.
    pub fn has_lost_time(&self, now: RadioInstant) -> bool {
        self.adrift.is_none() && self.course.is_beyond(now)
    }

    /// Advances by `superframes`, which the tag sleeps through. From here on the clock counts from the last of them.
    /// They count as one superframe without a received sync frame.
    pub fn hold_over(&mut self, superframes: u16) {
        (0..superframes).for_each(|_| self.course.next());
        self.election.advance(superframes);
        self.heard = self.course.phase.number.wrapping_sub(1);
        self.held = self.held.saturating_add(1);
    }

    /// The same, but afterwards the phase is unknown.
    pub fn doze(&mut self, superframes: u16, present: RadioInstant) {
        self.hold_over(superframes);
        self.adrift = Some(present);
    }

    /// Superframes since the last received sync frame. Who misses them for long does not follow for a whole turn.
    pub fn silent(&self) -> u16 {
        SerialNumber(self.course.phase.number).steps_from(self.heard)
    }

    /// The radio's clock was restarted: the former instant `before` is now `now`.
    pub fn rebase(&mut self, before: RadioInstant, now: RadioInstant) {
        let passed = self.course.phase.start.since(before);
        self.course.phase.start = now.plus(passed);
    }

    /// The plan in force in this superframe, unless it may have changed without the tag receiving the change.
    pub fn plan(&self) -> Option<&Plan> {
        self.course.membership.in_force().filter(|_| self.silent() <= HOLDOVER_SUPERFRAMES)
    }
}

#[cfg(test)]
mod tests {
    use super::super::plan::Members;
    use super::super::timing::Timing;
    use super::*;
    use wire::uwb::layout::{Layout, Span};
    use wire::uwb::native::{Member, Share};

    const NETWORK: Network = Network::new(1, crate::PhyConfig::FAST);
    const SLOT: u8 = 2;
    /// Superframes until a new layout is in force.
    const NOTICE: u8 = 3;

    fn layout(answer_us: u32) -> Layout {
        Layout { answer: Span::at_least(RadioDuration::from_micros(answer_us)), ..Layout::LEAST }
    }

    /// The sync frame of slot 2 in this superframe, of coordinator 1.
    fn sync_frame(superframe: u16, version: u8, layout: Layout, countdown: u8) -> SyncFrame {
        let (slot, layout_is_new) = (SLOT, countdown > 0);
        SyncFrame { superframe, slot, version, layout, countdown, layout_is_new, ..crate::native::blank_sync_frame() }
    }

    /// A tag that has followed since superframe 10, with a layout for answers of 600 µs, and then dozed; and the
    /// beginning of that superframe.
    fn dozing() -> (Sync, RadioInstant) {
        let start = RadioInstant::from_ticks(5_000_000_000);
        let heard = start.plus(Timing::of(&NETWORK, layout(600)).sync_frame(SLOT.into()));
        let mut sync = Sync::new(&NETWORK, &sync_frame(10, 7, layout(600), 0), heard).expect("nothing changes");
        sync.adrift = Some(heard);
        (sync, start)
    }

    /// Arrival of the same slot in superframe 20, at a clock that became wrong by half a millisecond in between.
    fn heard_late(start: RadioInstant) -> RadioInstant {
        let timing = Timing::of(&NETWORK, layout(600));
        let ten = RadioDuration::from_ticks(10 * timing.superframe.ticks());
        start.plus(ten).plus(timing.sync_frame(SLOT.into())).plus(RadioDuration::from_micros(500))
    }

    #[test]
    fn who_wakes_in_the_middle_of_a_change_of_layout_keeps_step_by_the_former_one() {
        let (mut sync, start) = dozing();
        let rx_time = heard_late(start);
        assert_eq!(sync.receive(&NETWORK, &sync_frame(20, 8, layout(300), NOTICE), rx_time), SyncUpdate::Followed);
        assert_eq!((sync.adrift, sync.course.phase.number), (None, 20));
        let (former, new) = (Timing::of(&NETWORK, layout(600)), Timing::of(&NETWORK, layout(300)));
        assert_eq!(sync.course.timing, former);
        assert_eq!(sync.course.phase.at(former.sync_frame(SLOT.into())), rx_time);
        // The new layout is in force from the third superframe on, which begins where the former layout's third one
        // ends.
        let third = RadioDuration::from_ticks(i64::from(NOTICE) * former.superframe.ticks());
        let begin = sync.course.phase.start.plus(third);
        sync.advance(begin);
        assert_eq!((sync.course.timing, sync.course.phase.start), (new, begin));
    }

    #[test]
    fn an_anchor_that_takes_over_with_an_older_list_is_followed_with_its_list() {
        let start = RadioInstant::from_ticks(5_000_000_000);
        let timing = Timing::of(&NETWORK, layout(600));
        let at = |superframe: i64| {
            let superframes = RadioDuration::from_ticks((superframe - 10) * timing.superframe.ticks());
            start.plus(superframes).plus(timing.sync_frame(SLOT.into()))
        };
        let mut sync = Sync::new(&NETWORK, &sync_frame(10, 8, layout(600), 0), at(10)).expect("nothing changes");
        let members: Members = [Member { tag: 7, share: Share::Greedy }].into_iter().collect();
        // Coordinator 2 has missed the change from version 7 to 8.
        let told = SyncFrame { term: 1, coordinator: 2, members: members.clone(), ..sync_frame(14, 7, layout(600), 0) };
        assert_eq!(sync.receive(&NETWORK, &told, at(14)), SyncUpdate::Changed);
        assert_eq!((sync.plan().map(|plan| &plan.members), sync.course.membership.version()), (Some(&members), 7));
    }

    #[test]
    fn who_may_have_missed_a_change_waits_for_the_end_of_this_one() {
        let (mut sync, start) = dozing();
        let rx_time = heard_late(start);
        assert_eq!(sync.receive(&NETWORK, &sync_frame(20, 9, layout(300), NOTICE), rx_time), SyncUpdate::Ignored);
        // Another coordinator's sync frame does not count as notice.
        let other = SyncFrame { coordinator: 2, ..sync_frame(20, 8, layout(300), NOTICE) };
        assert_eq!(sync.receive(&NETWORK, &other, rx_time), SyncUpdate::Ignored);
        assert!(sync.adrift.is_some());
        assert_eq!(sync.receive(&NETWORK, &sync_frame(20, 9, layout(300), 0), rx_time), SyncUpdate::Followed);
        assert_eq!(sync.course.timing, Timing::of(&NETWORK, layout(300)));
    }
}
