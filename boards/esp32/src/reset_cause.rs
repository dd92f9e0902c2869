//! Why a chip of Espressif was reset, by the number that its ROM returns. The numbers are the same in all of these
//! chips (technical reference manuals, "Reset Source").

use wire::telemetry::ResetCause;

/// The reset cause of a number.
pub fn of(number: u32) -> ResetCause {
    match number {
        // The enable pin cannot be distinguished from power-on.
        0x01 => ResetCause::PowerOn,
        0x03 | 0x0C => ResetCause::Software,
        0x05 => ResetCause::Wake,
        // The watchdogs of both timer groups, of the RTC, and the super watchdog. They reset the system, the core or
        // the processor.
        0x07 | 0x08 | 0x09 | 0x0B | 0x0D | 0x10 | 0x11 | 0x12 => ResetCause::Watchdog,
        0x0F => ResetCause::BrownOut,
        // By the built-in USB: serial lines or JTAG.
        0x15 | 0x16 | 0x18 => ResetCause::Pin,
        // A glitch of clock or power, a broken fuse, SDIO.
        other => ResetCause::Other(other),
    }
}

/// Whether an exception was an overflow of the stack. `cause` is the cause of the exception (MCAUSE). `watchpoint_hit`
/// says whether the watchpoint at the end of the running thread's stack was hit. esp-hal's start-up code uses the
/// number 14 if the stack pointer had left the RAM.
pub fn is_overflow(cause: u32, watchpoint_hit: bool) -> bool {
    const BREAKPOINT: u32 = 3;
    const STACK_POINTER_LOST: u32 = 14;
    cause == STACK_POINTER_LOST || cause == BREAKPOINT && watchpoint_hit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_manuals_numbers_are_told_apart() {
        // The numbers as esp-hal 1.2 names them (`SocResetReason` of the ESP32-C3 and -C6).
        for (number, cause) in [
            (0x01, ResetCause::PowerOn),
            (0x03, ResetCause::Software),
            (0x05, ResetCause::Wake),
            (0x07, ResetCause::Watchdog),
            (0x09, ResetCause::Watchdog),
            (0x0F, ResetCause::BrownOut),
            (0x10, ResetCause::Watchdog),
            (0x12, ResetCause::Watchdog),
            (0x13, ResetCause::Other(0x13)),
            (0x15, ResetCause::Pin),
            (0x17, ResetCause::Other(0x17)),
            (0x18, ResetCause::Pin),
            (0x00, ResetCause::Other(0)),
        ] {
            assert_eq!(of(number), cause, "{number:#x}");
        }
    }

    #[test]
    fn only_the_watchpoints_breakpoint_is_an_overflow() {
        assert!(is_overflow(3, true));
        assert!(!is_overflow(3, false));
        assert!(is_overflow(14, false));
        // An illegal instruction while an earlier hit is still recorded.
        assert!(!is_overflow(2, true));
    }
}
