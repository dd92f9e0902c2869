//! What an anchor's next sync frames say of leases.

use heapless::Deque;

use wire::uwb::native::{Lease, LeasedPoll, SyncFrame};

/// Sync frames that contain a new lease, one that is kept, a refusal, and the end of a lease.
const REPETITIONS: [u8; 4] = [2, 1, 2, 3];
/// Entries that wait for a sync frame, and polls that do.
const MAX_OUTGOING: usize = 64;
const MAX_PASSED_ON: usize = 32;
/// No refusal is added if this many entries wait already.
const MAX_REFUSALS: usize = 8;

/// Entries and polls that wait for sync frames.
#[derive(Clone, Debug)]
pub struct LeaseNews {
    /// The entries, and how often each is to be sent.
    outgoing: Deque<(Lease, u8), MAX_OUTGOING>,
    polls: Deque<LeasedPoll, MAX_PASSED_ON>,
}

impl LeaseNews {
    /// None.
    pub const fn new() -> Self {
        Self { outgoing: Deque::new(), polls: Deque::new() }
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.outgoing.clear();
        self.polls.clear();
    }

    /// Whether there is no room for an entry.
    pub fn is_full(&self) -> bool {
        self.outgoing.is_full()
    }

    /// Refusals leave room for all other entries.
    pub fn has_room_for_refusals(&self) -> bool {
        self.outgoing.len() < MAX_REFUSALS
    }

    /// Puts an entry into the next sync frames. Returns false if there is no room.
    pub fn announce(&mut self, lease: Lease) -> bool {
        self.outgoing.push_back((lease, REPETITIONS[lease.grant as usize])).is_ok()
    }

    /// Whether the next sync frames contain an entry.
    pub fn is_announced(&self, lease: &Lease) -> bool {
        self.outgoing.iter().any(|(known, _)| known == lease)
    }

    /// The same as [`announce`](Self::announce), unless the next sync frames contain it already.
    pub fn announce_once(&mut self, lease: Lease) {
        if !self.is_announced(&lease) {
            self.announce(lease);
        }
    }

    /// Passes a poll on. Without room for it the tag's next poll is passed on.
    pub fn pass_on(&mut self, poll: LeasedPoll) {
        if !self.polls.iter().any(|known| known.tag == poll.tag) {
            let _ = self.polls.push_back(poll);
        }
    }

    /// Fills a sync frame with what fits into it.
    pub fn fill(&mut self, sync_frame: &mut SyncFrame) {
        for _ in 0..self.polls.len().min(sync_frame.room_for_news().1) {
            // As many as fit.
            let _ = self.polls.pop_front().map(|poll| sync_frame.polls.push(poll));
        }
        for _ in 0..self.outgoing.len().min(sync_frame.room_for_news().0) {
            let Some((lease, times)) = self.outgoing.pop_front() else { return };
            let _ = sync_frame.leases.push(lease);
            if times > 1 {
                let _ = self.outgoing.push_back((lease, times - 1));
            }
        }
    }
}
