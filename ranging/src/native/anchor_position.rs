//! Which position a tag accepts for an anchor that it receives.
//!
//! An anchor's sync frame contains its position. Sync frames are not authenticated: anybody can send one with an
//! anchor's address. Such a sync frame must not move a known anchor. So these rules hold as long as the tag follows one
//! network without losing it (a session):
//!
//! - the tag accepts and keeps the position of a sync frame that came in the anchor's own slot; a position that came in
//!   a shared slot is used only until then;
//! - the tag ignores the position of a sync frame with another position, and counts it;
//! - the tag accepts a moved anchor once the anchor's own slot has contained the same new position [`MOVED_AFTER`]
//!   times and never the old one in between, or once the anchor was forgotten because it was silent.
//!
//! So a false position is possible only for a silent anchor, or in a tag that has just started.

use wire::uwb::native::{Position, SyncFrame};

/// Two positions are the same if they differ by less than this in each axis, metres. Anchors report positions in
/// millimetres.
const SAME_M: f32 = 0.01;
/// An anchor was moved if its own slot has contained the new position this many times: two seconds at 6.81 Mbit/s.
pub const MOVED_AFTER: u8 = 20;

/// What an anchor has reported of its position.
#[derive(Clone, Copy, Debug, Default)]
pub struct AnchorPosition {
    believed_m: Option<[f32; 3]>,
    /// The anchor's own slot contained the position in this session.
    is_settled: bool,
    /// Another position that the anchor's own slot has contained since …
    other_m: Option<[f32; 3]>,
    /// … this many times.
    repetitions: u8,
}

impl AnchorPosition {
    /// The accepted position, metres.
    pub const fn metres(&self) -> Option<[f32; 3]> {
        self.believed_m
    }

    /// A sync frame of the anchor contains this position. Returns whether it agrees with the accepted one.
    pub fn receive(&mut self, told: Option<Position>, is_own_slot: bool) -> bool {
        // A sync frame without a position contradicts nothing.
        let Some(told_m) = told.map(Position::metres) else { return true };
        let agrees = self.believed_m.is_none_or(|believed_m| is_same(believed_m, told_m));
        if agrees || !self.is_settled && is_own_slot {
            // The first position stays: small steps would add up.
            self.believed_m = self.believed_m.filter(|_| agrees).or(Some(told_m));
            if is_own_slot {
                *self = Self { believed_m: self.believed_m, is_settled: true, other_m: None, repetitions: 0 };
            }
            return true;
        }
        if is_own_slot {
            let is_repeated = self.other_m.is_some_and(|other_m| is_same(other_m, told_m));
            self.repetitions = if is_repeated { self.repetitions.saturating_add(1) } else { 1 };
            self.other_m = self.other_m.filter(|_| is_repeated).or(Some(told_m));
            if self.repetitions >= MOVED_AFTER {
                *self = Self { believed_m: self.other_m, is_settled: true, other_m: None, repetitions: 0 };
                return true;
            }
        }
        false
    }

    /// The network was lost: the position of the next own slot is accepted, whatever it is.
    pub fn end_session(&mut self) {
        self.is_settled = false;
    }
}

fn is_same(a: [f32; 3], b: [f32; 3]) -> bool {
    a.into_iter().zip(b).all(|(a, b)| (a - b).abs() <= SAME_M)
}

/// A byte that represents an address in sync frames; never 0.
pub fn hash(address: u16) -> u8 {
    (address % 255) as u8 + 1
}

/// Whether a sync frame came in a slot that belongs to its sender, according to the sync frame itself. Shared slots
/// belong to no anchor.
pub fn is_own_slot(source: u16, sync_frame: &SyncFrame) -> bool {
    sync_frame.slot_owners.get(usize::from(sync_frame.slot)) == Some(&hash(source))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f32) -> Option<Position> {
        Position::from_metres([x, 2.0, 3.0])
    }

    #[test]
    fn a_shared_slot_serves_until_the_own_one_is_heard_and_moves_nothing_then() {
        let mut position = AnchorPosition::default();
        assert!(position.receive(at(9.0), false));
        assert_eq!(position.metres(), Some([9.0, 2.0, 3.0]));
        assert!(position.receive(at(1.0), true));
        assert_eq!(position.metres(), Some([1.0, 2.0, 3.0]));
        for _ in 0..200 {
            assert!(!position.receive(at(9.0), false));
        }
        assert!(position.receive(None, true));
        assert_eq!(position.metres(), Some([1.0, 2.0, 3.0]));
    }

    #[test]
    fn steps_below_a_centimetre_do_not_add_up() {
        let mut position = AnchorPosition::default();
        let steps = [0.0, 0.008, 0.016, 0.024].map(|x| position.receive(at(x), true));
        assert_eq!(steps, [true, true, false, false]);
        assert_eq!(position.metres(), Some([0.0, 2.0, 3.0]));
    }

    #[test]
    fn a_moved_anchor_is_believed_once_it_insists_and_the_old_position_is_told_no_more() {
        let mut position = AnchorPosition::default();
        position.receive(at(1.0), true);
        // The old position comes in between: the anchor never moves.
        for _ in 0..10 * MOVED_AFTER {
            assert!(!position.receive(at(6.0), true));
            assert!(position.receive(at(1.0), true));
        }
        // Another position each time: none is accepted.
        for i in 0..10 * MOVED_AFTER {
            assert!(!position.receive(at(5.0 + f32::from(i)), true));
        }
        let believed = (0..MOVED_AFTER).filter(|_| position.receive(at(6.0), true)).count();
        assert_eq!((believed, position.metres()), (1, Some([6.0, 2.0, 3.0])));
    }

    #[test]
    fn a_new_session_believes_the_first_own_slot() {
        let mut position = AnchorPosition::default();
        position.receive(at(1.0), true);
        position.end_session();
        assert!(!position.receive(at(6.0), false));
        assert!(position.receive(at(6.0), true));
        assert_eq!(position.metres(), Some([6.0, 2.0, 3.0]));
    }
}
