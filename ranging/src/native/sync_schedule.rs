//! Which sync frames a tag with a fixed rate listens to: one is enough, from one anchor after the other.
//!
//! Inputs are sync frames, responses, and missing ones. The output is what to listen to in a superframe. The tag
//! listens to all sync slots now and then, and sooner if it knows few anchors.

use heapless::Vec;

use super::anchor_table::MAX_NEIGHBOURS;
use super::sync_slot::is_left_out;
use super::timing::HOLDOVER_SUPERFRAMES;
use wire::uwb::native::OWNED_SYNC_SLOTS;

/// The tag listens to all sync slots once in this many superframes that it does not sleep through …
const ALL_AFTER: u16 = 600;
/// … and once in this many if it knows too few anchors.
const ALL_SOON_AFTER: u16 = 20;
const ENOUGH: usize = 4;
/// An anchor whose frame was missed this many times in a row is given up.
const MOST_MISSES: u8 = 6;

/// A tag listens to this many sync frames of an anchor at which a message waits.
const MESSAGE_TRIES: u8 = 3;

/// An anchor that has a sync slot of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WatchedAnchor {
    /// Short address.
    pub address: u16,
    /// Its sync slot.
    pub slot: u8,
    misses: u8,
}

/// What the tag listens to in a superframe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Listening {
    /// All sync slots.
    All,
    /// The sync slot of this anchor.
    One(WatchedAnchor),
    /// None.
    Nothing,
}

/// The anchors whose sync slots are known.
#[derive(Clone, Debug, Default)]
pub struct SyncSchedule {
    anchors: Vec<WatchedAnchor, MAX_NEIGHBOURS>,
    /// The anchor whose turn it is.
    turn: usize,
    /// Superframes since the tag listened to all slots.
    since_all: u16,
    /// The decision for a superframe.
    plan: Option<(u16, Listening)>,
    /// The anchor whose next sync frames have a message to this tag, and how many more are listened to.
    expected: Option<(u16, u8)>,
}

impl SyncSchedule {
    /// A message to this tag waits at an anchor.
    pub fn expect(&mut self, address: u16) {
        self.expected = Some((address, MESSAGE_TRIES));
    }

    /// Whether sync frames are to be listened to because of a message.
    pub const fn expects_message(&self) -> bool {
        self.expected.is_some()
    }

    /// A sync frame was received.
    pub fn receive(&mut self, address: u16, slot: u8) {
        self.expected = self.expected.filter(|(expected, _)| *expected != address);
        if usize::from(slot) >= OWNED_SYNC_SLOTS {
            // A shared slot is used by all anchors without a slot of their own: it comes now and then.
            self.answered(address);
            return;
        }
        match self.anchors.iter_mut().find(|anchor| anchor.address == address) {
            Some(anchor) => *anchor = WatchedAnchor { address, slot, misses: 0 },
            None => {
                // There is room for as many anchors as in the anchor table: an anchor beyond that is ignored.
                let _ = self.anchors.push(WatchedAnchor { address, slot, misses: 0 });
            }
        }
    }

    /// An anchor answered.
    pub fn answered(&mut self, address: u16) {
        if let Some(anchor) = self.anchors.iter_mut().find(|anchor| anchor.address == address) {
            anchor.misses = 0;
        }
    }

    /// An anchor did not send its sync frame, or did not answer.
    pub fn missed(&mut self, address: u16) {
        if let Some(anchor) = self.anchors.iter_mut().find(|anchor| anchor.address == address) {
            anchor.misses += 1;
        }
        self.anchors.retain(|anchor| anchor.misses <= MOST_MISSES);
    }

    /// The anchors.
    pub fn anchors(&self) -> impl Iterator<Item = u16> {
        self.anchors.iter().map(|anchor| anchor.address)
    }

    /// The anchor at which a message waits, if its sync slot is known.
    fn next_message(&mut self) -> Option<WatchedAnchor> {
        let (address, tries) = self.expected.take()?;
        let anchor = self.anchors.iter().find(|anchor| anchor.address == address).copied()?;
        self.expected = tries.checked_sub(1).map(|tries| (address, tries));
        self.expected.map(|_| anchor)
    }

    /// The anchor whose sync frame is next, and does come in this superframe.
    fn next(&mut self, superframe: u16) -> Option<WatchedAnchor> {
        self.turn = (self.turn + 1).checked_rem(self.anchors.len())?;
        let left_out = self.anchors.get(self.turn).is_some_and(|anchor| is_left_out(anchor.address, superframe));
        self.turn = (self.turn + usize::from(left_out)).checked_rem(self.anchors.len())?;
        self.anchors.get(self.turn).copied()
    }

    /// What to listen to in this superframe. The last sync frame came `silent` superframes before it. Another call for
    /// the same superframe returns the same result.
    pub fn plan(&mut self, superframe: u16, silent: u16) -> Listening {
        if let Some((_, listening)) = self.plan.filter(|(planned, _)| *planned == superframe) {
            return listening;
        }
        if let Some(anchor) = self.next_message() {
            self.plan = Some((superframe, Listening::One(anchor)));
            return Listening::One(anchor);
        }
        self.since_all = self.since_all.saturating_add(1);
        let patience = if self.anchors.len() < ENOUGH { ALL_SOON_AFTER } else { ALL_AFTER };
        let listening = if silent > HOLDOVER_SUPERFRAMES || self.since_all >= patience {
            self.since_all = 0;
            Listening::All
        } else if silent < HOLDOVER_SUPERFRAMES {
            Listening::Nothing
        } else {
            self.next(superframe).map_or(Listening::All, Listening::One)
        };
        self.plan = Some((superframe, listening));
        listening
    }

    /// What to listen to in the superframe that a doze ends with.
    pub fn after_doze(&mut self, superframe: u16) -> Listening {
        // The clock is lost: one sync frame is needed, but not all.
        self.plan = None;
        match self.plan(superframe, HOLDOVER_SUPERFRAMES) {
            Listening::Nothing => Listening::All,
            listening @ (Listening::All | Listening::One(_)) => listening,
        }
    }

    /// The plan for this superframe is done.
    pub fn is_over(&mut self, superframe: u16) {
        self.plan = Some((superframe, Listening::Nothing));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn watch(anchors: u16) -> SyncSchedule {
        let mut watch = SyncSchedule::default();
        (0..anchors).for_each(|i| watch.receive(10 + i, i as u8));
        watch
    }

    #[test]
    fn one_sync_frame_in_two_superframes_is_listened_to_each_anchors_in_turn() {
        let mut watch = watch(4);
        let (mut silent, mut heard) = (0, std::vec::Vec::new());
        for superframe in 0..16 {
            silent += 1;
            match watch.plan(superframe, silent) {
                Listening::One(anchor) => {
                    assert_eq!(watch.plan(superframe, 0), Listening::One(anchor), "asked again");
                    heard.push((superframe, anchor.address));
                    silent = 0;
                }
                Listening::Nothing => {}
                Listening::All => panic!("all at {superframe}"),
            }
        }
        let expected = [11, 12, 13, 10, 11, 12, 13, 10];
        assert_eq!(heard, expected.iter().zip(0..).map(|(a, i)| (2 * i + 1, *a)).collect::<std::vec::Vec<_>>());
    }

    #[test]
    fn all_are_listened_to_seldom_and_sooner_where_few_are_known() {
        for (anchors, every) in [(4, 600), (3, 20), (0, 20)] {
            let mut watch = watch(anchors);
            let all = |watch: &mut SyncSchedule| (0..6_000).filter(|n| watch.plan(*n, 1) == Listening::All).count();
            assert_eq!(all(&mut watch), 6_000 / every, "{anchors} anchors");
        }
        assert_eq!(watch(4).plan(0, 3), Listening::All, "too long without a sync_frame");
    }

    #[test]
    fn the_anchor_with_a_message_is_listened_to_until_it_comes_three_times_at_most() {
        let mut watch = watch(4);
        let one = |listening| if let Listening::One(anchor) = listening { Some(anchor.address) } else { None };
        watch.expect(12);
        // Also in superframes in which nothing else is due.
        assert_eq!((one(watch.plan(1, 1)), one(watch.plan(1, 1))), (Some(12), Some(12)), "asked again");
        watch.receive(11, 1);
        assert_eq!((one(watch.plan(2, 1)), watch.expects_message()), (Some(12), true));
        watch.receive(12, 2);
        assert_eq!((watch.plan(3, 1), watch.expects_message()), (Listening::Nothing, false));
        watch.expect(12);
        assert_eq!([4, 5, 6].map(|superframe| one(watch.plan(superframe, 1))), [Some(12); 3]);
        assert_eq!((watch.plan(7, 1), watch.expects_message()), (Listening::Nothing, false));
        // An anchor whose slot is not known.
        watch.expect(99);
        assert_eq!((watch.plan(8, 1), watch.expects_message()), (Listening::Nothing, false));
    }

    #[test]
    fn who_does_not_come_seven_times_is_given_up() {
        let mut watch = watch(4);
        (0..6).for_each(|_| watch.missed(11));
        watch.answered(11);
        (0..6).for_each(|_| watch.missed(11));
        assert_eq!(watch.anchors().count(), 4);
        watch.missed(11);
        assert!(watch.anchors().eq([10, 12, 13]));
    }
}
