//! Instructions and stack of one call, on the chip.
//!
//! Instructions are counted by QEMU's clock, which with `-icount` advances by the same time for each instruction. Stack is
//! painted: the memory below the stack pointer is filled with a pattern, and what the call has overwritten is what it used;
//! a word that a call reserves and never writes is not seen.
#![allow(unsafe_code)]

use core::hint::black_box;
use core::sync::atomic::{Ordering, compiler_fence};

#[cfg_attr(target_arch = "arm", path = "cortex_m.rs")]
#[cfg_attr(target_arch = "riscv32", path = "riscv.rs")]
mod chip;

pub use chip::{instructions, stamp, steps};

/// Instructions from one stamp to another.
pub fn between(from: u32, to: u32) -> u32 {
    instructions(steps(from, to))
}

/// The memory below the stack pointer that is painted, in words. All images have ten times as much.
const PAINTED: usize = 1024;
const PAINT: u32 = 0xC5A3_96E1;

/// What one call costs.
#[derive(Clone, Copy, Debug)]
pub struct Cost {
    /// Instructions, the call and the return included.
    pub instructions: u32,
    /// Bytes of stack below the caller's frame. Arguments and the answer are in the caller's frame.
    pub stack: usize,
}

/// The one counter of the chip.
pub struct Instrument(chip::Counter);

impl Instrument {
    /// Starts the counter.
    pub fn start() -> Self {
        Self(chip::Counter::start())
    }

    /// What `call` costs, and its answer. It is called twice.
    pub fn cost<R>(&mut self, call: impl Fn() -> R) -> (Cost, R) {
        let empty = self.count(|| ());
        let instructions = self.count(&call) - empty;
        let (stack, answer) = stack_of(call);
        (Cost { instructions, stack }, answer)
    }

    /// What `call` costs, made on two copies of `state`.
    pub fn cost_on<S: Clone>(&mut self, state: &S, call: impl Fn(&mut S)) -> Cost {
        let empty = self.count(|| ());
        let mut copy = state.clone();
        let instructions = self.count(|| call(black_box(&mut copy))) - empty;
        let mut copy = state.clone();
        let (stack, ()) = stack_of(|| call(black_box(&mut copy)));
        Cost { instructions, stack }
    }

    /// What a stretch of a thousand instructions is counted as.
    pub fn calibration(&mut self) -> u32 {
        let empty = self.count(|| ());
        // SAFETY: does nothing.
        let stretch = || unsafe { core::arch::asm!(".rept 1000", "nop", ".endr", options(nomem, nostack)) };
        self.count(stretch) - empty
    }

    #[inline(never)]
    fn count<R>(&mut self, call: impl FnOnce() -> R) -> u32 {
        self.0.reset();
        compiler_fence(Ordering::SeqCst);
        black_box(call());
        compiler_fence(Ordering::SeqCst);
        self.0.instructions()
    }
}

#[inline(never)]
fn stack_of<R>(call: impl FnOnce() -> R) -> (usize, R) {
    let top = chip::stack_pointer() as *mut u32;
    // SAFETY: nothing below the stack pointer is in use, no interrupt is enabled, and the stack has PAINTED words left.
    // Volatile, so that no call to a routine with a frame of its own takes the loop's place.
    unsafe { (1..=PAINTED).for_each(|word| top.sub(word).write_volatile(PAINT)) };
    let answer = black_box(call());
    // SAFETY: as above.
    let untouched = (1..=PAINTED).rev().take_while(|&word| unsafe { top.sub(word).read_volatile() } == PAINT).count();
    assert!(untouched > 0, "the call used more stack than was painted");
    ((PAINTED - untouched) * size_of::<u32>(), answer)
}
