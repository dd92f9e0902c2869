//! In which sync slot an anchor sends.
//!
//! An anchor takes a slot in which no other one was received or reported: each sync frame reports whom its sender receives
//! in which slot. So slots are used again by anchors that no third one receives both. Two anchors that send at the same time
//! do not receive each other: an anchor leaves its slot if its neighbours report another one in it, or do not report it
//! there for long. One that has had its slot for long leaves it later than one that has just chosen it, so that who comes
//! last goes. (Anchors whose addresses differ by a multiple of 255 look like one in such reports.)
//!
//! Where there are more anchors than slots, the others send in the shared slots, at random, and as seldom as many of them
//! are received: all together less than once a superframe, as two at once destroy each other. They begin seldom, because too
//! many at once receive nothing of each other.

use super::anchor_position::{hash, is_own_slot};
use super::spread;
use super::timing::SHARED_SLOTS;
use wire::uwb::native::{OWNED_SYNC_SLOTS, SyncFrame};

/// The owner of a sync slot that was neither received nor reported for this many superframes has left it.
const SLOT_LEFT: u8 = 5;
/// An anchor leaves its sync slot if its neighbours have not reported it there for this many superframes.
const UNCONFIRMED: u8 = 20;
/// An anchor that has had its slot for this many superframes …
const SETTLED: u8 = 20;
/// … leaves it when superframes with reports of others in it outnumber the rest by this, or by up to seven.
const CONTESTED: u8 = 4;
/// One that others need stays longer, by this many superframes.
const NEEDED: u8 = 12;
/// If fewer slots are free, an anchor takes one only in a superframe in which it would send in a shared slot: if all that wait
/// took the next free one, none would get it.
const MANY_FREE: u16 = 4;
/// Without a slot of its own, an anchor sends in one superframe of this many at most. At first it sends in one of
/// [`FIRST_SHARED_EVERY`], and twice as often after each further 32 superframes.
const SHARED_EVERY: u16 = 4;
const FIRST_SHARED_EVERY: u16 = 32;
/// In one superframe of this many, an anchor listens in its own slot.
const LISTENED_EVERY: u16 = 128;
/// Others in shared slots are counted for this many superframes.
const COUNTED: u16 = 256;

/// Whether an anchor listens in its sync slot in this superframe, and sends nothing.
pub fn is_left_out(address: u16, number: u16) -> bool {
    spread(address, number, LISTENED_EVERY) == 0
}

/// Owners of sync slots: a byte of the address's hash (0: no owner) and superframes since the last sign of it.
type Owners = [(u8, u8); OWNED_SYNC_SLOTS];

/// An anchor's sync slot, and those of its neighbours.
#[derive(Clone, Debug)]
pub struct SyncSlot {
    address: u16,
    /// Others need the sync frames of this anchor: it is a gateway, or the coordinator.
    pub is_needed: bool,
    own: Option<u8>,
    /// Superframes since the own slot was chosen.
    tenure: u8,
    /// Superframes with neighbours of which none has reported this anchor in its slot.
    unconfirmed: u8,
    /// Superframes with another one in it, minus those without.
    contested: u8,
    /// Another one was reported in it in this superframe.
    is_contested: bool,
    heard: Owners,
    told: Owners,
    /// Without a slot of its own, the anchor sends in one superframe of this many.
    shared_every: u16,
    /// The others that were received in shared slots in this time, by hashes of their addresses.
    others: [u8; 16],
    /// How many these are, and how many they were in the time before.
    count: [u16; 2],
    /// Superframes of this time.
    counted: u16,
}

impl SyncSlot {
    /// No slot yet, and no neighbours.
    pub const fn new(address: u16) -> Self {
        Self {
            address,
            is_needed: false,
            own: None,
            tenure: 0,
            unconfirmed: 0,
            contested: 0,
            is_contested: false,
            heard: [(0, 0); OWNED_SYNC_SLOTS],
            told: [(0, 0); OWNED_SYNC_SLOTS],
            shared_every: FIRST_SHARED_EVERY,
            others: [0; 16],
            count: [0; 2],
            counted: 0,
        }
    }

    /// The slot that corresponds to the address: consecutive addresses never collide.
    pub fn take_first(&mut self) {
        self.own = Some(self.first());
    }

    const fn first(&self) -> u8 {
        (self.address % OWNED_SYNC_SLOTS as u16) as u8
    }

    /// The slot of this anchor's own.
    pub const fn own(&self) -> Option<u8> {
        self.own
    }

    /// Whether the anchor listens in its own slot in this superframe.
    pub fn is_listened_to(&self, number: u16) -> bool {
        is_left_out(self.address, number)
    }

    /// A sync frame of the same network came.
    #[inline(never)]
    pub fn receive(&mut self, source: u16, sync_frame: &SyncFrame) {
        match self.heard.get_mut(usize::from(sync_frame.slot)) {
            Some(owner) => *owner = (hash(source), 0),
            None => {
                let bit = spread(source, 0, 128);
                let byte = &mut self.others[usize::from(bit / 8)];
                self.count[0] += u16::from(*byte >> (bit % 8) & 1 == 0);
                *byte |= 1 << (bit % 8);
            }
        }
        for (told, &owner) in self.told.iter_mut().zip(&sync_frame.slot_owners) {
            if owner != 0 {
                *told = (owner, 0);
            }
        }
        let Some(slot) = self.own else { return };
        let owner = sync_frame.slot_owners.get(usize::from(slot)).copied().unwrap_or(0);
        if owner == hash(self.address) {
            self.unconfirmed = 0;
        }
        self.is_contested |=
            owner != 0 && owner != hash(self.address) || sync_frame.slot == slot && source < self.address;
        if self.is_contested && self.tenure < SETTLED && !self.is_needed {
            self.leave();
        }
    }

    fn gives_way(&self, number: u16) -> bool {
        let least = if self.is_needed { CONTESTED + NEEDED } else { CONTESTED };
        self.contested >= least && u16::from(self.contested - least) >= spread(self.address, number, CONTESTED.into())
    }

    pub fn leave(&mut self) {
        (self.own, self.contested, self.is_contested) = (None, 0, false);
    }

    /// Whether a sync frame came in a slot of its sender's own, which the sender had before.
    pub fn is_known(&self, source: u16, sync_frame: &SyncFrame) -> bool {
        let owner = self.heard.get(usize::from(sync_frame.slot));
        is_own_slot(source, sync_frame) && owner.is_some_and(|(owner, _)| *owner == hash(source))
    }

    /// Whether another anchor is received in a slot of its own.
    pub fn has_neighbours(&self) -> bool {
        self.heard.iter().any(|(owner, _)| *owner != 0)
    }

    /// Whom this anchor receives in which slot, and itself.
    pub fn owners(&self) -> [u8; OWNED_SYNC_SLOTS] {
        let mut owners = self.heard.map(|(owner, _)| owner);
        if let Some(own) = self.own.and_then(|slot| owners.get_mut(usize::from(slot))) {
            *own = hash(self.address);
        }
        owners
    }

    /// Superframes have begun, up to `number`. This anchor has followed its network for `listened`.
    pub fn advance(&mut self, begun: u16, number: u16, listened: u16) {
        let superframes = begun.min(u8::MAX.into()) as u8;
        for (owner, unheard) in self.heard.iter_mut().chain(&mut self.told) {
            *unheard = unheard.saturating_add(superframes);
            if *unheard > SLOT_LEFT {
                *owner = 0;
            }
        }
        let others = self.count[0].max(self.count[1]);
        let first = FIRST_SHARED_EVERY.checked_shr((listened / FIRST_SHARED_EVERY).into()).unwrap_or(0);
        self.shared_every = (others + others / 3).max(first).max(SHARED_EVERY);
        self.counted = self.counted.saturating_add(begun);
        if self.counted >= COUNTED {
            (self.others, self.count, self.counted) = ([0; 16], [0, self.count[0]], 0);
        }
        self.tenure = self.tenure.saturating_add(superframes);
        self.unconfirmed = if self.has_neighbours() { self.unconfirmed.saturating_add(superframes) } else { 0 };
        let was_contested = core::mem::take(&mut self.is_contested);
        self.contested = if was_contested { self.contested + 1 } else { self.contested.saturating_sub(superframes) };
        if self.own.is_some() && (self.unconfirmed > UNCONFIRMED || self.gives_way(number)) {
            self.leave();
        }
        if self.own.is_none() && listened > 1 {
            self.own = self.pick(number, listened);
            (self.tenure, self.unconfirmed) = (0, 0);
        }
    }

    fn pick(&self, number: u16, listened: u16) -> Option<u8> {
        let free = |slot: &u8| {
            let slot = usize::from(*slot);
            self.heard[slot].0 == 0 && self.told[slot].0 == 0
        };
        let (first, all) = (self.first(), 0..OWNED_SYNC_SLOTS as u8);
        // An anchor that had to leave its slot draws one at random.
        if free(&first) && listened < 4 {
            return Some(first);
        }
        let count = all.clone().filter(free).count() as u16;
        if count == 0 && self.is_needed {
            return Some(spread(self.address, number, OWNED_SYNC_SLOTS as u16) as u8);
        }
        let is_in_turn = self.is_needed || count >= MANY_FREE || self.shared_at_random(number).is_some();
        all.filter(free).nth(spread(self.address, number, count).into()).filter(|_| is_in_turn)
    }

    /// The shared slot of an anchor that was too late for its own one, in superframe `number`.
    pub fn shared(&self, number: u16) -> u8 {
        (OWNED_SYNC_SLOTS as u16 + spread(self.address, number, SHARED_SLOTS as u16)) as u8
    }

    /// The shared slot of an anchor without a slot of its own, if it sends in superframe `number`.
    pub fn shared_at_random(&self, number: u16) -> Option<u8> {
        let choices = self.shared_every * SHARED_SLOTS as u16;
        let drawn = usize::from(spread(self.address, number, choices));
        (drawn < SHARED_SLOTS).then_some((OWNED_SYNC_SLOTS + drawn) as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::seq::SliceRandom;
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64;
    use std::vec::Vec;

    const OTHER: u16 = 77;

    /// A sync frame of anchor 50 in slot 9, which receives this one in a slot, or nobody.
    fn reporting(owner: Option<u16>, slot: u8) -> SyncFrame {
        let mut sync_frame = SyncFrame { slot: 9, ..crate::native::blank_sync_frame() };
        sync_frame.slot_owners[9] = hash(50);
        sync_frame.slot_owners[usize::from(slot)] = owner.map_or(0, hash);
        sync_frame
    }

    /// An anchor in its slot, which neighbours have confirmed for this many superframes.
    fn after(superframes: u16, is_needed: bool) -> (SyncSlot, u8) {
        let mut anchor = SyncSlot::new(3);
        anchor.is_needed = is_needed;
        (1..4).for_each(|number| anchor.advance(1, number, number));
        let slot = anchor.own().unwrap();
        assert_eq!(slot, 3);
        for number in 4..4 + superframes {
            anchor.receive(50, &reporting(Some(3), slot));
            anchor.advance(1, number, number);
        }
        (anchor, slot)
    }

    /// Superframes until it leaves its slot, in each of which these reports come.
    fn leaves_after(mut anchor: SyncSlot, slot: u8, reports: impl Fn(u16) -> Option<u16>) -> Option<u16> {
        (0..200).find(|&number| {
            anchor.receive(50, &reporting(reports(number), slot));
            let is_out = anchor.own().is_none();
            anchor.advance(1, 1000 + number, 1000 + number);
            is_out || anchor.own() != Some(slot)
        })
    }

    #[test]
    fn who_has_a_slot_for_long_stays_and_who_comes_later_leaves() {
        let always = |_| Some(OTHER);
        let (newcomer, slot) = after(5, false);
        assert_eq!(leaves_after(newcomer, slot, always), Some(0));
        let (settled, slot) = after(40, false);
        // After the fourth to the eighth superframe.
        let left = leaves_after(settled.clone(), slot, always).unwrap();
        assert!((3..8).contains(&left), "{left}");
        assert_eq!(
            leaves_after(settled.clone(), slot, |number| (number < 2).then_some(OTHER)),
            Some(19),
            "unconfirmed"
        );
        // A newcomer that another anchor reports now and then.
        let now_and_then = |number: u16| Some(if number.is_multiple_of(3) { OTHER } else { 3 });
        assert_eq!(leaves_after(settled, slot, now_and_then), None);
        let (gateway, slot) = after(0, true);
        let left = leaves_after(gateway, slot, always).unwrap();
        assert!((15..20).contains(&left), "{left}");
    }

    #[test]
    fn a_gateway_takes_a_slot_although_none_is_free() {
        let full = |slot: u8| SyncFrame { slot_owners: [hash(OTHER); 16], slot, ..crate::native::blank_sync_frame() };
        for is_needed in [false, true] {
            let mut anchor = SyncSlot::new(3);
            anchor.is_needed = is_needed;
            for number in 1..5 {
                anchor.receive(OTHER, &full(5));
                anchor.advance(1, number, number);
            }
            assert_eq!(anchor.own().is_some(), is_needed);
        }
    }

    /// Anchors, and whom each receives from how far, the nearest first.
    struct Site {
        anchors: Vec<SyncSlot>,
        hears: Vec<Vec<(f64, usize)>>,
        number: u16,
    }

    impl Site {
        /// On a square with sides of this many metres, with a reach of 30 m.
        fn new(anchors: usize, side_m: f64, seed: u64) -> Self {
            let mut rng = Pcg64::seed_from_u64(seed);
            let at: Vec<[f64; 2]> = (0..anchors).map(|_| [0, 1].map(|_| rng.random_range(0.0..side_m))).collect();
            let mut addresses: Vec<u16> = (1..=anchors as u16).collect();
            addresses.shuffle(&mut rng);
            let hears = at.iter().map(|a| {
                let distance = |other: usize| ((a[0] - at[other][0]).hypot(a[1] - at[other][1]), other);
                let mut hears: Vec<_> = (0..anchors).map(distance).collect();
                hears.retain(|(metres, _)| *metres > 0.0 && *metres < 30.0);
                hears.sort_by(|a, b| a.0.total_cmp(&b.0));
                hears
            });
            let hears = hears.collect();
            Self { anchors: addresses.into_iter().map(SyncSlot::new).collect(), hears, number: 0 }
        }

        /// Returns how many sync frames came in shared slots, and whom each anchor received in them.
        fn superframe(&mut self) -> Vec<Vec<u16>> {
            self.number += 1;
            let number = self.number;
            let mut shared = std::vec![Vec::new(); self.anchors.len()];
            self.anchors.iter_mut().for_each(|anchor| anchor.advance(1, number, number));
            for slot in 0..(OWNED_SYNC_SLOTS + SHARED_SLOTS) as u8 {
                let sent = |anchor: &SyncSlot| anchor.own().or(anchor.shared_at_random(number)) == Some(slot);
                let frames: Vec<Option<SyncFrame>> = self
                    .anchors
                    .iter()
                    .map(|anchor| {
                        let slot_owners = anchor.owners();
                        sent(anchor).then(|| SyncFrame { slot, slot_owners, ..crate::native::blank_sync_frame() })
                    })
                    .collect();
                for receiver in 0..self.anchors.len() {
                    // Who sends receives nothing. Of several frames the strongest survives, by 6 dB.
                    let mut sending = self.hears[receiver].iter().filter(|(_, other)| frames[*other].is_some());
                    let nearest = sending.next().filter(|_| frames[receiver].is_none());
                    let next_m = sending.next().map_or(f64::INFINITY, |(metres, _)| *metres);
                    if let Some(&(_, other)) = nearest.filter(|(metres, _)| next_m > 2.0 * metres) {
                        let (source, frame) = (self.anchors[other].address, frames[other].as_ref().unwrap());
                        self.anchors[receiver].receive(source, frame);
                        if usize::from(slot) >= OWNED_SYNC_SLOTS {
                            shared[receiver].push(source);
                        }
                    }
                }
            }
            shared
        }

        fn owners(&self) -> Vec<Option<u8>> {
            self.anchors.iter().map(SyncSlot::own).collect()
        }
    }

    #[test]
    fn sixteen_anchors_in_one_room_all_have_slots_within_two_seconds() {
        for seed in 0..8 {
            let mut site = Site::new(16, 10.0, seed);
            (0..20).for_each(|_| drop(site.superframe()));
            let mut slots: Vec<u8> = site.owners().into_iter().map(Option::unwrap).collect();
            slots.sort_unstable();
            assert!(slots.iter().copied().eq(0..16), "{seed}: {slots:?}");
        }
    }

    #[test]
    fn of_two_hundred_anchors_some_have_slots_for_long_and_all_others_are_received() {
        for seed in 0..3 {
            let mut site = Site::new(200, 80.0, seed);
            (0..300).for_each(|_| drop(site.superframe()));
            let before = site.owners();
            let mut received: Vec<std::collections::BTreeSet<u16>> = std::vec![Default::default(); 200];
            let mut frames = 0;
            for _ in 0..600 {
                for (received, sources) in received.iter_mut().zip(site.superframe()) {
                    frames += sources.len();
                    received.extend(sources);
                }
            }
            let after = site.owners();
            let owners = before.iter().flatten().count();
            let kept = before.iter().zip(&after).filter(|(before, after)| before.is_some() && before == after).count();
            assert!(owners >= 24 && kept * 10 >= owners * 9, "{seed}: {kept} of {owners}");
            // Every anchor receives one with a slot, so it knows the time.
            let has_parent = |hears: &Vec<(f64, usize)>| hears.iter().any(|(_, other)| after[*other].is_some());
            assert!(site.hears.iter().all(has_parent));
            // They are to receive three quarters of a frame a superframe; where two collide none.
            let mean = frames as f64 / 600.0 / 200.0;
            assert!((0.4..1.2).contains(&mean), "{seed}: {mean}");
            let without: Vec<usize> = (0..200).filter(|&at| before[at].is_none() && after[at].is_none()).collect();
            for &at in &without {
                let by = (0..200).filter(|&by| received[by].contains(&site.anchors[at].address)).count();
                assert!(by * 2 > site.hears[at].len(), "{seed}: {by} of {}", site.hears[at].len());
            }
        }
    }
}
