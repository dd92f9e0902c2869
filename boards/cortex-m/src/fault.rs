//! What a fault of a Cortex-M means: the fault's registers and the stack's bounds in, a [`CrashReason`] and the place of the
//! stacked program counter out (ARMv7-M architecture reference manual, B1.5.6 and B3.2.15). Pure: the handler is elsewhere.

use core::ops::Range;

use wire::telemetry::CrashReason;

/// The registers that tell what happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Registers {
    /// Main stack pointer in the handler, below what the processor stacked.
    pub stack_pointer: u32,
    /// CFSR.
    pub status: u32,
    /// BFAR: the address that could not be reached, where the status says that it holds.
    pub address: u32,
}

/// CFSR: stacking for an exception failed, at the memory protection unit or on the bus.
const STACKING: u32 = 1 << 4 | 1 << 12;
/// CFSR: BFAR holds.
const ADDRESS_VALID: u32 = 1 << 15;
/// One instruction stores at most 14 registers, or 32 of the floating-point unit, below the stack pointer.
const REACH: u32 = 4 * 32;
/// Words that the processor stacks at least, and which of them is the program counter.
const FRAME_BYTES: u32 = 4 * 8;
const PROGRAM_COUNTER: u32 = 4 * 6;

/// Whether the stack overflowed, or something else happened. `stack` is the stack's memory; the word below it is no RAM.
pub fn reason(registers: Registers, stack: &Range<u32>) -> CrashReason {
    let beyond = registers.stack_pointer < stack.start;
    let below = stack.start.saturating_sub(REACH)..stack.start;
    let reached_below = registers.status & ADDRESS_VALID != 0 && below.contains(&registers.address);
    if beyond || reached_below || registers.status & STACKING != 0 {
        CrashReason::StackOverflow
    } else {
        CrashReason::Fault
    }
}

/// Where the program counter was stacked, if what was stacked lies in the stack.
pub fn stacked_program_counter(stack_pointer: u32, stack: &Range<u32>) -> Option<u32> {
    let end = stack_pointer.checked_add(FRAME_BYTES)?;
    let whole = stack.start <= stack_pointer && end <= stack.end && stack_pointer.is_multiple_of(4);
    whole.then_some(stack_pointer + PROGRAM_COUNTER)
}

#[cfg(test)]
mod tests {
    use super::*;

    const STACK: Range<u32> = 0x2000_0000..0x2000_C000;

    fn registers(stack_pointer: u32, status: u32, address: u32) -> Registers {
        Registers { stack_pointer, status, address }
    }

    #[test]
    fn a_bad_pointer_is_a_fault() {
        // PRECISERR and BFARVALID, an address nowhere near the stack.
        assert_eq!(reason(registers(0x2000_BF00, 0x8200, 0xFFFF_0000), &STACK), CrashReason::Fault);
        // UNDEFINSTR.
        assert_eq!(reason(registers(0x2000_BF00, 0x0001_0000, 0), &STACK), CrashReason::Fault);
    }

    #[test]
    fn a_pointer_below_the_stack_is_an_overflow() {
        assert_eq!(reason(registers(0x1FFF_FFE0, 0x0400, 0), &STACK), CrashReason::StackOverflow);
    }

    #[test]
    fn a_push_that_went_below_is_an_overflow_though_the_pointer_is_back() {
        // `push {r4-r11}` at 0x2000_0010 would have stored at 0x1FFF_FFF0; the frame of the fault just fits.
        assert_eq!(reason(registers(0x2000_0000, 0x8200, 0x1FFF_FFF0), &STACK), CrashReason::StackOverflow);
        // The same address in a register whose validity bit is not set says nothing.
        assert_eq!(reason(registers(0x2000_0000, 0x0200, 0x1FFF_FFF0), &STACK), CrashReason::Fault);
    }

    #[test]
    fn an_exception_without_room_for_its_frame_is_an_overflow() {
        assert_eq!(reason(registers(0x2000_0004, 0x1000, 0), &STACK), CrashReason::StackOverflow);
        assert_eq!(reason(registers(0x2000_0004, 0x0010, 0), &STACK), CrashReason::StackOverflow);
    }

    #[test]
    fn the_program_counter_is_the_seventh_word_stacked() {
        // r0, r1, r2, r3, r12, lr, pc, xpsr.
        assert_eq!(stacked_program_counter(0x2000_BFE0, &STACK), Some(0x2000_BFF8));
        assert_eq!(stacked_program_counter(0x2000_0000, &STACK), Some(0x2000_0018));
    }

    #[test]
    fn what_is_outside_the_stack_is_not_read() {
        assert_eq!(stacked_program_counter(0x1FFF_FFE0, &STACK), None);
        assert_eq!(stacked_program_counter(0x2000_BFE4, &STACK), None);
        assert_eq!(stacked_program_counter(0xFFFF_FFF0, &STACK), None);
        assert_eq!(stacked_program_counter(0x2000_0002, &STACK), None);
    }
}
