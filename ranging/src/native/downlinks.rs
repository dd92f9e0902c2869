//! Messages of hosts to tags, on their way from a gateway through all anchors to the tag.
//!
//! An anchor that learns of a message keeps it, and repeats it in its next sync frame, unless three others have done so: so
//! it goes from anchor to anchor, and to tags that listen. A tag that sleeps asks some anchor sooner or later. The anchor's
//! response says that a message waits, and its next two sync frames carry it. The tag's answer, in a poll, ends it at each
//! anchor that receives the poll; elsewhere it ends after ten minutes. Each anchor keeps one message a tag, the newest.

use heapless::Vec;

use wire::serial_number::SerialNumber;
use wire::uwb::native::{Downlink, MAX_RELAYED, Relayed, SyncFrame, UserData};

/// Messages that an anchor keeps. In a full store the one that has least time left gives way.
const MAX_WAITING: usize = 8;
/// Own sync frames that carry a message after a poll of its tag.
const REPETITIONS: u8 = 2;
/// A message that is new here need not be passed on if so many others have done so.
const ENOUGH: u8 = 3;
/// A message is kept for this many superframes: ten minutes at 6.81 Mbit/s. A tag polls once in 8.3 minutes at least.
const KEPT_SUPERFRAMES: u16 = 6_000;
/// A message with so much more left than another one to the same tag is newer: clocks and hops make less.
const NEWER_BY: u16 = 8;

/// The messages that an anchor keeps.
#[derive(Clone, Debug)]
pub struct Downlinks {
    waiting: Vec<Waiting, MAX_WAITING>,
    /// The present superframe.
    number: u16,
}

#[derive(Clone, Copy, Debug)]
struct Waiting {
    message: Downlink,
    /// Own sync frames that are to carry it.
    sendings: u8,
    /// Sync frames of others that carried it.
    heard: u8,
}

impl Downlinks {
    /// None.
    pub const fn new() -> Self {
        Self { waiting: Vec::new(), number: 0 }
    }

    /// Another network is followed, or the time is lost.
    pub fn clear(&mut self) {
        self.waiting.clear();
    }

    #[inline(never)]
    fn advance(&mut self, number: u16) {
        let begun = SerialNumber(number).steps_from(core::mem::replace(&mut self.number, number));
        self.waiting.retain_mut(|waiting| {
            waiting.message.left = waiting.message.left.saturating_sub(begun);
            waiting.message.left > 0
        });
    }

    /// The gateway's host sends a message.
    pub fn send(&mut self, message: Downlink, gateway: u16) {
        self.keep(Downlink { gateway, left: KEPT_SUPERFRAMES, ..message });
    }

    /// A sync frame may have messages that are new here.
    #[inline(never)]
    pub fn receive(&mut self, sync_frame: &SyncFrame) {
        let Some(relay) = &sync_frame.relay else { return };
        for message in relay.entries.iter().filter_map(Relayed::downlink) {
            self.advance(sync_frame.superframe);
            let left = message.left.min(KEPT_SUPERFRAMES);
            match self.waiting.iter_mut().find(|known| known.message.tag == message.tag) {
                Some(known) if left <= known.message.left.saturating_add(NEWER_BY) => {
                    known.heard = known.heard.saturating_add(1);
                    if known.heard == ENOUGH {
                        known.sendings = 0;
                    }
                }
                _ => self.keep(Downlink { left, ..message }),
            }
        }
    }

    #[inline(never)]
    fn keep(&mut self, message: Downlink) {
        self.waiting.retain(|known| known.message.tag != message.tag);
        if self.waiting.is_full() {
            let least = (0..self.waiting.len()).min_by_key(|&place| self.waiting[place].message.left);
            least.map(|place| self.waiting.remove(place));
        }
        // There is a place now.
        let _ = self.waiting.push(Waiting { message, sendings: 1, heard: 0 });
    }

    /// A tag polled, with these data. Returns whether a message to it waits, which the next sync frames carry if it is this
    /// anchor's turn.
    #[inline(never)]
    pub fn on_poll(&mut self, tag: u16, data: Option<&UserData>, is_in_turn: bool) -> bool {
        let Some(place) = self.waiting.iter().position(|waiting| waiting.message.tag == tag) else { return false };
        let answered = data.filter(|data| data.answer().is_some()).map(UserData::number);
        if answered == Some(self.waiting[place].message.data.number()) {
            self.waiting.remove(place);
            return false;
        }
        if is_in_turn {
            self.waiting[place].sendings = REPETITIONS;
        }
        is_in_turn
    }

    /// Puts a message into a sync frame that says the way to a gateway.
    #[inline(never)]
    pub fn fill(&mut self, sync_frame: &mut SyncFrame) {
        self.advance(sync_frame.superframe);
        let room = sync_frame.room();
        let Some(relay) = sync_frame.relay.as_mut().filter(|relay| relay.entries.len() < MAX_RELAYED) else { return };
        // Those that were sent less often come first.
        let due = self.waiting.iter_mut().filter(|waiting| waiting.sendings > 0).max_by_key(|waiting| waiting.sendings);
        let Some(due) = due else { return };
        let entry = Relayed::from(due.message);
        if entry.bytes() <= room && relay.entries.push(entry).is_ok() {
            due.sendings -= 1;
        }
    }
}
