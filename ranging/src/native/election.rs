//! Which coordinator a node follows. The node is an anchor that relays, the coordinator itself, or a tag.
//!
//! Of two coordinators, the one with the later term prevails; for equal terms, the one with the lower address. So
//! networks that meet become one, and nodes follow an anchor that takes over from a silent coordinator. Terms do not
//! wrap, since a circle has no latest term: a network whose coordinator has changed 255 times keeps the term 255. There
//! an anchor that takes over is followed whatever its address is, because the coordinator before it is silent.
//!
//! Of a network with a key that was in two parts for long, the part prevails whose superframes are ahead, whatever the terms
//! are: sync frames of the other part could be recorded ones.
//!
//! Sync frames are not authenticated, and a single sync frame with a later term must not end a working network. So a
//! node follows a coordinator that prevails
//!
//! - at once, if the followed coordinator is silent: its last message is older than the node's number of hops explains;
//! - at once, if it is the followed coordinator with the next term: it was restarted. This is accepted at most once in
//!   [`RESTARTS_APART`] superframes;
//! - at once, in the first [`YOUNG`] superframes of a network, when several anchors have just been switched on; and
//!   always if the node is a coordinator without members and without other anchors: then there is nothing to lose;
//! - else only after patience: its sync frames must come in [`NEAR_PATIENCE`] superframes, or in [`FAR_PATIENCE`] if it
//!   is more than one term ahead. Only single superframes may be missing in between. In this way two networks merge
//!   that have worked for long and come into range of each other.

use core::cmp::Ordering;

use super::prevails;
use super::timing::HOLDOVER_SUPERFRAMES;
use wire::uwb::native::SyncFrame;

/// Restarts of one coordinator are followed at once if they are this many superframes apart.
const RESTARTS_APART: u8 = 2;
/// A network is young for this many superframes.
const YOUNG: u16 = 10;
/// Superframes with a sync frame of another coordinator of the same term, or one term ahead, before it is followed …
const NEAR_PATIENCE: u8 = 10;
/// … and of a coordinator that is farther ahead.
const FAR_PATIENCE: u8 = 100;
/// The number of hops to the coordinator is that of the shortest way, unless nothing came that way for more than this many
/// superframes.
const HOPS_KEPT: u8 = 3;
/// After more than this many superframes without its sync frame, the count starts again.
const PAUSE: u8 = 1;

/// The followed coordinator, and the candidate that may replace it.
#[derive(Clone, Copy, Debug)]
pub struct Election {
    /// Counts changes of coordinator.
    pub term: u8,
    /// The coordinator's address.
    pub coordinator: u16,
    /// Hops to it; 0: the node itself.
    pub hops: u8,
    /// Superframes since the last known message left the coordinator.
    pub age: u8,
    /// Superframes since a sync frame came that way.
    unconfirmed: u8,
    /// Superframes since this network was joined or founded.
    superframes: u16,
    /// Superframes since its coordinator restarted.
    unrestarted: u8,
    candidate: Option<Candidate>,
}

/// A coordinator that prevails and is not followed yet.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    is: (u8, u16),
    /// Superframes in which a sync frame of its network was received.
    heard_in: u8,
    /// Superframes since the last one.
    unheard: u8,
}

/// How to treat a sync frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// It is from the followed coordinator.
    Same,
    /// Follow its coordinator from now on.
    Change,
    /// Its coordinator does not prevail.
    Older,
    /// Its coordinator prevails but is not followed: not yet, or never.
    Refused,
}

impl Election {
    /// The node coordinates a network that it has just founded.
    pub const fn founded(address: u16) -> Self {
        Self {
            term: 0,
            coordinator: address,
            hops: 0,
            age: 0,
            unconfirmed: 0,
            superframes: 0,
            unrestarted: u8::MAX,
            candidate: None,
        }
    }

    /// The network of a sync frame is joined.
    pub fn joined(sync_frame: &SyncFrame) -> Self {
        let mut joined = Self::founded(sync_frame.coordinator);
        joined.follow(sync_frame);
        joined
    }

    /// `superframes` have begun.
    pub fn advance(&mut self, superframes: u16) {
        let few = superframes.min(u8::MAX.into()) as u8;
        self.superframes = self.superframes.saturating_add(superframes);
        self.age = self.age.saturating_add(few);
        self.unconfirmed = self.unconfirmed.saturating_add(few);
        self.unrestarted = self.unrestarted.saturating_add(few);
        if let Some(candidate) = &mut self.candidate {
            candidate.unheard = candidate.unheard.saturating_add(few);
        }
        self.candidate = self.candidate.filter(|candidate| candidate.unheard <= PAUSE + 1);
    }

    /// A sync frame was received. `is_alone`: a change would leave no other node behind. `lateness`: how it comes by the clock
    /// of the own session.
    pub fn receive(&mut self, sync_frame: &SyncFrame, is_alone: bool, lateness: Ordering) -> Choice {
        let (told, followed) = ((sync_frame.term, sync_frame.coordinator), (self.term, self.coordinator));
        if told == followed {
            let hops = sync_frame.hops.saturating_add(1);
            let is_longer_way_known = self.hops > 0 && self.unconfirmed > HOPS_KEPT && sync_frame.age < self.age;
            if hops <= self.hops || is_longer_way_known {
                (self.hops, self.unconfirmed) = (hops, 0);
            }
            self.age = self.age.min(sync_frame.age);
            return Choice::Same;
        }
        let is_silent = u16::from(self.age) > HOLDOVER_SUPERFRAMES + u16::from(self.hops);
        let takes_over_last_term = is_silent && sync_frame.age < self.age && told.0 == u8::MAX && followed.0 == u8::MAX;
        let prevails = match lateness {
            Ordering::Less => true,
            Ordering::Equal => prevails(told, followed) || takes_over_last_term,
            Ordering::Greater => false,
        };
        if !prevails {
            return Choice::Older;
        }
        let ahead = told.0.saturating_sub(followed.0);
        let has_restarted = told.1 == followed.1 && ahead == 1 && self.unrestarted >= RESTARTS_APART;
        let patience = if ahead <= 1 { NEAR_PATIENCE } else { FAR_PATIENCE };
        let is_trusted = is_silent || has_restarted || is_alone || self.superframes < YOUNG;
        if is_trusted || self.heard_in(told) >= patience { Choice::Change } else { Choice::Refused }
    }

    /// The number of superframes in which the candidate was received, including a sync frame of `told` that came now.
    fn heard_in(&mut self, told: (u8, u16)) -> u8 {
        let candidate = self.candidate.get_or_insert(Candidate { is: told, heard_in: 0, unheard: 1 });
        // Another candidate waits until this one is silent.
        if candidate.is != told {
            return 0;
        }
        if candidate.unheard > 0 {
            candidate.heard_in = candidate.heard_in.saturating_add(1);
            candidate.unheard = 0;
        }
        candidate.heard_in
    }

    /// The coordinator of a sync frame is followed from now on, in the same network.
    pub fn follow(&mut self, sync_frame: &SyncFrame) {
        if self.coordinator == sync_frame.coordinator {
            self.unrestarted = 0;
        }
        (self.term, self.coordinator) = (sync_frame.term, sync_frame.coordinator);
        (self.age, self.hops, self.unconfirmed) = (sync_frame.age, sync_frame.hops.saturating_add(1), 0);
        self.candidate = None;
    }

    /// The node itself coordinates from now on, one term later.
    pub fn take_over(&mut self, address: u16) {
        self.term = self.term.saturating_add(1);
        (self.coordinator, self.hops, self.age) = (address, 0, 0);
        self.candidate = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sync_frame(term: u8, coordinator: u16) -> SyncFrame {
        SyncFrame { term, coordinator, ..crate::native::blank_sync_frame() }
    }

    /// A node that has followed coordinator 5 in term 3 for a minute.
    fn settled() -> Election {
        let mut election = Election::joined(&sync_frame(3, 5));
        (0..600).for_each(|_| superframe(&mut election));
        election
    }

    /// A superframe with a sync frame of the followed coordinator.
    fn superframe(election: &mut Election) {
        election.advance(1);
        assert_eq!(
            election.receive(&sync_frame(election.term, election.coordinator), false, Ordering::Equal),
            Choice::Same
        );
    }

    /// Superframes, of 1000, until a sync frame in each of them is followed.
    fn patience(mut election: Election, told: &SyncFrame) -> Option<usize> {
        (0..1000).position(|_| {
            superframe(&mut election);
            election.receive(told, false, Ordering::Equal) == Choice::Change
        })
    }

    #[test]
    fn a_later_term_is_followed_at_once_where_the_coordinator_is_silent() {
        let mut election = settled();
        // A message from the superframe before last, over one more hop, is not too old.
        for age in 0..4 {
            assert_eq!(election.receive(&sync_frame(4, 9), false, Ordering::Equal), Choice::Refused, "age {age}");
            election.advance(1);
        }
        assert_eq!(election.receive(&sync_frame(4, 9), false, Ordering::Equal), Choice::Change);
        assert_eq!(election.receive(&sync_frame(103, 9), false, Ordering::Equal), Choice::Change);
        assert_eq!(election.receive(&sync_frame(2, 1), false, Ordering::Equal), Choice::Older);
        // 200 terms back, which a circle would take for 56 ahead.
        assert_eq!(
            Election::joined(&sync_frame(200, 5)).receive(&sync_frame(0, 1), false, Ordering::Equal),
            Choice::Older
        );
    }

    #[test]
    fn a_coordinator_that_is_heard_is_replaced_after_patience_only() {
        assert_eq!(patience(settled(), &sync_frame(4, 9)), Some(9));
        assert_eq!(patience(settled(), &sync_frame(3, 2)), Some(9));
        assert_eq!(patience(settled(), &sync_frame(5, 2)), Some(99));
        assert_eq!(patience(settled(), &sync_frame(2, 2)), None);
        // One sync frame in three superframes, or another coordinator each time: never.
        let (mut seldom, mut changing) = (settled(), settled());
        for i in 0..1000 {
            superframe(&mut seldom);
            superframe(&mut changing);
            assert!(i % 3 > 0 || seldom.receive(&sync_frame(4, 9), false, Ordering::Equal) == Choice::Refused);
            assert_eq!(changing.receive(&sync_frame(4, 100 + i), false, Ordering::Equal), Choice::Refused);
        }
    }

    #[test]
    fn a_restart_of_the_coordinator_is_followed_at_once_but_not_each_superframe() {
        let mut election = settled();
        assert_eq!(election.receive(&sync_frame(4, 5), false, Ordering::Equal), Choice::Change);
        election.follow(&sync_frame(4, 5));
        election.advance(1);
        assert_eq!(election.receive(&sync_frame(5, 5), false, Ordering::Equal), Choice::Refused);
        election.advance(1);
        assert_eq!(election.receive(&sync_frame(6, 5), false, Ordering::Equal), Choice::Refused);
        assert_eq!(election.receive(&sync_frame(5, 5), false, Ordering::Equal), Choice::Change);
    }

    /// A node that has worked for a minute as the coordinator of a network.
    fn coordinator(term: u8, address: u16) -> Election {
        let mut election = Election { term, ..Election::founded(address) };
        election.advance(600);
        Election { age: 0, ..election }
    }

    #[test]
    fn one_of_any_networks_prevails_over_all_others() {
        for networks in [[0, 86, 172], [0, 129, 255], [0, 1, 255], [100, 228, 1], [255, 255, 0], [0, 128, 128]] {
            for addresses in [[1, 2, 3], [3, 1, 2], [2, 3, 1]] {
                let networks: std::vec::Vec<(u8, u16)> = networks.into_iter().zip(addresses).collect();
                let over_all = |told: &&(u8, u16)| networks.iter().all(|followed| prevails(**told, *followed));
                assert_eq!(networks.iter().filter(over_all).count(), 1, "{networks:?}");
            }
        }
        // An anchor without knowledge prevails over no network whose coordinator has ever changed.
        assert!((1..=u8::MAX).all(|term| !prevails((0, 0), (term, 9))));
    }

    #[test]
    fn three_networks_that_meet_follow_one_coordinator() {
        let mut nodes = [(0, 3), (86, 1), (172, 2)].map(|(term, address)| (address, coordinator(term, address)));
        for _ in 0..300 {
            for at in 0..nodes.len() {
                let (address, node) = &mut nodes[at];
                node.advance(1);
                if node.coordinator == *address {
                    node.age = 0;
                } else if node.age > 3 + 2 * node.hops {
                    node.take_over(*address);
                }
                let (source, Election { term, coordinator, hops, age, .. }) = (*address, *node);
                for (_, other) in nodes.iter_mut().filter(|(address, _)| *address != source) {
                    let told = SyncFrame { hops, age, ..sync_frame(term, coordinator) };
                    if other.receive(&told, false, Ordering::Equal) == Choice::Change {
                        other.follow(&told);
                    }
                }
            }
        }
        assert_eq!(nodes.map(|(_, node)| (node.term, node.coordinator)), [(172, 2); 3]);
    }

    #[test]
    fn a_network_at_the_last_term_replaces_its_coordinator_by_any_address() {
        let mut taker = Election { hops: 1, ..coordinator(u8::MAX, 5) };
        taker.take_over(9);
        assert_eq!((taker.term, taker.coordinator), (u8::MAX, 9));
        let told = sync_frame(u8::MAX, 9);
        let mut election = coordinator(u8::MAX, 5);
        election.hops = 1;
        // As long as coordinator 5 is received, the higher address does not prevail.
        assert_eq!(election.receive(&told, false, Ordering::Equal), Choice::Older);
        election.advance(4);
        assert_eq!(election.receive(&told, false, Ordering::Equal), Choice::Change);
        election.follow(&told);
        // Who has not followed yet repeats the old coordinator's message, which changes nothing.
        let old = SyncFrame { age: 4, hops: 1, ..sync_frame(u8::MAX, 5) };
        assert_eq!(election.receive(&old, false, Ordering::Equal), Choice::Refused);
    }

    #[test]
    fn young_networks_merge_at_once_and_so_does_an_anchor_that_is_alone() {
        let mut young = Election::joined(&sync_frame(0, 5));
        young.advance(YOUNG - 1);
        assert_eq!(young.receive(&sync_frame(0, 5), false, Ordering::Equal), Choice::Same);
        assert_eq!(young.receive(&sync_frame(0, 4), false, Ordering::Equal), Choice::Change);
        let mut alone = Election::founded(5);
        for _ in 0..600 {
            alone.advance(1);
            alone.age = 0;
        }
        assert_eq!(alone.receive(&sync_frame(7, 9), true, Ordering::Equal), Choice::Change);
    }
}
