//! Whether a host reads what a node reports: such an anchor is a gateway for others.

use core::cell::Cell;
use core::sync::atomic::{AtomicBool, Ordering};

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::RawMutex;
use wire::uwb::native::Downlink;

/// A channel to a host. Writing never waits, nor does reading.
pub trait HostChannel {
    /// Writes a whole frame, or nothing if there is no room now. Returns whether it was written.
    fn write(&mut self, frame: &[u8]) -> bool;

    /// Whether the host has read all that was written. Never, of a channel that cannot know.
    fn is_read(&self) -> bool;

    /// Reads bytes of the host's messages to tags. Returns how many there were.
    fn read(&mut self, into: &mut [u8]) -> usize;
}

/// A host that has not read a frame for this long is gone, microseconds.
const PATIENCE_US: u64 = 1_000_000;

/// The host, for a `static`: whether it is there, and what it wants to tell tags.
pub struct Host<M: RawMutex> {
    is_there: AtomicBool,
    has_message: AtomicBool,
    message: Mutex<M, Cell<Option<Downlink>>>,
}

impl<M: RawMutex> Host<M> {
    /// None.
    pub const fn new() -> Self {
        Self {
            is_there: AtomicBool::new(false),
            has_message: AtomicBool::new(false),
            message: Mutex::new(Cell::new(None)),
        }
    }

    /// Whether it is there.
    pub fn is_there(&self) -> bool {
        self.is_there.load(Ordering::Relaxed)
    }

    /// It is there, or not.
    pub fn set(&self, is_there: bool) {
        self.is_there.store(is_there, Ordering::Relaxed);
    }

    /// Whether the exchange has not taken the host's last message to a tag yet.
    pub fn has_message(&self) -> bool {
        self.has_message.load(Ordering::Relaxed)
    }

    /// The host tells a tag something, in place of what the exchange has not taken yet.
    pub fn put(&self, message: Downlink) {
        self.message.lock(|place| place.set(Some(message)));
        self.has_message.store(true, Ordering::Relaxed);
    }

    /// Takes the message to a tag. It costs next to nothing as long as there is none.
    #[inline]
    pub fn message(&self) -> Option<Downlink> {
        if self.has_message() { self.take_message() } else { None }
    }

    #[cold]
    #[inline(never)]
    fn take_message(&self) -> Option<Downlink> {
        self.has_message.store(false, Ordering::Relaxed);
        self.message.lock(Cell::take)
    }
}

impl<M: RawMutex> Default for Host<M> {
    fn default() -> Self {
        Self::new()
    }
}

/// Finds out whether a host reads a channel.
#[derive(Debug, Default)]
pub struct HostWatch {
    is_there: bool,
    /// Something was written since the last look.
    has_written: bool,
    /// When the channel was first seen with something that nobody had read.
    unread_since_us: Option<u64>,
}

impl HostWatch {
    /// Looks at the channel, before more is written. Returns whether a host is there.
    pub fn look(&mut self, now_us: u64, is_read: bool) -> bool {
        if is_read {
            // An empty channel shows a reader only if something was in it.
            self.is_there |= core::mem::take(&mut self.has_written);
            self.unread_since_us = None;
        } else {
            let since_us = *self.unread_since_us.get_or_insert(now_us);
            self.is_there &= now_us.saturating_sub(since_us) < PATIENCE_US;
        }
        self.is_there
    }

    /// A frame was written.
    pub fn note_write(&mut self) {
        self.has_written = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_is_there_once_it_has_read_and_gone_when_a_frame_waits_for_a_second() {
        let mut watch = HostWatch::default();
        // Nothing was written yet, and then nobody reads it.
        assert!(!watch.look(0, true));
        watch.note_write();
        assert!(!watch.look(10_000, false) && !watch.look(5_000_000, false));
        assert!(watch.look(5_010_000, true), "it was read");
        assert!(watch.look(9_000_000, true), "nothing new");
        watch.note_write();
        // Others follow, none is read.
        assert!(watch.look(9_010_000, false) && watch.look(10_000_000, false));
        watch.note_write();
        assert!(!watch.look(10_010_000, false) && !watch.look(60_000_000, false));
        assert!(watch.look(60_010_000, true), "plugged in again");
    }

    #[test]
    fn a_host_that_reads_before_every_look_is_there() {
        let mut watch = HostWatch::default();
        watch.note_write();
        assert!(watch.look(10_000, true));
    }
}
