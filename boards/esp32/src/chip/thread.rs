//! The thread of ranging: an executor of its own, on a stack of its own, above all other threads.

use alloc::boxed::Box;
use core::ffi::c_void;

use embassy_executor::Spawner;
use esp_radio_rtos_driver::{max_task_priority, task_create};
use esp_rtos::embassy::Executor;

type Start = Box<dyn FnOnce(Spawner) + Send>;

/// Bytes of its stack, taken from the heap. Frames along the deepest calls of the tag's exchange and driver add up to 2.3 kB
/// (the image's disassembly), and interrupts of a few levels, a few hundred each, use the stack that they find.
const STACK: usize = 8 << 10;

/// Starts the thread; `start` runs in it and spawns its tasks. It preempts the main thread from now on.
pub fn start(start: impl FnOnce(Spawner) + Send + 'static) {
    let start: Start = Box::new(start);
    let parameter = Box::into_raw(Box::new(start)).cast();
    // SAFETY: the thread takes the box over, once; what is in it may be sent to another thread.
    unsafe { task_create("ranging", run, parameter, max_task_priority(), Some(0), STACK) };
}

extern "C" fn run(parameter: *mut c_void) {
    // SAFETY: the pointer of `start`, whom it no longer belongs to.
    let start = unsafe { Box::from_raw(parameter.cast::<Start>()) };
    let executor = Box::leak(Box::new(Executor::new()));
    executor.run(start)
}
