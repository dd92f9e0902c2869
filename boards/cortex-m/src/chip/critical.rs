//! The critical section of images without Bluetooth: all interrupts off. With Bluetooth, its controller brings one that leaves
//! the radio's interrupts on. A board's crate chooses: `critical_section::set_impl!(critical::InterruptsOff)`.

use cortex_m::{interrupt, register::primask};

/// All interrupts off.
pub struct InterruptsOff;

// SAFETY: one core; with interrupts off nothing else runs, and the state before is restored.
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
