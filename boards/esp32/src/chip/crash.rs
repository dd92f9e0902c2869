//! Panics and exceptions: what happened is left in memory that a reset does not clear, and the chip is reset.
//!
//! Nothing is logged here, because the log itself may have been interrupted: the next start tells, by log and telemetry. Stacks
//! end in a watchpoint (esp-hal's for the main thread, esp-rtos's for the others; both are on by default), whose exception comes
//! here as well.

use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, Ordering};

use firmware_common::crash::{self, Remains};
use wire::telemetry::Crash;

/// Zeroed when power comes, by the start-up code.
#[unsafe(link_section = ".rtc_fast.persistent")]
static mut REMAINS: MaybeUninit<Remains> = MaybeUninit::uninit();

/// In this life a crash has been left.
static LEFT: AtomicBool = AtomicBool::new(false);

/// Leaves a crash for the next start, and resets the chip.
pub fn end(crash: Crash) -> ! {
    leave(crash);
    super::restart()
}

/// Leaves a crash for the next start; the watchdog does the rest.
pub fn leave(crash: Crash) {
    LEFT.store(true, Ordering::Relaxed);
    let place = &raw mut REMAINS;
    // SAFETY: called by the supervisor, by the watchdog's interrupt above all tasks, and by those who never return; the worst of
    // an interruption is a checksum that fails.
    crash::leave(unsafe { &mut *place }, crash);
}

/// Leaves a crash where nobody has left one: what came first is the cause.
pub(super) fn leave_if_first(crash: Crash) {
    if !LEFT.load(Ordering::Relaxed) {
        leave(crash);
    }
}

/// Takes what the life before left.
pub(super) fn take() -> Option<Crash> {
    let place = &raw mut REMAINS;
    // SAFETY: called at the start, before there are tasks.
    crash::take(unsafe { &mut *place })
}

#[panic_handler]
fn panicked(panic: &PanicInfo<'_>) -> ! {
    // The address that this function returns to lies in the core library on this architecture: line and file say more.
    critical_section::with(|_| end(crash::of_panic(panic, 0)))
}

/// On RISC-V an exception is no panic: it leaves its own program counter.
#[cfg(target_arch = "riscv32")]
mod exception {
    use esp_hal::trapframe::TrapFrame;
    use wire::telemetry::{Crash, CrashReason};

    use crate::reset_cause::is_overflow;

    /// Where esp-riscv-rt's trap handler goes with all but interrupts.
    #[unsafe(no_mangle)]
    #[allow(non_snake_case, reason = "the name that the trap handler looks for")]
    unsafe extern "C" fn ExceptionHandler(_: &TrapFrame) -> ! {
        let (program_counter, cause, trigger): (u32, u32, u32);
        // SAFETY: reads registers of the processor; the trigger that is selected matters to nobody any more.
        unsafe {
            core::arch::asm!(
                "csrr {program_counter}, mepc",
                "csrr {cause}, mcause",
                // Trigger 0 is the watchpoint at the end of the running thread's stack: its tdata1.
                "csrw 0x7a0, zero",
                "csrr {trigger}, 0x7a1",
                program_counter = out(reg) program_counter,
                cause = out(reg) cause,
                trigger = out(reg) trigger,
            );
        }
        /// MCAUSE: the number of an exception.
        const NUMBER: u32 = 0x1F;
        /// TDATA1 of a watchpoint: it was hit.
        const HIT: u32 = 1 << 20;
        let reason = if is_overflow(cause & NUMBER, trigger & HIT != 0) {
            CrashReason::StackOverflow
        } else {
            CrashReason::Fault
        };
        super::end(Crash { reason, program_counter, line: 0, file: 0 })
    }
}
