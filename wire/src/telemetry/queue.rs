//! Frames that wait for the channel: whole ones, in order. When there is no room, the oldest are dropped.
//!
//! A ring in which no frame is split: a frame that does not fit before the end of the buffer goes to its beginning. A
//! frame ends at its zero, so the ring stores nothing but the frames.

use crate::telemetry::MAX_FRAME;

/// Frames in `BYTES` bytes, at least [`MAX_FRAME`].
#[derive(Clone, Debug)]
pub struct Queue<const BYTES: usize> {
    bytes: [u8; BYTES],
    /// Beginning of the oldest frame.
    front: usize,
    /// Position of the next frame.
    back: usize,
    /// The end of the frames at the end of the buffer, while newer ones are at its beginning.
    seam: Option<usize>,
    frames: usize,
    dropped: u32,
}

impl<const BYTES: usize> Default for Queue<BYTES> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const BYTES: usize> Queue<BYTES> {
    /// Empty.
    pub const fn new() -> Self {
        const { assert!(BYTES >= MAX_FRAME, "one frame must fit") };
        Self { bytes: [0; BYTES], front: 0, back: 0, seam: None, frames: 0, dropped: 0 }
    }

    /// Appends a frame as [`encode`](crate::telemetry::encode) makes it, and drops the oldest frames if it needs their
    /// room. To make one takes 4,000 instructions, to append it takes few: so a node locks the queue for this alone.
    pub fn push(&mut self, frame: &[u8]) {
        if frame.len() > BYTES {
            self.dropped = self.dropped.wrapping_add(1);
            return;
        }
        let place = loop {
            if let Some(place) = self.place(frame.len()) {
                break place;
            }
            self.pop();
            self.dropped = self.dropped.wrapping_add(1);
        };
        for (to, from) in self.bytes.iter_mut().skip(place).zip(frame) {
            *to = *from;
        }
        self.back = place + frame.len();
        self.frames += 1;
    }

    /// The position for a frame of this length that touches no other frame.
    fn place(&mut self, length: usize) -> Option<usize> {
        if self.frames == 0 {
            (self.front, self.seam) = (0, None);
            return Some(0);
        }
        if self.seam.is_some() {
            return (self.back + length <= self.front).then_some(self.back);
        }
        if self.back + length <= BYTES {
            return Some(self.back);
        }
        (length <= self.front).then(|| {
            self.seam = Some(self.back);
            0
        })
    }

    /// The oldest frame, with its final zero.
    pub fn front(&self) -> Option<&[u8]> {
        if self.frames == 0 {
            return None;
        }
        let waiting = self.bytes.get(self.front..)?;
        waiting.split_inclusive(|byte| *byte == 0).next()
    }

    /// Removes the oldest frame: it has been sent.
    pub fn pop(&mut self) {
        let Some(length) = self.front().map(<[u8]>::len) else { return };
        self.front += length;
        self.frames -= 1;
        if self.seam == Some(self.front) {
            (self.front, self.seam) = (0, None);
        }
    }

    /// How many frames wait.
    pub fn len(&self) -> usize {
        self.frames
    }

    /// Whether no frame waits.
    pub fn is_empty(&self) -> bool {
        self.frames == 0
    }

    /// Frames dropped since the start; wraps.
    pub fn dropped(&self) -> u32 {
        self.dropped
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;
    use crate::telemetry::{Condition, Message, State, decode, encode};

    fn push(queue: &mut Queue<100>, t_us: u64) {
        let message = Message::State(State { t_us, is: Condition::Searching });
        queue.push(encode(&message, &mut [0; MAX_FRAME]));
    }

    /// The time of the oldest message.
    fn oldest(queue: &Queue<100>) -> Option<u64> {
        queue.front().map(|frame| decode(frame).expect("a whole frame").t_us())
    }

    #[test]
    fn frames_come_out_in_the_order_in_which_they_came() {
        let mut queue = Queue::<100>::new();
        assert_eq!((queue.front(), queue.len()), (None, 0));
        (1..=3).for_each(|t_us| push(&mut queue, t_us));
        for t_us in 1..=3 {
            assert_eq!(oldest(&queue), Some(t_us));
            queue.pop();
        }
        queue.pop();
        assert!(queue.is_empty() && queue.front().is_none() && queue.dropped() == 0);
    }

    #[test]
    fn a_full_queue_drops_the_oldest_and_counts_them() {
        let mut queue = Queue::<100>::new();
        (0..120).for_each(|t_us| push(&mut queue, t_us));
        // Schema, variant, time, condition, checksum, COBS, zero: 8 bytes each, 12 in a hundred.
        assert_eq!((queue.len(), queue.dropped(), oldest(&queue)), (12, 108, Some(108)));
    }

    #[test]
    fn what_can_never_fit_is_counted_and_nothing_else_is_lost() {
        let mut queue = Queue::<100>::new();
        push(&mut queue, 7);
        queue.push(&[1; 101]);
        assert_eq!((queue.len(), queue.dropped(), oldest(&queue)), (1, 1, Some(7)));
    }

    proptest! {
        /// For any order of pushes and pops, the newest frames remain, in order, and each lost one is counted.
        #[test]
        fn nothing_is_lost_uncounted(steps in proptest::collection::vec((any::<bool>(), any::<u64>()), 1..400)) {
            let mut queue = Queue::<100>::new();
            let mut model = VecDeque::new();
            let mut dropped = 0;
            for (pushes, t_us) in steps {
                if pushes {
                    push(&mut queue, t_us);
                    model.push_back(t_us);
                    while model.len() > queue.len() {
                        model.pop_front();
                        dropped += 1;
                    }
                } else {
                    queue.pop();
                    model.pop_front();
                }
                prop_assert_eq!(queue.dropped(), dropped);
                prop_assert_eq!(oldest(&queue), model.front().copied());
            }
            let mut left = Vec::new();
            while let Some(t_us) = oldest(&queue) {
                left.push(t_us);
                queue.pop();
            }
            prop_assert_eq!(left, Vec::from(model));
        }
    }
}
