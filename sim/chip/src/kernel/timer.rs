//! Timers that can be cancelled.

use super::executor::Continuation;

/// A timer that was armed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Key {
    slot: u32,
    generation: u32,
}

#[derive(Default)]
pub(super) struct Timers {
    slots: Vec<(u32, Option<Continuation>)>,
    free: Vec<u32>,
}

impl Timers {
    pub(super) fn arm(&mut self, continuation: Continuation) -> Key {
        match self.free.pop() {
            Some(slot) => {
                let (generation, waiting) = &mut self.slots[slot as usize];
                *waiting = Some(continuation);
                Key { slot, generation: *generation }
            }
            None => {
                self.slots.push((0, Some(continuation)));
                Key { slot: self.slots.len() as u32 - 1, generation: 0 }
            }
        }
    }

    pub(super) fn fire(&mut self, key: Key) -> Option<Continuation> {
        let (generation, waiting) = &mut self.slots[key.slot as usize];
        if *generation != key.generation {
            return None;
        }
        *generation = generation.wrapping_add(1);
        self.free.push(key.slot);
        waiting.take()
    }

    /// Changes what continues when the timer fires.
    pub(super) fn retarget(&mut self, key: Key, continuation: Continuation) {
        let (generation, waiting) = &mut self.slots[key.slot as usize];
        if *generation == key.generation {
            *waiting = Some(continuation);
        }
    }

    pub(super) fn disarm(&mut self, key: Key) {
        self.fire(key);
    }
}
