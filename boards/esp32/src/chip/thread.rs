//! The thread of ranging: it has its own executor and its own stack, and its priority is above all other threads.

use alloc::boxed::Box;
use core::ffi::c_void;

use embassy_executor::Spawner;
use esp_radio_rtos_driver::{max_task_priority, task_create};
use esp_rtos::embassy::Executor;

type Start = Box<dyn FnOnce(Spawner) + Send>;

/// The size of its stack, bytes, taken from the heap. The frames along the deepest calls of the tag's exchange and
/// driver add up to 2.3 kB (the image's disassembly). Interrupts of a few levels use the same stack, a few hundred
/// bytes each.
const STACK: usize = 8 << 10;

/// Starts the thread. `start` runs in it and spawns its tasks. From now on it preempts the main thread.
pub fn start(start: impl FnOnce(Spawner) + Send + 'static) {
    let start: Start = Box::new(start);
    let parameter = Box::into_raw(Box::new(start)).cast();
    // SAFETY: the thread takes ownership of the box, once. Its content is `Send`.
    unsafe { task_create("ranging", run, parameter, max_task_priority(), Some(0), STACK) };
}

extern "C" fn run(parameter: *mut c_void) {
    // SAFETY: this is the pointer from `start`, which has given up its ownership.
    let start = unsafe { Box::from_raw(parameter.cast::<Start>()) };
    let executor = Box::leak(Box::new(Executor::new()));
    executor.run(start)
}
