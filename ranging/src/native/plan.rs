//! Who may range when: a network's list of members, and the plan of round slots that follows from the list.
//!
//! Sync frames carry the list. Every node computes the same plan from it, so no slot needs to be announced. A changed
//! list is in force from a superframe that is late enough for every node to have received the list. Until then the
//! former list is in force.

use heapless::Vec;

use super::timing::{MAX_ROUND_SLOTS, Timing};
use crate::RadioDuration;
use wire::serial_number::SerialNumber;
use wire::uwb::layout::Layout;
use wire::uwb::native::{MAX_MEMBERS, Member, Share, SyncFrame};

/// A changed list is in force this many superframes after its first announcement.
pub const NOTICE_SUPERFRAMES: u8 = 4;
/// A list that is behind by at most this many versions is late: a relay sent it that has not received the newest. A
/// relay that receives nothing takes over sooner than the list can change so often. Any other list is newer.
const LATE_VERSIONS: u8 = 16;

/// How often a node ranges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Rate {
    /// A fair share of all slots: a lone member uses all of them.
    Greedy,
    /// At least once in this time, as long as there are enough slots.
    Every(RadioDuration),
}

/// Members by address, each once.
pub type Members = Vec<Member, MAX_MEMBERS>;

/// The list of members, and the layout of the slots, as a node knows them.
#[derive(Clone, Debug, PartialEq)]
pub struct Membership {
    /// Number of the list.
    version: u8,
    /// The newest list …
    members: Members,
    /// … and its layout.
    layout: Layout,
    /// The former list and its layout, as long as they are in force; `None` also if they are unknown.
    former: Option<(Members, Layout)>,
    /// Superframes until the newest list is in force.
    countdown: u8,
}

impl Membership {
    /// No members yet, with this layout.
    pub const fn new(layout: Layout) -> Self {
        Self { version: 0, members: Members::new(), layout, former: None, countdown: 0 }
    }

    /// What a node without any knowledge learns from a sync frame.
    pub fn from_sync_frame(sync_frame: &SyncFrame) -> Self {
        Self {
            version: sync_frame.version,
            members: sync_frame.members.clone(),
            layout: sync_frame.layout,
            former: None,
            countdown: sync_frame.countdown.min(NOTICE_SUPERFRAMES),
        }
    }

    /// Number of the newest list.
    pub const fn version(&self) -> u8 {
        self.version
    }

    /// The newest list.
    pub const fn members(&self) -> &Members {
        &self.members
    }

    /// The layout of the newest list.
    pub const fn layout(&self) -> Layout {
        self.layout
    }

    /// Superframes until the newest list is in force.
    pub const fn countdown(&self) -> u8 {
        self.countdown
    }

    /// The list in force, if known.
    pub fn in_force(&self) -> Option<&Members> {
        if self.countdown == 0 { Some(&self.members) } else { self.former.as_ref().map(|(members, _)| members) }
    }

    /// The list that is in force and stays in force, as far as is known: no change has been announced.
    pub fn settled(&self) -> Option<&Members> {
        (self.countdown == 0).then_some(&self.members)
    }

    /// The layout in force. No node joins a network in the middle of a change of its layout.
    pub fn layout_in_force(&self) -> Layout {
        self.former.as_ref().filter(|_| self.countdown > 0).map_or(self.layout, |(_, layout)| *layout)
    }

    /// Whether the layout changes when the newest list comes into force.
    pub fn changes_layout(&self) -> bool {
        self.layout_in_force() != self.layout
    }

    /// A superframe has begun.
    pub fn advance(&mut self) {
        self.countdown = self.countdown.saturating_sub(1);
        if self.countdown == 0 {
            self.former = None;
        }
    }

    /// Takes the contents of a sync frame of the followed coordinator, if they are newer.
    pub fn receive(&mut self, sync_frame: &SyncFrame) {
        if !SerialNumber(sync_frame.version).is_within(LATE_VERSIONS, self.version) {
            self.adopt(sync_frame);
        }
    }

    /// Takes the contents of the first sync frame of another coordinator, unless they are the same. Its versions do not
    /// continue those of the coordinator before it: it may have missed the newest list when it took over.
    pub fn adopt(&mut self, sync_frame: &SyncFrame) {
        let SyncFrame { version, members, layout, .. } = sync_frame;
        if (version, members, layout) != (&self.version, &self.members, &self.layout) {
            self.replace(*version, sync_frame.countdown.min(NOTICE_SUPERFRAMES), members, *layout);
        }
    }

    fn replace(&mut self, version: u8, countdown: u8, members: &Members, layout: Layout) {
        let former = self.in_force().cloned().map(|former| (former, self.layout_in_force()));
        *self = Self { version, members: members.clone(), layout, former: former.filter(|_| countdown > 0), countdown };
    }

    /// The coordinator changes list or layout: with notice, but at once if there was no member whose slots could be
    /// taken.
    pub fn change(&mut self, members: &Members, layout: Layout) {
        let nobody_is_affected = self.members.is_empty() && layout == self.layout;
        let notice = if nobody_is_affected { 0 } else { NOTICE_SUPERFRAMES };
        self.replace(self.version.wrapping_add(1), notice, members, layout);
    }
}

/// Whether a tag is in a list.
pub fn lists(members: &Members, tag: u16) -> bool {
    members.iter().any(|member| member.tag == tag)
}

/// The round slots that `tag` owns in a superframe: bit i for slot i.
///
/// Slots are dealt in turn to the members that need one more, beginning with another member in each superframe. If
/// fewer are needed than there are, they are spread evenly over the superframe. All nodes compute the same result from
/// a list and a number.
pub fn owned_slots(members: &Members, tag: u16, superframe: u16, slots: u8) -> u64 {
    let slots = slots.min(MAX_ROUND_SLOTS as u8);
    let mut wanted: Vec<(u16, u8), MAX_MEMBERS> = Vec::new();
    for (place, member) in members.iter().enumerate() {
        let slots = match member.share {
            Share::Release => 0,
            Share::Slots(n) => n,
            Share::Greedy => u8::MAX,
            Share::OneIn(n) => u8::from(superframe.wrapping_add(place as u16).is_multiple_of(u16::from(n))),
        };
        if slots > 0 {
            // As many places as members: it fits.
            let _ = wanted.push((member.tag, slots));
        }
    }
    let demand: u16 = wanted.iter().map(|&(_, slots)| u16::from(slots)).sum();
    let dealt = demand.min(slots.into());
    let mut owned = 0;
    let mut turn = if wanted.is_empty() { 0 } else { usize::from(superframe) % wanted.len() };
    for deal in 0..dealt {
        // As long as fewer slots are dealt than are needed, some member needs one.
        while let Some((_, 0)) = wanted.get(turn) {
            turn = (turn + 1) % wanted.len();
        }
        let Some((owner, wants)) = wanted.get_mut(turn) else { break };
        *wants -= 1;
        if *owner == tag {
            owned |= 1 << (u32::from(deal) * u32::from(slots) / u32::from(dealt));
        }
        turn = (turn + 1) % wanted.len();
    }
    owned
}

/// From the superframe's beginning to the first pulse of the next round. The round asks `anchors` anchors, fits into
/// owned slots and begins no sooner than `earliest`. The node's clock may be off by `uncertainty` in addition to the
/// guard.
pub fn next_round(
    owned: u64,
    timing: &Timing,
    earliest: RadioDuration,
    anchors: usize,
    uncertainty: RadioDuration,
) -> Option<RadioDuration> {
    let half_guard = timing.guard.ticks() / 2 + uncertainty.ticks();
    let length = timing.round(anchors).ticks() + half_guard;
    runs(owned).find_map(|(begin, end)| {
        let pulse = earliest.ticks().max(timing.round_slot_begin(begin).ticks() + half_guard);
        (pulse + length <= timing.round_slot_begin(end).ticks()).then_some(RadioDuration::from_ticks(pulse))
    })
}

/// Runs of set bits: (first, one past the last).
fn runs(bits: u64) -> impl Iterator<Item = (usize, usize)> {
    let mut from = 0;
    core::iter::from_fn(move || {
        let rest = bits.checked_shr(from)?;
        if rest == 0 {
            return None;
        }
        let begin = from + rest.trailing_zeros();
        let end = begin + (bits >> begin).trailing_ones();
        from = end;
        Some((begin as usize, end as usize))
    })
}

/// The share of each superframe that a rate needs.
pub fn share_of(rate: Rate, timing: &Timing) -> Share {
    match rate {
        Rate::Greedy => Share::Greedy,
        Rate::Every(period) => {
            let (period, superframe) = (period.ticks().max(1), timing.superframe.ticks());
            // At least as often as requested: slots rounded up, superframes down.
            match (period / superframe).min(127) as u8 {
                0 | 1 => Share::Slots(((superframe + period - 1) / period).min(126) as u8),
                superframes => Share::OneIn(superframes),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::uwb::layout::Span;

    fn list(shares: &[Share]) -> Members {
        shares.iter().enumerate().map(|(tag, &share)| Member { tag: tag as u16, share }).collect()
    }

    fn plan(members: &Members, superframe: u16, slots: u8) -> std::vec::Vec<u64> {
        members.iter().map(|member| owned_slots(members, member.tag, superframe, slots)).collect()
    }

    #[test]
    fn a_lone_greedy_tag_owns_every_slot() {
        assert_eq!(plan(&list(&[Share::Greedy]), 5, 37), [(1 << 37) - 1]);
        assert_eq!(plan(&list(&[Share::Greedy]), 5, 64), [u64::MAX]);
        assert_eq!(plan(&list(&[Share::Greedy]), 5, 0), [0]);
    }

    #[test]
    fn no_slot_has_two_owners_and_none_is_lost() {
        for slots in [1, 5, 37, 64] {
            for tags in 1..=MAX_MEMBERS {
                let members = list(&std::vec![Share::Greedy; tags]);
                for superframe in [0, 1, 1000, u16::MAX] {
                    let mut all = 0u64;
                    for owned in plan(&members, superframe, slots) {
                        assert_eq!(all & owned, 0, "{tags} tags, {slots} slots, superframe {superframe}");
                        all |= owned;
                    }
                    assert_eq!(all.count_ones(), u32::from(slots));
                }
            }
        }
    }

    #[test]
    fn shares_are_fair_over_superframes() {
        // 15 tags, 37 slots: 37 / 15 = 2.47 a superframe; over 150 superframes, 370 slots each.
        let members = list(&[Share::Greedy; 15]);
        let mut counts = [0u32; 15];
        for superframe in 0..150 {
            for (count, owned) in counts.iter_mut().zip(plan(&members, superframe, 37)) {
                *count += owned.count_ones();
            }
        }
        assert_eq!(counts, [370; 15]);
        // 24 tags, 10 slots: every tag gets slots, 10 / 24 a superframe.
        let members = list(&[Share::Greedy; 24]);
        let mut counts = [0u32; 24];
        for superframe in 0..240 {
            for (count, owned) in counts.iter_mut().zip(plan(&members, superframe, 10)) {
                *count += owned.count_ones();
            }
        }
        assert_eq!(counts, [100; 24]);
    }

    #[test]
    fn modest_tags_get_what_they_ask_for_and_greedy_ones_the_rest() {
        let members = list(&[Share::Slots(2), Share::Greedy, Share::OneIn(4), Share::Release]);
        let mut counts = [0u32; 4];
        for superframe in 0..40 {
            for (count, owned) in counts.iter_mut().zip(plan(&members, superframe, 37)) {
                *count += owned.count_ones();
            }
        }
        assert_eq!(counts, [80, 40 * 37 - 80 - 10, 10, 0]);
    }

    #[test]
    fn wanted_slots_lie_evenly() {
        // Two of 36: slots 0 and 18.
        assert_eq!(plan(&list(&[Share::Slots(2)]), 0, 36), [1 | 1 << 18]);
    }

    #[test]
    fn a_changed_list_counts_after_its_notice() {
        let mut membership = Membership::new(Layout::LEAST);
        let [old, new] = [list(&[Share::Greedy]), list(&[Share::Greedy, Share::Slots(1)])];
        membership.change(&old, Layout::LEAST);
        assert_eq!(membership.in_force(), Some(&old), "nobody's slots were taken");
        membership.change(&new, Layout::LEAST);
        assert_eq!((membership.in_force(), membership.countdown()), (Some(&old), 4));
        (0..3).for_each(|_| membership.advance());
        assert_eq!(membership.in_force(), Some(&old));
        membership.advance();
        assert_eq!(membership.in_force(), Some(&new));
    }

    #[test]
    fn a_changed_layout_counts_after_its_notice_even_where_there_are_no_members() {
        let wide = Layout { answer: Span::LONGEST, ..Layout::LEAST };
        let mut membership = Membership::new(Layout::LEAST);
        membership.change(&Members::new(), wide);
        assert_eq!((membership.layout_in_force(), membership.layout()), (Layout::LEAST, wide));
        assert!(membership.changes_layout());
        (0..NOTICE_SUPERFRAMES).for_each(|_| membership.advance());
        assert_eq!(membership.layout_in_force(), wide);
        assert!(!membership.changes_layout());
    }

    #[test]
    fn a_list_is_late_if_it_is_a_few_versions_behind_and_newer_at_any_other_distance() {
        let [known, told] = [list(&[Share::Greedy]), list(&[Share::Slots(1)])];
        let sync_frame = |version, members: &Members| SyncFrame {
            version,
            members: members.clone(),
            ..crate::native::blank_sync_frame()
        };
        for (at, behind) in [0, 7, 128, 255].into_iter().flat_map(|at| (0..=u8::MAX).map(move |behind| (at, behind))) {
            let mut membership = Membership::from_sync_frame(&sync_frame(at, &known));
            membership.receive(&sync_frame(at.wrapping_sub(behind), &told));
            let expected = if behind <= 16 { &known } else { &told };
            assert_eq!(membership.members(), expected, "{behind} behind {at}");
        }
    }

    #[test]
    fn a_newcomer_knows_the_new_list_and_not_the_one_that_counts() {
        let [old, new] = [list(&[Share::Greedy]), list(&[Share::Greedy, Share::Slots(1)])];
        let sync_frame = |version, countdown, members: &Members| SyncFrame {
            version,
            countdown,
            members: members.clone(),
            ..crate::native::blank_sync_frame()
        };
        let mut newcomer = Membership::from_sync_frame(&sync_frame(2, 3, &new));
        assert_eq!(newcomer.in_force(), None);
        (0..3).for_each(|_| newcomer.advance());
        assert_eq!(newcomer.in_force(), Some(&new));
        // An older list that another anchor still relays changes nothing.
        newcomer.receive(&sync_frame(1, 0, &old));
        assert_eq!(newcomer.members(), &new);
    }
}
