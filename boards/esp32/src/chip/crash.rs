//! Panics and exceptions: a crash record is written to memory that a reset does not clear, and the chip is reset.
//!
//! Nothing is logged here, because the log itself may have been interrupted. The next start reports the crash, by log
//! and telemetry. Each stack ends in a watchpoint (esp-hal's for the main thread, esp-rtos's for the others; both are
//! on by default). The exception of a watchpoint is handled here as well.

use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, Ordering};

use firmware_common::crash::{self, Remains};
use wire::telemetry::Crash;

/// The start-up code zeroes it at power-on.
#[unsafe(link_section = ".rtc_fast.persistent")]
static mut REMAINS: MaybeUninit<Remains> = MaybeUninit::uninit();

/// Whether this run of the program has recorded a crash.
static LEFT: AtomicBool = AtomicBool::new(false);

/// Writes a crash for the next start, and resets the chip.
pub fn end(crash: Crash) -> ! {
    leave(crash);
    super::restart()
}

/// Writes a crash for the next start. The watchdog then resets the chip.
pub fn leave(crash: Crash) {
    LEFT.store(true, Ordering::Relaxed);
    let place = &raw mut REMAINS;
    // SAFETY: the callers are the supervisor, the watchdog's interrupt above all tasks, and functions that never
    // return. If one interrupts another, the worst result is a checksum that fails.
    crash::leave(unsafe { &mut *place }, crash);
}

/// Writes a crash if none has been recorded: the first event is the cause.
pub(super) fn leave_if_first(crash: Crash) {
    if !LEFT.load(Ordering::Relaxed) {
        leave(crash);
    }
}

/// Takes the crash of the run before.
pub(super) fn take() -> Option<Crash> {
    let place = &raw mut REMAINS;
    // SAFETY: called at the start, before there are tasks.
    crash::take(unsafe { &mut *place })
}

#[panic_handler]
fn panicked(panic: &PanicInfo<'_>) -> ! {
    // On this architecture this function's return address lies in the core library: line and file are more useful.
    critical_section::with(|_| end(crash::of_panic(panic, 0)))
}

/// On RISC-V an exception is not a panic. It has its own program counter.
#[cfg(target_arch = "riscv32")]
mod exception {
    use esp_hal::trapframe::TrapFrame;
    use wire::telemetry::{Crash, CrashReason};

    use crate::reset_cause::is_overflow;

    /// esp-riscv-rt's trap handler calls this for everything except interrupts.
    #[unsafe(no_mangle)]
    #[allow(non_snake_case, reason = "the name that the trap handler looks for")]
    unsafe extern "C" fn ExceptionHandler(_: &TrapFrame) -> ! {
        let (program_counter, cause, trigger): (u32, u32, u32);
        // SAFETY: reads registers of the processor. The selected trigger changes, which has no effect any more.
        unsafe {
            core::arch::asm!(
                "csrr {program_counter}, mepc",
                "csrr {cause}, mcause",
                // Trigger 0 is the watchpoint at the end of the running thread's stack. This reads its tdata1.
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
