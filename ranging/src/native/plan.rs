//! Who may range when: how many round slots are leased, the list of members that share the others, and the layout.
//!
//! Sync frames carry this plan. Every node computes the slots of each member from it, so none of them needs to be
//! announced. A changed plan is in force from a superframe that is late enough for every node to have received it. Until
//! then the former plan is in force. Leases are not part of it ([`leases`](super::leases)).

use heapless::Vec;

use super::timing::{MAX_ROUND_SLOTS, Timing};
use crate::RadioDuration;
use wire::serial_number::SerialNumber;
use wire::uwb::layout::Layout;
use wire::uwb::native::{MAX_MEMBERS, Member, Period, Share, SyncFrame, Turns};

/// A changed list is in force this many superframes after its first announcement.
pub const NOTICE_SUPERFRAMES: u8 = 4;
/// A node that has received nothing of its list for this many superframes takes any other one: it may have missed a
/// change.
const MISSED_SUPERFRAMES: u8 = 2 * NOTICE_SUPERFRAMES;
/// A list that is not in force yet is taken back after this many more sync frames with the list in force than with the
/// new one: relays send the former list for a few superframes, the coordinator never does.
const TAKEN_BACK_AFTER: u8 = 6;

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

/// What all nodes compute the slots from.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    version: u8,
    /// The tags that share the slots that are not leased.
    pub members: Members,
    /// The slots.
    pub slots: Slots,
}

/// What the slots of a superframe are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slots {
    /// How long they are.
    pub layout: Layout,
    /// The first round slots are leased, this many.
    pub leased: u8,
    /// The last ones are relay slots ([`Timing::relay_slots`]).
    pub relays: bool,
}

impl Plan {
    fn of_sync_frame(sync_frame: &SyncFrame) -> Self {
        let SyncFrame { version, ref members, .. } = *sync_frame;
        Self { version, members: members.clone(), slots: Slots::of_sync_frame(sync_frame) }
    }

    /// Whether a sync frame tells this plan.
    fn is_in(&self, sync_frame: &SyncFrame) -> bool {
        let SyncFrame { version, members, .. } = sync_frame;
        (version, members) == (&self.version, &self.members) && Slots::of_sync_frame(sync_frame) == self.slots
    }

    /// The round slots of a member in a superframe: bit i for slot i.
    pub fn owned_slots(&self, tag: u16, superframe: u16, timing: &Timing) -> u64 {
        let Slots { leased, relays, .. } = self.slots;
        let dealt = owned_slots(&self.members, tag, superframe, timing.tag_slots(relays).saturating_sub(leased));
        dealt.checked_shl(leased.into()).unwrap_or(0)
    }
}

impl Slots {
    fn of_sync_frame(sync_frame: &SyncFrame) -> Self {
        let SyncFrame { layout, leased, has_relay_slots: relays, .. } = *sync_frame;
        Self { layout, leased, relays }
    }
}

/// The most round slots, of this many, that can be leased: an eighth is left to the list of members.
pub const fn most_leased(round_slots: u8) -> u8 {
    round_slots - round_slots.div_ceil(8)
}

/// The list of members, and the layout of the slots, as a node knows them.
///
/// Sync frames are not authenticated, so a forged list must neither stay nor keep the true ones out:
///
/// - a list is announced with its whole notice, and the next one only when it is in force: a list that would have been
///   announced before the coordinator last told the known one is refused;
/// - a list that is announced is taken back if the coordinator, or the majority of sync frames, goes on with the list in
///   force;
/// - who has received nothing of its list for long takes any other.
#[derive(Clone, Debug, PartialEq)]
pub struct Membership {
    newest: Plan,
    /// The former list, as long as it is in force; `None` also if it is unknown.
    former: Option<Plan>,
    /// Superframes until the newest list is in force.
    countdown: u8,
    /// Superframes since the coordinator told the newest list, as far as is known.
    unheard: u8,
    /// Sync frames with the former list since the newest one was announced, minus those with the newest one.
    contradicted: u8,
}

impl Membership {
    /// No members yet, with this layout.
    pub const fn new(layout: Layout) -> Self {
        Self::in_notice(
            Plan { version: 0, members: Members::new(), slots: Slots { layout, leased: 0, relays: false } },
            None,
            0,
        )
    }

    const fn in_notice(newest: Plan, former: Option<Plan>, countdown: u8) -> Self {
        Self { newest, former, countdown, unheard: 0, contradicted: 0 }
    }

    /// What a node without any knowledge learns from a sync frame.
    pub fn from_sync_frame(sync_frame: &SyncFrame) -> Self {
        Self::in_notice(Plan::of_sync_frame(sync_frame), None, sync_frame.countdown.min(NOTICE_SUPERFRAMES))
    }

    /// Number of the newest list.
    pub const fn version(&self) -> u8 {
        self.newest.version
    }

    /// The newest plan.
    pub const fn newest(&self) -> &Plan {
        &self.newest
    }

    /// The newest list.
    pub const fn members(&self) -> &Members {
        &self.newest.members
    }

    /// The layout of the newest list.
    pub const fn layout(&self) -> Layout {
        self.newest.slots.layout
    }

    /// Superframes until the newest list is in force.
    pub const fn countdown(&self) -> u8 {
        self.countdown
    }

    /// The plan in force, if known.
    pub fn in_force(&self) -> Option<&Plan> {
        if self.countdown == 0 { Some(&self.newest) } else { self.former.as_ref() }
    }

    /// The plan that is in force and stays in force, as far as is known: no change has been announced.
    pub fn settled(&self) -> Option<&Plan> {
        (self.countdown == 0).then_some(&self.newest)
    }

    /// How many slots are leased now and with the newest plan, too; `None` while the layout changes.
    pub fn leased(&self) -> Option<u8> {
        let in_force = self.in_force()?;
        let (now, next) = (in_force.slots, self.newest.slots);
        (now.layout == next.layout).then_some(now.leased.min(next.leased))
    }

    /// The layout in force. No node joins a network in the middle of a change of its layout.
    pub fn layout_in_force(&self) -> Layout {
        self.in_force().unwrap_or(&self.newest).slots.layout
    }

    /// Whether the layout changes when the newest list comes into force.
    pub fn changes_layout(&self) -> bool {
        self.layout_in_force() != self.newest.slots.layout
    }

    /// A superframe has begun.
    pub fn advance(&mut self) {
        self.countdown = self.countdown.saturating_sub(1);
        self.unheard = self.unheard.saturating_add(1);
        if self.countdown == 0 {
            self.former = None;
        }
    }

    /// Takes the contents of a sync frame of the followed coordinator, if they are newer. Returns false if they
    /// contradict what was received before.
    pub fn receive(&mut self, sync_frame: &SyncFrame) -> bool {
        if self.newest.is_in(sync_frame) {
            // What a relay tells is as old as what it knows of the coordinator.
            self.unheard = self.unheard.min(sync_frame.age);
            self.contradicted = self.contradicted.saturating_sub(1);
            return true;
        }
        if self.former.as_ref().is_some_and(|former| former.is_in(sync_frame)) {
            let is_of_the_coordinator = sync_frame.hops == 0;
            self.contradicted = if is_of_the_coordinator { TAKEN_BACK_AFTER } else { self.contradicted + 1 };
            let is_forged = self.contradicted >= TAKEN_BACK_AFTER;
            if is_forged {
                self.adopt(sync_frame);
            }
            return !is_forged;
        }
        let ahead = SerialNumber(sync_frame.version).minus(self.newest.version);
        // Each list between the known one and this one was announced for its whole notice.
        let announced = NOTICE_SUPERFRAMES.saturating_mul(ahead.max(1) as u8).saturating_sub(sync_frame.countdown);
        let is_next = ahead > 0 && self.countdown == 0 && announced <= self.unheard.saturating_add(1);
        let changes_nothing = ahead > 0 && self.newest.members.is_empty();
        let is_taken = is_next || changes_nothing || self.unheard >= MISSED_SUPERFRAMES;
        if is_taken {
            self.adopt(sync_frame);
        }
        // A relay that has not received the newest list sends the one before.
        is_taken || ahead <= 0
    }

    /// Takes the contents of the first sync frame of another coordinator, unless they are the same. Its versions do not
    /// continue those of the coordinator before it: it may have missed the newest list when it took over.
    pub fn adopt(&mut self, sync_frame: &SyncFrame) {
        if !self.newest.is_in(sync_frame) {
            self.replace(Plan::of_sync_frame(sync_frame), sync_frame.countdown.min(NOTICE_SUPERFRAMES));
        }
    }

    fn replace(&mut self, plan: Plan, countdown: u8) {
        let former = self.in_force().cloned().filter(|_| countdown > 0);
        *self = Self::in_notice(plan, former, countdown);
    }

    /// The coordinator changes the plan: with notice, but at once if nobody's slots are taken.
    pub fn change(&mut self, members: &Members, slots: Slots) {
        let newest = &self.newest;
        let is_wider = slots.leased >= newest.slots.leased && slots.relays <= newest.slots.relays;
        let nobody_is_affected = newest.members.is_empty() && is_wider && slots.layout == newest.slots.layout;
        let notice = if nobody_is_affected { 0 } else { NOTICE_SUPERFRAMES };
        let version = newest.version.wrapping_add(1);
        self.replace(Plan { version, members: members.clone(), slots }, notice);
    }
}

/// Whether a tag is in a list.
pub fn lists(members: &Members, tag: u16) -> bool {
    members.iter().any(|member| member.tag == tag)
}

/// Those of the `slots` that `tag` owns in a superframe: bit i for the i-th.
///
/// Slots are dealt in turn to the members that need one more, beginning with another member in each superframe. If
/// fewer are needed than there are, they are spread evenly over the superframe. All nodes compute the same result from
/// a list and a number.
fn owned_slots(members: &Members, tag: u16, superframe: u16, slots: u8) -> u64 {
    let slots = slots.min(MAX_ROUND_SLOTS as u8);
    let mut wanted: Vec<(u16, u8), MAX_MEMBERS> = Vec::new();
    for member in members {
        let slots = match member.share {
            // A lease is not in the list.
            Share::Release | Share::Leased(_) => 0,
            Share::Slots(n) => n,
            Share::Greedy => u8::MAX,
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

/// The same for the last instant at which a round may begin.
pub fn last_round(owned: u64, timing: &Timing, anchors: usize, uncertainty: RadioDuration) -> RadioDuration {
    let end = u64::BITS - owned.leading_zeros();
    let length = timing.round(anchors).ticks() + timing.guard.ticks() / 2 + uncertainty.ticks();
    RadioDuration::from_ticks(timing.round_slot_begin(end as usize).ticks() - length)
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
            // At least as often as requested, but for a sixteenth: slots rounded up, superframes down. Superframes last
            // somewhat longer while nodes measure how quick they are.
            match u16::try_from((period + period / 16) / superframe).unwrap_or(u16::MAX) {
                0 => Share::Slots(((superframe + period - 1) / period).min(126) as u8),
                superframes => Share::Leased(Turns::rounds(Period::at_most(superframes))),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::timing::Network;
    use super::*;
    use crate::PhyConfig;
    use wire::uwb::layout::Span;

    const FAST: Network = Network::new(1, PhyConfig::FAST);

    fn slots(leased: u8) -> Slots {
        Slots { layout: Layout::LEAST, leased, relays: false }
    }

    fn list(shares: &[Share]) -> Members {
        shares.iter().enumerate().map(|(tag, &share)| Member { tag: tag as u16, share }).collect()
    }

    fn in_force(membership: &Membership) -> Option<&Members> {
        membership.in_force().map(|plan| &plan.members)
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
        // 16 tags, 10 slots: every tag gets slots, 10 / 16 a superframe.
        let members = list(&[Share::Greedy; 16]);
        let mut counts = [0u32; 16];
        for superframe in 0..160 {
            for (count, owned) in counts.iter_mut().zip(plan(&members, superframe, 10)) {
                *count += owned.count_ones();
            }
        }
        assert_eq!(counts, [100; 16]);
    }

    #[test]
    fn modest_tags_get_what_they_ask_for_and_greedy_ones_the_rest() {
        let members =
            list(&[Share::Slots(2), Share::Greedy, Share::Leased(Turns::rounds(Period::ONE)), Share::Release]);
        let mut counts = [0u32; 4];
        for superframe in 0..40 {
            for (count, owned) in counts.iter_mut().zip(plan(&members, superframe, 37)) {
                *count += owned.count_ones();
            }
        }
        assert_eq!(counts, [80, 40 * 37 - 80, 0, 0]);
    }

    #[test]
    fn members_share_the_slots_that_are_not_leased() {
        let plan = |leased, relays| Plan {
            version: 0,
            members: list(&[Share::Greedy]),
            slots: Slots { relays, ..slots(leased) },
        };
        let timing = |round_slots| Timing { round_slots, relay_slots: 2, ..Timing::of(&FAST, Layout::LEAST) };
        assert_eq!(plan(5, false).owned_slots(0, 7, &timing(8)), 0b1110_0000);
        assert_eq!(plan(5, true).owned_slots(0, 7, &timing(8)), 0b0010_0000);
        assert_eq!(plan(0, false).owned_slots(0, 7, &timing(8)), 0b1111_1111);
        assert_eq!([8, 64, 255].map(|leased| plan(leased, false).owned_slots(0, 7, &timing(8))), [0; 3]);
        assert_eq!([6, 8, 255].map(|leased| plan(leased, true).owned_slots(0, 7, &timing(8))), [0; 3]);
        assert_eq!(plan(63, false).owned_slots(0, 7, &timing(64)), 1 << 63);
        // An eighth stays: 1 of 4, 5 of 35.
        assert_eq!([0, 1, 4, 35, 64].map(most_leased), [0, 0, 3, 30, 56]);
    }

    #[test]
    fn more_leased_slots_count_at_once_and_fewer_or_taken_ones_after_their_notice() {
        let mut membership = Membership::new(Layout::LEAST);
        membership.change(&Members::new(), slots(9));
        assert_eq!((membership.leased(), membership.countdown()), (Some(9), 0));
        membership.change(&list(&[Share::Greedy]), slots(4));
        assert_eq!((membership.leased(), membership.countdown()), (Some(4), 4));
        assert_eq!(membership.in_force().map(|plan| plan.slots.leased), Some(9));
        (0..4).for_each(|_| membership.advance());
        membership.change(&list(&[Share::Greedy]), slots(6));
        assert_eq!((membership.leased(), membership.countdown()), (Some(4), 4));
        let wide = Layout { answer: Span::LONGEST, ..Layout::LEAST };
        membership.change(&list(&[Share::Greedy]), Slots { layout: wide, ..slots(6) });
        assert_eq!(membership.leased(), None, "the layout changes");
    }

    #[test]
    fn relay_slots_are_taken_after_their_notice_and_given_back_at_once() {
        let mut membership = Membership::new(Layout::LEAST);
        membership.change(&Members::new(), Slots { relays: true, ..slots(9) });
        assert_eq!(membership.countdown(), 4);
        let has = |membership: &Membership| membership.in_force().map(|plan| plan.slots.relays);
        assert_eq!(has(&membership), Some(false));
        (0..4).for_each(|_| membership.advance());
        assert_eq!(has(&membership), Some(true));
        membership.change(&Members::new(), slots(9));
        assert_eq!((has(&membership), membership.countdown()), (Some(false), 0));
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
        membership.change(&old, slots(0));
        assert_eq!(in_force(&membership), Some(&old), "nobody's slots were taken");
        membership.change(&new, slots(0));
        assert_eq!((in_force(&membership), membership.countdown()), (Some(&old), 4));
        (0..3).for_each(|_| membership.advance());
        assert_eq!(in_force(&membership), Some(&old));
        membership.advance();
        assert_eq!(in_force(&membership), Some(&new));
    }

    #[test]
    fn a_changed_layout_counts_after_its_notice_even_where_there_are_no_members() {
        let wide = Layout { answer: Span::LONGEST, ..Layout::LEAST };
        let mut membership = Membership::new(Layout::LEAST);
        membership.change(&Members::new(), Slots { layout: wide, ..slots(0) });
        assert_eq!((membership.layout_in_force(), membership.layout()), (Layout::LEAST, wide));
        assert!(membership.changes_layout());
        (0..NOTICE_SUPERFRAMES).for_each(|_| membership.advance());
        assert_eq!(membership.layout_in_force(), wide);
        assert!(!membership.changes_layout());
    }

    /// A relay's sync frame with this list.
    fn sync_frame(version: u8, countdown: u8, members: &Members) -> SyncFrame {
        SyncFrame { version, countdown, members: members.clone(), hops: 1, ..crate::native::blank_sync_frame() }
    }

    #[test]
    fn a_list_is_taken_with_its_whole_notice_or_if_the_known_one_was_missed_for_long() {
        let [known, told] = [list(&[Share::Greedy]), list(&[Share::Slots(1)])];
        let all = (0..=u8::MAX).flat_map(|ahead| (0..=NOTICE_SUPERFRAMES).map(move |countdown| (ahead, countdown)));
        for (at, (ahead, countdown)) in [0, 7, 128, 255].into_iter().flat_map(|at| all.clone().map(move |of| (at, of)))
        {
            for missed in 0..=MISSED_SUPERFRAMES {
                let mut membership = Membership::from_sync_frame(&sync_frame(at, 0, &known));
                (0..missed).for_each(|_| membership.advance());
                membership.receive(&sync_frame(at.wrapping_add(ahead), countdown, &told));
                // The notice began 4 − countdown superframes ago, and the list before it was announced for four. A relay
                // may have sent the known list until then, and in one more superframe.
                let follows =
                    matches!(ahead, 1..=127) && 4 * u16::from(ahead) - u16::from(countdown) <= u16::from(missed) + 1;
                let expected = if follows || missed == 8 { &told } else { &known };
                assert_eq!(membership.members(), expected, "{ahead} ahead, {countdown} before, {missed} missed");
            }
        }
    }

    #[test]
    fn a_relay_that_is_late_does_not_keep_a_node_from_the_next_list() {
        let [known, told] = [list(&[Share::Greedy]), list(&[Share::Slots(1)])];
        for age in 0..=3 {
            let mut membership = Membership::from_sync_frame(&sync_frame(5, 0, &known));
            (0..3).for_each(|_| membership.advance());
            assert!(membership.receive(&SyncFrame { age, ..sync_frame(5, 0, &known) }));
            // Announced two superframes ago, when a relay that has heard the coordinator since knows of it.
            assert_eq!(membership.receive(&sync_frame(6, 2, &told)), age >= 1, "{age}");
        }
    }

    #[test]
    fn no_other_list_is_announced_before_the_newest_one_is_in_force() {
        let [known, told, forged] = [list(&[Share::Greedy]), list(&[Share::Slots(1)]), list(&[Share::Slots(2)])];
        let mut membership = Membership::from_sync_frame(&sync_frame(5, 0, &known));
        assert!(membership.receive(&sync_frame(6, 4, &told)));
        for left in (0..4).rev() {
            assert!(!membership.receive(&sync_frame(7, 4, &forged)));
            membership.advance();
            assert!(membership.receive(&sync_frame(6, left, &told)));
        }
        assert_eq!(in_force(&membership), Some(&told));
        assert!(membership.receive(&sync_frame(7, 4, &forged)), "now it may be announced");
    }

    #[test]
    fn an_announced_list_is_taken_back_if_the_coordinator_or_the_majority_does_not_know_it() {
        let [known, forged] = [list(&[Share::Greedy]), Members::new()];
        let announced = || {
            let mut membership = Membership::from_sync_frame(&sync_frame(5, 0, &known));
            assert!(membership.receive(&sync_frame(6, 4, &forged)));
            membership
        };
        let mut by_coordinator = announced();
        assert!(!by_coordinator.receive(&SyncFrame { hops: 0, ..sync_frame(5, 0, &known) }));
        assert_eq!((by_coordinator.settled().map(|plan| &plan.members), by_coordinator.version()), (Some(&known), 5));
        let mut by_relays = announced();
        // Some relays are late, others are not.
        for _ in 0..4 {
            for version in [5, 5, 5, 6, 6] {
                let list = if version == 5 { &known } else { &forged };
                assert!(by_relays.receive(&sync_frame(version, 0, list)));
            }
            by_relays.receive(&sync_frame(6, 3, &forged));
        }
        assert_eq!(by_relays.members(), &forged);
        for more in 0..6 {
            assert_eq!(by_relays.receive(&sync_frame(5, 0, &known)), more < 5);
        }
        assert_eq!((by_relays.settled().map(|plan| &plan.members), by_relays.version()), (Some(&known), 5));
    }

    #[test]
    fn a_newcomer_knows_the_new_list_and_not_the_one_that_counts() {
        let [old, new] = [list(&[Share::Greedy]), list(&[Share::Greedy, Share::Slots(1)])];
        let mut newcomer = Membership::from_sync_frame(&sync_frame(2, 3, &new));
        assert_eq!(in_force(&newcomer), None);
        (0..3).for_each(|_| newcomer.advance());
        assert_eq!(in_force(&newcomer), Some(&new));
        // An older list that another anchor still relays changes nothing.
        newcomer.receive(&sync_frame(1, 0, &old));
        assert_eq!(newcomer.members(), &new);
    }

    #[test]
    fn no_round_fits_after_the_last() {
        let timing = Timing::of(&crate::native::Network::new(1, crate::PhyConfig::FAST), Layout::LEAST);
        let uncertainty = RadioDuration::from_micros(3);
        for (owned, anchors) in [(0b1, 8), (0b0110_0100, 4), (0b11, 1)] {
            let last = last_round(owned, &timing, anchors, uncertainty);
            let next = |earliest| next_round(owned, &timing, earliest, anchors, uncertainty);
            assert_eq!(next(last), Some(last));
            assert_eq!(next(RadioDuration::from_ticks(last.ticks() + 1)), None);
        }
    }
}
