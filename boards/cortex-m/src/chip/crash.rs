//! Panics and faults: a crash record is written to memory that a reset does not clear, and the processor is reset.
//!
//! Nothing is logged here, because the log itself may have been interrupted. The next start reports the crash, by log
//! and telemetry.

use core::mem::MaybeUninit;
use core::panic::PanicInfo;

use firmware_common::crash::{self, Remains};
use wire::telemetry::{Crash, CrashReason};

use crate::fault::{self, Registers};

#[unsafe(link_section = ".uninit.remains")]
static mut REMAINS: MaybeUninit<Remains> = MaybeUninit::uninit();

unsafe extern "C" {
    /// The stack's lowest address, and the address above its highest, from the linker. With flip-link the stack ends
    /// where the RAM begins.
    static _stack_end: u32;
    static _stack_start: u32;
}

/// Writes a crash for the next start, and resets the processor.
pub fn end(crash: Crash) -> ! {
    cortex_m::interrupt::disable();
    leave(crash);
    super::restart()
}

/// Writes a crash for the next start. The watchdog then resets the processor.
pub fn leave(crash: Crash) {
    let place = &raw mut REMAINS;
    // SAFETY: there is one core. Tasks call this from one place only, the supervisor. The other callers never return.
    crash::leave(unsafe { &mut *place }, crash);
}

/// Takes the crash of the run before.
pub fn take() -> Option<Crash> {
    let place = &raw mut REMAINS;
    // SAFETY: called at the start, before there are tasks or interrupts.
    crash::take(unsafe { &mut *place })
}

#[panic_handler]
fn panicked(panic: &PanicInfo<'_>) -> ! {
    let return_address = cortex_m::register::lr::read();
    end(crash::of_panic(panic, return_address))
}

/// The handler of faults. The fault may be in the stack itself, so the handler gets a new one: nothing returns to the
/// old stack.
#[unsafe(naked)]
#[unsafe(no_mangle)]
#[allow(non_snake_case, reason = "the vector table's name")]
unsafe extern "C" fn HardFault() -> ! {
    core::arch::naked_asm!(
        "mrs r0, msp",
        "movw r1, :lower16:{top}",
        "movt r1, :upper16:{top}",
        "msr msp, r1",
        "b {handler}",
        top = sym _stack_start,
        handler = sym faulted,
    )
}

/// `stack_pointer` is where the processor stacked the registers.
unsafe extern "C" fn faulted(stack_pointer: u32) -> ! {
    let stack = (&raw const _stack_end) as u32..(&raw const _stack_start) as u32;
    // SAFETY: the system control block's registers may be read at any time.
    let (status, address) = unsafe {
        let scb = &*cortex_m::peripheral::SCB::PTR;
        (scb.cfsr.read(), scb.bfar.read())
    };
    let at = fault::stacked_program_counter(stack_pointer, &stack);
    // SAFETY: in the stack's memory, aligned.
    let program_counter = at.map_or(0, |at| unsafe { (at as *const u32).read_volatile() });
    let reason = fault::reason(Registers { stack_pointer, status, address }, &stack);
    // At an overflow the stacked values may not have reached memory.
    let program_counter = if reason == CrashReason::StackOverflow { 0 } else { program_counter };
    end(Crash { reason, program_counter, line: 0, file: 0 })
}
