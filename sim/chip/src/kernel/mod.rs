//! Virtual time: an event queue ordered by (time, sequence) and a single-threaded executor for the nodes' async code.
//!
//! Time moves only when nothing is left to do at the present instant. Events of equal time happen in the order in which
//! they were scheduled, so a run depends only on its seed. The user of the kernel defines the events.

mod executor;
mod queue;
mod timer;

pub use executor::TaskId;
pub(crate) use executor::{Continuation, Executor};
pub(crate) use timer::Key;

use crate::time::TrueTime;
use queue::Queue;
use std::cell::{Cell, RefCell};
use std::task::Waker;
use timer::Timers;

/// The next thing that happens.
pub(crate) enum Next<E> {
    /// The wake-up time of a sleeping future.
    Timer(Key),
    /// An event.
    Event(E),
}

/// The clock, the queue of events `E`, and the tasks.
pub(crate) struct Kernel<E> {
    now: Cell<TrueTime>,
    horizon: Cell<TrueTime>,
    /// Whether something runs without which the world cannot continue.
    held: Cell<bool>,
    queue: RefCell<Queue<Next<E>>>,
    timers: RefCell<Timers>,
    pub(crate) executor: Executor,
}

impl<E> Kernel<E> {
    pub(crate) fn new() -> Self {
        Self {
            now: Cell::new(TrueTime::ZERO),
            horizon: Cell::new(TrueTime::ZERO),
            held: Cell::new(false),
            queue: RefCell::new(Queue::new()),
            timers: RefCell::new(Timers::default()),
            executor: Executor::new(),
        }
    }

    pub(crate) fn now(&self) -> TrueTime {
        self.now.get()
    }

    pub(crate) fn schedule(&self, at: TrueTime, event: impl Into<E>) {
        self.push(at, Next::Event(event.into()));
    }

    fn push(&self, at: TrueTime, next: Next<E>) {
        self.queue.borrow_mut().push(at.max(self.now.get()), next);
    }

    /// Wakes `waker` at `at`.
    pub(crate) fn schedule_wake(&self, at: TrueTime, waker: &Waker) -> Key {
        self.schedule_continuation(at, self.executor.continuation(waker))
    }

    /// Continues something at `at`.
    pub(crate) fn schedule_continuation(&self, at: TrueTime, continuation: Continuation) -> Key {
        let key = self.timers.borrow_mut().arm(continuation);
        self.push(at, Next::Timer(key));
        key
    }

    pub(crate) fn fire_timer(&self, key: Key) {
        if let Some(wake) = self.timers.borrow_mut().fire(key) {
            self.executor.wake(wake);
        }
    }

    pub(crate) fn retarget(&self, key: Key, waker: &Waker) {
        self.timers.borrow_mut().retarget(key, self.executor.continuation(waker));
    }

    pub(crate) fn disarm(&self, key: Key) {
        self.timers.borrow_mut().disarm(key);
    }

    /// Moves time to `at` if nothing else happens up to and at that instant. Returns whether it did. A transfer that
    /// nothing can disturb thus ends within its poll, as with a driver that blocks on its bus.
    pub(crate) fn advance_if_quiet(&self, at: TrueTime) -> bool {
        let quiet = at <= self.horizon.get() && self.executor.is_idle() && self.queue.borrow().head() > at;
        if quiet {
            self.now.set(at);
        }
        quiet
    }

    /// The next event up to the horizon. Moves time to it.
    pub(crate) fn next_event(&self) -> Option<Next<E>> {
        let mut queue = self.queue.borrow_mut();
        if queue.head() > self.horizon.get() {
            return None;
        }
        let (at, next) = queue.pop()?;
        self.now.set(at);
        Some(next)
    }

    /// Lets time continue up to `horizon` until the returned value is dropped. Then the former horizon is restored.
    ///
    /// # Panics
    /// Panics if the world waits for the caller: inside a task, or under [`Kernel::hold`].
    pub(crate) fn enter(&self, caller: &str, horizon: TrueTime) -> Horizon<'_> {
        let waits = self.executor.is_polling() || self.held.get();
        assert!(
            !waits,
            "World::{caller} inside a task or an AirClient, for which the world waits: await there instead"
        );
        Horizon { horizon: &self.horizon, before: self.horizon.replace(horizon) }
    }

    /// Refuses [`Kernel::enter`] until the returned value is dropped.
    pub(crate) fn hold(&self) -> Hold<'_> {
        self.held.set(true);
        Hold(&self.held)
    }

    /// Moves time to the horizon, after its last event.
    pub(crate) fn arrive_at_horizon(&self) {
        self.now.set(self.now.get().max(self.horizon.get()));
    }
}

/// Restores the horizon of an outer caller that runs the world.
pub(crate) struct Horizon<'a> {
    horizon: &'a Cell<TrueTime>,
    before: TrueTime,
}

impl Drop for Horizon<'_> {
    fn drop(&mut self) {
        self.horizon.set(self.before);
    }
}

/// See [`Kernel::hold`].
pub(crate) struct Hold<'a>(&'a Cell<bool>);

impl Drop for Hold<'_> {
    fn drop(&mut self) {
        self.0.set(false);
    }
}
