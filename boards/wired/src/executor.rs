//! The two executors, and the request to the simulated world when neither has anything to do.

use core::cell::Cell;
use core::ptr;

use critical_section::Mutex;
use embassy_executor::{Spawner, raw};
use qemu_link::{Request, WorldAnswer};
use static_cell::StaticCell;

use super::clock::{self, Level, Pause};
use super::pipe::PIPE;
use super::{lines, timers};

/// Whether each executor has something to do: ranging's, and the background's.
static PENDING: [Mutex<Cell<bool>>; 2] = [const { Mutex::new(Cell::new(false)) }; 2];

/// Called by an executor that has something to do. Its context is its index in [`PENDING`].
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

    /// Runs the ready tasks. Returns whether there were any.
    fn step(&self) -> bool {
        let pending = critical_section::with(|token| PENDING[self.place].borrow(token).replace(false));
        if pending {
            // SAFETY: this is never called within a poll: only `run` calls it, and no task calls `run`.
            clock::count(self.level, || unsafe { self.executor.poll() });
        }
        pending
    }
}

/// Both executors.
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

    /// The spawner of ranging's tasks.
    pub fn ranging(&self) -> Spawner {
        self.ranging.executor.spawner()
    }

    /// The spawner of all other tasks.
    pub fn background(&self) -> Spawner {
        self.background.executor.spawner()
    }

    /// Runs the spawned tasks until the simulated world ends. It calls `after` after each step of the lower executor,
    /// as a part of that step.
    pub(super) fn run(&self, mut after: impl FnMut()) {
        loop {
            while self.ranging.step() {}
            if !PIPE.says(WorldAnswer::BACKGROUND_IS_BUSY) && self.background.step() {
                clock::count(Level::Background, &mut after);
                continue;
            }
            let request = Request::Wait {
                until_ns: timers::first_ns().unwrap_or(u64::MAX),
                interrupt: lines::is_awaited(),
                background: self.background.is_pending(),
            };
            let now_ns = PIPE.ask(request, |answer| answer.now_ns);
            if PIPE.says(WorldAnswer::END) {
                return;
            }
            // As an interrupt handler would.
            timers::ring(now_ns);
            if PIPE.says(WorldAnswer::IRQ_IS_HIGH) {
                lines::wake();
            }
        }
    }
}
