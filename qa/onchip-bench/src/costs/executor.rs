//! Measures the waking of a task by embassy's executor: from an interrupt handler's wake call to the first instruction
//! of the task.
#![allow(unsafe_code)]

use core::future::Future;
use core::pin::Pin;
use core::sync::atomic::{AtomicU32, Ordering};
use core::task::{Context, Poll};

use embassy_executor::raw::{Executor, TaskStorage};
use embassy_sync::waitqueue::AtomicWaker;

use super::Mean;
use crate::instrument::{between, stamp};

static WAKER: AtomicWaker = AtomicWaker::new();
static POLLED: AtomicU32 = AtomicU32::new(0);
static TASK: TaskStorage<Waiting> = TaskStorage::new();
const TIMES: u32 = 16;

/// A task that waits for ever, and notes the time of each poll.
struct Waiting;

impl Future for Waiting {
    type Output = ();

    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<()> {
        POLLED.store(stamp(), Ordering::Relaxed);
        WAKER.register(context.waker());
        Poll::Pending
    }
}

/// The function that would pend an executor's interrupt.
#[unsafe(export_name = "__pender")]
fn pend(_: *mut ()) {}

/// Measures the cost.
pub fn measure() -> Mean {
    let cost = Mean::new();
    let executor = Executor::new(core::ptr::null_mut());
    // SAFETY: the executor outlives its task. The task is never polled after this function, and nothing else is called
    // meanwhile.
    let executor: &'static Executor = unsafe { &*core::ptr::from_ref(&executor) };
    if let Ok(token) = TASK.spawn(|| Waiting) {
        executor.spawner().spawn(token);
    }
    // SAFETY: `poll` is not called within itself, and no other code calls it.
    unsafe { executor.poll() };
    for _ in 0..TIMES {
        let begun = stamp();
        WAKER.wake();
        // SAFETY: as above.
        unsafe { executor.poll() };
        cost.add(between(begun, POLLED.load(Ordering::Relaxed)));
    }
    cost
}
