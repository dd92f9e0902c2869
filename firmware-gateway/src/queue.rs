//! The queue of a gateway: frames of telemetry in bundles of a datagram each, in the order of their making, until a
//! receipt has come.
//!
//! ```text
//!          full, or 100 ms old      sent                receipt                5 s
//!   Open ─────────▶ Waiting ─────────▶ Sent ────────────────▶ Taken ──────────────▶ gone
//!                      ▲   no receipt for half a second │        │ another run of the station
//!                      └────────────────────────────────┴────────┘
//! ```
//!
//! A full queue drops its oldest bundle: what was taken first, as that is the oldest.

use heapless::Deque;
use wire::datagram::MAX_FRAMES;

use crate::clock::StationClock;

/// Frames wait for others for this time at most, microseconds.
const TOGETHER_US: u64 = 100_000;
/// While nothing can be sent, a bundle has the frames of this time at most: a station takes its last frame's age for that
/// of all.
const LONGEST_US: u64 = 1_000_000;
/// Without a receipt for this time, a bundle is sent again.
const RECEIPT_US: u64 = 500_000;
/// What was taken is kept for this time: a station writes to its store twice a second, and may be killed before.
const RETAINED_US: u64 = 5_000_000;
/// The most bundles. Few frames make a bundle on a quiet node: ten a second.
const MOST_BUNDLES: usize = 96;

/// What has become of a bundle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    /// Frames are added to it.
    Open,
    /// It is to be sent.
    Waiting,
    /// It was sent at this time.
    Sent(u64),
    /// The station has it since this time.
    Taken(u64),
}

/// Frames that go into one datagram.
#[derive(Clone, Copy, Debug)]
pub struct Bundle {
    /// Its number in the session.
    pub number: u32,
    /// How often it was sent.
    pub sendings: u32,
    /// When its last frame came, by the station's clock as it was known when it was sent first: a station that gets a
    /// datagram in two of its runs must find the same time in both.
    pub received_us: u64,
    /// The same by the node's clock.
    last_us: u64,
    begun_us: u64,
    length: u16,
    frames: u16,
    fate: Fate,
}

/// The queue, with room for `BYTES` of frames.
pub struct Queue<const BYTES: usize> {
    bytes: [u8; BYTES],
    /// Where the oldest bundle begins in `bytes`, and how many bytes all have.
    begin: usize,
    length: usize,
    bundles: Deque<Bundle, MOST_BUNDLES>,
    next_number: u32,
    lost: u32,
}

impl<const BYTES: usize> Queue<BYTES> {
    /// An empty queue.
    pub const fn new() -> Self {
        const { assert!(BYTES >= 2 * MAX_FRAMES) };
        Self { bytes: [0; BYTES], begin: 0, length: 0, bundles: Deque::new(), next_number: 0, lost: 0 }
    }

    /// Frames that were dropped before the station had them. It wraps.
    pub fn lost(&self) -> u32 {
        self.lost
    }

    /// When the oldest frame came that was not taken; `None`: all were.
    pub fn untaken_since_us(&self) -> Option<u64> {
        let untaken = |bundle: &&Bundle| !matches!(bundle.fate, Fate::Taken(_));
        self.bundles.iter().find(untaken).map(|bundle| bundle.begun_us)
    }

    /// Adds a frame of at most [`MAX_FRAMES`] bytes; a longer one is dropped and counted.
    pub fn push(&mut self, frame: &[u8], now_us: u64) {
        if frame.len() > MAX_FRAMES {
            self.lost = self.lost.wrapping_add(1);
            return;
        }
        self.tidy(now_us);
        let is_over = |open: &mut Bundle| {
            usize::from(open.length) + frame.len() > MAX_FRAMES || now_us.saturating_sub(open.begun_us) >= LONGEST_US
        };
        if self.open().is_some_and(is_over) {
            self.close();
        }
        while self.length + frame.len() > BYTES || (self.open().is_none() && self.bundles.is_full()) {
            self.drop_oldest();
        }
        if self.open().is_none() {
            let (number, fate) = (self.next_number, Fate::Open);
            self.next_number = number.wrapping_add(1);
            let (received_us, last_us, begun_us) = (0, now_us, now_us);
            let bundle = Bundle { number, sendings: 0, received_us, last_us, begun_us, length: 0, frames: 0, fate };
            // There is room, as made above.
            let _ = self.bundles.push_back(bundle);
        }
        self.write(frame);
        if let Some(open) = self.open() {
            // Both are at most `MAX_FRAMES`.
            open.length += frame.len() as u16;
            open.frames = open.frames.saturating_add(1);
            open.last_us = now_us;
        }
    }

    fn open(&mut self) -> Option<&mut Bundle> {
        self.bundles.back_mut().filter(|last| last.fate == Fate::Open)
    }

    fn close(&mut self) {
        if let Some(open) = self.open() {
            open.fate = Fate::Waiting;
        }
    }

    /// Writes bytes behind all others. There is room for them.
    fn write(&mut self, frame: &[u8]) {
        let at = (self.begin + self.length) % BYTES;
        let (first, rest) = frame.split_at(frame.len().min(BYTES - at));
        self.bytes[at..at + first.len()].copy_from_slice(first);
        self.bytes[..rest.len()].copy_from_slice(rest);
        self.length += frame.len();
    }

    fn drop_oldest(&mut self) {
        let Some(oldest) = self.bundles.pop_front() else { return };
        let length = usize::from(oldest.length);
        if !matches!(oldest.fate, Fate::Taken(_)) {
            self.lost = self.lost.wrapping_add(oldest.frames.into());
        }
        self.begin = (self.begin + length) % BYTES;
        self.length -= length;
    }

    /// Drops what was taken a while ago.
    fn tidy(&mut self, now_us: u64) {
        while let Some(Fate::Taken(at_us)) = self.bundles.front().map(|oldest| oldest.fate)
            && now_us.saturating_sub(at_us) >= RETAINED_US
        {
            self.drop_oldest();
        }
    }

    /// The bytes at a distance from the oldest one, in two pieces.
    fn slices(&self, from: usize, length: usize) -> (&[u8], &[u8]) {
        let at = (self.begin + from) % BYTES;
        let first = length.min(BYTES - at);
        (&self.bytes[at..at + first], &self.bytes[..length - first])
    }

    /// The next bundle that is to be sent: the oldest that was never sent; if there is none, the oldest that got no receipt.
    /// It counts as sent. While `window` bundles wait for their receipts, nothing new is sent. Writes its frames into `into`.
    pub fn next<'i>(
        &mut self,
        now_us: u64,
        window: usize,
        clock: &StationClock,
        into: &'i mut [u8; MAX_FRAMES],
    ) -> Option<(Bundle, &'i [u8])> {
        self.tidy(now_us);
        if self.open().is_some_and(|open| now_us.saturating_sub(open.begun_us) >= TOGETHER_US) {
            self.close();
        }
        let mut from = 0;
        let (mut new, mut unanswered, mut in_flight) = (None, None, 0);
        for (index, bundle) in self.bundles.iter().enumerate() {
            match bundle.fate {
                Fate::Waiting if bundle.sendings == 0 => new = new.or(Some((index, from))),
                Fate::Waiting => unanswered = unanswered.or(Some((index, from))),
                Fate::Sent(at_us) if now_us.saturating_sub(at_us) >= RECEIPT_US => {
                    unanswered = unanswered.or(Some((index, from)));
                }
                Fate::Sent(_) => in_flight += 1,
                Fate::Open | Fate::Taken(_) => {}
            }
            from += usize::from(bundle.length);
        }
        let (index, from) = new.or(unanswered).filter(|_| in_flight < window)?;
        let length = usize::from(self.bundles.get(index)?.length);
        let (first, rest) = self.slices(from, length);
        into[..first.len()].copy_from_slice(first);
        into[first.len()..length].copy_from_slice(rest);
        let bundle = self.bundles.get_mut(index)?;
        bundle.fate = Fate::Sent(now_us);
        if bundle.sendings == 0 {
            bundle.received_us = clock.utc_us(bundle.last_us);
        }
        bundle.sendings = bundle.sendings.saturating_add(1);
        Some((*bundle, &into[..length]))
    }

    /// A receipt has come. Returns when the bundle was sent, if it was sent once.
    pub fn taken(&mut self, number: u32, now_us: u64) -> Option<u64> {
        let bundle = self.bundles.iter_mut().find(|bundle| bundle.number == number)?;
        let Fate::Sent(at_us) = bundle.fate else { return None };
        bundle.fate = Fate::Taken(now_us);
        (bundle.sendings == 1).then_some(at_us)
    }

    /// The station runs anew: what it has taken lately may be lost, and what is on its way is refused.
    pub fn recall(&mut self) {
        for bundle in self.bundles.iter_mut().filter(|bundle| bundle.fate != Fate::Open) {
            bundle.fate = Fate::Waiting;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    const MS: u64 = 1000;

    fn sent<const N: usize>(queue: &mut Queue<N>, now_us: u64) -> Option<(u32, Vec<u8>, u32)> {
        let mut into = [0; MAX_FRAMES];
        queue
            .next(now_us, 4, &StationClock::of(0, 0, 0), &mut into)
            .map(|(bundle, frames)| (bundle.number, frames.to_vec(), bundle.sendings))
    }

    #[test]
    fn frames_wait_for_others_for_a_tenth_of_a_second() {
        let mut queue = Queue::<4096>::new();
        assert_eq!(sent(&mut queue, 0), None);
        queue.push(b"a\0", 0);
        queue.push(b"bc\0", 99 * MS);
        assert_eq!(sent(&mut queue, 99 * MS), None);
        assert_eq!(sent(&mut queue, 100 * MS), Some((0, b"a\0bc\0".to_vec(), 1)));
        assert_eq!(sent(&mut queue, 300 * MS), None, "it was sent");
        queue.push(b"d\0", 300 * MS);
        assert_eq!(sent(&mut queue, 400 * MS), Some((1, b"d\0".to_vec(), 1)));
    }

    #[test]
    fn without_a_receipt_a_bundle_is_sent_again_after_new_ones() {
        let mut queue = Queue::<4096>::new();
        queue.push(b"a\0", 0);
        assert_eq!(sent(&mut queue, 100 * MS), Some((0, b"a\0".to_vec(), 1)));
        queue.push(b"b\0", 510 * MS);
        assert_eq!(sent(&mut queue, 610 * MS), Some((1, b"b\0".to_vec(), 1)));
        assert_eq!(sent(&mut queue, 611 * MS), Some((0, b"a\0".to_vec(), 2)));
        assert_eq!(queue.taken(1, 650 * MS), Some(610 * MS));
        assert_eq!(queue.taken(0, 650 * MS), None, "nobody knows which of the two was taken");
        assert_eq!((queue.taken(0, 660 * MS), queue.taken(7, 660 * MS)), (None, None));
        assert_eq!(sent(&mut queue, 2_000 * MS), None);
    }

    #[test]
    fn only_some_bundles_are_on_their_way_at_a_time() {
        let mut queue = Queue::<8192>::new();
        for _ in 0..7 {
            queue.push(&[1; MAX_FRAMES], 0);
        }
        let numbers: Vec<_> = core::iter::from_fn(|| sent(&mut queue, 100 * MS)).map(|(number, ..)| number).collect();
        assert_eq!(numbers, [0, 1, 2, 3]);
        queue.taken(2, 110 * MS);
        assert_eq!(sent(&mut queue, 110 * MS).map(|(number, ..)| number), Some(4));
        assert_eq!(sent(&mut queue, 110 * MS), None);
    }

    #[test]
    fn another_run_of_the_station_gets_again_what_was_taken_in_the_last_five_seconds() {
        let mut queue = Queue::<4096>::new();
        for (frame, at_ms) in [(b"a\0", 0), (b"b\0", 4000)] {
            queue.push(frame, at_ms * MS);
            let (number, ..) = sent(&mut queue, (at_ms + 100) * MS).expect("one");
            queue.taken(number, (at_ms + 110) * MS);
        }
        assert_eq!(sent(&mut queue, 5200 * MS), None, "the first one is gone");
        queue.recall();
        assert_eq!(sent(&mut queue, 5200 * MS), Some((1, b"b\0".to_vec(), 2)));
        assert_eq!(sent(&mut queue, 5200 * MS), None);
        assert_eq!(queue.lost(), 0);
    }

    #[test]
    fn a_full_queue_drops_the_oldest_and_counts_what_nobody_has() {
        let mut queue = Queue::<4096>::new();
        // Frames of 100 bytes, eleven in a bundle; the first bundle is taken.
        let frame = |number: u8| {
            let mut frame = [number; 100];
            frame[99] = 0;
            frame
        };
        for number in 1..=12 {
            queue.push(&frame(number), 0);
        }
        let (first, frames, _) = sent(&mut queue, 0).expect("the full one");
        assert_eq!((first, frames.len()), (0, 1100));
        queue.taken(first, 0);
        for number in 13..=100 {
            queue.push(&frame(number), 0);
        }
        let mut got = Vec::new();
        while let Some((number, frames, _)) = sent(&mut queue, 100 * MS) {
            got.extend(frames.chunks(100).map(|frame| frame[0]));
            assert!(frames.iter().filter(|byte| **byte == 0).count() * 100 == frames.len());
            queue.taken(number, 100 * MS);
        }
        assert_eq!(got, (100 - got.len() as u8 + 1..=100).collect::<Vec<_>>(), "the newest, without a gap");
        // At most eleven more than the bytes for forty would leave.
        assert!(got.len() >= 29, "{}", got.len());
        assert_eq!(usize::from(100_u8 - 11) - got.len(), queue.lost() as usize);
        queue.push(&[1; MAX_FRAMES + 1], 200 * MS);
        assert_eq!((sent(&mut queue, 400 * MS), queue.lost() as usize), (None, 89 - got.len() + 1));
    }

    #[test]
    fn many_small_bundles_leave_room_for_new_ones() {
        let mut queue = Queue::<4096>::new();
        for tenth in 0..200 {
            queue.push(b"a\0", tenth * 100 * MS);
            let mut into = [0; MAX_FRAMES];
            // No receipt ever comes.
            queue.next((tenth + 1) * 100 * MS, usize::MAX, &StationClock::of(0, 0, 0), &mut into);
        }
        assert_eq!(queue.lost() as usize, 200 - MOST_BUNDLES);
    }
}
