//! Who is in the list of members and for how long, and the requests of tags on their way to the coordinator.
//!
//! A member keeps its slots as long as its polls are received. A new member is on probation until one of its polls was
//! received. A forged request costs a single frame, so tags that do not exist must neither stay nor take every place.
//! If more tags request slots than there are places on probation, chance decides who gets one. No tag keeps such a
//! place for long, and the others request again.
//!
//! A full list is shared in turn: while a tag asks for a place, the member that has had its own for longest gives it
//! up after its turn. At most two places at a time are given away like this before the new tags' polls are received, so
//! that tags that do not exist cannot drive out those that do.

use heapless::Vec;

use super::plan::{Members, Membership, Slots};
use super::spread;
use wire::uwb::native::{Grant, Lease, MAX_MEMBERS, Member, Share, Turns};

/// A member without a received poll for this many superframes loses its slots.
const KEPT_UNHEARD: u16 = 10;
/// A member on probation loses them after this many: its list does not count at once, and relays need some superframes
/// to report its poll.
const PROBATION_SUPERFRAMES: u16 = 10;
/// Members on probation at a time.
const MAX_ON_PROBATION: usize = 8;
/// A member of a full list keeps its place for this many superframes before another tag gets it.
const KEPT_SUPERFRAMES: u16 = 60;
/// No place of a full list is given away while this many members are on probation.
const MAX_GIVEN_AWAY: usize = 2;
/// Pending requests.
const MAX_REQUESTS: usize = 16;

/// Pending requests, and for the coordinator what is known of each member of the list.
#[derive(Clone, Debug)]
pub struct Enrolment {
    requests: Vec<Member, MAX_REQUESTS>,
    /// Superframes since a poll of each member.
    unheard: [u16; MAX_MEMBERS],
    /// Superframes since each member became one.
    tenure: [u16; MAX_MEMBERS],
    /// Members (bit i: the list's i-th) with a poll received since they became members.
    proven: u16,
}

impl Enrolment {
    /// No requests. The members of a list that is taken over count as proven.
    pub const fn new() -> Self {
        Self { requests: Vec::new(), unheard: [0; MAX_MEMBERS], tenure: [0; MAX_MEMBERS], proven: u16::MAX }
    }

    /// The list was another coordinator's: the leases of its members begin now.
    pub fn take_over(&mut self) {
        (self.unheard, self.tenure, self.proven) = ([0; MAX_MEMBERS], [0; MAX_MEMBERS], u16::MAX);
    }

    /// A tag requests a share, in superframe `number`. `has_lease`: it may have one, so that it has something to give
    /// back.
    pub fn request(&mut self, request: Member, members: &Members, has_lease: bool, number: u16) {
        let listed = members.iter().find(|member| member.tag == request.tag);
        let is_release = has_lease && request.share == Share::Release;
        if !is_release && listed.map_or(Share::Release, |member| member.share) == request.share {
            return;
        }
        if let Some(known) = self.requests.iter_mut().find(|known| known.tag == request.tag) {
            *known = request;
        } else if self.requests.push(request).is_err() {
            // Too many requests are pending. The new one replaces a random one; its tag requests again.
            let place = usize::from(spread(request.tag, number, MAX_REQUESTS as u16));
            if let Some(other) = self.requests.get_mut(place) {
                *other = request;
            }
        }
    }

    /// Hands requests of leases over: an anchor that has become coordinator has kept them for the one before.
    pub fn take_leases(&mut self, mut lease: impl FnMut(u16, Turns)) {
        self.requests.retain(|request| {
            let Share::Leased(turns) = request.share else { return true };
            lease(request.tag, turns);
            false
        });
    }

    /// Whether a tag requests slots of the list.
    pub fn is_awaited(&self) -> bool {
        self.requests.iter().any(|request| request.share != Share::Release)
    }

    /// The coordinator has granted a lease to a tag, or its list is to lose the tag for another reason.
    pub fn withdraw(&mut self, tag: u16, members: &Members, number: u16) {
        self.request(Member { tag, share: Share::Release }, members, false, number);
    }

    /// A request to be passed on towards the coordinator: a random one, so that other relays pass on others.
    pub fn pass_on(&mut self, relay: u16, number: u16) -> Option<Member> {
        let place = spread(relay, number, self.requests.len() as u16);
        (!self.requests.is_empty()).then(|| self.requests.swap_remove(place.into()))
    }

    /// The coordinator has answered requests of leases.
    pub fn answered(&mut self, leases: &[Lease]) {
        let answers = |lease: &Lease, request: &Member| {
            lease.grant != Grant::Ended
                && (lease.tag, Share::Leased(lease.turn.turns())) == (request.tag, request.share)
        };
        self.requests.retain(|request| !leases.iter().any(|lease| answers(lease, request)));
    }

    /// The coordinator's work when `begun` superframes have begun, up to `number`: it ends memberships, grants requests,
    /// and announces the change if the plan changes. `heard` are the members whose poll was received.
    pub fn renew(&mut self, membership: &mut Membership, slots: Slots, heard: u16, begun: u16, number: u16) {
        for (place, unheard) in self.unheard.iter_mut().enumerate() {
            *unheard = if heard >> place & 1 == 1 { 0 } else { unheard.saturating_add(begun) };
        }
        for tenure in &mut self.tenure {
            *tenure = tenure.saturating_add(begun);
        }
        self.proven |= heard;
        if membership.countdown() > 0 {
            return;
        }
        let members = membership.members();
        let is_proven = |place: usize| self.proven >> place & 1 == 1;
        let place_of = |tag: u16| members.iter().position(|member| member.tag == tag);
        let unproven = (0..members.len()).filter(|place| !is_proven(*place)).count();
        let is_over = |&(place, _): &(usize, &Member)| {
            let unheard = self.unheard.get(place).copied().unwrap_or(u16::MAX);
            unheard > if is_proven(place) { KEPT_UNHEARD } else { PROBATION_SUPERFRAMES }
        };
        let is_full = members.len() == MAX_MEMBERS && !members.iter().enumerate().any(|member| is_over(&member));
        let gives_way = (is_full && unproven < MAX_GIVEN_AWAY).then(|| self.gives_way(members)).flatten();
        let is_kept = |member: &(usize, &Member)| {
            let asks = self.requests.iter().any(|request| request.tag == member.1.tag);
            !is_over(member) && !asks && gives_way != Some(member.0)
        };
        // In the order of their addresses. A library's sort takes five kilobytes.
        let mut list = Members::new();
        let mut insert = |member: Member| {
            let place = list.iter().position(|other: &Member| other.tag > member.tag).unwrap_or(list.len());
            // A full network accepts no further member.
            let _ = list.insert(place, member);
        };
        let mut on_probation = 0;
        for (place, member) in members.iter().enumerate().filter(is_kept) {
            on_probation += usize::from(!is_proven(place));
            insert(*member);
        }
        let first = usize::from(spread(number, number, self.requests.len() as u16));
        let (later, sooner) = self.requests.split_at(first.min(self.requests.len()));
        for request in sooner.iter().chain(later).filter(|request| request.share != Share::Release) {
            let is_new = place_of(request.tag).is_none_or(|place| !is_proven(place));
            if !is_new || on_probation < MAX_ON_PROBATION {
                on_probation += usize::from(is_new);
                insert(*request);
            }
        }
        self.requests.clear();
        if list == *members && slots == membership.newest().slots {
            return;
        }
        let (mut unheard, mut tenure, mut proven) = ([0; MAX_MEMBERS], [0; MAX_MEMBERS], 0);
        for ((place, member), (unheard, tenure)) in list.iter().enumerate().zip(unheard.iter_mut().zip(&mut tenure)) {
            if let Some(before) = members.iter().position(|known| known.tag == member.tag) {
                *unheard = self.unheard.get(before).copied().unwrap_or(0);
                *tenure = self.tenure.get(before).copied().unwrap_or(0);
                proven |= (self.proven >> before & 1) << place;
            }
        }
        (self.unheard, self.tenure, self.proven) = (unheard, tenure, proven);
        membership.change(&list, slots);
    }

    /// The member of a full network whose place another tag gets, if one asks for it: the one that has had its place
    /// for longest, after its turn.
    fn gives_way(&self, members: &Members) -> Option<usize> {
        let is_listed = |request: &Member| members.iter().any(|member| member.tag == request.tag);
        if !self.requests.iter().any(|request| request.share != Share::Release && !is_listed(request)) {
            return None;
        }
        let served = self.tenure.iter().enumerate().take(members.len());
        served
            .filter(|(_, tenure)| **tenure >= KEPT_SUPERFRAMES)
            .max_by_key(|(_, tenure)| **tenure)
            .map(|(place, _)| place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::uwb::layout::Layout;

    /// A coordinator without members, and the superframes that pass.
    struct Coordinator {
        enrolment: Enrolment,
        membership: Membership,
        number: u16,
    }

    impl Coordinator {
        fn new() -> Self {
            Self { enrolment: Enrolment::new(), membership: Membership::new(Layout::LEAST), number: 0 }
        }

        fn request(&mut self, tag: u16, share: Share) {
            self.enrolment.request(Member { tag, share }, self.membership.members(), false, self.number);
        }

        /// A superframe in which these tags were received.
        fn superframe(&mut self, heard: &[u16]) {
            let members = self.membership.members().iter().enumerate();
            let bits = members.filter(|(_, member)| heard.contains(&member.tag)).map(|(place, _)| 1 << place).sum();
            self.number += 1;
            self.membership.advance();
            let slots = self.membership.newest().slots;
            self.enrolment.renew(&mut self.membership, slots, bits, 1, self.number);
        }

        fn has(&self, tag: u16) -> bool {
            self.membership.members().iter().any(|member| member.tag == tag)
        }
    }

    #[test]
    fn a_tag_that_never_polls_loses_its_place_soon() {
        let mut coordinator = Coordinator::new();
        coordinator.request(1, Share::Slots(2));
        coordinator.request(2, Share::Greedy);
        // One poll of tag 2, in the eighth superframe.
        for i in 0..=18 {
            coordinator.superframe(if i == 8 { &[2] } else { &[] });
            assert_eq!(coordinator.has(1), i <= 10, "superframe {i}");
            assert!(coordinator.has(2), "superframe {i}");
        }
        // The change of the list takes four superframes.
        (0..4).for_each(|_| coordinator.superframe(&[]));
        assert!(!coordinator.has(2));
    }

    #[test]
    fn who_gets_a_lease_leaves_the_list() {
        let mut coordinator = Coordinator::new();
        coordinator.request(1, Share::Slots(2));
        (0..10).for_each(|_| coordinator.superframe(&[1]));
        coordinator.enrolment.withdraw(1, coordinator.membership.members(), 10);
        coordinator.superframe(&[1]);
        assert!(!coordinator.has(1));
    }

    #[test]
    fn tags_that_do_not_exist_leave_places_to_those_that_do() {
        let mut coordinator = Coordinator::new();
        let real: std::vec::Vec<u16> = (1..=8).collect();
        let (mut invented, mut most) = (0x4000, 0);
        for _ in 0..600 {
            // Six requests of new invented tags in each superframe, and those of all real tags that are not members.
            for _ in 0..6 {
                invented += 1;
                coordinator.request(invented, Share::Greedy);
            }
            real.iter().for_each(|&tag| coordinator.request(tag, Share::Slots(1)));
            coordinator.superframe(&real);
            let members = coordinator.membership.members().iter();
            most = most.max(members.filter(|member| member.tag > 0x4000).count());
        }
        assert!(real.iter().all(|&tag| coordinator.has(tag)), "{:?}", coordinator.membership.members());
        assert!(most <= MAX_ON_PROBATION, "{most}");
    }

    #[test]
    fn a_full_list_is_shared_in_turn() {
        let mut coordinator = Coordinator::new();
        let tags: std::vec::Vec<u16> = (1..=20).collect();
        let mut served = [0_u32; 20];
        let mut waited = [0_u32; 20];
        let mut longest = 0;
        for superframe in 0..12_000 {
            // Who has no place asks about every 15 superframes.
            let heard: std::vec::Vec<u16> = tags.iter().copied().filter(|&tag| coordinator.has(tag)).collect();
            for &tag in &tags {
                if !coordinator.has(tag) && spread(tag, superframe, 15) == 0 {
                    coordinator.request(tag, Share::Slots(2));
                }
            }
            coordinator.superframe(&heard);
            for (tag, (served, waited)) in tags.iter().zip(served.iter_mut().zip(&mut waited)) {
                if coordinator.has(*tag) {
                    (*served, *waited) = (*served + 1, 0);
                } else {
                    *waited += 1;
                    longest = longest.max(*waited);
                }
            }
        }
        // 16 places for 20 tags: each has one for four fifths of the time. A member keeps its place for 60 superframes at
        // least and then waits about 15, some 160 times: the sum of so many waits deviates by 160^½ · 15 = 190. If chance
        // picks another tag every other time, the longest of 20 · 160 waits takes 30 ln 3200 = 240 superframes.
        let fair = 12_000 * 16 / 20;
        assert!(served.iter().all(|served| served.abs_diff(fair) <= 4 * 190), "{served:?}");
        assert!(longest <= 240, "{longest}");
    }

    #[test]
    fn in_a_full_network_invented_tags_take_two_places_at_most() {
        let mut coordinator = Coordinator::new();
        let real: std::vec::Vec<u16> = (1..=16).collect();
        real.iter().for_each(|&tag| coordinator.request(tag, Share::Slots(1)));
        (0..40).for_each(|_| {
            real.iter().for_each(|&tag| coordinator.request(tag, Share::Slots(1)));
            coordinator.superframe(&real);
        });
        assert!(real.iter().all(|&tag| coordinator.has(tag)));
        let (mut invented, mut most) = (0x4000, 0);
        for _ in 0..1200 {
            for _ in 0..6 {
                invented += 1;
                coordinator.request(invented, Share::Greedy);
            }
            let out: std::vec::Vec<u16> = real.iter().copied().filter(|&tag| !coordinator.has(tag)).collect();
            out.iter().for_each(|&tag| coordinator.request(tag, Share::Slots(1)));
            coordinator.superframe(&real);
            most = most.max(coordinator.membership.members().iter().filter(|member| member.tag > 0x4000).count());
        }
        assert!((1..=MAX_GIVEN_AWAY).contains(&most), "{most}");
    }

    #[test]
    fn a_member_that_asks_for_another_share_is_not_on_probation_again() {
        let mut coordinator = Coordinator::new();
        coordinator.request(1, Share::Slots(1));
        coordinator.superframe(&[]);
        coordinator.superframe(&[1]);
        coordinator.request(1, Share::Slots(2));
        // The notice, and more than ten superframes after the request, but not after the poll before.
        (0..8).for_each(|_| coordinator.superframe(&[1]));
        (0..10).for_each(|_| coordinator.superframe(&[]));
        assert!(coordinator.has(1));
    }
}
