//! The event queue: a heap ordered by time, then by the order of scheduling.

use crate::time::TrueTime;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

pub(super) struct Queue<E> {
    heap: BinaryHeap<Entry<E>>,
    sequence: u64,
}

struct Entry<E> {
    at: TrueTime,
    sequence: u64,
    event: E,
}

impl<E> Queue<E> {
    pub(super) fn new() -> Self {
        Self { heap: BinaryHeap::with_capacity(256), sequence: 0 }
    }

    pub(super) fn push(&mut self, at: TrueTime, event: E) {
        self.heap.push(Entry { at, sequence: self.sequence, event });
        self.sequence += 1;
    }

    pub(super) fn pop(&mut self) -> Option<(TrueTime, E)> {
        self.heap.pop().map(|e| (e.at, e.event))
    }

    /// The time of the next event.
    pub(super) fn head(&self) -> TrueTime {
        self.heap.peek().map_or(TrueTime::NEVER, |e| e.at)
    }
}

impl<E> Ord for Entry<E> {
    /// Reversed: the heap returns its greatest element first.
    fn cmp(&self, other: &Self) -> Ordering {
        (other.at, other.sequence).cmp(&(self.at, self.sequence))
    }
}

impl<E> PartialOrd for Entry<E> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<E> PartialEq for Entry<E> {
    fn eq(&self, other: &Self) -> bool {
        self.sequence == other.sequence
    }
}

impl<E> Eq for Entry<E> {}
