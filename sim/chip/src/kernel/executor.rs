//! The tasks, and the queue of tasks to be polled.
//!
//! A future that waits for virtual time or a pin is woken without its waker. Wakers also work, for channels and
//! combinators that bring their own.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::future::Future;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Wake, Waker};

/// A spawned task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TaskId {
    slot: u32,
    generation: u32,
}

/// How to continue a waiting future.
#[derive(Clone)]
pub(crate) enum Continuation {
    Task(TaskId),
    Waker(Waker),
}

/// The tasks that other wakers than ours have woken.
#[derive(Default)]
struct Inbox {
    filled: AtomicBool,
    tasks: Mutex<Vec<TaskId>>,
}

struct TaskWaker {
    task: TaskId,
    inbox: Arc<Inbox>,
}

impl Wake for TaskWaker {
    fn wake(self: Arc<Self>) {
        self.wake_by_ref();
    }

    fn wake_by_ref(self: &Arc<Self>) {
        // A poisoned lock means that a panic is already propagating.
        if let Ok(mut tasks) = self.inbox.tasks.lock() {
            tasks.push(self.task);
            self.inbox.filled.store(true, Ordering::Relaxed);
        }
    }
}

struct Slot {
    generation: u32,
    /// Empty while the task is polled, and when it is done.
    future: Option<Pin<Box<dyn Future<Output = ()>>>>,
    waker: Waker,
    queued: bool,
}

pub(crate) struct Executor {
    slots: RefCell<Vec<Slot>>,
    free: RefCell<Vec<u32>>,
    ready: RefCell<VecDeque<TaskId>>,
    inbox: Arc<Inbox>,
    current: Cell<Option<TaskId>>,
    /// The waker of the task being polled.
    current_waker: RefCell<Waker>,
}

impl Executor {
    pub(super) fn new() -> Self {
        Self {
            slots: RefCell::default(),
            free: RefCell::default(),
            ready: RefCell::default(),
            inbox: Arc::default(),
            current: Cell::new(None),
            current_waker: RefCell::new(Waker::noop().clone()),
        }
    }

    pub(crate) fn spawn(&self, future: impl Future<Output = ()> + 'static) -> TaskId {
        let mut slots = self.slots.borrow_mut();
        let slot = self.free.borrow_mut().pop().unwrap_or(slots.len() as u32);
        let generation = slots.get(slot as usize).map_or(0, |s| s.generation + 1);
        let task = TaskId { slot, generation };
        let waker = Waker::from(Arc::new(TaskWaker { task, inbox: self.inbox.clone() }));
        let entry = Slot { generation, future: Some(Box::pin(future)), waker, queued: true };
        match slots.get_mut(slot as usize) {
            Some(old) => *old = entry,
            None => slots.push(entry),
        }
        self.ready.borrow_mut().push_back(task);
        task
    }

    /// Drops a task in its present state.
    pub(crate) fn abort(&self, task: TaskId) {
        let mut slots = self.slots.borrow_mut();
        let Some(slot) = slots.get_mut(task.slot as usize).filter(|s| s.generation == task.generation) else { return };
        // A task that aborts itself is not here now: `poll` finds the new generation and drops it.
        slot.generation += 1;
        let future = slot.future.take();
        if self.current.get() != Some(task) {
            self.free.borrow_mut().push(task.slot);
        }
        drop(slots);
        // Destructors may call the executor.
        drop(future);
    }

    /// Whether a task is being polled.
    pub(super) fn is_polling(&self) -> bool {
        self.current.get().is_some()
    }

    pub(crate) fn is_idle(&self) -> bool {
        self.ready.borrow().is_empty() && !self.inbox.filled.load(Ordering::Relaxed)
    }

    /// Polls the ready tasks in order, until none is ready.
    pub(crate) fn run_ready(&self) {
        loop {
            if self.inbox.filled.load(Ordering::Relaxed) {
                self.inbox.filled.store(false, Ordering::Relaxed);
                let woken = self.inbox.tasks.lock().map(|mut t| std::mem::take(&mut *t)).unwrap_or_default();
                woken.into_iter().for_each(|t| self.make_ready(t));
            }
            let next = self.ready.borrow_mut().pop_front();
            match next {
                Some(task) => self.poll(task),
                None if self.is_idle() => return,
                None => {}
            }
        }
    }

    /// The cheap way to continue the task of `waker`, if that is the task being polled.
    pub(crate) fn continuation(&self, waker: &Waker) -> Continuation {
        match self.current.get() {
            Some(task) if self.current_waker.borrow().will_wake(waker) => Continuation::Task(task),
            _ => Continuation::Waker(waker.clone()),
        }
    }

    pub(super) fn wake(&self, continuation: Continuation) {
        match continuation {
            Continuation::Task(task) => self.make_ready(task),
            Continuation::Waker(waker) => waker.wake(),
        }
    }

    fn make_ready(&self, task: TaskId) {
        let mut slots = self.slots.borrow_mut();
        if let Some(slot) = slots.get_mut(task.slot as usize)
            && slot.generation == task.generation
            && !slot.queued
        {
            slot.queued = true;
            self.ready.borrow_mut().push_back(task);
        }
    }

    fn poll(&self, task: TaskId) {
        let (mut future, waker) = {
            let mut slots = self.slots.borrow_mut();
            let Some(slot) = slots.get_mut(task.slot as usize).filter(|s| s.generation == task.generation) else {
                return;
            };
            slot.queued = false;
            let Some(future) = slot.future.take() else { return };
            (future, std::mem::replace(&mut slot.waker, Waker::noop().clone()))
        };
        self.current.set(Some(task));
        self.current_waker.replace(waker);
        // While it is borrowed, wakers are only compared, below in `continuation`.
        let poll = {
            let waker = self.current_waker.borrow();
            future.as_mut().poll(&mut Context::from_waker(&waker))
        };
        self.current.set(None);
        let waker = self.current_waker.replace(Waker::noop().clone());
        let mut slots = self.slots.borrow_mut();
        let slot = &mut slots[task.slot as usize];
        let alive = slot.generation == task.generation;
        match poll {
            Poll::Pending if alive => {
                slot.future = Some(future);
                slot.waker = waker;
            }
            Poll::Pending | Poll::Ready(()) => {
                if alive {
                    slot.generation += 1;
                }
                self.free.borrow_mut().push(task.slot);
                drop(slots);
                // Destructors may call the executor.
                drop(future);
            }
        }
    }
}
