//! Counts the instructions of one call and measures its stack, on the chip.
//!
//! Instructions are counted by QEMU's clock, which with `-icount` advances by the same time for each instruction. The
//! stack is painted: the memory below the stack pointer is filled with a pattern, and the call has used the part that
//! it has overwritten. A word that a call reserves and never writes is not counted.
#![allow(unsafe_code)]

use core::fmt;
use core::hint::black_box;
use core::sync::atomic::{Ordering, compiler_fence};

#[cfg_attr(target_arch = "arm", path = "cortex_m.rs")]
#[cfg_attr(target_arch = "riscv32", path = "riscv.rs")]
mod chip;

pub use chip::{instructions, stamp, steps};
use semihosting::{print, println};

/// The instructions between two stamps.
pub fn between(from: u32, to: u32) -> u32 {
    instructions(steps(from, to))
}

/// The number of words below the stack pointer that are painted. All images have ten times as much stack.
const PAINTED: usize = 1024;
const PAINT: u32 = 0xC5A3_96E1;

/// The cost of one call.
#[derive(Clone, Copy, Debug)]
pub struct Cost {
    /// The instructions, including the call and the return.
    pub instructions: u32,
    /// The bytes of stack below the caller's frame. The arguments and the result are in the caller's frame.
    pub stack: usize,
}

impl Cost {
    /// Prints the line of a call: the words that name it, its cost, and its results.
    pub fn print(self, words: fmt::Arguments<'_>, results: &[f32]) {
        print!("{words} : {} {} :", self.instructions, self.stack);
        results.iter().for_each(|result| print!(" {:08x}", result.to_bits()));
        println!();
    }
}

/// The only counter of the chip.
pub struct Instrument(chip::Counter);

impl Instrument {
    /// Starts the counter.
    pub fn start() -> Self {
        Self(chip::Counter::start())
    }

    /// The cost of `call`, and its result. `call` is called twice.
    pub fn cost<R>(&mut self, call: impl Fn() -> R) -> (Cost, R) {
        let empty = self.count(|| ());
        let instructions = self.count(&call) - empty;
        let (stack, answer) = stack_of(call);
        (Cost { instructions, stack }, answer)
    }

    /// The cost of `call`, measured on two copies of `state`.
    pub fn cost_on<S: Clone>(&mut self, state: &S, call: impl Fn(&mut S)) -> Cost {
        self.cost_twice(|| state.clone(), call)
    }

    /// The cost of `call`, measured on two equal states.
    pub fn cost_twice<S>(&mut self, mut state: impl FnMut() -> S, call: impl Fn(&mut S)) -> Cost {
        let empty = self.count(|| ());
        let mut first = state();
        let instructions = self.count(|| call(black_box(&mut first))) - empty;
        drop(first);
        let mut second = state();
        let (stack, ()) = stack_of(|| call(black_box(&mut second)));
        Cost { instructions, stack }
    }

    /// The count for a stretch of a thousand instructions.
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
    // The writes are volatile, so that the compiler does not replace the loop by a call of a routine with its own
    // frame.
    unsafe { (1..=PAINTED).for_each(|word| top.sub(word).write_volatile(PAINT)) };
    let answer = black_box(call());
    // SAFETY: as above.
    let untouched = (1..=PAINTED).rev().take_while(|&word| unsafe { top.sub(word).read_volatile() } == PAINT).count();
    assert!(untouched > 0, "the call used more stack than was painted");
    ((PAINTED - untouched) * size_of::<u32>(), answer)
}
