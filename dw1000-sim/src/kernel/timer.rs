//! Timers that can be given up, and the future that sleeps.

use super::executor::Continuation;
use crate::time::TrueTime;
use crate::world::World;
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};

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

    /// Continues something else when the timer fires.
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

/// Waits until an instant of true time.
pub struct Sleep {
    world: World,
    until: TrueTime,
    armed: Option<Key>,
}

impl Sleep {
    pub(crate) fn new(world: World, until: TrueTime) -> Self {
        Self { world, until, armed: None }
    }
}

impl Future for Sleep {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let this = self.get_mut();
        let kernel = this.world.kernel();
        if kernel.now() >= this.until {
            if let Some(key) = this.armed.take() {
                kernel.disarm(key);
            }
            return Poll::Ready(());
        }
        match this.armed {
            Some(key) => kernel.retarget(key, cx.waker()),
            None => this.armed = Some(kernel.schedule_wake(this.until, cx.waker())),
        }
        Poll::Pending
    }
}

impl Drop for Sleep {
    fn drop(&mut self) {
        if let Some(key) = self.armed.take() {
            self.world.kernel().disarm(key);
        }
    }
}
