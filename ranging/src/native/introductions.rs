//! Anchors without a sync slot of their own, whose positions those with one say in their sync frames.
//!
//! Such an anchor sends seldom, so most tags never receive its sync frames. They learn of it from its neighbours, and ask it
//! in their rounds as any other.

use heapless::Vec;

use super::spread;
use wire::serial_number::SerialNumber;
use wire::uwb::native::{AnchorAt, OWNED_SYNC_SLOTS, SyncFrame};

/// Anchors that are remembered. Of more, the one that was silent for longest is forgotten, …
const MAX_KNOWN: usize = 16;
/// … and each that was silent for this many superframes: more than two times as long as an anchor sends least often.
const FORGOTTEN_AFTER: u16 = 600;
/// One sync frame in this many says where another anchor is.
const EVERY: u16 = 4;

/// The anchors without a slot that this one receives.
#[derive(Clone, Debug)]
pub struct Introductions {
    known: Vec<(AnchorAt, u16), MAX_KNOWN>,
    turn: usize,
}

impl Introductions {
    /// None.
    pub const fn new() -> Self {
        Self { known: Vec::new(), turn: 0 }
    }

    /// A sync frame of the same network came.
    #[inline(never)]
    pub fn receive(&mut self, source: u16, sync_frame: &SyncFrame) {
        let number = sync_frame.superframe;
        if usize::from(sync_frame.slot) < OWNED_SYNC_SLOTS && self.known.is_empty() {
            return;
        }
        self.known.retain(|(anchor, heard)| {
            anchor.address != source && SerialNumber(number).steps_from(*heard) <= FORGOTTEN_AFTER
        });
        let Some(position) = sync_frame.position.filter(|_| usize::from(sync_frame.slot) >= OWNED_SYNC_SLOTS) else {
            return;
        };
        if self.known.is_full() {
            // In the order in which they came.
            self.known.remove(0);
        }
        let _ = self.known.push((AnchorAt { address: source, position }, number));
    }

    /// Puts one of them into a sync frame of the anchor with this address, now and then, if there is room.
    #[inline(never)]
    pub fn fill(&mut self, address: u16, sync_frame: &mut SyncFrame) {
        // Most anchors know none.
        if self.known.is_empty()
            || spread(address, sync_frame.superframe, EVERY) > 0
            || sync_frame.room() < AnchorAt::BYTES
        {
            return;
        }
        self.turn = (self.turn + 1) % self.known.len();
        sync_frame.neighbour = self.known.get(self.turn).map(|(anchor, _)| *anchor);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::uwb::native::Position;

    fn told(slot: u8, superframe: u16, x_m: f32) -> SyncFrame {
        let position = Position::from_metres([x_m, 0.0, 0.0]);
        SyncFrame { slot, superframe, position, ..crate::native::blank_sync_frame() }
    }

    /// The anchors that are named in 200 superframes from this one on.
    fn named(introductions: &mut Introductions, from: u16) -> std::vec::Vec<u16> {
        let mut named: std::vec::Vec<u16> = (0..200)
            .filter_map(|i| {
                let mut sync_frame = told(1, from.wrapping_add(i), 0.0);
                introductions.fill(9, &mut sync_frame);
                sync_frame.neighbour.map(|anchor| anchor.address)
            })
            .collect();
        // A quarter of the sync frames; 200 · ¼ · ¾ = 6².
        assert!(named.is_empty() || (50_usize).abs_diff(named.len()) < 4 * 6, "{named:?}");
        named.sort_unstable();
        named.dedup();
        named
    }

    #[test]
    fn anchors_in_shared_slots_are_named_until_they_have_a_slot_or_are_silent() {
        let mut introductions = Introductions::new();
        assert!(named(&mut introductions, 65_500).is_empty());
        for (address, slot) in [(1, 3), (2, 16), (3, 19), (2, 17)] {
            introductions.receive(address, &told(slot, 65_500, f32::from(address)));
        }
        assert_eq!(named(&mut introductions, 65_500), [2, 3]);
        introductions.receive(3, &told(4, 65_510, 3.0));
        assert_eq!(named(&mut introductions, 65_510), [2]);
        // 65500 + 600 = 564 after the wrap.
        introductions.receive(5, &told(4, 564, 0.0));
        assert_eq!(named(&mut introductions, 564), [2]);
        introductions.receive(5, &told(4, 565, 0.0));
        assert!(named(&mut introductions, 565).is_empty());
        // Of 20 the last 16, and none without a position.
        (10..30).for_each(|address| introductions.receive(address, &told(16, 565, 0.0)));
        introductions.receive(30, &SyncFrame { position: None, ..told(16, 565, 0.0) });
        assert_eq!(named(&mut introductions, 566), (14..30).collect::<std::vec::Vec<_>>());
    }

    #[test]
    fn a_full_sync_frame_names_none() {
        let mut introductions = Introductions::new();
        introductions.receive(2, &told(16, 0, 0.0));
        let relay = |bytes: usize| {
            use wire::uwb::native::{Carried, Relay, Relayed, UserData};
            let data = UserData::new(0, &[0; 24][..bytes]).unwrap();
            let entry = Relayed { tag: 0, round: 0, at: 0, asked: 0, content: Carried::Data(data) };
            Some(Relay {
                cost: 8,
                next: 0,
                taken: 0,
                taken_frames: 0,
                heard: 0,
                entries: [entry; 2].into_iter().collect(),
            })
        };
        // 119 − 56 bytes, minus 4 and two entries of 9 + 15: eleven are left, or with one more byte each nine.
        for (bytes, names) in [(15, true), (16, false)] {
            let any = (0..50).any(|number| {
                let mut sync_frame = SyncFrame { relay: relay(bytes), ..told(1, number, 0.0) };
                introductions.fill(9, &mut sync_frame);
                sync_frame.neighbour.is_some()
            });
            assert_eq!(any, names, "{bytes} bytes");
        }
    }
}
