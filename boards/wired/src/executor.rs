//! The two executors, and what is done when neither has anything to do.

use core::cell::Cell;
use core::ptr;

use critical_section::Mutex;
use embassy_executor::{Spawner, raw};
use qemu_link::{Answer, Request};
use static_cell::StaticCell;

use super::clock::{self, Level, Pause};
use super::pipe::PIPE;
use super::{lines, timers};

/// Which executor has something to do: ranging's, the background's.
static PENDING: [Mutex<Cell<bool>>; 2] = [const { Mutex::new(Cell::new(false)) }; 2];

/// Called by an executor that has something to do; its context is its place in [`PENDING`].
#[unsafe(export_name = "__pender")]
fn pend(context: *mut ()) {
    let _pause = Pause::begin();
    if let Some(pending) = PENDING.get(context.addr()) {
        critical_section::with(|token| pending.borrow(token).set(true));
    }
}

static RANGING: StaticCell<raw::Executor> = StaticCell::new();
static BACKGROUND: StaticCell<raw::Executor> = StaticCell::new();

/// An executor at one level.
struct Executor {
    executor: &'static raw::Executor,
    level: Level,
    place: usize,
}

impl Executor {
    fn is_pending(&self) -> bool {
        critical_section::with(|token| PENDING[self.place].borrow(token).get())
    }

    /// Runs what is ready; whether there was anything.
    fn step(&self) -> bool {
        let pending = critical_section::with(|token| PENDING[self.place].borrow(token).replace(false));
        if pending {
            // SAFETY: not from within a poll: only `run` calls it, and no task calls that.
            clock::count(self.level, || unsafe { self.executor.poll() });
        }
        pending
    }
}

/// Both.
pub struct Executors {
    ranging: Executor,
    background: Executor,
}

impl Executors {
    pub(super) fn take() -> Self {
        let make = |cell: &'static StaticCell<raw::Executor>, level, place| {
            let executor: &_ = cell.init(raw::Executor::new(ptr::without_provenance_mut(place)));
            Executor { executor, level, place }
        };
        Self { ranging: make(&RANGING, Level::Ranging, 0), background: make(&BACKGROUND, Level::Background, 1) }
    }

    /// Of ranging's tasks.
    pub fn ranging(&self) -> Spawner {
        self.ranging.executor.spawner()
    }

    /// Of all other tasks.
    pub fn background(&self) -> Spawner {
        self.background.executor.spawner()
    }

    /// Runs what was spawned until the world ends; `after` each step of the lower executor, which is part of it, something else.
    pub(super) fn run(&self, mut after: impl FnMut()) {
        loop {
            while self.ranging.step() {}
            if !PIPE.says(Answer::BACKGROUND_IS_BUSY) && self.background.step() {
                clock::count(Level::Background, &mut after);
                continue;
            }
            let request = Request::Wait {
                until_ns: timers::first_ns().unwrap_or(u64::MAX),
                interrupt: lines::is_awaited(),
                background: self.background.is_pending(),
            };
            let now_ns = PIPE.ask(request, |answer| answer.now_ns);
            if PIPE.says(Answer::END) {
                return;
            }
            // As a handler would.
            timers::ring(now_ns);
            if PIPE.says(Answer::IRQ_IS_HIGH) {
                lines::wake();
            }
        }
    }
}
