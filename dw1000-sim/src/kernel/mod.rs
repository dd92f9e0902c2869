//! Virtual time: an event queue ordered by (time, sequence) and a single-threaded executor for the nodes' async code.
//!
//! Time moves only when nothing is left to do at the present instant. Events of equal time happen in the order in which they
//! were scheduled, so that a run depends on its seed and on nothing else.

mod executor;
mod queue;
mod timer;

pub use executor::TaskId;
pub(crate) use executor::{Continuation, Executor};
pub use timer::Sleep;

use crate::air::AirEvent;
use crate::chip::ChipEvent;
use crate::time::TrueTime;
use crate::world::World;
use queue::Queue;
use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::task::Waker;
use timer::Timers;

/// What happens at an instant.
pub(crate) enum Event {
    /// A sleeping future's time has come.
    Timer(timer::Key),
    /// Something in the chip of a node.
    Chip { node: u32, event: ChipEvent },
    /// A frame reaches a point of its course at a receiver.
    Air(AirEvent),
    /// The scenario does something: an action by its number, so that events stay small.
    Call(u32),
}

type Action = Box<dyn FnOnce(&World)>;

/// The clock, the queue and the tasks.
pub(crate) struct Kernel {
    now: Cell<TrueTime>,
    horizon: Cell<TrueTime>,
    /// Whether something runs that the world cannot go on without.
    held: Cell<bool>,
    queue: RefCell<Queue>,
    timers: RefCell<Timers>,
    /// Actions to come, by number, and the next number.
    actions: RefCell<(BTreeMap<u32, Action>, u32)>,
    pub(crate) executor: Executor,
}

impl Kernel {
    pub(crate) fn new() -> Self {
        Self {
            now: Cell::new(TrueTime::ZERO),
            horizon: Cell::new(TrueTime::ZERO),
            held: Cell::new(false),
            queue: RefCell::new(Queue::new()),
            timers: RefCell::new(Timers::default()),
            actions: RefCell::default(),
            executor: Executor::new(),
        }
    }

    pub(crate) fn now(&self) -> TrueTime {
        self.now.get()
    }

    pub(crate) fn schedule(&self, at: TrueTime, event: Event) {
        self.queue.borrow_mut().push(at.max(self.now.get()), event);
    }

    /// Does `action` at `at`.
    pub(crate) fn schedule_action(&self, at: TrueTime, action: impl FnOnce(&World) + 'static) {
        let mut actions = self.actions.borrow_mut();
        let number = actions.1;
        actions.1 += 1;
        actions.0.insert(number, Box::new(action));
        self.schedule(at, Event::Call(number));
    }

    pub(crate) fn take_action(&self, number: u32) -> Option<Action> {
        self.actions.borrow_mut().0.remove(&number)
    }

    /// Wakes `waker` at `at`.
    pub(crate) fn schedule_wake(&self, at: TrueTime, waker: &Waker) -> timer::Key {
        self.schedule_continuation(at, self.executor.continuation(waker))
    }

    /// Continues something at `at`.
    pub(crate) fn schedule_continuation(&self, at: TrueTime, continuation: Continuation) -> timer::Key {
        let key = self.timers.borrow_mut().arm(continuation);
        self.schedule(at, Event::Timer(key));
        key
    }

    pub(crate) fn fire_timer(&self, key: timer::Key) {
        if let Some(wake) = self.timers.borrow_mut().fire(key) {
            self.executor.wake(wake);
        }
    }

    pub(crate) fn retarget(&self, key: timer::Key, waker: &Waker) {
        self.timers.borrow_mut().retarget(key, self.executor.continuation(waker));
    }

    pub(crate) fn disarm(&self, key: timer::Key) {
        self.timers.borrow_mut().disarm(key);
    }

    /// Moves time to `at` if nothing at all happens up to and at that instant, and tells whether it did. A transfer that
    /// nobody can disturb thus ends within its poll, as with a driver that waits for its bus.
    pub(crate) fn advance_if_quiet(&self, at: TrueTime) -> bool {
        let quiet = at <= self.horizon.get() && self.executor.is_idle() && self.queue.borrow().head() > at;
        if quiet {
            self.now.set(at);
        }
        quiet
    }

    /// The next event up to the horizon; moves time to it.
    pub(crate) fn next_event(&self) -> Option<Event> {
        let mut queue = self.queue.borrow_mut();
        if queue.head() > self.horizon.get() {
            return None;
        }
        let (at, event) = queue.pop()?;
        self.now.set(at);
        Some(event)
    }

    /// Lets time go on up to `horizon` until what is returned is dropped; then the horizon is again what it was.
    ///
    /// # Panics
    /// Where the world waits for the caller: inside a task, or under [`Kernel::hold`].
    pub(crate) fn enter(&self, caller: &str, horizon: TrueTime) -> Horizon<'_> {
        let waits = self.executor.is_polling() || self.held.get();
        assert!(
            !waits,
            "World::{caller} inside a task or an AirClient, for which the world waits: await there instead"
        );
        Horizon { kernel: self, before: self.horizon.replace(horizon) }
    }

    /// Refuses [`Kernel::enter`] until what is returned is dropped.
    pub(crate) fn hold(&self) -> Hold<'_> {
        self.held.set(true);
        Hold(self)
    }

    /// Lets the time of the horizon come, after its last event.
    pub(crate) fn arrive_at_horizon(&self) {
        self.now.set(self.now.get().max(self.horizon.get()));
    }
}

/// Restores the horizon of whoever lets the world run around this.
pub(crate) struct Horizon<'a> {
    kernel: &'a Kernel,
    before: TrueTime,
}

impl Drop for Horizon<'_> {
    fn drop(&mut self) {
        self.kernel.horizon.set(self.before);
    }
}

/// See [`Kernel::hold`].
pub(crate) struct Hold<'a>(&'a Kernel);

impl Drop for Hold<'_> {
    fn drop(&mut self) {
        self.0.held.set(false);
    }
}
