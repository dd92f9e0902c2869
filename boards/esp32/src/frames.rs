//! A queue of bytes for a port that is slower than its writers. Each frame goes in whole or not at all.

use heapless::Deque;

/// A queue of `N` bytes.
pub struct Frames<const N: usize> {
    bytes: Deque<u8, N>,
    /// The bytes of the frame that is being written.
    open: usize,
    /// There was no room for that frame.
    spoiled: bool,
    /// The number of frames without room. It wraps.
    dropped: u32,
}

impl<const N: usize> Frames<N> {
    /// An empty queue.
    pub const fn new() -> Self {
        Self { bytes: Deque::new(), open: 0, spoiled: false, dropped: 0 }
    }

    /// Writes a piece of a frame.
    pub fn write(&mut self, bytes: &[u8]) {
        if self.spoiled || self.bytes.capacity() - self.bytes.len() < bytes.len() {
            self.spoiled = true;
            return;
        }
        self.open += bytes.len();
        // There is room, as checked above.
        self.bytes.extend(bytes.iter().copied());
    }

    /// Ends a frame. Returns whether the frame is in the queue.
    pub fn end(&mut self) -> bool {
        let whole = !self.spoiled;
        if !whole {
            for _ in 0..self.open {
                self.bytes.pop_back();
            }
            self.dropped = self.dropped.wrapping_add(1);
        }
        self.open = 0;
        self.spoiled = false;
        whole
    }

    /// Takes the oldest bytes, as many as there are and as fit into `into`. Returns their number. Must not be called
    /// while a frame is being written.
    pub fn take(&mut self, into: &mut [u8]) -> usize {
        let mut taken = 0;
        for (place, byte) in into.iter_mut().zip(core::iter::from_fn(|| self.bytes.pop_front())) {
            *place = byte;
            taken += 1;
        }
        taken
    }

    /// The number of frames without room. It wraps.
    pub fn dropped(&self) -> u32 {
        self.dropped
    }
}

impl<const N: usize> Default for Frames<N> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_come_out_as_they_went_in() {
        let mut frames = Frames::<8>::new();
        frames.write(b"ab");
        frames.write(b"c");
        assert!(frames.end());
        frames.write(b"de");
        assert!(frames.end());
        let mut out = [0; 4];
        assert_eq!((frames.take(&mut out), &out), (4, b"abcd"));
        assert_eq!((frames.take(&mut out), out[0]), (1, b'e'));
        assert_eq!(frames.take(&mut out), 0);
    }

    #[test]
    fn a_frame_without_room_leaves_nothing_and_is_counted() {
        let mut frames = Frames::<8>::new();
        frames.write(b"abcdef");
        assert!(frames.end());
        // Two bytes fit, the third does not. Later bytes of the same frame that would fit are dropped too.
        frames.write(b"gh");
        frames.write(b"i");
        frames.write(b"");
        assert!(!frames.end());
        assert_eq!(frames.dropped(), 1);
        frames.write(b"jk");
        assert!(frames.end());
        let mut out = [0; 16];
        let taken = frames.take(&mut out);
        assert_eq!(&out[..taken], b"abcdefjk");
    }

    #[test]
    fn no_byte_is_taken_from_the_queue_that_has_no_place() {
        let mut frames = Frames::<8>::new();
        frames.write(b"ab");
        assert!(frames.end());
        assert_eq!(frames.take(&mut []), 0);
        let mut out = [0; 1];
        frames.take(&mut out);
        frames.take(&mut out);
        assert_eq!(out, *b"b");
    }
}
