//! Classifies a fault of a Cortex-M. Input: the fault's registers and the stack's bounds. Output: a [`CrashReason`] and
//! the address of the stacked program counter (ARMv7-M architecture reference manual, B1.5.6 and B3.2.15). The
//! functions are pure: the handler is elsewhere.

use core::ops::Range;

use wire::telemetry::CrashReason;

/// The registers that describe a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Registers {
    /// The main stack pointer in the handler, below the registers that the processor stacked.
    pub stack_pointer: u32,
    /// CFSR.
    pub status: u32,
    /// BFAR: the address of the failed access, if the status marks it as valid.
    pub address: u32,
}

/// CFSR: stacking for an exception failed, at the memory protection unit or on the bus.
const STACKING: u32 = 1 << 4 | 1 << 12;
/// CFSR: BFAR is valid.
const ADDRESS_VALID: u32 = 1 << 15;
/// One instruction stores at most 14 registers, or 32 of the floating-point unit, below the stack pointer.
const REACH: u32 = 4 * 32;
/// The bytes that the processor stacks at least, and the offset of the program counter in them.
const FRAME_BYTES: u32 = 4 * 8;
const PROGRAM_COUNTER: u32 = 4 * 6;

/// Whether the stack overflowed, or something else happened. `stack` is the stack's memory. The word below it is no
/// RAM.
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

/// The address of the stacked program counter, if the stacked registers lie in the stack.
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
        // PRECISERR and BFARVALID, with an address far from the stack.
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
        // `push {r4-r11}` at 0x2000_0010 would have stored at 0x1FFF_FFF0. The frame of the fault just fits.
        assert_eq!(reason(registers(0x2000_0000, 0x8200, 0x1FFF_FFF0), &STACK), CrashReason::StackOverflow);
        // The same address in a register that is not marked as valid has no meaning.
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
