//! The critical section of images without Bluetooth: all interrupts off. With Bluetooth, its controller provides a
//! critical section that leaves the radio's interrupts on. A board's crate chooses:
//! `critical_section::set_impl!(critical::InterruptsOff)`.

use cortex_m::{interrupt, register::primask};

/// A critical section with all interrupts off.
pub struct InterruptsOff;

// SAFETY: there is one core. With interrupts off nothing else runs, and the state before is restored.
unsafe impl critical_section::Impl for InterruptsOff {
    unsafe fn acquire() -> critical_section::RawRestoreState {
        let were_enabled = primask::read().is_active();
        interrupt::disable();
        were_enabled
    }

    unsafe fn release(were_enabled: critical_section::RawRestoreState) {
        if were_enabled {
            // SAFETY: they were enabled when the section was entered.
            unsafe { interrupt::enable() }
        }
    }
}
