//! RISC-V: the counter of retired instructions. In QEMU it is the virtual time in ns: `-icount shift=0`, one
//! instruction in a nanosecond.

use riscv::register::minstret;

pub struct Counter {
    start: usize,
}

impl Counter {
    pub fn start() -> Self {
        Self { start: 0 }
    }

    #[inline(always)]
    pub fn reset(&mut self) {
        self.start = minstret::read();
    }

    #[inline(always)]
    pub fn instructions(&mut self) -> u32 {
        minstret::read().wrapping_sub(self.start) as u32
    }
}

/// The present value of the counter.
#[inline(always)]
pub fn stamp() -> u32 {
    minstret::read() as u32
}

/// The counter's steps between two stamps.
#[inline(always)]
pub fn steps(from: u32, to: u32) -> u32 {
    to.wrapping_sub(from)
}

/// The instructions in `steps` steps.
pub fn instructions(steps: u32) -> u32 {
    steps
}

#[inline(always)]
pub fn stack_pointer() -> usize {
    let pointer;
    // SAFETY: reads a register.
    unsafe { core::arch::asm!("mv {}, sp", out(reg) pointer, options(nomem, nostack, preserves_flags)) };
    pointer
}
