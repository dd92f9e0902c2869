//! What nodes request of the layout, collected over the last superframes. The coordinator sets the slot lengths by
//! these requests; other anchors pass them on.

use heapless::Vec;

use super::plan::{Members, lists};
use wire::uwb::layout::Layout;
use wire::uwb::native::MAX_MEMBERS;

/// Requests of anchors, and of a new network's tags, are kept for one to two times this many superframes, because anchors
/// repeat them in their sync frames. Requests of members are kept until the members request something else, or leave.
const KEPT_SUPERFRAMES: u16 = 10;
/// From this superframe of a network, or of an anchor's coordination, on, it is settled: all nodes were received, the
/// layout may become shorter, and only members request a longer one.
const SETTLED_AFTER: u16 = 5;
/// In this many periods of [`KEPT_SUPERFRAMES`], in which nodes make their first rounds, a layout becomes shorter by any step.
const MEASURED_AFTER: u8 = 5;
/// The coordinator makes relay slots after requests in this many periods of [`KEPT_SUPERFRAMES`] in a row: a way that is lost
/// for a second is no reason. Two periods without a request end them.
const ASKED_FOR: u8 = 4;
/// A layout that follows from requests becomes shorter only if it exceeds the requests by more than this many steps (of
/// 3 to 6 % each). Otherwise every small variation would change it.
const SPARE_STEPS: u8 = 3;

/// The longest recent requests.
#[derive(Clone, Debug)]
pub struct LayoutRequests {
    /// Tags that are members, and the byte of their last request.
    members: Vec<(u16, u8), MAX_MEMBERS>,
    current: Layout,
    former: Layout,
    /// Relay slots are requested: in this period, and in the one before.
    relay_slots: [bool; 2],
    /// In how many periods in a row they were.
    asked_for: u8,
    needs_relay_slots: bool,
    /// Superframes in which `current` was collected.
    superframes: u16,
    /// Every node has had time to send its request.
    is_settled: bool,
    /// Periods that have ended, at most [`MEASURED_AFTER`].
    periods: u8,
    /// The layout was shortened to such requests before. Until then it is what nodes assumed.
    is_measured: bool,
}

impl LayoutRequests {
    /// No request yet.
    pub const fn new() -> Self {
        Self {
            members: Vec::new(),
            current: Layout::LEAST,
            former: Layout::LEAST,
            relay_slots: [false; 2],
            asked_for: 0,
            needs_relay_slots: false,
            superframes: 0,
            is_settled: false,
            periods: 0,
            is_measured: false,
        }
    }

    /// A node requests this.
    pub fn note(&mut self, wish: Layout) {
        self.current = self.current.max(wish);
    }

    /// An anchor has more to pass on than fits into its sync frames.
    pub fn note_relay_slots(&mut self) {
        self.relay_slots[0] = true;
    }

    /// Whether an anchor has asked for relay slots lately.
    pub fn wants_relay_slots(&self) -> bool {
        self.relay_slots != [false; 2]
    }

    /// A tag requests this, in place of its earlier request. Tags that are not members count only in a new network.
    /// After that they would make the tags of a site slow at no cost: anybody can send a tag's request.
    pub fn note_tag(&mut self, tag: u16, wish: Layout, members: &Members) {
        if !lists(members, tag) {
            if !self.is_settled {
                self.note(wish);
            }
            return;
        }
        match self.members.iter_mut().find(|(known, _)| *known == tag) {
            Some((_, byte)) => *byte = wish.tag_byte(),
            None => {
                if self.members.is_full() {
                    self.members.retain(|(known, _)| lists(members, *known));
                }
                // There are no more members than places.
                let _ = self.members.push((tag, wish.tag_byte()));
            }
        }
    }

    /// These are the members now.
    pub fn keep(&mut self, members: &Members) {
        self.members.retain(|(tag, _)| lists(members, *tag));
    }

    /// `superframes` have begun.
    pub fn advance(&mut self, superframes: u16) {
        self.superframes = self.superframes.saturating_add(superframes);
        self.is_settled |= self.superframes >= SETTLED_AFTER;
        if self.superframes >= KEPT_SUPERFRAMES {
            (self.former, self.current) = (self.current, Layout::LEAST);
            let [now, before] = self.relay_slots;
            self.asked_for = if now { self.asked_for.saturating_add(1) } else { 0 };
            self.needs_relay_slots = self.asked_for >= ASKED_FOR || self.needs_relay_slots && (now || before);
            self.relay_slots = [false, now];
            self.superframes = 0;
            self.periods = (self.periods + 1).min(MEASURED_AFTER);
        }
    }

    /// The layout was changed to the requests.
    pub fn adopted(&mut self) {
        self.is_measured |= self.periods == MEASURED_AFTER;
    }

    /// The layout that serves all requests.
    pub fn all(&self) -> Layout {
        let of_members = self.members.iter().map(|(_, byte)| Layout::from_tag_byte(*byte));
        of_members.fold(self.current.max(self.former), Layout::max)
    }

    /// Whether the coordinator is to make relay slots.
    pub fn needs_relay_slots(&self) -> bool {
        self.needs_relay_slots
    }

    /// Whether anything is requested.
    pub fn has_any(&self) -> bool {
        self.all() != Layout::LEAST || self.wants_relay_slots()
    }

    /// The layout to change to, if the one in force is too short for a request, or much longer than needed.
    pub fn better_than(&self, layout: Layout) -> Option<Layout> {
        let all = self.all();
        if all.max(layout) != layout {
            return Some(all.max(layout));
        }
        if all == Layout::LEAST {
            return None;
        }
        let spare = if self.is_measured { SPARE_STEPS } else { 0 };
        let is_far = |now: super::Span, asked: super::Span| now.code().saturating_sub(asked.code()) > spare;
        let is_longer = is_far(layout.answer, all.answer)
            || is_far(layout.listen_again, all.listen_again)
            || layout.scheme != all.scheme;
        // No node has measured this span yet: it stays.
        let or_stay = |asked: super::Span, now: super::Span| if asked == super::Span::default() { now } else { asked };
        let shorter = Layout {
            answer: or_stay(all.answer, layout.answer),
            listen_again: or_stay(all.listen_again, layout.listen_again),
            ..all
        };
        (self.is_settled && is_longer && shorter != layout).then_some(shorter)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Scheme, Span};
    use super::*;
    use crate::RadioDuration;
    use wire::uwb::native::{Member, Share};

    fn layout(answer_us: u32) -> Layout {
        let span = |micros| Span::at_least(RadioDuration::from_micros(micros));
        Layout { answer: span(answer_us), listen_again: span(64), scheme: Scheme::SingleSided }
    }

    #[test]
    fn relay_slots_come_after_requests_in_four_times_and_stay_for_two_after_the_last() {
        let mut wishes = LayoutRequests::new();
        assert!(!wishes.wants_relay_slots() && !wishes.has_any());
        wishes.note_relay_slots();
        for _ in 0..2 {
            assert!(wishes.wants_relay_slots() && wishes.has_any() && !wishes.needs_relay_slots());
            wishes.advance(KEPT_SUPERFRAMES);
        }
        assert!(!wishes.wants_relay_slots());
        let mut after = |asks: bool| {
            if asks {
                wishes.note_relay_slots();
            }
            wishes.advance(KEPT_SUPERFRAMES);
            wishes.needs_relay_slots()
        };
        let asked = [true, true, true, false, true, true, true, true, false, true, false, false, true];
        let needed = [false, false, false, false, false, false, false, true, true, true, true, false, false];
        assert_eq!(asked.map(&mut after), needed);
    }

    #[test]
    fn a_slower_node_counts_at_once_and_one_that_left_after_two_periods_at_most() {
        let mut wishes = LayoutRequests::new();
        wishes.note(layout(300));
        assert_eq!(wishes.better_than(layout(300)), None);
        wishes.note(layout(900));
        assert_eq!(wishes.better_than(layout(300)), Some(layout(900)));
        for _ in 0..2 {
            assert_eq!(wishes.better_than(layout(900)), None);
            wishes.advance(KEPT_SUPERFRAMES);
            wishes.note(layout(300));
        }
        assert_eq!(wishes.better_than(layout(900)), Some(layout(300)));
    }

    #[test]
    fn what_a_founder_began_with_is_made_shorter_once_all_had_time_to_ask() {
        let mut wishes = LayoutRequests::new();
        wishes.advance(SETTLED_AFTER - 1);
        wishes.note(layout(300));
        assert_eq!(wishes.better_than(layout(900)), None);
        wishes.advance(1);
        assert_eq!(wishes.better_than(layout(900)), Some(layout(300)));
        // Only nodes that have measured send requests.
        let mut silent = LayoutRequests::new();
        silent.advance(SETTLED_AFTER);
        assert_eq!(silent.better_than(layout(900)), None);
        silent.note(Layout { answer: Span::default(), ..layout(300) });
        assert_eq!(silent.better_than(layout(900)), None);
    }

    #[test]
    fn a_member_that_ranges_seldom_is_not_forgotten_until_it_leaves() {
        let member = |tag| Member { tag, share: Share::Slots(2) };
        let members: Members = [member(1), member(2)].into_iter().collect();
        let mut wishes = LayoutRequests::new();
        wishes.note_tag(2, layout(0), &members);
        wishes.note_tag(3, layout(300), &members);
        wishes.note_tag(2, Layout { scheme: Scheme::DoubleSided, ..layout(0) }, &members);
        for _ in 0..30 {
            wishes.advance(KEPT_SUPERFRAMES);
        }
        // Tags request no answer time.
        assert_eq!(wishes.all(), Layout { scheme: Scheme::DoubleSided, answer: Span::default(), ..layout(0) });
        wishes.keep(&[member(1)].into_iter().collect());
        assert_eq!(wishes.all(), Layout::LEAST);
    }

    #[test]
    fn a_layout_a_little_too_long_stays() {
        let mut wishes = LayoutRequests::new();
        for _ in 0..MEASURED_AFTER {
            wishes.note(layout(300));
            wishes.advance(KEPT_SUPERFRAMES);
        }
        // What a founder assumed is not measured: no step of it is spare.
        assert_eq!(wishes.better_than(layout(320)), Some(layout(300)));
        wishes.adopted();
        // 304 µs = 19 · 16 serve 300; 352 = 22 · 16 are three steps more, 368 four.
        assert_eq!(wishes.better_than(layout(352)), None);
        assert_eq!(wishes.better_than(layout(368)), Some(layout(300)));
    }

    #[test]
    fn a_founder_s_first_guess_does_not_stay_because_it_is_near() {
        let mut wishes = LayoutRequests::new();
        wishes.note(layout(352));
        wishes.advance(SETTLED_AFTER);
        wishes.note(layout(300));
        wishes.advance(SETTLED_AFTER);
        // The guess and what was measured, of one period: the network changes to the guess.
        assert_eq!(wishes.better_than(layout(608)), Some(layout(352)));
        wishes.adopted();
        let pass = |wishes: &mut LayoutRequests, periods: u8| {
            (0..periods).for_each(|_| {
                wishes.note(layout(300));
                wishes.advance(KEPT_SUPERFRAMES);
            });
        };
        pass(&mut wishes, MEASURED_AFTER - 2);
        assert_eq!(wishes.better_than(layout(352)), Some(layout(300)));
        wishes.adopted();
        assert_eq!(wishes.better_than(layout(320)), Some(layout(300)), "still in the first periods");
        pass(&mut wishes, 1);
        wishes.adopted();
        assert_eq!(wishes.better_than(layout(352)), None);
    }

    #[test]
    fn a_final_is_made_room_for_as_long_as_somebody_asks_for_it() {
        let double = Layout { scheme: Scheme::DoubleSided, ..layout(300) };
        let mut wishes = LayoutRequests::new();
        wishes.note(double);
        assert_eq!(wishes.better_than(layout(300)), Some(double));
        (0..2).for_each(|_| {
            wishes.advance(KEPT_SUPERFRAMES);
            wishes.note(layout(300));
        });
        assert_eq!(wishes.better_than(double), Some(layout(300)));
    }
}
