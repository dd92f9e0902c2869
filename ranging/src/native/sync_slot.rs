//! In which sync slot an anchor sends.
//!
//! An anchor takes a slot in which no other one was received or reported: each sync frame reports whom its sender receives
//! in which slot. So slots are used again by anchors that no third one receives both. Two anchors that send at the same time
//! do not receive each other: an anchor leaves its slot if its neighbours report another one in it, or do not report it
//! there for long. One that has had its slot for long leaves it later than one that has just chosen it, so that who comes
//! last goes. (Anchors whose addresses differ by a multiple of 255 look like one in such reports.)
//!
//! Where there are more anchors than slots, the others send in the shared slots, at random, and as seldom as there are many
//! of them: each sends more often while it receives less than [`SHARED_TARGET`] of others, and less often while it receives
//! more. It begins seldom, because too many at once receive nothing of each other.

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
/// … leaves it when others were reported in it in so many superframes more than not, or in up to as many more.
const CONTESTED: u8 = 4;
/// One that others need stays longer than others, by so many.
const NEEDED: u8 = 12;
/// If fewer slots are free, an anchor takes one only in a superframe in which it would send in a shared slot: if all that wait
/// took the next free one, none would get it.
const MANY_FREE: u16 = 4;
/// Without a slot of its own, it sends in one superframe of this many at most, and at first, and at least.
const SHARED_EVERY: [u32; 3] = [4, 32, 256];
/// Sync frames of others in shared slots that an anchor receives in a superframe, in sixteenths, if all send as often as
/// they should. Slotted ALOHA has its peak at one a slot.
const SHARED_TARGET: u32 = 12;
/// How quickly that is reached: the part of the interval by which it changes in a superframe.
const SHARED_STEP: u32 = 32;

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
    /// Without a slot of its own, the anchor sends in one superframe of this many, in 1/256.
    shared_every: u32,
    /// Sync frames in shared slots in this superframe.
    heard_shared: u8,
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
            shared_every: SHARED_EVERY[1] << 8,
            heard_shared: 0,
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

    /// A sync frame of the same network came.
    pub fn receive(&mut self, source: u16, sync_frame: &SyncFrame) {
        match self.heard.get_mut(usize::from(sync_frame.slot)) {
            Some(owner) => *owner = (hash(source), 0),
            None => self.heard_shared = self.heard_shared.saturating_add(1),
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

    fn leave(&mut self) {
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
        let heard = u32::from(core::mem::take(&mut self.heard_shared));
        let [least, _, most] = SHARED_EVERY.map(|every| every << 8);
        let every = self.shared_every * (16 * (SHARED_STEP + heard) - SHARED_TARGET) / (16 * SHARED_STEP);
        self.shared_every = every.clamp(least, most);
        self.tenure = self.tenure.saturating_add(superframes);
        self.unconfirmed = if self.has_neighbours() { self.unconfirmed.saturating_add(superframes) } else { 0 };
        let was_contested = core::mem::take(&mut self.is_contested);
        self.contested = if was_contested { self.contested + 1 } else { self.contested.saturating_sub(superframes) };
        let most = CONTESTED + spread(self.address, number, CONTESTED.into()) as u8;
        let most = if self.is_needed { most + NEEDED } else { most };
        if self.own.is_some() && (self.unconfirmed > UNCONFIRMED || self.contested >= most) {
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
        let choices = (self.shared_every >> 8) as u16 * SHARED_SLOTS as u16;
        let drawn = usize::from(spread(self.address, number, choices));
        (drawn < SHARED_SLOTS).then_some((OWNED_SYNC_SLOTS + drawn) as u8)
    }
}
