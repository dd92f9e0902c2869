//! Who is a member of the network and for how long: the coordinator's requests and leases.
//!
//! A member keeps its slots as long as its polls are received. A new member is on probation until one of its polls was
//! received. A forged request costs a single frame, so tags that do not exist must neither stay nor take every place.
//! If more tags request slots than there are places on probation, chance decides who gets one. No tag keeps such a
//! place for long, and the others request again.
//!
//! A full network is shared in turn: while a tag asks for a place, the member that has had its own for longest gives it
//! up after its turn. At most two places at a time are given away like this before the new tags' polls are received, so
//! that tags that do not exist cannot drive out those that do.

use heapless::Vec;

use super::plan::{Members, Membership};
use super::spread;
use wire::uwb::layout::Layout;
use wire::uwb::native::{MAX_MEMBERS, Member, Share};

/// A member without a received poll for this many of its turns loses its slots.
const LEASE_TURNS: u16 = 10;
/// A member on probation loses them after this many turns …
const PROBATION_TURNS: u16 = 2;
/// … and this many superframes: its list does not count at once, and relays need some superframes to report its poll.
const PROBATION_SUPERFRAMES: u16 = 8;
/// Members on probation at a time.
const MAX_ON_PROBATION: usize = 8;
/// A member of a full network keeps its place for this many turns before another tag gets it: a sleeping tag receives
/// the changed list only when it wakes, and must not lose many rounds by that.
const KEPT_TURNS: u16 = 60;
/// No place of a full network is given away while this many members are on probation.
const MAX_GIVEN_AWAY: usize = 2;
/// Pending requests.
const MAX_REQUESTS: usize = 16;

/// Pending requests, and for the coordinator what is known of each member of the list.
#[derive(Clone, Debug)]
pub struct Leases {
    requests: Vec<Member, MAX_REQUESTS>,
    /// Superframes since a poll of each member.
    unheard: [u16; MAX_MEMBERS],
    /// Superframes since each member became one.
    tenure: [u16; MAX_MEMBERS],
    /// Members (bit i: the list's i-th) with a poll received since they became members.
    proven: u32,
}

impl Leases {
    /// No requests. The members of a list that is taken over count as proven.
    pub const fn new() -> Self {
        Self { requests: Vec::new(), unheard: [0; MAX_MEMBERS], tenure: [0; MAX_MEMBERS], proven: u32::MAX }
    }

    /// The list was another coordinator's: the leases of its members begin now.
    pub fn take_over(&mut self) {
        (self.unheard, self.tenure, self.proven) = ([0; MAX_MEMBERS], [0; MAX_MEMBERS], u32::MAX);
    }

    /// A tag requests a share, in superframe `number`.
    pub fn request(&mut self, request: Member, members: &Members, number: u16) {
        let listed = members.iter().find(|member| member.tag == request.tag);
        if listed.map_or(Share::Release, |member| member.share) == request.share {
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

    /// A request to be passed on towards the coordinator.
    pub fn pass_on(&mut self) -> Option<Member> {
        self.requests.pop()
    }

    /// The coordinator's work when `begun` superframes have begun, up to `number`: it ends leases, grants requests, and
    /// announces the change if the list or the layout changes. `heard` are the members whose poll was received.
    pub fn renew(&mut self, membership: &mut Membership, layout: Layout, heard: u32, begun: u16, number: u16) {
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
        let is_crowded =
            unproven >= MAX_ON_PROBATION && self.requests.iter().any(|request| place_of(request.tag).is_none());
        let is_over = |&(place, member): &(usize, &Member)| {
            let unheard = self.unheard.get(place).copied().unwrap_or(u16::MAX);
            let lease = if is_proven(place) { lease(member.share) } else { probation(member.share, is_crowded) };
            unheard > lease
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
        if list == *members && layout == membership.layout() {
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
        membership.change(&list, layout);
    }

    /// The member of a full network whose place another tag gets, if one asks for it: the one that has had its place
    /// for longest, after its turn.
    fn gives_way(&self, members: &Members) -> Option<usize> {
        let is_listed = |request: &Member| members.iter().any(|member| member.tag == request.tag);
        if !self.requests.iter().any(|request| request.share != Share::Release && !is_listed(request)) {
            return None;
        }
        let turns = members.iter().map(|member| KEPT_TURNS * turn(member.share));
        let served = self.tenure.iter().zip(turns).enumerate().filter(|(_, (tenure, turn))| *tenure >= turn);
        served.max_by_key(|(_, (tenure, _))| **tenure).map(|(place, _)| place)
    }
}

/// Superframes from one turn of a share to the next.
fn turn(share: Share) -> u16 {
    match share {
        Share::OneIn(superframes) => u16::from(superframes),
        Share::Release | Share::Slots(_) | Share::Greedy => 1,
    }
}

/// Superframes that a member keeps its slots without a received poll.
fn lease(share: Share) -> u16 {
    LEASE_TURNS * turn(share)
}

/// Superframes that a member on probation keeps its slots. If other tags wait (`is_crowded`), the time ends even
/// without a turn.
fn probation(share: Share, is_crowded: bool) -> u16 {
    let turn = if is_crowded { 1 } else { turn(share) };
    PROBATION_TURNS * turn + PROBATION_SUPERFRAMES
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A coordinator without members, and the superframes that pass.
    struct Coordinator {
        leases: Leases,
        membership: Membership,
        number: u16,
    }

    impl Coordinator {
        fn new() -> Self {
            Self { leases: Leases::new(), membership: Membership::new(Layout::LEAST), number: 0 }
        }

        fn request(&mut self, tag: u16, share: Share) {
            self.leases.request(Member { tag, share }, self.membership.members(), self.number);
        }

        /// A superframe in which these tags were received.
        fn superframe(&mut self, heard: &[u16]) {
            let members = self.membership.members().iter().enumerate();
            let bits = members.filter(|(_, member)| heard.contains(&member.tag)).map(|(place, _)| 1 << place).sum();
            self.number += 1;
            self.membership.advance();
            self.leases.renew(&mut self.membership, Layout::LEAST, bits, 1, self.number);
        }

        fn has(&self, tag: u16) -> bool {
            self.membership.members().iter().any(|member| member.tag == tag)
        }
    }

    #[test]
    fn a_tag_that_never_polls_loses_its_place_soon_however_seldom_it_wants_to() {
        let mut coordinator = Coordinator::new();
        coordinator.request(1, Share::OneIn(20));
        coordinator.request(2, Share::OneIn(20));
        // One poll of tag 2, in its first turn.
        for i in 0..60 {
            coordinator.superframe(if i == 15 { &[2] } else { &[] });
            assert_eq!(coordinator.has(1), i <= 2 * 20 + 8, "superframe {i}");
            assert!(coordinator.has(2));
        }
        // Ten turns of 20 after its poll, tag 2 goes too.
        (60..=15 + 200).for_each(|_| coordinator.superframe(&[]));
        assert!(coordinator.has(2));
        (0..2).for_each(|_| coordinator.superframe(&[]));
        assert!(!coordinator.has(2));
    }

    #[test]
    fn tags_that_do_not_exist_leave_places_to_those_that_do() {
        let mut coordinator = Coordinator::new();
        let real: std::vec::Vec<u16> = (1..=16).collect();
        let (mut invented, mut most) = (0x4000, 0);
        for _ in 0..600 {
            // Six requests of new invented tags in each superframe, and those of all real tags that are not members.
            for _ in 0..6 {
                invented += 1;
                coordinator.request(invented, Share::OneIn(127));
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
    fn a_full_network_is_shared_in_turn() {
        let mut coordinator = Coordinator::new();
        let tags: std::vec::Vec<u16> = (1..=30).collect();
        let mut served = [0_u32; 30];
        let mut waited = [0_u32; 30];
        let mut longest = 0;
        for superframe in 0..12_000 {
            // Each polls once in ten superframes; who has no place asks every 15.
            let polls = |tag: u16| (superframe + tag).is_multiple_of(10) && coordinator.has(tag);
            let heard: std::vec::Vec<u16> = tags.iter().copied().filter(|&tag| polls(tag)).collect();
            for &tag in &tags {
                if !coordinator.has(tag) && (superframe + tag).is_multiple_of(15) {
                    coordinator.request(tag, Share::OneIn(10));
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
        // 24 places for 30 tags: each has one for four fifths of the time. A member keeps its place for 60 turns of 10
        // superframes, so that one is given away every 25. Chance picks one of the six that wait: of some 120 waits the
        // longest takes 6 ln 120 = 29 times as long, after the first 600.
        let (fair, cycle) = (12_000 * 24 / 30, 600 * 30 / 24);
        assert!(served.iter().all(|served| served.abs_diff(fair) <= cycle), "{served:?}");
        assert!((600..600 + 25 * 29).contains(&longest), "{longest}");
    }

    #[test]
    fn in_a_full_network_invented_tags_take_two_places_at_most() {
        let mut coordinator = Coordinator::new();
        let real: std::vec::Vec<u16> = (1..=24).collect();
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
                coordinator.request(invented, Share::OneIn(127));
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
        coordinator.request(1, Share::OneIn(10));
        // More than 2 · 10 + 8 superframes without a poll.
        (0..60).for_each(|_| coordinator.superframe(&[]));
        assert!(coordinator.has(1));
    }
}
